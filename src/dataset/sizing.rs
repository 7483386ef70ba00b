//! The size at which photographs are used, by this program's rules and those of other trainers.

use std::path::Path;

use super::error::Error;
use super::lens::Lens;
use super::model::Shot;
use crate::scene::Camera;

/// The size that photographs are reduced to. Photographs are never enlarged.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Sizing {
    /// Most pixels of the longer side, relative to the size of the file.
    MaxSide(u32),
    /// The calibration's sides divided by a factor, as in `images_N` folders.
    Downscale(f64),
    /// Width and height of all photographs.
    Exact(u32, u32),
}

/// How a side that is no whole number of pixels is rounded.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Rounding {
    /// To the nearest whole number, halves up.
    #[default]
    Nearest,
    /// Down, as integer division does.
    Down,
    /// Up.
    Up,
}

impl Rounding {
    fn side(self, exact: f64) -> u32 {
        // A quotient that is whole up to its last bits counts as whole.
        let near = (exact + 0.5).floor();
        let rounded = match self {
            _ if (exact - near).abs() < 1e-9 * near.abs() => near,
            Self::Nearest => near,
            Self::Down => exact.floor(),
            Self::Up => exact.ceil(),
        };
        rounded.max(1.0) as u32
    }
}

impl Sizing {
    /// Width and height for a photograph with a size on disk and a size of its calibration.
    pub(super) fn apply(self, on_disk: (u32, u32), calibrated: (u32, u32), rounding: Rounding) -> (u32, u32) {
        let longest = on_disk.0.max(on_disk.1);
        let scaled = |(w, h): (u32, u32), multiply: f64, divide: f64| {
            let side = |v: u32| rounding.side(f64::from(v) * multiply / divide);
            (side(w), side(h))
        };
        match self {
            Self::MaxSide(side) if side < longest => scaled(on_disk, f64::from(side), f64::from(longest)),
            Self::MaxSide(_) => on_disk,
            Self::Downscale(factor) => scaled(calibrated, 1.0, factor),
            Self::Exact(width, height) => (width, height),
        }
    }

    /// The longest wanted side for photographs whose calibration has this longest side.
    pub(super) fn longest(self, calibrated: u32) -> u32 {
        match self {
            Self::MaxSide(side) => side.min(calibrated),
            Self::Downscale(factor) => (f64::from(calibrated) / factor).floor().max(1.0) as u32,
            Self::Exact(width, height) => width.max(height),
        }
    }
}

/// The camera for training with a photograph, and its lens if the photograph has to be undistorted.
pub(super) fn camera(
    file: &Path,
    shot: &Shot,
    on_disk: (u32, u32),
    sizing: Sizing,
    rounding: Rounding,
) -> Result<(Option<Lens>, Camera), Error> {
    let (calibrated, straight) = (shot.lens, shot.lens.distortion.is_none());
    let lens = calibrated.resized(on_disk.0, on_disk.1);
    let ([fx, fy], [cx, cy], [width, height]) = (calibrated.focal, calibrated.center, calibrated.size);
    let (rotation, translation) = (shot.rotation, shot.translation);
    let plain = Camera { rotation, translation, fx, fy, cx, cy, width, height };
    // The image at the photograph's full size, and the size of the calibration.
    let (full, of) =
        if straight { (plain.resized(on_disk.0, on_disk.1), plain) } else { (lens.pinhole(), calibrated.pinhole()) };
    let at_most = (full.width, full.height);
    let (width, height) = sizing.apply(at_most, (of.width, of.height), rounding);
    check_size(file, &of, sizing, at_most, (width, height))?;
    // Resized from the calibration directly: a second rounding would change the last bits.
    let camera = if straight { plain.resized(width, height) } else { full.resized(width, height) };
    Ok(((!straight).then_some(lens), Camera { rotation, translation, ..camera }))
}

/// Refuses sizes that no image can have.
pub(super) fn check(sizing: Sizing) -> Result<(), Error> {
    match sizing {
        Sizing::MaxSide(0) => Err(Error::ZeroMaxSide),
        Sizing::Downscale(factor) if !(factor >= 1.0 && factor.is_finite()) => Err(Error::BadSize),
        Sizing::Exact(0, _) | Sizing::Exact(_, 0) => Err(Error::BadSize),
        _ => Ok(()),
    }
}

/// Refuses a size that the photograph cannot be reduced to without stretching.
fn check_size(
    file: &Path,
    camera: &Camera,
    sizing: Sizing,
    on_disk: (u32, u32),
    wanted: (u32, u32),
) -> Result<(), Error> {
    let shape = (camera.width, camera.height);
    let shaped = !matches!(sizing, Sizing::Exact(..)) || same_shape(wanted, shape);
    if shaped && wanted.0 <= on_disk.0 && wanted.1 <= on_disk.1 {
        return Ok(());
    }
    Err(Error::SizeDoesNotFit { file: file.to_owned(), photograph: on_disk, wanted })
}

/// Whether a size is that of a reduced copy: its sides are rounded up or down.
pub(super) fn same_shape(copy: (u32, u32), of: (u32, u32)) -> bool {
    let (w, h) = (f64::from(copy.0), f64::from(copy.1));
    let ratio = f64::from(of.1) / f64::from(of.0);
    (h - w * ratio).abs() <= 1.0 + ratio
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sides_are_rounded_as_asked() {
        let size = |sizing: Sizing, rounding| sizing.apply((1079, 1919), (1079, 1919), rounding);
        for (rounding, want) in
            [(Rounding::Nearest, (360, 640)), (Rounding::Down, (359, 639)), (Rounding::Up, (360, 640))]
        {
            assert_eq!(size(Sizing::Downscale(3.0), rounding), want, "{rounding:?}");
        }
        assert_eq!(size(Sizing::MaxSide(640), Rounding::Nearest), (360, 640));
        assert_eq!(size(Sizing::MaxSide(640), Rounding::Down), (359, 640));
        assert_eq!(size(Sizing::MaxSide(5000), Rounding::Down), (1079, 1919));
        assert_eq!(size(Sizing::Exact(7, 9), Rounding::Down), (7, 9));
        // For a reduced copy, the factor still counts from the calibration.
        assert_eq!(Sizing::Downscale(4.0).apply((250, 100), (1000, 400), Rounding::Down), (250, 100));
        assert_eq!(Sizing::Downscale(1e9).apply((250, 100), (1000, 400), Rounding::Down), (1, 1));
    }

    /// Integer arithmetic gives the same sizes.
    #[test]
    fn the_longer_side_is_met_and_the_other_is_nearest() {
        for longest in [2_u64, 3, 7, 639, 1600, 4000] {
            for other in 1..=longest {
                for side in [1_u64, 2, 16, 333, 640, 1599] {
                    let got =
                        Sizing::MaxSide(side as u32).apply((other as u32, longest as u32), (1, 1), Rounding::Nearest);
                    let want =
                        if side < longest { ((other * side * 2 + longest) / (2 * longest)).max(1) } else { other };
                    assert_eq!(got, (want as u32, side.min(longest) as u32), "{other}x{longest} to {side}");
                }
            }
        }
    }
}
