//! The files of the SuperSplat Viewer of PlayCanvas, as its npm package has them: gzipped, with their licences.
//!
//! The README names version and hashes. A page that contains the script has to contain both of the [`LICENSES`].
#![warn(missing_docs)]

use std::io::Read;

use flate2::read::GzDecoder;

/// Version of the npm package `@playcanvas/supersplat-viewer`.
pub const VERSION: &str = "1.36.2";

/// Version of the PlayCanvas engine, which the script contains.
pub const ENGINE_VERSION: &str = "2.22.6";

/// Each part of the script with its licence, the text of which begins with the copyright notice.
pub const LICENSES: [(&str, &str); 2] = [
    ("SuperSplat Viewer", include_str!("../files/LICENSE-supersplat-viewer")),
    ("PlayCanvas Engine", include_str!("../files/LICENSE-playcanvas")),
];

/// The script, an ECMAScript module that exports `createViewer`, gzipped.
pub const JS_GZIPPED: &[u8] = include_bytes!("../files/index.js.gz");

/// The style sheet, gzipped.
pub const CSS_GZIPPED: &[u8] = include_bytes!("../files/index.css.gz");

/// The page of the package, gzipped.
pub const HTML_GZIPPED: &[u8] = include_bytes!("../files/index.html.gz");

/// The script.
pub fn js() -> Vec<u8> {
    unpacked(JS_GZIPPED)
}

/// The style sheet.
pub fn css() -> Vec<u8> {
    unpacked(CSS_GZIPPED)
}

/// The page of the package.
pub fn html() -> Vec<u8> {
    unpacked(HTML_GZIPPED)
}

fn unpacked(gzipped: &[u8]) -> Vec<u8> {
    let mut bytes = Vec::new();
    // A test of the program compares the bytes with their hashes; reading from memory has no other errors.
    GzDecoder::new(gzipped).read_to_end(&mut bytes).expect("a file of this package is damaged");
    bytes
}
