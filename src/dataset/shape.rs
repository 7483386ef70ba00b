//! Shapes of pictures.

/// Whether one size is that of a copy of the other: sides of reduced copies are rounded up or down.
pub(super) fn same_shape(copy: (u32, u32), of: (u32, u32)) -> bool {
    let (w, h) = (f64::from(copy.0), f64::from(copy.1));
    let ratio = f64::from(of.1) / f64::from(of.0);
    (h - w * ratio).abs() <= 1.0 + ratio
}
