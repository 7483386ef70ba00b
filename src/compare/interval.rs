//! Mean differences of pairs with their 95 % intervals.

/// Two-sided 95 % quantiles of Student's t for 1 to 30 degrees of freedom.
const T95: [f64; 30] = [
    12.706, 4.303, 3.182, 2.776, 2.571, 2.447, 2.365, 2.306, 2.262, 2.228, 2.201, 2.179, 2.160, 2.145, 2.131, 2.120,
    2.110, 2.101, 2.093, 2.086, 2.080, 2.074, 2.069, 2.064, 2.060, 2.056, 2.052, 2.048, 2.045, 2.042,
];
/// That of the normal distribution, for more.
const NORMAL95: f64 = 1.96;

/// The mean of differences between pairs, and how far it can be trusted.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Difference {
    /// Number of pairs.
    pub pairs: usize,
    /// Their mean.
    pub mean: f64,
    /// Half the width of the 95 % interval; infinite for a single pair.
    pub half: f64,
}

impl Difference {
    /// Whether 0 is outside the interval.
    pub fn is_real(&self) -> bool {
        self.mean.abs() > self.half
    }
}

/// Of these differences, by Student's t; `None` where there are none.
pub fn paired(differences: &[f64]) -> Option<Difference> {
    let n = differences.len();
    if n == 0 {
        return None;
    }
    let mean = differences.iter().sum::<f64>() / n as f64;
    let squares: f64 = differences.iter().map(|d| (d - mean).powi(2)).sum();
    let half = match n {
        1 => f64::INFINITY,
        _ => {
            let t = T95.get(n - 2).copied().unwrap_or(NORMAL95);
            t * (squares / (n - 1) as f64 / n as f64).sqrt()
        }
    };
    Some(Difference { pairs: n, mean, half })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn intervals_are_those_of_the_textbook() {
        // Mean 2, deviation 1, three pairs: 4.303 / sqrt 3.
        let found = paired(&[1.0, 2.0, 3.0]).unwrap();
        assert!((found.mean - 2.0).abs() < 1e-12 && (found.half - 4.303 / 3.0_f64.sqrt()).abs() < 1e-9);
        assert!(!found.is_real());
        assert!(paired(&[1.0, 1.1, 0.9, 1.0]).unwrap().is_real());
        assert!(!paired(&[5.0]).unwrap().is_real(), "one pair says nothing");
        assert_eq!(paired(&[]), None);
        assert!(paired(&vec![0.0; 50]).is_some_and(|d| d.half == 0.0 && !d.is_real()));
    }
}
