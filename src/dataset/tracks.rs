//! The views that observe each point.

/// For each point of a dataset its observing views; empty where the format does not say.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Tracks {
    /// End of each point's views in `views`.
    ends: Vec<usize>,
    views: Vec<u32>,
}

impl Tracks {
    /// Takes one list of positions in [`super::Dataset::views`] per point.
    pub fn new(lists: impl IntoIterator<Item = Vec<u32>>) -> Self {
        let mut tracks = Self::default();
        for mut list in lists {
            // An image may observe a point twice.
            list.sort_unstable();
            list.dedup();
            tracks.views.extend(list);
            tracks.ends.push(tracks.views.len());
        }
        tracks
    }

    /// Positions in [`super::Dataset::views`] of the views that observe a point, ascending.
    pub fn of(&self, point: usize) -> &[u32] {
        let start = point.checked_sub(1).and_then(|before| self.ends.get(before)).copied().unwrap_or(0);
        self.ends.get(point).and_then(|end| self.views.get(start..*end)).unwrap_or(&[])
    }

    /// The tracks of the points where `points` is true. `places` has the new position of each view, `None` for a
    /// removed view.
    pub(super) fn kept(&self, points: &[bool], places: &[Option<u32>]) -> Self {
        let kept = points.iter().enumerate().filter(|(_, kept)| **kept).map(|(point, _)| self.of(point));
        let placed = |view: &u32| places.get(*view as usize).copied().flatten();
        if self.ends.is_empty() {
            Self::default()
        } else {
            Self::new(kept.map(|views| views.iter().filter_map(placed).collect()))
        }
    }

    /// Whether no tracks are known.
    pub fn is_empty(&self) -> bool {
        self.views.is_empty()
    }
}

#[cfg(test)]
mod tests {
    use super::Tracks;

    #[test]
    fn views_and_points_that_are_left_out_leave_the_others_theirs() {
        let tracks = Tracks::new([vec![0, 1, 2], vec![2], vec![1, 3]]);
        let kept = tracks.kept(&[true, false, true], &[Some(0), None, Some(1), Some(2)]);
        assert_eq!(kept, Tracks::new([vec![0, 1], vec![2]]));
        assert_eq!(Tracks::default().kept(&[true], &[None]), Tracks::default());
    }
}
