//! Which photographs are trained on and which are held out.

use super::model::Parts;
use std::collections::HashMap;

use super::model::Shot;

/// How to hold photographs out. Positions count the views sorted bytewise by name (one whose photograph is missing
/// too), the convention of Mip-NeRF 360 and of the 3DGS reference.
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

/// The use of a view.
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

    /// The roles of photographs sorted by name. Where the dataset says what they are for, `test` and `val` hold out
    /// what it keeps for that, also of those to train on; where it keeps nothing for it, and with the other splits,
    /// positions count those to train on.
    pub(super) fn roles(self, parts: &[Option<Parts>]) -> Vec<Role> {
        let is_kept = |part: &Parts| match self {
            Self::Test => part.test,
            Self::Val => part.val,
            Self::None | Self::Every { .. } => false,
        };
        let kept = parts.iter().flatten().any(is_kept);
        let mut position = 0..;
        let mut role = |part: &Option<Parts>| match part {
            Some(part) if is_kept(part) => Role::HeldOut,
            // Settings are not to be chosen by test photographs.
            Some(part) if !part.train || (self == Self::Val && part.test) => Role::Unused,
            Some(_) if kept => Role::Train,
            Some(_) | None => self.role(position.next().unwrap_or(0)),
        };
        parts.iter().map(&mut role).collect()
    }
}

/// The role of every photograph by its name, for photographs sorted by name.
pub(super) fn planned(split: Split, shots: &[Shot]) -> HashMap<String, Role> {
    let roles = split.roles(&shots.iter().map(|shot| shot.part).collect::<Vec<_>>());
    shots.iter().map(|shot| shot.name.clone()).zip(roles).collect()
}
