//! The split into training and held-out photographs.

use super::model::SplitParts;
use std::collections::HashMap;

use super::model::Shot;

/// Which photographs are held out. Positions count the views sorted bytewise by name, views with a missing photograph
/// included: the convention of Mip-NeRF 360 and the 3DGS reference.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Split {
    /// Every 8th photograph (index % 8 == 0) is held out.
    #[default]
    Test,
    /// For choosing settings: index % 8 == 4 is held out, and the test photographs are not used.
    Val,
    /// All photographs are for training.
    None,
    /// index % `every` == `first` is held out, all others are for training: conventions of other trainers.
    Every {
        /// Distance of held-out positions, at least 2.
        every: u32,
        /// The first held-out position, below `every`.
        first: u32,
    },
}

/// The use of a view.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Role {
    /// For training.
    Train,
    /// For evaluation.
    HeldOut,
    /// For neither.
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

    /// The roles of photographs sorted by name. Where the dataset assigns parts, `test` and `val` hold out the part of
    /// that name, including photographs that are also for training. Where that part is empty, and with the other
    /// splits, positions count the photographs for training.
    pub(super) fn roles(self, parts: &[Option<SplitParts>]) -> Vec<Role> {
        let is_kept = |part: &SplitParts| match self {
            Self::Test => part.test,
            Self::Val => part.val,
            Self::None | Self::Every { .. } => false,
        };
        let kept = parts.iter().flatten().any(is_kept);
        let mut position = 0..;
        let mut role = |part: &Option<SplitParts>| match part {
            Some(part) if is_kept(part) => Role::HeldOut,
            // Test photographs must not decide settings.
            Some(part) if !part.train || (self == Self::Val && part.test) => Role::Unused,
            Some(_) if kept => Role::Train,
            Some(_) | None => self.role(position.next().unwrap_or(0)),
        };
        parts.iter().map(&mut role).collect()
    }
}

/// The role of every photograph by name, for photographs sorted by name.
pub(super) fn planned(split: Split, shots: &[Shot]) -> HashMap<String, Role> {
    let roles = split.roles(&shots.iter().map(|shot| shot.part).collect::<Vec<_>>());
    shots.iter().map(|shot| shot.name.clone()).zip(roles).collect()
}
