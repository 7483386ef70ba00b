//! Which photographs are trained on and which are held out.

/// How to hold photographs out. Positions count the views sorted bytewise by name, the convention of Mip-NeRF 360 and of the
/// 3DGS reference.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Split {
    /// Every 8th photograph (index % 8 == 0) is a test photograph.
    #[default]
    Test,
    /// For choosing settings: index % 8 == 4 is held out, and the test photographs are not used at all.
    Val,
    /// Train on everything.
    None,
    /// index % `every` == `first` is held out, all others are trained on: conventions of other trainers.
    Every {
        /// Distance of held-out positions, at least 2.
        every: u32,
        /// The first of them, below `every`.
        first: u32,
    },
}

/// What a view is used for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Role {
    /// Trained on.
    Train,
    /// Evaluated on.
    HeldOut,
    /// Neither.
    Unused,
}

impl Split {
    /// The role of the view at a position of the sorted names.
    pub fn role(self, index: usize) -> Role {
        if let Self::Every { every, first } = self {
            let held_out = index as u64 % u64::from(every.max(1)) == u64::from(first);
            return if held_out { Role::HeldOut } else { Role::Train };
        }
        match (self, index % 8) {
            (Self::Test, 0) | (Self::Val, 4) => Role::HeldOut,
            (Self::Val, 0) => Role::Unused,
            _ => Role::Train,
        }
    }
}
