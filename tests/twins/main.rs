//! Every registered pass against its twin.

mod density;
mod density_model;
mod density_reference;
mod density_twin;
