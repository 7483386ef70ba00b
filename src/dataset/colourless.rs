//! Points without colours of their own.

use std::fmt;
use std::path::PathBuf;

use super::Point;

/// Most names of properties in the message.
const NAMED: usize = 8;

/// A cloud of points without usable colours.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Colourless {
    /// The file with the points.
    pub file: PathBuf,
    /// Why the colours cannot be used.
    pub why: NoColours,
}

/// Why the colours of points cannot be used.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum NoColours {
    /// All points have this colour.
    OneColour([u8; 3]),
    /// The file holds positions only.
    Absent,
    /// The file has these properties, and none is a colour in a known form.
    Unknown(Vec<String>),
}

impl NoColours {
    /// For a cloud whose file has these properties besides positions and normals.
    pub fn with_properties(unknown: &[String]) -> Self {
        if unknown.is_empty() { Self::Absent } else { Self::Unknown(unknown.to_vec()) }
    }

    /// Why these colours cannot be used; `None` where they can.
    pub fn of_colours(colours: impl IntoIterator<Item = [u8; 3]>) -> Option<Self> {
        let mut colours = colours.into_iter();
        let first = colours.next()?;
        // A single point says nothing about the colours of others.
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
