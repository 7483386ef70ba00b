//! Points without colours of their own.

use std::fmt;
use std::path::PathBuf;

use super::Point;

/// Names of properties are told up to this many.
const NAMED: usize = 8;

/// A cloud of points whose colours say nothing.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Colourless {
    /// The file with the points.
    pub file: PathBuf,
    /// Why they say nothing.
    pub why: NoColours,
}

/// Why the colours of points say nothing.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum NoColours {
    /// All points have this one.
    OneColour([u8; 3]),
    /// The file holds nothing but places.
    Absent,
    /// The file has these properties, and none of them are colours in a form that is known.
    Unknown(Vec<String>),
}

impl NoColours {
    /// Of a cloud whose file has these properties besides places and normals.
    pub fn with_properties(unknown: &[String]) -> Self {
        if unknown.is_empty() { Self::Absent } else { Self::Unknown(unknown.to_vec()) }
    }

    /// The warning about these colours, if any.
    pub fn of_colours(colours: impl IntoIterator<Item = [u8; 3]>) -> Option<Self> {
        let mut colours = colours.into_iter();
        let first = colours.next()?;
        // One point alone says nothing of the others.
        let mut others = colours.peekable();
        (others.peek().is_some() && others.all(|colour| colour == first)).then_some(Self::OneColour(first))
    }

    pub(super) fn of_points(points: &[Point]) -> Option<Self> {
        Self::of_colours(points.iter().map(|p| p.colour))
    }
}

impl fmt::Display for NoColours {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::OneColour([0, 0, 0]) => write!(f, "all points are black"),
            Self::OneColour([r, g, b]) => write!(f, "all points have the colour {r} {g} {b}"),
            Self::Absent => write!(f, "the file holds no colours"),
            Self::Unknown(names) => {
                let more = if names.len() > NAMED { ", ..." } else { "" };
                let named = names[..names.len().min(NAMED)].join(", ");
                write!(f, "no colours that can be read are among the properties of its points: {named}{more}")
            }
        }
    }
}

impl fmt::Display for Colourless {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { file, why } = self;
        write!(
            f,
            "{}: {why}. Training takes the colours of the points from the photographs that see them",
            file.display()
        )
    }
}
