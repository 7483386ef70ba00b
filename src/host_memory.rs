//! The machine's memory: how much this process holds, how much is free, and how much decoding one photograph may take.

/// Free bytes to assume where the system reports none.
pub(crate) const FREE_UNKNOWN: u64 = 4 << 30;

/// Bytes of memory that this process holds (`VmRSS` of Linux).
pub(crate) fn resident() -> Option<u64> {
    kib(&std::fs::read_to_string("/proc/self/status").ok()?, "VmRSS:")
}

/// Bytes that can be allocated without swapping: the smaller of the machine's and the control group's free memory.
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

/// How much memory decoding one photograph may take. Free memory changes from one moment to the next, so two limits
/// derived from free memory count as equal.
#[derive(Clone, Copy, Debug)]
pub struct DecodeLimit {
    /// Largest number of bytes.
    pub most: u64,
    /// Whether the caller set the limit; otherwise the limit is derived from free memory.
    pub asked: bool,
}

impl PartialEq for DecodeLimit {
    fn eq(&self, other: &Self) -> bool {
        self.asked == other.asked && (!self.asked || self.most == other.most)
    }
}

impl Eq for DecodeLimit {}

/// Why a photograph is not decoded.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum NoMemory {
    /// Decoding would exceed the limit.
    OverLimit,
    /// The system refuses the allocation.
    Refused,
}

impl DecodeLimit {
    /// The limit `asked` for, else half of the memory that is free now.
    pub fn new(asked: Option<u64>) -> Self {
        match asked {
            Some(most) => Self { most, asked: true },
            None => Self { most: free().unwrap_or(FREE_UNKNOWN) / 2, asked: false },
        }
    }

    /// Fails where `bytes` exceeds the limit.
    pub(crate) fn allows(self, bytes: u64) -> Result<(), NoMemory> {
        if bytes <= self.most { Ok(()) } else { Err(NoMemory::OverLimit) }
    }

    /// Fails where `bytes` exceeds the limit or cannot be allocated now. Without this check, the decoders of
    /// dependencies would abort the process where an allocation fails.
    pub(crate) fn has_room_for(self, bytes: u64) -> Result<(), NoMemory> {
        self.allows(bytes)?;
        let bytes = usize::try_from(bytes).map_err(|_| NoMemory::Refused)?;
        Vec::<u8>::new().try_reserve_exact(bytes).map_err(|_| NoMemory::Refused)
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
        assert_eq!((limit.has_room_for(1000), limit.has_room_for(1001)), (Ok(()), Err(NoMemory::OverLimit)));
        let none = DecodeLimit { most: u64::MAX, asked: false };
        assert_eq!(none.has_room_for(u64::MAX), Err(NoMemory::Refused), "no machine has 2^64 bytes");
        assert!(!DecodeLimit::new(None).asked);
    }
}
