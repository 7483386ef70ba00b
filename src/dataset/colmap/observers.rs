//! Maps the image numbers in tracks of points to photographs.

use std::collections::HashMap;
use std::path::Path;

use super::Point;
use crate::dataset::Warning;

/// Positions of the photographs by COLMAP's image numbers.
pub(super) struct Observers {
    /// `None` where the image is left out.
    places: HashMap<u32, Option<u32>>,
    /// The first number that two images share, and the number of images whose number an earlier image has.
    shared: Option<(u32, usize)>,
    /// The first point with an unknown image, the image's number, and the number of such points.
    unknown: Option<(u64, u32, usize)>,
}

impl Observers {
    /// Starts with the numbers of images that are left out.
    pub(super) fn new(left_out: &[u32]) -> Self {
        Self { places: left_out.iter().map(|number| (*number, None)).collect(), shared: None, unknown: None }
    }

    /// Adds an image's number with the photograph's position.
    pub(super) fn add(&mut self, number: u32, place: Option<u32>) {
        let before = self.places.insert(number, place);
        if before.is_some() {
            // Two images with one number: which one the points mean is not known.
            self.places.insert(number, None);
            let (first, images) = self.shared.unwrap_or((number, 0));
            self.shared = Some((first, images + 1));
        }
    }

    /// Positions of the photographs with these numbers, which observe a point.
    pub(super) fn of(&mut self, point: &Point, numbers: &[u32]) -> Vec<u32> {
        let mut all_known = true;
        let mut places = Vec::with_capacity(numbers.len());
        for number in numbers {
            match self.places.get(number) {
                Some(place) => places.extend(*place),
                None if all_known => {
                    all_known = false;
                    let (first, image, points) = self.unknown.unwrap_or((point.id, *number, 0));
                    self.unknown = Some((first, image, points + 1));
                }
                None => {}
            }
        }
        places
    }

    /// The warnings; `file` holds the points.
    pub(super) fn warnings(&self, file: &Path) -> Vec<Warning> {
        let shared = self.shared.map(|(number, images)| Warning::SharedNumber { number, images });
        let unknown = self.unknown.map(|(point, image, points)| Warning::UnknownObservers {
            file: file.to_owned(),
            points,
            point,
            image,
        });
        shared.into_iter().chain(unknown).collect()
    }
}
