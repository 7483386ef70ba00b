//! Numbers and text for people.

use crate::numbers::fraction;
use std::fmt::Write;

/// Bytes with a decimal unit.
pub(super) fn bytes(n: u64) -> String {
    let units = ["B", "kB", "MB", "GB", "TB"];
    let mut value = n as f64;
    let mut unit = 0;
    while value >= 999.5 && unit + 1 < units.len() {
        value /= 1000.0;
        unit += 1;
    }
    if unit == 0 { format!("{n} B") } else { format!("{} {}", significant(value), units[unit]) }
}

/// A duration.
pub(super) fn duration(seconds: f64) -> String {
    if !seconds.is_finite() || seconds < 0.0 {
        return "\u{2013}".into();
    }
    if seconds < 1.0 {
        return format!("{} ms", significant(seconds * 1000.0));
    }
    if seconds < 59.95 {
        return format!("{seconds:.1} s");
    }
    let whole = seconds.round() as u64;
    let (h, m, s) = (whole / 3600, whole / 60 % 60, whole % 60);
    if h > 0 { format!("{h} h {m} min") } else { format!("{m} min {s} s") }
}

/// Three significant digits, without exponent.
pub(super) fn significant(value: f64) -> String {
    rounded(value, 3)
}

/// A number of significant digits, without exponent. The decade is that after rounding: 9.996 is "10.0".
pub(super) fn rounded(value: f64, digits: usize) -> String {
    if value == 0.0 || !value.is_finite() {
        return format!("{value}");
    }
    let scientific = format!("{value:.*e}", digits.saturating_sub(1));
    let decade: i32 = scientific.split_once('e').and_then(|(_, e)| e.parse().ok()).unwrap_or(0);
    let decimals = (digits as i32 - 1 - decade).clamp(0, 9) as usize;
    fraction(value, decimals)
}

/// An axis label: as many decimals as the step needs, thousands as k and M.
pub(super) fn tick(value: f64, step: f64) -> String {
    let (scaled, unit, step) = if value.abs() >= 1e6 {
        (value / 1e6, "M", step / 1e6)
    } else if value.abs() >= 1e4 {
        (value / 1e3, "k", step / 1e3)
    } else {
        (value, "", step)
    };
    let digits = (-(step * 1.0001).log10().floor()).clamp(0.0, 9.0) as usize;
    format!("{}{unit}", fraction(scaled, digits))
}

/// Decibels, or a dash.
pub(super) fn decibels(value: Option<f64>) -> String {
    value.map_or_else(|| "\u{2013}".into(), |v| if v.is_finite() { fraction(v, 2) } else { "\u{221e}".into() })
}

/// A file's relative address: percent-encoded where needed.
pub(super) fn link(path: &str) -> String {
    path.bytes().fold(String::new(), |mut out, b| {
        if b.is_ascii_alphanumeric() || b"-._~/".contains(&b) {
            out.push(char::from(b));
        } else {
            // Writing to a String cannot fail.
            let _ = write!(out, "%{b:02X}");
        }
        out
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn people_read_numbers() {
        assert_eq!([bytes(12), bytes(999_600), bytes(1_234_567)], ["12 B", "1.00 MB", "1.23 MB"]);
        assert_eq!(
            [significant(9.996), significant(99.96), significant(0.001_234), significant(-4567.0)],
            ["10.0", "100", "0.00123", "-4567"]
        );
        assert_eq!(
            [duration(0.0123), duration(59.9), duration(60.0), duration(3599.7), duration(f64::NAN)],
            ["12.3 ms", "59.9 s", "1 min 0 s", "1 h 0 min", "\u{2013}"]
        );
        assert_eq!(
            [tick(0.05, 0.05), tick(20_000.0, 5000.0), tick(2.5e6, 5e5), tick(1500.0, 500.0)],
            ["0.05", "20k", "2.5M", "1500"]
        );
    }

    #[test]
    fn links_are_percent_encoded() {
        assert_eq!(link("a b/ä.ply"), "a%20b/%C3%A4.ply");
    }
}
