//! Ranges of settings.

/// The values that a setting takes, with their description for errors.
#[derive(Clone, Copy, Debug)]
pub struct Range {
    words: &'static str,
    holds: fn(f64) -> bool,
}

impl Range {
    /// At least 1.
    pub const COUNT: Self = Self::new("at least 1", |v| v >= 1.0);
    /// From 0 to 1.
    pub const SHARE: Self = Self::new("a number from 0 to 1", |v| (0.0..=1.0).contains(&v));
    /// From 0 to 1, without 0.
    pub const SHARE_ABOVE_0: Self = Self::new("a number above 0, at most 1", |v| v > 0.0 && v <= 1.0);
    /// From 0 to 1, without 1.
    pub const BELOW_1: Self = Self::new("a number from 0 to 1", |v| (0.0..1.0).contains(&v));
    /// Finite and not negative.
    pub const WEIGHT: Self = Self::new("a number that is not negative", |v| v >= 0.0 && v.is_finite());
    /// Finite and above 0.
    pub const POSITIVE: Self = Self::new("a positive number", |v| v > 0.0 && v.is_finite());
    /// Above 0; infinity is a threshold that nothing reaches.
    pub const THRESHOLD: Self = Self::new("a positive number", |v| v > 0.0);

    /// The values for which `holds` is true. `words` complete "must be".
    pub const fn new(words: &'static str, holds: fn(f64) -> bool) -> Self {
        Self { words, holds }
    }

    /// The words that complete "must be".
    pub fn words(self) -> &'static str {
        self.words
    }

    /// Whether a value is in the range.
    pub fn contains(self, value: f64) -> bool {
        (self.holds)(value)
    }
}

/// A numeric setting.
pub(super) trait Number: Copy {
    /// The value as f64.
    fn number(self) -> f64;
}

impl Number for f64 {
    fn number(self) -> f64 {
        self
    }
}

impl Number for u32 {
    fn number(self) -> f64 {
        f64::from(self)
    }
}
