//! Sizes in bytes: parsed from text such as `6GiB`, `800M` or plain digits, and formatted as text. K, M, G and T stand
//! for powers of 1024.

/// Each unit with the binary logarithm of its size in bytes.
pub(crate) const UNITS: [(&str, u32); 4] = [("T", 40), ("G", 30), ("M", 20), ("K", 10)];

/// The number of bytes that `word` gives. `None` where `word` is no number, or the number is below 1 or exceeds 64
/// bits.
pub(crate) fn parse(word: &str) -> Option<u64> {
    let end = word.find(|c: char| !c.is_ascii_digit() && c != '.').unwrap_or(word.len());
    let (digits, unit) = word.split_at(end);
    let unit = unit.trim().to_ascii_uppercase();
    let unit = unit.strip_suffix("IB").or_else(|| unit.strip_suffix('B')).unwrap_or(&unit);
    let shift = match unit {
        "" => 0,
        _ => UNITS.iter().find(|(name, _)| *name == unit)?.1,
    };
    let bytes = digits.parse::<f64>().ok()? * (1_u64 << shift) as f64;
    (1.0..u64::MAX as f64).contains(&bytes).then_some(bytes as u64)
}

/// A number of bytes as text in MiB, or in GiB from 1024 MiB on.
pub(crate) fn readable(bytes: u64) -> String {
    let mib = bytes as f64 / f64::from(1 << 20);
    if mib >= 1024.0 { format!("{:.2} GiB", mib / 1024.0) } else { format!("{mib:.1} MiB") }
}
