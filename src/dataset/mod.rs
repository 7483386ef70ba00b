//! (module dataset)
