//! A colour given on the command line.

use std::fmt;
use std::str::FromStr;

/// Red, green and blue from 0 to 1, and the word that the user gave.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Colour {
    pub(crate) rgb: [f32; 3],
    word: String,
}

impl FromStr for Colour {
    type Err = String;
    fn from_str(word: &str) -> Result<Self, String> {
        let hex = |digits: &str| -> Option<[f32; 3]> {
            // Digits only: `from_str_radix` would accept a sign.
            let sound = digits.len() == 6 && digits.bytes().all(|digit| digit.is_ascii_hexdigit());
            let bits = u32::from_str_radix(digits, 16).ok().filter(|_| sound)?;
            Some([16, 8, 0].map(|shift| (bits >> shift & 255) as f32 / 255.0))
        };
        let numbers = || -> Option<[f32; 3]> {
            let values: Option<Vec<f32>> = word.split(',').map(|part| part.trim().parse().ok()).collect();
            values?.try_into().ok().filter(|rgb: &[f32; 3]| rgb.iter().all(|v| (0.0..=1.0).contains(v)))
        };
        let rgb = match word {
            "black" => Some([0.0; 3]),
            "white" => Some([1.0; 3]),
            _ => word.strip_prefix('#').and_then(hex).or_else(numbers),
        };
        rgb.map(|rgb| Self { rgb, word: word.to_owned() }).ok_or_else(|| {
            format!("no colour `{word}`: it is black, white, #rrggbb, or R,G,B with numbers from 0 to 1")
        })
    }
}

impl fmt::Display for Colour {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.word)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colours_are_read_in_every_spelling() {
        for (word, want) in [
            ("black", [0.0; 3]),
            ("white", [1.0; 3]),
            ("#ff0080", [1.0, 0.0, 128.0 / 255.0]),
            ("0.5,0, 1", [0.5, 0.0, 1.0]),
        ] {
            let colour: Colour = word.parse().unwrap();
            assert_eq!((colour.rgb, colour.to_string().as_str()), (want, word));
        }
        for word in ["", "grey", "#ff00", "#ff00gg", "#+f0080", "1,2,3", "0,0", "0,0,0,0", "NaN,0,0", "-1,0,0"] {
            assert!(word.parse::<Colour>().is_err(), "{word}");
        }
    }
}
