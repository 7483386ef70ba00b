//! Directories of a TIFF file, classic or big.

use super::levels::Level;
use super::{Kind, NO_DATA, Picture, TILE};

/// The values of a field.
enum Values {
    Text(String),
    Short(Vec<u16>),
    /// Unsigned numbers of 32 bits, or of 64 bits in big files.
    Offset(Vec<u64>),
    Double(Vec<f64>),
}

/// The fields of a picture, by ascending tag.
pub(super) struct Directory {
    fields: Vec<(u16, Values)>,
}

/// Appends an offset.
pub(super) fn number(bytes: &mut Vec<u8>, value: u64, big: bool) {
    if big { bytes.extend(value.to_le_bytes()) } else { bytes.extend((value as u32).to_le_bytes()) }
}

impl Values {
    /// Type and number of the values, and their bytes.
    fn encoded(&self, big: bool) -> (u16, u64, Vec<u8>) {
        match self {
            Self::Text(text) => {
                let bytes: Vec<u8> = text.bytes().chain([0]).collect();
                (2, bytes.len() as u64, bytes)
            }
            Self::Short(values) => (3, values.len() as u64, values.iter().flat_map(|v| v.to_le_bytes()).collect()),
            Self::Offset(values) => {
                let mut bytes = Vec::new();
                values.iter().for_each(|value| number(&mut bytes, *value, big));
                (if big { 16 } else { 4 }, values.len() as u64, bytes)
            }
            Self::Double(values) => (12, values.len() as u64, values.iter().flat_map(|v| v.to_le_bytes()).collect()),
        }
    }
}

impl Directory {
    /// Of a level whose tiles lie at `offsets`. Overviews lack what is the same for all levels.
    pub(super) fn of_level(picture: &Picture, level: &Level, offsets: &[u64], overview: bool) -> Self {
        let kind = picture.kind;
        let bands = kind.samples() as u16;
        let (photometric, format, bits, predictor) = match kind {
            Kind::Rgba8 => (2, 1, 8, 2),
            Kind::Gray8 => (1, 1, 8, 2),
            Kind::Float(_) => (1, 3, 32, 3),
        };
        let short = |value: u16| Values::Short(vec![value]);
        let long = |value: u32| Values::Offset(vec![u64::from(value)]);
        let mut fields = vec![
            (254, Values::Short(vec![u16::from(overview)])),
            (256, long(level.width)),
            (257, long(level.height)),
            (258, Values::Short(vec![bits; kind.samples()])),
            (259, short(8)),
            (262, short(photometric)),
            (277, short(bands)),
            (284, short(1)),
            (317, short(predictor)),
            (322, short(TILE as u16)),
            (323, short(TILE as u16)),
            (324, Values::Offset(offsets.to_vec())),
            (325, Values::Offset(level.places.iter().map(|place| u64::from(place.bytes)).collect())),
        ];
        match kind {
            // Alpha that colours are not multiplied by.
            Kind::Rgba8 => fields.push((338, short(2))),
            Kind::Gray8 | Kind::Float(1) => {}
            Kind::Float(_) => fields.push((338, Values::Short(vec![0; kind.samples() - 1]))),
        }
        fields.push((339, Values::Short(vec![format; kind.samples()])));
        if !overview {
            let ([west, north], gsd) = (picture.corner, picture.gsd);
            fields.push((33_550, Values::Double(vec![gsd, gsd, 0.0])));
            fields.push((33_922, Values::Double(vec![0.0, 0.0, 0.0, west, north, 0.0])));
            let (directory, text) = picture.keys.encoded();
            fields.push((34_735, Values::Short(directory)));
            fields.push((34_737, Values::Text(text)));
            if !picture.descriptions.is_empty() {
                fields.push((42_112, Values::Text(descriptions(&picture.descriptions))));
            }
        }
        match kind {
            Kind::Rgba8 => {}
            Kind::Gray8 => fields.push((42_113, Values::Text("0".to_owned()))),
            Kind::Float(_) => fields.push((42_113, Values::Text(format!("{NO_DATA}")))),
        }
        Self { fields }
    }

    /// Appends the directory, then the values that have no room in it.
    pub(super) fn append(&self, bytes: &mut Vec<u8>, big: bool, last: bool) {
        let (word, row) = if big { (8, 20) } else { (4, 12) };
        let begin = bytes.len();
        let head = if big { 8 } else { 2 };
        let mut room = begin + head + row * self.fields.len() + word;
        let mut beyond: Vec<u8> = Vec::new();
        if big {
            bytes.extend((self.fields.len() as u64).to_le_bytes());
        } else {
            bytes.extend((self.fields.len() as u16).to_le_bytes());
        }
        room = room.next_multiple_of(8);
        for (tag, values) in &self.fields {
            let (kind, count, encoded) = values.encoded(big);
            bytes.extend(tag.to_le_bytes());
            bytes.extend(kind.to_le_bytes());
            number(bytes, count, big);
            if encoded.len() <= word {
                bytes.extend(&encoded);
                bytes.resize(bytes.len() + word - encoded.len(), 0);
            } else {
                number(bytes, (room + beyond.len()) as u64, big);
                beyond.extend(&encoded);
                beyond.resize(beyond.len().next_multiple_of(8), 0);
            }
        }
        let next = if last { 0 } else { room + beyond.len() };
        number(bytes, next as u64, big);
        bytes.resize(room, 0);
        bytes.extend(beyond);
    }
}

/// Text within XML.
pub(super) fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

/// What each band is, as GDAL reads it.
fn descriptions(bands: &[String]) -> String {
    let item = |(k, text): (usize, &String)| {
        format!("  <Item name=\"DESCRIPTION\" sample=\"{k}\" role=\"description\">{}</Item>\n", escaped(text))
    };
    let items: String = bands.iter().enumerate().map(item).collect();
    format!("<GDALMetadata>\n{items}</GDALMetadata>\n")
}
