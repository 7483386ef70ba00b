//! Quality and cost of a model: metrics, colour maps, the report.

pub mod colormap;
mod colour_fit;
mod exposure;
pub mod geometry;
mod gmsd;
mod metrics;
mod report;
mod seen;
mod ssim;
mod texture;
mod training_photographs;

pub use crate::numbers::{mean, mean_if_all};
pub use colour_fit::{psnr_cc, psnr_cc_where};
pub use exposure::{Exposures, Follows};
pub use geometry::{Geometry, GeometryError, GeometryTruth};
pub use gmsd::gmsd;
pub use metrics::{
    ExposureScores, ImageScore, Metrics, MetricsError, PhotographWait, Quality, Streaming, mean_seen, peak_host_bytes,
};
pub(crate) use report::painted_depth;
pub use report::{
    Curve, CurveForm, DepthMap, Interactive, REPORT_BYTES, ReportData, ReportError, StagePanel, ViewPanel, is_report,
    render_report, write_report,
};
pub use seen::{Counting, SeenPixels};
pub use ssim::{psnr, psnr_where, ssim, ssim_where};
pub use texture::psnr_high_frequency;
pub use training_photographs::{TrainingPhotograph, TrainingScores, median_loss, misfits, worst_first};
