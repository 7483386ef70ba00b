use super::*;

/// A similarity far from identity, and points about 4.6e6 away from zero.
fn truth() -> Similarity {
    let (s, c) = 0.7_f64.sin_cos();
    let rows = [[0.0, -3.0, 0.0, 40.0], [3.0 * c, 0.0, -3.0 * s, -20.0], [3.0 * s, 0.0, 3.0 * c, 7.0]];
    Similarity::from_rows(&rows).expect("a similarity")
}

/// Pairs over an area of 100 m, with noise in deviations of their own.
fn pairs(n: usize, deviation: [f64; 3], seed: u64) -> Vec<Pair> {
    let mut random = Random::new(seed);
    let back = truth().inverse();
    let mut pair = || {
        let at = [random.range(-50.0, 50.0), random.range(-50.0, 50.0), random.range(45.0, 50.0)];
        let place = std::array::from_fn(|k| at[k] + deviation[k] * random.normal());
        Pair { point: back.point(at), place, deviation: deviation.map(|v| v.max(1e-3)) }
    };
    (0..n).map(|_| pair()).collect()
}

fn off(found: &Similarity) -> f64 {
    let back = truth().inverse();
    let corners = [[-50.0, -50.0, 0.0], [50.0, -50.0, 0.0], [50.0, 50.0, 0.0], [0.0, 0.0, 50.0]];
    let distance = |at: [f64; 3]| {
        let got = found.point(back.point(at));
        (0..3).map(|k| (got[k] - at[k]).powi(2)).sum::<f64>().sqrt()
    };
    corners.into_iter().map(distance).fold(0.0, f64::max)
}

#[track_caller]
fn same(a: &Similarity, b: &Similarity) {
    let farthest = a.rows().into_iter().flatten().zip(b.rows().into_iter().flatten()).map(|(a, b)| (a - b).abs());
    assert!(farthest.fold(0.0, f64::max) < 1e-6, "{a:?} {b:?}");
}

#[test]
fn exact_pairs_give_the_exact_similarity() {
    for n in [3, 4, 30] {
        let found = fit(&pairs(n, [0.0; 3], 3), 3.0).expect("a fit");
        assert!(
            off(&found.similarity) < 1e-9 && found.used.iter().all(|used| *used),
            "{n}: {}",
            off(&found.similarity)
        );
    }
}

#[test]
fn gross_errors_are_found_and_left_out() {
    let noise = [1.5, 1.5, 3.0];
    let sound = pairs(60, noise, 5);
    let mut wrong = sound.clone();
    for k in [3, 20, 21, 40, 55] {
        wrong[k].place[0] += 40.0 + k as f64;
        wrong[k].place[2] -= 25.0;
    }
    let found = fit(&wrong, 0.1).expect("a fit");
    let left_out: Vec<usize> = (0..60).filter(|k| !found.used[*k]).collect();
    assert_eq!(left_out, [3, 20, 21, 40, 55]);
    let without: Vec<Pair> = (0..60).filter(|k| found.used[*k]).map(|k| sound[k]).collect();
    same(&found.similarity, &fit(&without, 0.1).expect("a fit").similarity);
    assert!(fit(&sound, 0.1).expect("a fit").used.iter().filter(|used| !**used).count() <= 1);
}

#[test]
fn one_gross_error_of_five_is_found() {
    for at in 0..5 {
        let mut few = pairs(5, [0.01; 3], 9);
        few[at].place[1] += 1.0;
        let found = fit(&few, 3.0).expect("a fit");
        assert_eq!((0..5).filter(|k| !found.used[*k]).collect::<Vec<_>>(), [at]);
        let without: Vec<Pair> = (0..5).filter(|k| *k != at).map(|k| few[k]).collect();
        same(&found.similarity, &fit(&without, 3.0).expect("a fit").similarity);
    }
}

#[test]
fn deviations_weigh_the_pairs() {
    let mut mixed = pairs(40, [3.0, 3.0, 5.0], 11);
    for (pair, exact) in mixed.iter_mut().zip(pairs(10, [0.02; 3], 12)) {
        *pair = exact;
    }
    let weighed = off(&fit(&mixed, 0.1).expect("a fit").similarity);
    mixed.iter_mut().for_each(|pair| pair.deviation = [1.0; 3]);
    let alike = off(&fit(&mixed, 0.1).expect("a fit").similarity);
    assert!(weighed < 0.1 && alike > 0.2, "{weighed} {alike}");
}

#[test]
fn unknown_heights_count_for_nothing() {
    let mut some = pairs(20, [0.01; 3], 13);
    for pair in &mut some[..12] {
        pair.place[2] = 1e6;
        pair.deviation[2] = f64::INFINITY;
    }
    let found = fit(&some, 3.0).expect("a fit");
    assert!(off(&found.similarity) < 0.1, "{}", off(&found.similarity));
    assert!(found.residuals[0][2].is_nan() && found.residuals[19][2].is_finite());
    some.iter_mut().for_each(|pair| pair.deviation[2] = f64::INFINITY);
    assert_eq!(fit(&some, 3.0), Err(NoFit::NoHeights(0)));
}

#[test]
fn pairs_that_leave_the_similarity_open_are_refused() {
    assert_eq!(fit(&pairs(2, [0.0; 3], 1), 3.0), Err(NoFit::TooFew(2)));
    let back = truth().inverse();
    let strip = |width: f64| -> Vec<Pair> {
        let at = |k: i32| [10.0 * f64::from(k), width * f64::from(k % 2), 50.0];
        let pair = |k: i32| Pair { point: back.point(at(k)), place: at(k), deviation: [1.5, 1.5, 3.0] };
        (0..12).map(pair).collect()
    };
    assert!(matches!(fit(&strip(0.5), 0.1), Err(NoFit::OnALine { .. })));
    assert!(fit(&strip(30.0), 0.1).is_ok());
    let same = vec![Pair { point: [1.0; 3], place: [2.0; 3], deviation: [1.0; 3] }; 5];
    assert!(matches!(fit(&same, 0.1), Err(NoFit::OnALine { .. })));
    let mut random = Random::new(4);
    let mut chaos = pairs(30, [0.01; 3], 2);
    for pair in &mut chaos {
        pair.place = std::array::from_fn(|_| random.range(-50.0, 50.0));
    }
    assert!(matches!(fit(&chaos, 3.0), Err(NoFit::NoAgreement { .. })));
}
