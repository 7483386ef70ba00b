//! (module raster)
