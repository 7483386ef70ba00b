//! Mean differences of pairs: 95 % intervals by Student's t, and Holm's correction of several tests.

/// The mean of differences between pairs, and how far it can be trusted.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Difference {
    /// Number of pairs.
    pub pairs: usize,
    /// Their mean.
    pub mean: f64,
    /// Half the width of the 95 % interval. Infinite for a single pair.
    pub half: f64,
    /// How probable a mean at least as far from 0 is where there is no difference. 1 for a single pair.
    pub p: f64,
}

impl Difference {
    /// Whether 0 is outside the interval.
    pub fn is_real(&self) -> bool {
        self.mean.abs() > self.half
    }
}

/// The mean of these differences, by Student's t. `None` without differences.
pub fn paired(differences: &[f64]) -> Option<Difference> {
    let n = differences.len();
    if n == 0 {
        return None;
    }
    let mean = differences.iter().sum::<f64>() / n as f64;
    let squares: f64 = differences.iter().map(|d| (d - mean).powi(2)).sum();
    let (half, p) = match n {
        1 => (f64::INFINITY, 1.0),
        _ => {
            let error = (squares / (n - 1) as f64 / n as f64).sqrt();
            let p = if mean == 0.0 { 1.0 } else { 1.0 - within(mean.abs() / error, n - 1) };
            (quantile(0.95, n - 1) * error, p)
        }
    };
    Some(Difference { pairs: n, mean, half, p })
}

/// Holm's correction: probabilities as if each test were the only one, in the order of the tests.
pub fn holm(p: &[f64]) -> Vec<f64> {
    let mut order: Vec<usize> = (0..p.len()).collect();
    order.sort_by(|a, b| p[*a].total_cmp(&p[*b]));
    let (mut corrected, mut most) = (vec![1.0; p.len()], 0.0_f64);
    for (rank, at) in order.into_iter().enumerate() {
        most = most.max(p[at] * (p.len() - rank) as f64).min(1.0);
        corrected[at] = most;
    }
    corrected
}

/// The probability of Student's t between -t and t, by its finite series for whole degrees of freedom.
fn within(t: f64, degrees: usize) -> f64 {
    let angle = (t / (degrees as f64).sqrt()).atan();
    let (sine, cosine) = angle.sin_cos();
    let odd = degrees % 2 == 1;
    // cos + 2/3 cos^3 + 2 4 / (3 5) cos^5 ... for odd degrees, 1 + 1/2 cos^2 + 1 3 / (2 4) cos^4 ... for even ones.
    let (mut term, mut sum) = if odd { (cosine, cosine) } else { (1.0, 1.0) };
    let first = if odd { 3 } else { 2 };
    for k in (first..degrees).step_by(2) {
        term *= (k - 1) as f64 / k as f64 * cosine * cosine;
        sum += term;
    }
    match (odd, degrees) {
        (true, 1) => angle / std::f64::consts::FRAC_PI_2,
        (true, _) => (angle + sine * sum) / std::f64::consts::FRAC_PI_2,
        (false, _) => sine * sum,
    }
}

/// The t within which so much of Student's distribution lies.
fn quantile(share: f64, degrees: usize) -> f64 {
    let (mut low, mut high) = (0.0, 1e3);
    for _ in 0..100 {
        let middle = 0.5 * (low + high);
        if within(middle, degrees) < share { low = middle } else { high = middle }
    }
    0.5 * (low + high)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// With two degrees of freedom the quantile is 0.95 / sqrt(2 0.975 0.025).
    const T2: f64 = 4.302_652_729_696_142;

    #[test]
    fn intervals_are_those_of_the_textbook() {
        // Mean 2, deviation 1, three pairs.
        let found = paired(&[1.0, 2.0, 3.0]).unwrap();
        assert!((found.mean - 2.0).abs() < 1e-12 && (found.half - T2 / 3.0_f64.sqrt()).abs() < 1e-9);
        // t is 2 sqrt 3, and p is 1 - t / sqrt(2 + t^2) with two degrees of freedom.
        let t = 2.0 * 3.0_f64.sqrt();
        assert!((found.p - (1.0 - t / (2.0 + t * t).sqrt())).abs() < 1e-12, "{}", found.p);
        assert!(!found.is_real());
        assert!(paired(&[1.0, 1.1, 0.9, 1.0]).unwrap().is_real());
        let one = paired(&[5.0]).unwrap();
        assert!(!one.is_real() && one.p == 1.0, "one pair says nothing");
        assert_eq!(paired(&[]), None);
        assert!(paired(&vec![0.0; 50]).is_some_and(|d| d.half == 0.0 && !d.is_real() && d.p == 1.0));
        assert!(paired(&[2.0, 2.0]).is_some_and(|d| d.half == 0.0 && d.is_real() && d.p == 0.0));
    }

    /// From printed tables of Student's distribution, and its closed forms for one and two degrees of freedom.
    #[test]
    fn quantiles_of_t_are_those_of_tables() {
        assert!((quantile(0.95, 1) - (0.475 * std::f64::consts::PI).tan()).abs() < 1e-9);
        assert!((quantile(0.95, 2) - T2).abs() < 1e-9);
        let printed =
            [(3, 3.182), (4, 2.776), (5, 2.571), (7, 2.365), (8, 2.306), (9, 2.262), (30, 2.042), (120, 1.980)];
        for (degrees, t) in printed {
            assert!((quantile(0.95, degrees) - t).abs() < 6e-4, "{degrees}: {}", quantile(0.95, degrees));
        }
        for (degrees, t) in [(4, 4.604), (7, 3.499), (8, 3.355)] {
            assert!((quantile(0.99, degrees) - t).abs() < 6e-4, "{degrees}: {}", quantile(0.99, degrees));
        }
    }

    /// By hand: 4 x 0.005, then 3 x 0.01, then 2 x 0.03, and 0.04, which may not be below the one before.
    #[test]
    fn holm_multiplies_by_the_tests_that_are_left() {
        let close = |got: Vec<f64>, want: &[f64]| got.iter().zip(want).all(|(a, b)| (a - b).abs() < 1e-12);
        assert!(close(holm(&[0.01, 0.04, 0.03, 0.005]), &[0.03, 0.06, 0.06, 0.02]));
        assert!(close(holm(&[0.4, 0.9]), &[0.8, 0.9]));
        assert!(close(holm(&[0.6, 0.7]), &[1.0, 1.0]));
        assert!(holm(&[]).is_empty());
    }
}
