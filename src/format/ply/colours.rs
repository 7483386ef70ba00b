//! Finds the colours of a cloud's points: their properties and their range.

use super::header::{Element, Kind};
use crate::scene::init::SH_C0;

/// Prefixes and suffixes of a channel's name, the preferred ones first.
const BEFORE: [&str; 9] = ["", "diffuse_", "vertex_", "color_", "colour_", "col_", "rgb_", "scalar_", "ambient_"];
const AFTER: [&str; 6] = ["", "_float", "_f", "_u8", "_color", "_colour"];
/// Names of the channels.
const CHANNELS: [[&str; 3]; 2] = [["red", "green", "blue"], ["r", "g", "b"]];
/// Constant coefficients of splats.
const HARMONICS: [&str; 3] = ["f_dc_0", "f_dc_1", "f_dc_2"];
/// Names of colours packed into the bits of one number, as PCL writes them.
const PACKED: [&str; 4] = ["rgb", "rgba", "color", "colour"];
/// Largest values of the usual ranges, with the share of values that may exceed them. A larger share indicates the next
/// range.
const UNIT: (f64, f64) = (1.0, 0.01);
const BYTES: (f64, f64) = (255.0, 0.25);
const WORDS: (f64, f64) = (65535.0, 0.01);
/// Rounded or resampled values may exceed the largest of a range by this share of it.
const SLACK: f64 = 1e-3;

/// The properties that hold a vertex's colour.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Place {
    /// Positions of three properties, one per channel.
    Channels([usize; 3]),
    /// Positions of three spherical harmonics coefficients.
    Harmonics([usize; 3]),
    /// Position of a single packed property.
    Packed(usize),
}

impl Place {
    /// The properties of an element that hold colours.
    pub(super) fn find(element: &Element) -> Option<Self> {
        let names: Vec<String> = element.properties.iter().map(|p| p.name.to_lowercase().replace('-', "_")).collect();
        let all = |wanted: [String; 3]| -> Option<[usize; 3]> {
            let [r, g, b] = wanted.map(|name| names.iter().position(|n| *n == name));
            Some([r?, g?, b?])
        };
        for before in BEFORE {
            for after in AFTER {
                for channels in CHANNELS {
                    if let Some(found) = all(channels.map(|channel| format!("{before}{channel}{after}"))) {
                        return Some(Self::Channels(found));
                    }
                }
            }
        }
        if let Some(found) = all(HARMONICS.map(str::to_owned)) {
            return Some(Self::Harmonics(found));
        }
        let packed = |name: &&str| names.iter().position(|n| n == name).filter(|p| holds_bits(element, *p));
        PACKED.iter().find_map(packed).map(Self::Packed)
    }

    /// Positions of the properties in the element.
    pub(super) fn properties(&self) -> Vec<usize> {
        match self {
            Self::Channels(places) | Self::Harmonics(places) => places.to_vec(),
            Self::Packed(place) => vec![*place],
        }
    }

    /// The colours of all vertices from the values of [`Self::properties`], vertex by vertex; `None` where the values
    /// are in no known range.
    pub(super) fn colours(&self, element: &Element, values: &[f64]) -> Option<Vec<[u8; 3]>> {
        match self {
            Self::Channels(places) => {
                let kinds = places.map(|p| element.properties[p].kind);
                in_range(values, kinds)
            }
            Self::Harmonics(_) => {
                let colour = |v: &f64| to_byte(255.0 * (0.5 + SH_C0 * v));
                values.iter().all(|v| v.is_finite()).then(|| triples(values.iter().map(colour)))
            }
            Self::Packed(place) => {
                let kind = element.properties[*place].kind;
                Some(values.iter().map(|v| unpacked(*v, kind)).collect())
            }
        }
    }
}

/// Eight-bit colours from three numbers each, and the largest number of their range; `None` where the range is unclear.
pub(crate) fn of_numbers(values: &[f64]) -> Option<(Vec<[u8; 3]>, f64)> {
    let whole = values.iter().all(|v| v.fract() == 0.0);
    let kinds = [if whole { Kind::I32 } else { Kind::F64 }; 3];
    Some((in_range(values, kinds)?, largest(values, kinds)?))
}

fn holds_bits(element: &Element, place: usize) -> bool {
    matches!(element.properties[place].kind, Kind::F32 | Kind::F64 | Kind::I32 | Kind::U32)
}

fn in_range(values: &[f64], kinds: [Kind; 3]) -> Option<Vec<[u8; 3]>> {
    let signed = kinds.contains(&Kind::I8);
    // Bytes above 127 stored in a signed type.
    let value = |v: &f64| if signed && *v < 0.0 { v + 256.0 } else { *v };
    let largest = largest(values, kinds)?;
    Some(triples(values.iter().map(|v| to_byte(value(v) * 255.0 / largest))))
}

/// The number that stands for full intensity.
fn largest(values: &[f64], kinds: [Kind; 3]) -> Option<f64> {
    if kinds.iter().all(|kind| matches!(kind, Kind::U8 | Kind::I8)) && values.iter().all(|v| v.fract() == 0.0) {
        return Some(255.0);
    }
    let floats = kinds.iter().any(|kind| matches!(kind, Kind::F32 | Kind::F64));
    // A text file may hold other numbers than its header declares.
    let floats = floats || values.iter().any(|v| v.fract() != 0.0);
    let outside = |most: f64| {
        let inside = |v: &&f64| v.is_finite() && (-SLACK * most..=(1.0 + SLACK) * most).contains(*v);
        values.len() - values.iter().filter(inside).count()
    };
    let ranges: &[(f64, f64)] = if floats { &[UNIT, BYTES, WORDS] } else { &[BYTES, WORDS] };
    // Negative values are in no range.
    let negative = values.iter().filter(|v| **v < -SLACK * UNIT.0).count() as f64;
    let fits = |(most, beyond): &&(f64, f64)| outside(*most) as f64 <= beyond * values.len() as f64;
    ranges.iter().find(fits).filter(|_| negative <= UNIT.1 * values.len() as f64).map(|(most, _)| *most)
}

fn triples(bytes: impl Iterator<Item = u8>) -> Vec<[u8; 3]> {
    let bytes: Vec<u8> = bytes.collect();
    bytes.chunks_exact(3).map(|c| [c[0], c[1], c[2]]).collect()
}

/// NaN becomes black.
fn to_byte(value: f64) -> u8 {
    value.round().clamp(0.0, 255.0) as u8
}

/// Red, green and blue from the highest of 24 bits on. A float holds them in its bit pattern, unless its value is an
/// integer of 24 bits.
fn unpacked(value: f64, kind: Kind) -> [u8; 3] {
    let whole = value.fract() == 0.0 && (1.0..16_777_216.0).contains(&value);
    let bits = match kind {
        Kind::F32 if !whole => (value as f32).to_bits(),
        _ => (value as i64) as u32,
    };
    let [_, red, green, blue] = bits.to_be_bytes();
    [red, green, blue]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ranges_of_colours_are_told_by_their_type_and_their_values() {
        use Kind::*;
        let of = |kind: Kind, values: [f64; 6]| in_range(&values, [kind; 3]);
        let want = Some(vec![[0, 51, 255], [128, 0, 26]]);
        assert_eq!(of(U8, [0.0, 51.0, 255.0, 128.0, 0.0, 26.0]), want);
        assert_eq!(of(F32, [0.0, 0.2, 1.0, 0.5, 0.0, 0.1]), want);
        assert_eq!(of(F64, [0.0, 51.0, 255.0, 128.0, 0.0, 26.0]), want);
        assert_eq!(of(U16, [0.0, 13107.0, 65535.0, 32768.0, 0.0, 6682.0]), want);
        assert_eq!(of(I32, [0.0, 51.0, 255.0, 128.0, 0.0, 26.0]), want);
        assert_eq!(of(I8, [0.0, 51.0, -1.0, -128.0, 0.0, 26.0]), want);
        // The upper byte of a word differs from the nearest byte.
        assert_eq!(of(U16, [33_023.0, 2770.0, 65535.0, 0.0, 0.0, 0.0]), Some(vec![[128, 11, 255], [0; 3]]));
        // A text file whose header declares bytes.
        assert_eq!(of(U8, [0.0, 0.2, 1.0, 0.5, 0.0, 0.1]), want);
        // A byte of 1 is nearly black, whatever the other values are.
        assert_eq!(of(U8, [0.0, 1.0, 1.0, 0.0, 1.0, 0.0]), Some(vec![[0, 1, 1], [0, 1, 0]]));
        assert_eq!(of(F32, [-3.0, 0.2, 1.0, 0.5, 0.0, 0.1]), None);
        assert_eq!(of(F64, [1e6, 1e6, 1e6, 0.5, 0.0, 0.1]), None);
        assert_eq!(of(F32, [f64::NAN; 6]), None);
    }

    #[test]
    fn packed_colours_are_in_the_bits_of_a_number() {
        let bits = 0x0012_34ff_u32;
        for (value, kind) in [
            (f64::from(bits), Kind::U32),
            (f64::from(0xff12_34ff_u32 as i32), Kind::I32),
            (f64::from(f32::from_bits(bits)), Kind::F32),
            (f64::from(bits), Kind::F32),
        ] {
            assert_eq!(unpacked(value, kind), [0x12, 0x34, 0xff], "{kind:?}");
        }
    }
}
