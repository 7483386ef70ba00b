//! Which views observe which points.

/// For each point of a dataset the views that it was reconstructed from; empty where the format does not say.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Tracks {
    /// Where each point's views end.
    ends: Vec<usize>,
    views: Vec<u32>,
}

impl Tracks {
    /// One list of positions in [`super::Dataset::views`] per point.
    pub fn new(lists: impl IntoIterator<Item = Vec<u32>>) -> Self {
        let mut tracks = Self::default();
        for mut list in lists {
            // A point may be seen twice in one picture.
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

    /// Whether nothing is known.
    pub fn is_empty(&self) -> bool {
        self.views.is_empty()
    }
}
