//! Numbers in sentences: counts with their nouns, and fractions that are never "-0".

/// A whole number with a comma between thousands (`42,293`).
pub fn grouped(n: impl TryInto<u64>) -> String {
    indicatif::HumanCount(n.try_into().unwrap_or(u64::MAX)).to_string()
}

/// A count with its noun, given in the singular: `1 photograph`, `2 photographs`, `42,293 splats`.
pub fn counted(n: impl TryInto<u64>, noun: &str) -> String {
    let n = n.try_into().unwrap_or(u64::MAX);
    format!("{} {noun}{}", grouped(n), of_count(n, "", "s"))
}

/// `one` for a count of 1, otherwise `several`; for example `is` and `are`.
pub fn of_count<'a>(n: impl TryInto<u64>, one: &'a str, several: &'a str) -> &'a str {
    if n.try_into().is_ok_and(|n| n == 1) { one } else { several }
}

/// A number of steps with what it comes to for each photograph: `4,200 steps: 28 photographs, 150 looks each`.
pub fn steps_and_looks(steps: u32, photographs: usize) -> String {
    let each = f64::from(steps) / photographs.max(1) as f64;
    let looks = if each < 10.0 { fraction(each, 1) } else { grouped(each.round() as u64) };
    format!("{}: {}, {looks} looks each", counted(steps, "step"), counted(photographs, "photograph"))
}

/// A number with `digits` decimal places. A number that rounds to zero has no sign.
pub fn fraction(value: f64, digits: usize) -> String {
    let text = format!("{value:.digits$}");
    match text.strip_prefix('-') {
        Some(rest) if is_zero(rest) => rest.to_owned(),
        _ => text,
    }
}

/// A difference with its sign and `digits` decimal places. A difference that rounds to zero is `+0`.
pub fn signed(value: f64, digits: usize) -> String {
    let text = format!("{value:+.digits$}");
    match text.strip_prefix('-') {
        Some(rest) if is_zero(rest) => format!("+{rest}"),
        _ => text,
    }
}

/// A share in percent: `percent(0.125, 1)` is `12.5 %`.
pub fn percent(share: f64, digits: usize) -> String {
    format!("{} %", fraction(100.0 * share, digits))
}

fn is_zero(digits: &str) -> bool {
    digits.bytes().all(|c| matches!(c, b'0' | b'.'))
}

/// The mean; `None` without values or where the mean is not finite.
pub fn mean(values: impl Iterator<Item = f64>) -> Option<f64> {
    let (sum, count) = values.fold((0.0, 0u32), |(s, n), v| (s + v, n + 1));
    Some(sum / f64::from(count)).filter(|m| m.is_finite())
}

/// The mean; `None` where a value is missing or [`mean`] gives `None`.
pub fn mean_if_all(values: impl Iterator<Item = Option<f64>>) -> Option<f64> {
    mean(values.collect::<Option<Vec<_>>>()?.into_iter())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_rounds_to_zero_has_no_minus() {
        assert_eq!([percent(-0.004, 0), percent(-0.0, 1), percent(-0.006, 0)], ["0 %", "0.0 %", "-1 %"]);
        assert_eq!([fraction(-0.004, 2), fraction(-0.005_1, 2), fraction(0.0, 0)], ["0.00", "-0.01", "0"]);
        assert_eq!([signed(-0.004, 2), signed(-0.0, 1), signed(0.004, 2)], ["+0.00", "+0.0", "+0.00"]);
        assert_eq!([signed(-0.01, 2), signed(1.0, 1), fraction(f64::NEG_INFINITY, 1)], ["-0.01", "+1.0", "-inf"]);
    }

    #[test]
    fn looks_are_those_of_each_photograph() {
        assert_eq!(steps_and_looks(4200, 28), "4,200 steps: 28 photographs, 150 looks each");
        assert_eq!(steps_and_looks(2000, 9), "2,000 steps: 9 photographs, 222 looks each");
        assert_eq!(steps_and_looks(30_000, 1), "30,000 steps: 1 photograph, 30,000 looks each");
        assert_eq!(steps_and_looks(3, 2), "3 steps: 2 photographs, 1.5 looks each");
    }

    #[test]
    fn one_is_singular_and_thousands_have_commas() {
        let said = [0_u64, 1, 2, 999, 1000, 1_234_567].map(|n| counted(n, "splat"));
        assert_eq!(said, ["0 splats", "1 splat", "2 splats", "999 splats", "1,000 splats", "1,234,567 splats"]);
        assert_eq!([of_count(1_usize, "is", "are"), of_count(0_u32, "is", "are")], ["is", "are"]);
    }
}
