//! What stands where: roads, buildings, plants, cars, masts.

mod building;
mod footprint;
mod layout;
mod plants;
mod roads;
mod street;

pub(crate) use footprint::Footprint;
pub(crate) use layout::Site;
pub(crate) use roads::Roads;
