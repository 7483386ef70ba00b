//! Values of the options of `export`.

use std::str::FromStr;

use psrgs_vk::format::splats::Format;
use psrgs_vk::format::splats::spz::Version;

/// Formats of the command.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub(crate) enum Kind {
    /// PLY in the layout of INRIA's 3DGS
    Ply,
    /// SuperSplat's compressed PLY
    CompressedPly,
    /// SPZ
    Spz,
    /// SOG
    Sog,
    /// .splat
    Splat,
    /// glTF with KHR_gaussian_splatting
    Glb,
    /// HTML file with a viewer, which a browser opens without a network
    Html,
    /// Every format but HTML, into a folder
    All,
}

impl Kind {
    /// What `all` writes.
    pub(crate) const FORMATS: [Format; 6] =
        [Format::Ply, Format::CompressedPly, Format::Spz(Version::Four), Format::Sog, Format::Splat, Format::Glb];

    /// The format; nothing for all, and for the HTML file.
    pub(crate) fn format(self) -> Option<Format> {
        Some(match self {
            Self::Ply => Format::Ply,
            Self::CompressedPly => Format::CompressedPly,
            Self::Spz => Format::Spz(Version::default()),
            Self::Sog => Format::Sog,
            Self::Splat => Format::Splat,
            Self::Glb => Format::Glb,
            Self::Html | Self::All => return None,
        })
    }
}

/// An axis of the model that points up.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub(crate) enum Up {
    X,
    Y,
    Z,
    #[value(name = "-x")]
    MinusX,
    #[value(name = "-y")]
    MinusY,
    #[value(name = "-z")]
    MinusZ,
    Auto,
}

impl Up {
    /// The axis; nothing where cameras decide.
    pub(crate) fn direction(self) -> Option<[f64; 3]> {
        Some(match self {
            Self::X => [1.0, 0.0, 0.0],
            Self::Y => [0.0, 1.0, 0.0],
            Self::Z => [0.0, 0.0, 1.0],
            Self::MinusX => [-1.0, 0.0, 0.0],
            Self::MinusY => [0.0, -1.0, 0.0],
            Self::MinusZ => [0.0, 0.0, -1.0],
            Self::Auto => return None,
        })
    }
}

/// A box.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Crop {
    /// Least coordinates.
    pub(crate) low: [f64; 3],
    /// Largest coordinates.
    pub(crate) high: [f64; 3],
}

impl FromStr for Crop {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let wanted = || "six numbers are needed: x0,y0,z0,x1,y1,z1".to_owned();
        let numbers: Vec<f64> =
            text.split(',').map(|word| word.trim().parse().map_err(|_| wanted())).collect::<Result<_, _>>()?;
        let &[a, b, c, x, y, z] = numbers.as_slice() else { return Err(wanted()) };
        let (low, high) = ([a, b, c], [x, y, z]);
        // A comparison with NaN is false too.
        if !(0..3).all(|k| low[k] <= high[k]) {
            return Err("the first three numbers must not be larger than the last three".to_owned());
        }
        Ok(Self { low, high })
    }
}

/// An opacity from 0 to 1.
pub(crate) fn opacity(text: &str) -> Result<f64, String> {
    let value = text.parse().ok().filter(|v| (0.0..=1.0).contains(v));
    value.ok_or_else(|| "a number from 0 to 1 is needed".to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_box_has_six_numbers_in_order() {
        assert_eq!("-1, 2,3,4,5e5,6".parse(), Ok(Crop { low: [-1.0, 2.0, 3.0], high: [4.0, 5e5, 6.0] }));
        for wrong in ["", "1,2,3", "1,2,3,4,5,x", "1,2,3,0,5,6", "1,2,3,4,5,6,7", "nan,0,0,1,1,1"] {
            assert!(wrong.parse::<Crop>().is_err(), "{wrong}");
        }
        assert_eq!((opacity("0.5"), opacity("1.5").is_err(), opacity("nan").is_err()), (Ok(0.5), true, true));
    }
}
