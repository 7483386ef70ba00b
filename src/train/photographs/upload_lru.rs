//! Which photograph is in which staging buffer.

/// Slots (staging buffers) in the order of their use. A photograph that is still in a slot is reused; any other
/// photograph takes the slot that was unused for the longest.
#[derive(Clone, Debug)]
pub(super) struct StagingSlots {
    /// (slot, photograph in it), the last used at the end.
    by_use: Vec<(usize, Option<usize>)>,
}

impl StagingSlots {
    /// `count` empty slots.
    pub(super) fn new(count: usize) -> Self {
        Self { by_use: (0..count).map(|slot| (slot, None)).collect() }
    }

    /// Number of slots.
    pub(super) fn count(&self) -> usize {
        self.by_use.len()
    }

    /// The slot of a photograph, which becomes the last used.
    pub(super) fn find(&mut self, view: usize) -> Option<usize> {
        let at = self.by_use.iter().position(|(_, held)| *held == Some(view))?;
        let found = self.by_use.remove(at);
        self.by_use.push(found);
        Some(found.0)
    }

    /// Empties the slot that was unused for the longest, and returns it. Call [`Self::fill`] when a photograph is in
    /// it.
    pub(super) fn clear_oldest(&mut self) -> Option<usize> {
        let oldest = self.by_use.first_mut()?;
        oldest.1 = None;
        Some(oldest.0)
    }

    /// Notes that a photograph is in a slot, which becomes the last used.
    pub(super) fn fill(&mut self, slot: usize, view: usize) {
        self.by_use.retain(|(of, _)| *of != slot);
        self.by_use.push((slot, Some(view)));
    }

    /// Of photographs that are used in this order, those that are in no slot when their turn comes.
    pub(super) fn missing(&self, views: &[usize]) -> Vec<usize> {
        let (mut then, mut missing) = (self.clone(), Vec::new());
        for &view in views {
            if then.find(view).is_some() {
                continue;
            }
            missing.push(view);
            if let Some(slot) = then.clear_oldest() {
                then.fill(slot, view);
            }
        }
        missing
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn put(slots: &mut StagingSlots, view: usize) -> usize {
        let slot = slots.clear_oldest().expect("a slot");
        slots.fill(slot, view);
        slot
    }

    #[test]
    fn the_slot_that_was_used_longest_ago_is_the_next() {
        let mut slots = StagingSlots::new(3);
        assert_eq!([10, 11, 12].map(|view| put(&mut slots, view)), [0, 1, 2]);
        assert_eq!((slots.find(10), slots.find(13)), (Some(0), None));
        // 11 goes, because 10 has been used since.
        assert_eq!(put(&mut slots, 13), 1);
        assert_eq!((slots.find(11), slots.find(10), slots.find(12)), (None, Some(0), Some(2)));
    }

    /// A slot is written again only after all other slots were used. With one slot more than recordings in flight, the
    /// recording that read the slot is done by then, whatever is repeated in between.
    #[test]
    fn a_slot_rests_while_all_others_are_used() {
        let mut slots = StagingSlots::new(5);
        let mut used: Vec<usize> = Vec::new();
        for view in [1, 2, 3, 4, 3, 4, 5, 3, 4, 5, 6, 7, 1, 1, 2, 8, 9, 8, 9, 10] {
            let slot = match slots.find(view) {
                Some(slot) => slot,
                None => {
                    let slot = put(&mut slots, view);
                    assert!(!used.iter().rev().take(4).any(|last| *last == slot), "{slot} after {used:?}");
                    slot
                }
            };
            used.push(slot);
        }
    }

    #[test]
    fn missing_photographs_are_known_before_their_turn() {
        let mut slots = StagingSlots::new(2);
        put(&mut slots, 1);
        put(&mut slots, 2);
        assert_eq!(slots.missing(&[1, 2, 3, 3, 1]), [3, 1], "1 makes room for 3");
        assert_eq!(slots.missing(&[2, 3, 2]), [3]);
        assert_eq!(slots.find(1), Some(0), "nothing has moved");
        assert!(StagingSlots::new(0).missing(&[4, 4]) == [4, 4]);
    }

    #[test]
    fn an_emptied_slot_is_not_found() {
        let mut slots = StagingSlots::new(1);
        put(&mut slots, 1);
        assert_eq!(slots.clear_oldest(), Some(0));
        assert_eq!(slots.find(1), None);
    }
}
