//! Names of camera models in the spellings of other programs.

/// A name in lower case without separators between its words.
pub(in crate::dataset) fn key(name: &str) -> String {
    name.chars().filter(char::is_ascii_alphanumeric).map(|letter| letter.to_ascii_uppercase()).collect()
}

/// Whether images of this kind show all directions at once, which no lens does.
pub(in crate::dataset) fn is_panorama(name: &str) -> bool {
    ["EQUIRECTANGULAR", "SPHERICAL", "PANORAMA", "PANORAMIC", "LATLONG"].contains(&key(name).as_str())
}

/// The remedy for panoramas.
pub(in crate::dataset) const PANORAMA: &str =
    "a panorama shows all directions at once; cut it into pictures of perspective cameras";

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spellings_of_a_name_are_one_name() {
        for name in ["OPENCV_FISHEYE", "opencv_fisheye", "OpenCV Fisheye", "opencv-fisheye"] {
            assert_eq!(key(name), "OPENCVFISHEYE");
        }
        assert!(is_panorama("equirectangular") && is_panorama("Lat-Long") && !is_panorama("OPENCV"));
    }
}
