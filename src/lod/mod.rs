//! Levels of detail: a tree of tiles whose inner tiles hold fewer splats, merged so that they look alike from afar;
//! files from which viewers load what a view needs.

mod blob;
mod choose;
mod likeness;
mod merge;
mod streamed;
mod tiles;
mod tree;

pub use merge::Splats;
pub use streamed::{LEVELS, Streamed, StreamedSog};
pub use tiles::{Content, TileSet};
pub use tree::{Bounds, Tile, Tree};
