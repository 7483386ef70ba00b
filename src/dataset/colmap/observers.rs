//! Which photographs the numbers in the tracks of points stand for.

use std::collections::HashMap;
use std::path::Path;

use super::Point;
use crate::dataset::Warning;

/// The places of images among the photographs, by COLMAP's numbers.
pub(super) struct Observers {
    /// Nothing where the image is left out.
    places: HashMap<u32, Option<u32>>,
    /// The first number that an image before has already, and how many images have such a one.
    shared: Option<(u32, usize)>,
    /// The first point that asks for an image that is not there, the image's number,
    /// and how many such points there are.
    unknown: Option<(u64, u32, usize)>,
}

impl Observers {
    /// Begins with images that are left out.
    pub(super) fn new(left_out: &[u32]) -> Self {
        Self { places: left_out.iter().map(|number| (*number, None)).collect(), shared: None, unknown: None }
    }

    /// An image, and its place.
    pub(super) fn add(&mut self, number: u32, place: Option<u32>) {
        let before = self.places.insert(number, place);
        if before.is_some() {
            // Which of them was meant is not known.
            self.places.insert(number, None);
            let (first, images) = self.shared.unwrap_or((number, 0));
            self.shared = Some((first, images + 1));
        }
    }

    /// The places of the images of these numbers that observe a point.
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

    /// What is to be told; `file` has the points.
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
