//! Levels of detail: a tree of tiles whose inner tiles hold fewer splats, merged so that they look alike from afar;
//! files from which viewers load what a view needs.

mod blob;
mod choose;
mod likeness;
mod merge;
mod streamed;
mod tiles;
mod tree;

use std::path::Path;

use crate::format::Error;

pub use merge::Splats;
pub use streamed::{LEVELS, Streamed, StreamedSog};
pub use tiles::{Content, TileSet};
pub use tree::{Bounds, Tile, Tree};

/// The `head` of a file that is to be replaced: JSON with `asset.generator`. A head that names another program is an
/// error.
fn by_this_program(file: &Path, head: &[u8]) -> Result<serde_json::Value, Error> {
    let document: serde_json::Value = serde_json::from_slice(head).unwrap_or_default();
    let generator = document["asset"]["generator"].as_str().unwrap_or("");
    if generator.split(' ').next() == Some(env!("CARGO_PKG_NAME")) {
        return Ok(document);
    }
    let problem = "the file that is there is another program's; choose another folder, or remove the file".to_owned();
    Err(Error::Unwritable { file: file.to_owned(), what: "levels of detail", problem })
}
