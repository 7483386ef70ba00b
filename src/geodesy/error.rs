//! Why a place on a map cannot be told.

/// A reference system or a georeference that cannot be used.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum Error {
    /// A text names no reference system.
    #[error(
        "'{text}' names no reference system: write an EPSG code (EPSG:32632), a PROJ string (+proj=utm +zone=32 \
         +datum=WGS84) or a zone (WGS84 UTM 32N)"
    )]
    Unnamed {
        /// The text.
        text: String,
    },
    /// A code of no known horizontal system.
    #[error(
        "EPSG:{code} is none of the horizontal systems that are known: vertical and compound systems are not taken, \
         because no height is converted; name the horizontal part alone, or write it as a PROJ string"
    )]
    UnknownCode {
        /// The code.
        code: u32,
    },
    /// A compound system of a horizontal and a vertical one.
    #[error(
        "'{text}' also names a system of heights, and no height is converted: name the horizontal part alone ({part})"
    )]
    Compound {
        /// The text.
        text: String,
        /// Its first part.
        part: String,
    },
    /// A system that needs what is not there: grids, geoids, other units or axes.
    #[error("{system}: {problem}")]
    Unfit {
        /// The system as it was named.
        system: String,
        /// What is amiss, and the remedy.
        problem: String,
    },
    /// Lengths on the map differ from those on the ground.
    #[error(
        "{system}: a metre on the ground is {stretch:.4} m on the map at {place}; choose a system that is made for the \
         place, such as {instead}"
    )]
    Stretched {
        /// The system.
        system: String,
        /// Metres on the map per metre on the ground.
        stretch: f64,
        /// The place.
        place: String,
        /// A system that fits.
        instead: String,
    },
    /// A place outside the area of a system.
    #[error(
        "{system}: {place} has no coordinates there; choose a system that is made for the place, such as {instead}"
    )]
    Outside {
        /// The system.
        system: String,
        /// The place.
        place: String,
        /// A system that fits.
        instead: String,
    },
    /// A latitude beyond the UTM zones.
    #[error("no UTM zone lies at {place}: name a reference system")]
    NoZone {
        /// The place.
        place: String,
    },
    /// Coordinates that are nowhere on Earth.
    #[error("the dataset's coordinates lie nowhere on Earth: {0}")]
    Nowhere(String),
    /// A dataset without coordinates of its own.
    #[error("nothing says where the dataset lies: photographs with GPS or ground control points are needed")]
    Unplaced,
}
