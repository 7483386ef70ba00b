//! Marked patches of ground.

use crate::world::site::Footprint;

/// The kind of a marked patch of ground.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum DecalKind {
    /// Tennis court.
    Court,
    /// Parking lot.
    Parking,
    /// Evenly sown grass.
    Meadow,
    /// An elliptic pond.
    Pond,
    /// A paved place with lettering and a resolution star.
    Plaza,
}

/// A marked patch of ground.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Decal {
    pub(crate) area: Footprint,
    pub(crate) kind: DecalKind,
}
