//! Quality and cost of a model: metrics, colour maps, the report.

pub mod colormap;
pub mod geometry;
mod metrics;
mod quality;
mod report;
mod ssim;

pub use geometry::{Geometry, GeometryError, GeometryTruth};
pub use metrics::{ImageScore, Metrics, MetricsError, mean, peak_host_bytes};
pub use quality::Quality;
pub use report::{Curve, DepthMap, ReportData, ReportError, ViewPanel, render_report, write_report};
pub use ssim::{psnr, psnr_where, ssim, ssim_where};
