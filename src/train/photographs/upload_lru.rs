//! Which photograph lies in which of a few places that they are uploaded from.

/// Places in the order of their use. A photograph that still lies in one is taken from there; another comes into the place that
/// has not been used for the longest.
#[derive(Clone, Debug)]
pub(super) struct Places {
    /// (place, photograph in it), the last used at the end.
    by_use: Vec<(usize, Option<usize>)>,
}

impl Places {
    /// So many, all of them empty.
    pub(super) fn new(count: usize) -> Self {
        Self { by_use: (0..count).map(|place| (place, None)).collect() }
    }

    /// How many.
    pub(super) fn count(&self) -> usize {
        self.by_use.len()
    }

    /// The place where a photograph lies, used now.
    pub(super) fn find(&mut self, view: usize) -> Option<usize> {
        let at = self.by_use.iter().position(|(_, held)| *held == Some(view))?;
        let found = self.by_use.remove(at);
        self.by_use.push(found);
        Some(found.0)
    }

    /// The place for one that lies nowhere. What was there is gone; that the photograph is there now is for [`Self::fill`] to say.
    pub(super) fn clear_oldest(&mut self) -> Option<usize> {
        let oldest = self.by_use.first_mut()?;
        oldest.1 = None;
        Some(oldest.0)
    }

    /// A photograph was put into a place, used now.
    pub(super) fn fill(&mut self, place: usize, view: usize) {
        self.by_use.retain(|(of, _)| *of != place);
        self.by_use.push((place, Some(view)));
    }

    /// Of photographs that are used in this order, those that lie nowhere when their turn comes.
    pub(super) fn missing(&self, views: &[usize]) -> Vec<usize> {
        let (mut then, mut missing) = (self.clone(), Vec::new());
        for &view in views {
            if then.find(view).is_some() {
                continue;
            }
            missing.push(view);
            if let Some(place) = then.clear_oldest() {
                then.fill(place, view);
            }
        }
        missing
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn put(places: &mut Places, view: usize) -> usize {
        let place = places.clear_oldest().expect("a place");
        places.fill(place, view);
        place
    }

    #[test]
    fn the_place_that_was_used_longest_ago_is_the_next() {
        let mut places = Places::new(3);
        assert_eq!([10, 11, 12].map(|view| put(&mut places, view)), [0, 1, 2]);
        assert_eq!((places.find(10), places.find(13)), (Some(0), None));
        // 11 goes, as 10 has been used since.
        assert_eq!(put(&mut places, 13), 1);
        assert_eq!((places.find(11), places.find(10), places.find(12)), (None, Some(0), Some(2)));
    }

    /// A place is written again only after as many others have been used: with one more than there are recordings on their way, its
    /// own has passed by then, whatever is repeated in between.
    #[test]
    fn a_place_rests_while_all_others_are_used() {
        let mut places = Places::new(5);
        let mut used: Vec<usize> = Vec::new();
        for view in [1, 2, 3, 4, 3, 4, 5, 3, 4, 5, 6, 7, 1, 1, 2, 8, 9, 8, 9, 10] {
            let place = match places.find(view) {
                Some(place) => place,
                None => {
                    let place = put(&mut places, view);
                    assert!(!used.iter().rev().take(4).any(|last| *last == place), "{place} after {used:?}");
                    place
                }
            };
            used.push(place);
        }
    }

    #[test]
    fn what_will_be_missing_is_known_before() {
        let mut places = Places::new(2);
        put(&mut places, 1);
        put(&mut places, 2);
        assert_eq!(places.missing(&[1, 2, 3, 3, 1]), [3, 1], "1 makes room for 3");
        assert_eq!(places.missing(&[2, 3, 2]), [3]);
        assert_eq!(places.find(1), Some(0), "nothing has moved");
        assert!(Places::new(0).missing(&[4, 4]) == [4, 4]);
    }

    #[test]
    fn what_was_not_filled_is_not_found() {
        let mut places = Places::new(1);
        put(&mut places, 1);
        assert_eq!(places.clear_oldest(), Some(0));
        assert_eq!(places.find(1), None);
    }
}
