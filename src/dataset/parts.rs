//! The parts of a dataset (training, validation, test) to which its own lists assign photographs.

/// The parts to which a dataset assigns a photograph: one, several, or none.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Parts {
    pub(super) train: bool,
    pub(super) val: bool,
    pub(super) test: bool,
}

impl Parts {
    pub(super) const TRAIN: Self = Self { train: true, val: false, test: false };
    pub(super) const VAL: Self = Self { train: false, val: true, test: false };
    pub(super) const TEST: Self = Self { train: false, val: false, test: true };

    /// The parts of both.
    pub(super) fn and(self, other: Self) -> Self {
        Self { train: self.train || other.train, val: self.val || other.val, test: self.test || other.test }
    }
}
