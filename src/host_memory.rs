//! Memory of the machine: what this process holds, what could still be had, and what one picture may take of it.

/// Where nothing can be found out.
pub(crate) const FREE_UNKNOWN: u64 = 4 << 30;

/// Bytes of memory that this process holds (`VmRSS` of Linux).
pub(crate) fn resident() -> Option<u64> {
    kib(&std::fs::read_to_string("/proc/self/status").ok()?, "VmRSS:")
}

/// Bytes that can be allocated without swapping: the machine's, or the control group's if that has less.
pub(crate) fn free() -> Option<u64> {
    let machine = std::fs::read_to_string("/proc/meminfo").ok().and_then(|text| kib(&text, "MemAvailable:"));
    let number = |file| std::fs::read_to_string(file).ok()?.trim().parse::<u64>().ok();
    let group = number("/sys/fs/cgroup/memory.max")
        .zip(number("/sys/fs/cgroup/memory.current"))
        .map(|(most, now)| most.saturating_sub(now));
    machine.into_iter().chain(group).min()
}

fn kib(text: &str, key: &str) -> Option<u64> {
    let line = text.lines().find_map(|line| line.strip_prefix(key))?;
    line.trim().strip_suffix("kB")?.trim().parse::<u64>().ok()?.checked_mul(1024)
}

/// What decoding one picture may take. What a machine has changes from one moment to the next:
/// two such limits count as equal.
#[derive(Clone, Copy, Debug)]
pub struct DecodeLimit {
    /// Bytes.
    pub most: u64,
    /// Whether the limit was asked for, and is not what the machine has.
    pub asked: bool,
}

impl PartialEq for DecodeLimit {
    fn eq(&self, other: &Self) -> bool {
        self.asked == other.asked && (!self.asked || self.most == other.most)
    }
}

impl Eq for DecodeLimit {}

/// Why a picture is not decoded.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum NoRoom {
    /// It takes more than it may.
    Beyond,
    /// The system does not give the memory.
    Refused,
}

impl DecodeLimit {
    /// As asked for, else half of what is free now.
    pub fn new(asked: Option<u64>) -> Self {
        match asked {
            Some(most) => Self { most, asked: true },
            None => Self { most: free().unwrap_or(FREE_UNKNOWN) / 2, asked: false },
        }
    }

    /// Whether so many bytes may be taken.
    pub(crate) fn allows(self, bytes: u64) -> Result<(), NoRoom> {
        if bytes <= self.most { Ok(()) } else { Err(NoRoom::Beyond) }
    }

    /// Whether so many bytes may be taken and can be had now. A decoder of another project would end the process where
    /// they cannot.
    pub(crate) fn has_room_for(self, bytes: u64) -> Result<(), NoRoom> {
        self.allows(bytes)?;
        let bytes = usize::try_from(bytes).map_err(|_| NoRoom::Refused)?;
        Vec::<u8>::new().try_reserve_exact(bytes).map_err(|_| NoRoom::Refused)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn figures_of_the_system_are_read() {
        assert_eq!(kib("MemTotal:  8 kB\nMemAvailable:    6 kB\n", "MemAvailable:"), Some(6144));
        assert_eq!(kib("MemAvailable: many kB\n", "MemAvailable:"), None);
        if cfg!(target_os = "linux") {
            assert!(resident() > Some(1 << 20) && free() > Some(1 << 20));
        }
    }

    #[test]
    fn a_limit_lets_through_what_it_has_and_no_more() {
        let limit = DecodeLimit::new(Some(1000));
        assert_eq!((limit.has_room_for(1000), limit.has_room_for(1001)), (Ok(()), Err(NoRoom::Beyond)));
        let none = DecodeLimit { most: u64::MAX, asked: false };
        assert_eq!(none.has_room_for(u64::MAX), Err(NoRoom::Refused), "no machine has so much");
        assert!(!DecodeLimit::new(None).asked);
    }
}
