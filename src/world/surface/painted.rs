//! What is painted on the ground.

use crate::world::site::Footprint;

/// A marked patch of ground.
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

/// A rectangle painted on the ground.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Decal {
    pub(crate) area: Footprint,
    pub(crate) kind: DecalKind,
}
