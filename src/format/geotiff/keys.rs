//! The reference system of a GeoTIFF: OGC 19-008r4.

/// A reference system of metres east and north.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum System {
    /// A projected system by its EPSG code.
    Code(u32),
    /// A projected system by its text in WKT 1, which stands in a file beside the picture.
    Wkt(String),
    /// A local system, whose place on Earth is not known.
    Local,
}

/// What the file says of its reference system.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct GeoKeys {
    /// The system.
    pub system: System,
    /// Its name.
    pub citation: String,
}

const MODEL_TYPE: u16 = 1024;
const RASTER_TYPE: u16 = 1025;
const CITATION: u16 = 1026;
const PROJECTED: u16 = 3072;
const UNITS: u16 = 3076;
const METRE: u16 = 9001;
const USER_DEFINED: u16 = 32_767;
const AREA: u16 = 1;
/// The field of the texts.
const TEXTS: u16 = 34_737;

impl GeoKeys {
    /// The fields GeoKeyDirectory and GeoAsciiParams.
    pub(super) fn encoded(&self) -> (Vec<u16>, String) {
        // Texts end at a bar.
        let plain = |c: char| if c.is_ascii() && c != '|' { c } else { '?' };
        let mut text: String = self.citation.chars().take(4000).map(plain).collect();
        text.push('|');
        let mut keys: Vec<[u16; 4]> = Vec::new();
        let model = if self.system == System::Local { USER_DEFINED } else { 1 };
        keys.push([MODEL_TYPE, 0, 1, model]);
        keys.push([RASTER_TYPE, 0, 1, AREA]);
        keys.push([CITATION, TEXTS, text.len() as u16, 0]);
        match &self.system {
            System::Code(code) => match u16::try_from(*code) {
                Ok(code) => keys.push([PROJECTED, 0, 1, code]),
                Err(_) => keys.push([PROJECTED, 0, 1, USER_DEFINED]),
            },
            System::Wkt(_) => keys.push([PROJECTED, 0, 1, USER_DEFINED]),
            System::Local => {}
        }
        keys.push([UNITS, 0, 1, METRE]);
        let head = [1, 1, 1, keys.len() as u16];
        (head.into_iter().chain(keys.into_iter().flatten()).collect(), text)
    }
}
