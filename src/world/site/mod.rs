//! The site: roads, buildings, plants, cars, masts and wires.

mod building;
mod footprint;
mod layout;
mod plants;
mod roads;
mod street;
mod wires;

pub(crate) use footprint::Footprint;
pub(crate) use layout::Site;
pub(crate) use roads::Roads;
