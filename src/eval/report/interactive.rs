//! The model within a report, to look around in.

use std::io::Write;

use flate2::Compression;
use flate2::write::GzEncoder;

use crate::format::markup::{base64, escape};

/// Most bytes of a report that its model may take.
pub(super) const MODEL_BUDGET: usize = 12_000_000;
/// Least bytes that a splat of a page takes within a report.
const PER_SPLAT: usize = 12;

/// The model of a report.
#[derive(Clone, Debug, PartialEq)]
pub struct Interactive(Content);

#[derive(Clone, Debug, PartialEq)]
enum Content {
    /// A page of its own, gzipped, as base64.
    Page(String),
    /// A sentence about why there is none.
    Absent(String),
}

impl Interactive {
    /// Most splats that may have a place in a report; a page of them is then worth making.
    pub const MOST_SPLATS: usize = MODEL_BUDGET / PER_SPLAT;

    /// An HTML file of the model, which the report opens within itself; `None` where the file is too large for a report.
    pub fn page(html: &str) -> Option<Self> {
        // Base64 of compressed data gets small again at the least effort.
        let mut gzip = GzEncoder::new(Vec::new(), Compression::fast());
        gzip.write_all(html.as_bytes()).ok()?;
        let packed = base64(&gzip.finish().ok()?);
        (packed.len() <= MODEL_BUDGET).then_some(Self(Content::Page(packed)))
    }

    /// No model, and a sentence that says why.
    pub fn absent(why: impl Into<String>) -> Self {
        Self(Content::Absent(why.into()))
    }

    /// Bytes of the page.
    pub(super) fn bytes(&self) -> usize {
        match &self.0 {
            Content::Page(packed) => packed.len(),
            Content::Absent(_) => 0,
        }
    }

    /// The part of the report.
    pub(super) fn section(&self) -> String {
        let body = match &self.0 {
            Content::Page(packed) => format!(
                "<div class=\"look\" hidden><button type=\"button\" class=\"open\">Look around</button></div>\n\
                 <p class=\"look-hint\" hidden>Drag to orbit, turn the wheel to come nearer; the viewer's own buttons are \
                 in its corners. <button type=\"button\" class=\"close\">Close the viewer</button></p>\n\
                 <script type=\"text/plain\" id=\"model-page\">{packed}</script>"
            ),
            Content::Absent(why) => format!("<p class=\"hint\">{}</p>", escape(why)),
        };
        format!("<section aria-labelledby=\"model\"><h2 id=\"model\">Model</h2>{body}</section>")
    }
}
