//! A model as one HTML file, which shows the model in a browser and needs nothing else.
//!
//! The file holds PlayCanvas' SuperSplat Viewer, the model as SOG, and where to look from. The viewer stays as it is: a
//! script of this program unpacks the viewer and calls it. The page's policy forbids every address outside of the file.

mod of_model;
mod settings;

use sha2::{Digest, Sha256};

use super::markup::{base64, escape, fill};
use crate::scene::viewpoints::Viewpoint;

pub use of_model::Shown;

const SCRIPT: &str = include_str!("page.js");
/// The handler of events that the viewer's own markup has.
const HANDLER: &str = "event.stopPropagation()";

/// From the coordinates in which the viewer looks, y up, to those of the model in the file: the viewer turns a model by
/// half a turn about z.
pub const FROM_VIEWER: [[f64; 3]; 3] = [[-1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, 1.0]];

/// What a page shows.
#[derive(Clone, Copy, Debug)]
pub struct Page<'a> {
    /// Title of the page.
    pub title: &'a str,
    /// The model, a SOG file: [`FROM_VIEWER`] times the coordinates in which y is up.
    pub sog: &'a [u8],
    /// Where to look from, in coordinates in which y is up. The first is where the viewer begins.
    pub views: &'a [Viewpoint],
    /// Colour behind the model, 0 to 1.
    pub background: [f32; 3],
    /// Whether opacities carry the anti-aliasing factor.
    pub antialias: bool,
}

impl Page<'_> {
    /// The file.
    pub fn html(&self) -> String {
        let options = serde_json::json!({
            "settings": settings::experience(self.views, self.background),
            "aa": self.antialias,
        });
        fill(
            include_str!("page.html"),
            &[
                ("policy", &policy()),
                ("title", &escape(self.title)),
                ("style", include_str!("page.css")),
                ("notices", &notices()),
                ("viewer_css", &base64(psrgs_supersplat_viewer::CSS_GZIPPED)),
                ("viewer_js", &base64(psrgs_supersplat_viewer::JS_GZIPPED)),
                ("options", &within_script(&options)),
                ("model", &base64(self.sog)),
                ("script", SCRIPT),
            ],
        )
    }
}

/// Only the script of the page runs, and what the script unpacks.
fn policy() -> String {
    let hash = |text: &str| format!("'sha256-{}'", base64(&Sha256::digest(text)));
    format!(
        "default-src 'none'; script-src {} 'unsafe-hashes' {} blob:; style-src 'unsafe-inline'; img-src data: blob:; \
         connect-src data: blob:; worker-src blob:; base-uri 'none'; form-action 'none'",
        hash(SCRIPT),
        hash(HANDLER)
    )
}

/// The licences of the viewer and its engine, as text of a comment.
fn notices() -> String {
    let versions = [psrgs_supersplat_viewer::VERSION, psrgs_supersplat_viewer::ENGINE_VERSION];
    let parts = psrgs_supersplat_viewer::LICENSES.iter().zip(versions);
    parts.map(|((name, licence), version)| format!("\n{name} {version}\n\n{licence}")).collect()
}

/// A value as JSON that ends no script element and no line of a script.
fn within_script(value: &serde_json::Value) -> String {
    value.to_string().replace('<', "\\u003c").replace('\u{2028}', "\\u2028").replace('\u{2029}', "\\u2029")
}

#[cfg(test)]
mod tests {
    use super::*;

    const HOSTILE: &str = "</script><img src=x onerror=alert(1)>\u{2028}<!-- {{model}}";

    fn page(name: &str) -> String {
        let view = Viewpoint { name: name.into(), position: [0.0; 3], target: [0.0, 0.0, 1.0], degrees: 60.0 };
        let (sog, views) = (b"model".as_slice(), [view.clone(), view]);
        Page { title: name, sog, views: &views, background: [0.0; 3], antialias: false }.html()
    }

    #[test]
    fn hostile_names_stay_text_in_the_html_file() {
        let (plain, hostile) = (page("plain"), page(HOSTILE));
        assert_eq!(hostile.matches("<script").count(), plain.matches("<script").count());
        assert_eq!(hostile.matches("</script").count(), plain.matches("</script").count());
        assert_eq!(hostile.matches("<!--").count(), plain.matches("<!--").count());
        assert!(!hostile.contains("<img"));
        let options = hostile.split("id=\"options\">").nth(1).unwrap().split("</script>").next().unwrap();
        assert!(!options.contains(['<', '\u{2028}', '\u{2029}']), "{options}");
        let options: serde_json::Value = serde_json::from_str(options).unwrap();
        assert_eq!(options["settings"]["annotations"][1]["title"], settings::shortened(HOSTILE));
    }

    #[test]
    fn html_file_has_the_notices_of_viewer_and_engine() {
        let page = page("a");
        let notices = page.split("<!--").nth(1).unwrap().split("-->").next().unwrap();
        for (name, licence) in psrgs_supersplat_viewer::LICENSES {
            assert!(notices.contains(name) && notices.contains(licence), "{name}");
            assert!(licence.contains("Copyright (c) 2011-2026 PlayCanvas Ltd.") && !licence.contains("--"), "{name}");
        }
    }

    #[test]
    fn html_file_names_no_address_outside() {
        let page = page("a");
        let own: String =
            page.split("<script type=\"text/plain\"").map(|part| part.split("</script>").last().unwrap()).collect();
        assert!(!own.contains("://") && !own.contains("src=") && own.contains("default-src 'none'"), "{own}");
    }
}
