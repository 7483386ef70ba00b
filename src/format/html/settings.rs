//! The viewer's settings: version 2 of its `settings.json`.

use serde_json::{Value, json};

use crate::scene::viewpoints::Viewpoint;

/// Angles of view that the viewer has, degrees.
const DEGREES: (f64, f64) = (10.0, 120.0);
/// Letters of a title that the viewer allows.
const TITLE: usize = 60;

/// Looks from the first viewpoint, without animation and effects; each viewpoint is an annotation.
pub(super) fn experience(views: &[Viewpoint], background: [f32; 3]) -> Value {
    let cameras: Vec<Value> = views.first().map(camera).into_iter().collect();
    let annotations: Vec<Value> = match views {
        [] | [_] => Vec::new(),
        several => several.iter().map(annotation).collect(),
    };
    json!({
        "version": 2,
        "tonemapping": "none",
        "highPrecisionRendering": false,
        "background": { "color": background },
        "postEffectSettings": {
            "sharpness": { "enabled": false, "amount": 0 },
            "bloom": { "enabled": false, "intensity": 0.1, "blurLevel": 2 },
            "grading": { "enabled": false, "brightness": 1, "contrast": 1, "saturation": 1, "tint": [1, 1, 1] },
            "vignette": { "enabled": false, "intensity": 0.5, "inner": 0.3, "outer": 0.75, "curvature": 1 },
            "fringing": { "enabled": false, "intensity": 0.5 },
        },
        "animTracks": [],
        "cameras": cameras,
        "annotations": annotations,
        "startMode": "default",
    })
}

fn camera(view: &Viewpoint) -> Value {
    let fov = view.degrees.clamp(DEGREES.0, DEGREES.1);
    json!({ "initial": { "position": view.position, "target": view.target, "fov": fov } })
}

fn annotation(view: &Viewpoint) -> Value {
    json!({ "position": view.target, "title": shortened(&view.name), "text": "", "camera": camera(view) })
}

/// The end of a name that is too long: the beginning is often one for all photographs.
pub(super) fn shortened(name: &str) -> String {
    let letters = name.chars().count();
    if letters <= TITLE {
        return name.to_owned();
    }
    let end: String = name.chars().skip(letters + 1 - TITLE).collect();
    format!("\u{2026}{end}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn long_names_keep_their_end() {
        assert_eq!(shortened("short.jpg"), "short.jpg");
        let long = format!("{}/IMG_1.jpg", "folder".repeat(20));
        let title = shortened(&long);
        assert!(title.chars().count() == TITLE && title.ends_with("/IMG_1.jpg") && title.starts_with('\u{2026}'));
    }

    #[test]
    fn one_viewpoint_is_the_first_camera_alone() {
        let view = |degrees| Viewpoint { name: "a".into(), position: [1.0; 3], target: [0.0; 3], degrees };
        let one = experience(&[view(150.0)], [0.0; 3]);
        assert_eq!(one["cameras"][0]["initial"]["fov"], 120.0);
        assert_eq!(one["annotations"], json!([]));
        assert_eq!(experience(&[], [0.0; 3])["cameras"], json!([]));
        assert_eq!(experience(&[view(60.0), view(50.0)], [0.0; 3])["annotations"][1]["camera"]["initial"]["fov"], 50.0);
    }
}
