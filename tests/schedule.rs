//! The schedule of the reference method, its quirks, scaled schedules, and the order of views.

use psrgs_vk::train::schedule::{Adam, DroppedSplats, Schedule};
use psrgs_vk::train::settings::{Background, Growth, Method, Settings};

fn schedule(change: impl FnOnce(&mut Settings)) -> Schedule {
    let mut settings = Settings::default();
    change(&mut settings);
    settings.check().expect("settings of the test");
    Schedule::new(&settings, 43)
}

/// Steps 1..=iterations at which `what` holds.
fn steps(schedule: &Schedule, what: impl Fn(u32) -> bool) -> Vec<u32> {
    (1..=schedule.iterations).filter(|&t| what(t)).collect()
}

fn densified(s: &Schedule) -> Vec<u32> {
    steps(s, |t| s.step(t).densify.is_some())
}

fn resets(s: &Schedule) -> Vec<u32> {
    steps(s, |t| s.step(t).reset_opacity)
}

#[test]
fn learning_rate_of_the_means_is_log_linear() {
    let s = schedule(|_| {});
    // exp of a straight line from ln 1.6e-4 at 0 to ln 1.6e-6 at 30,000: a factor 10 per 15,000 steps.
    for (t, want) in
        [(0, 1.6e-4), (1, 1.6e-4 * 10_f64.powf(-1.0 / 15_000.0)), (15_000, 1.6e-5), (30_000, 1.6e-6), (40_000, 1.6e-6)]
    {
        let got = s.step(t).rates.means;
        assert!((got / want - 1.0).abs() < 1e-12, "step {t}: {got} instead of {want}");
    }
    assert_eq!(s.step(1).rates.opacities, 0.025);
    assert_eq!(s.step(29_999).rates.sh_rest * 20.0, s.step(1).rates.sh_base);
}

#[test]
fn short_schedules_begin_with_higher_rates_that_fall() {
    let of = |iterations: u32, change: fn(&mut Settings)| {
        let s = schedule(|s| {
            (s.run.iterations, s.run.scale_schedule) = (iterations, true);
            change(s);
        });
        (s.step(0).rates, s.step(iterations).rates)
    };
    let close = |got: f64, want: f64| assert!((got / want - 1.0).abs() < 1e-12, "{got} instead of {want}");
    let published = schedule(|_| {}).step(0).rates;

    let (first, last) = of(1500, |_| {});
    let (gain, sh, left) = (20_f64.powf(0.5), 20_f64.powf(0.6), 20_f64.powf(-0.6));
    for (first, last, rate, gain) in [
        (first.rotations, last.rotations, published.rotations, gain),
        (first.scales, last.scales, published.scales, gain),
        (first.opacities, last.opacities, published.opacities, gain),
        (first.sh_base, last.sh_base, published.sh_base, gain),
        (first.sh_rest, last.sh_rest, published.sh_rest, sh),
    ] {
        close(first, rate * gain);
        close(last, rate * gain * left);
    }
    close(first.means, published.means * gain);
    close(last.means, published.means * gain / 100.0);

    let off: fn(&mut Settings) =
        |s| (s.optimiser.lr_scaling, s.optimiser.lr_scaling_sh, s.optimiser.lr_decay) = (0.0, 0.0, 0.0);
    let (first, last) = of(1500, off);
    assert_eq!(first, published);
    close(last.sh_rest, published.sh_rest);
    close(last.means, 1.6e-6);

    assert_eq!(of(60_000, |_| {}).0, published, "a schedule longer than published");
    assert_eq!(of(100, |_| {}).0, of(750, |_| {}).0, "a schedule shorter than those that were measured");
}

#[test]
fn harmonics_rise_every_thousand_steps() {
    let s = schedule(|_| {});
    let degrees: Vec<u32> = [1, 999, 1000, 1999, 2000, 2999, 3000, 30_000].map(|t| s.step(t).sh_degree).to_vec();
    assert_eq!(degrees, [0, 0, 1, 1, 2, 2, 3, 3]);
    assert_eq!(schedule(|o| o.model.sh_degree = 1).step(30_000).sh_degree, 1);
}

#[test]
fn wide_splats_are_split_after_the_next_density_change() {
    let at = |change: &dyn Fn(&mut Settings)| {
        let s = schedule(|s| change(s));
        steps(&s, |t| s.splits_wide(t))
    };
    assert_eq!(at(&|_| {}), Vec::<u32>::new());
    let split = |s: &mut Settings, at: f64| (s.density.split_wavelength, s.density.split_wavelength_at) = (1.0, at);
    assert_eq!(at(&|s| split(s, 0.1)), [3001]);
    assert_eq!(at(&|s| split(s, 0.100_1)), [3101], "with the statistics of all splats");
    assert_eq!([0.0, 0.8].map(|share| at(&|s| split(s, share))), [[1], [24_001]], "where nothing grows");
    assert_eq!(at(&|s| (split(s, 0.1), s.density.no_densify = true).0), Vec::<u32>::new());
}

#[test]
fn harmonics_of_few_splats_wait_for_the_end_of_growth() {
    let s = schedule(|s| s.model.sh_share = 0.3);
    let degrees: Vec<u32> = [999, 1000, 14_999, 15_000, 30_000].map(|t| s.step(t).sh_degree).to_vec();
    assert_eq!(degrees, [0, 1, 1, 3, 3]);
    assert_eq!(steps(&s, |t| s.settles_sh(t)), [15_000]);
    let still = schedule(|s| (s.model.sh_share, s.density.no_densify) = (0.3, true));
    assert_eq!(steps(&still, |t| still.settles_sh(t)), [2000]);
    assert_eq!([1999, 2000, 3000].map(|t| still.step(t).sh_degree), [1, 2, 3]);
    let none = |change: fn(&mut Settings)| steps(&schedule(change), |t| schedule(change).settles_sh(t)).len();
    assert_eq!((none(|_| {}), none(|s| (s.model.sh_share, s.model.sh_degree) = (0.3, 1))), (0, 0));
    let mut endless = Settings::default();
    (endless.model.sh_share, endless.run.iterations) = (0.3, 7000);
    let why = endless.check().expect_err("growth does not end").to_string();
    assert!(why.contains("sh-share") && why.contains("densify-until"), "{why}");
}

#[test]
fn densification_is_strictly_inside_its_interval() {
    let s = schedule(|_| {});
    let at = densified(&s);
    assert_eq!((at[0], at[1], *at.last().unwrap(), at.len()), (600, 700, 14_900, 144));
    assert!(s.step(14_999).accumulate && !s.step(15_000).accumulate);
    assert_eq!(s.density_changes(30_000), 144);
    assert_eq!(s.density_changes(599), 0);
    assert_eq!(s.density_changes(600), 1);
}

#[test]
fn nothing_follows_the_last_step() {
    let s = schedule(|s| s.run.iterations = 6000);
    assert!(densified(&s).contains(&5900) && !densified(&s).contains(&6000));
    assert_eq!(resets(&s), [3000]);
    assert_eq!(s.density_changes(6000), s.density_changes(5999));
}

#[test]
fn large_splats_are_pruned_after_the_first_reset_only() {
    let s = schedule(|_| {});
    assert!(!s.step(3000).densify.unwrap().prune_large);
    assert!(s.step(3100).densify.unwrap().prune_large);
}

#[test]
fn opacities_are_reset_while_growing() {
    assert_eq!(resets(&schedule(|_| {})), [3000, 6000, 9000, 12_000]);
    assert_eq!(
        resets(&schedule(|o| o.model.background = Background::White)),
        [500, 3000, 6000, 9000, 12_000],
        "a white background adds a reset where growth begins"
    );
    assert_eq!(resets(&schedule(|o| o.density.opacity_reset_interval = 0)), [0_u32; 0]);
}

#[test]
fn a_fixed_set_has_no_density_control_at_all() {
    let s = schedule(|o| o.density.no_densify = true);
    assert!(densified(&s).is_empty() && resets(&s).is_empty() && steps(&s, |t| s.step(t).accumulate).is_empty());
    assert_eq!(steps(&s, |t| s.step(t).adam != Adam::All), [30_000]);
}

#[test]
fn adam_skips_what_the_reference_skips() {
    // An interval that does not divide the interval of resets: some resets have no density change.
    let s = schedule(|o| {
        o.run.iterations = 8000;
        o.density.densify_interval = 700;
        o.density.opacity_reset_interval = 1000;
    });
    assert_eq!(s.step(700).adam, Adam::None);
    assert_eq!(s.step(1000).adam, Adam::AllButOpacities);
    assert!(s.step(7000).densify.is_some() && s.step(7000).reset_opacity);
    assert_eq!(s.step(7000).adam, Adam::None);
    assert_eq!(schedule(|_| {}).step(3000).adam, Adam::None, "density change and reset together");
    assert_eq!(schedule(|_| {}).step(30_000).adam, Adam::None, "last iteration");
    assert_eq!(schedule(|o| o.model.background = Background::White).step(500).adam, Adam::AllButOpacities);
}

#[test]
fn optimiser_steps_are_those_counted_one_by_one() {
    let schedules = [
        schedule(|o| o.run.iterations = 4000),
        schedule(|o| o.model.background = Background::White),
        schedule(|o| {
            o.run.iterations = 7000;
            o.density.densify_interval = 700;
            o.density.opacity_reset_interval = 1000;
            o.model.background = Background::White;
        }),
        schedule(|o| {
            o.run.iterations = 1500;
            o.run.scale_schedule = true;
        }),
        schedule(|o| o.density.no_densify = true),
    ];
    for s in schedules {
        let (mut all, mut opacities) = (0, 0);
        for t in 1..=s.iterations {
            let plan = s.step(t);
            all += u32::from(plan.adam != Adam::None);
            opacities += u32::from(plan.adam == Adam::All);
            assert_eq!((plan.adam_steps, plan.adam_steps_opacities), (all, opacities), "step {t} of {s:?}");
        }
    }
}

#[test]
fn a_scaled_schedule_of_full_length_is_the_reference() {
    let (plain, scaled) = (schedule(|_| {}), schedule(|o| o.run.scale_schedule = true));
    for t in 1..=30_000 {
        assert_eq!(plain.step(t), scaled.step(t));
    }
}

#[test]
fn a_short_schedule_densifies_seldom_with_room_after_resets() {
    let s = schedule(|o| {
        o.run.iterations = 500;
        o.run.scale_schedule = true;
    });
    assert_eq!((s.densify_from, s.densify_until, s.densify_interval), (8, 250, 43), "at least a pass over the views");

    let s = schedule(|o| {
        o.run.iterations = 900;
        o.run.scale_schedule = true;
    });
    assert_eq!(s.densify_interval, 60, "at least a fifteenth of the steps");

    let s = schedule(|o| {
        o.run.iterations = 1500;
        o.run.scale_schedule = true;
    });
    assert_eq!((s.densify_from, s.densify_until, s.densify_interval), (25, 750, 100));
    assert_eq!((s.sh_interval, s.lr_means_steps, s.reset_interval), (50, 1500, 500));
    assert_eq!(densified(&s).first(), Some(&100));
    assert_eq!(densified(&s).last(), Some(&700));
    assert_eq!(resets(&s), [0_u32; 0], "500 is less than 300 steps before 750");

    let s = schedule(|o| {
        o.run.iterations = 7000;
        o.run.scale_schedule = true;
    });
    assert_eq!((s.densify_until, s.densify_interval, s.reset_interval), (3500, 100, 700));
    assert_eq!(resets(&s), [700, 1400, 2100, 2800]);

    let mut settings = Settings::default();
    settings.run.iterations = 1600;
    settings.run.scale_schedule = true;
    let many = Schedule::new(&settings, 900);
    assert_eq!(many.densify_interval, 100, "never above the reference's");

    // Steps that change density do not optimise: with an interval of one step no step would.
    settings.density.densify_interval = 1;
    assert_eq!(Schedule::new(&settings, 43).densify_interval, 43, "at least a pass over all photographs");
    assert_eq!(Schedule::new(&settings, 900).densify_interval, 100);
    settings.density.densify_interval = 70;
    assert_eq!(Schedule::new(&settings, 43).densify_interval, 70);
    settings.run.scale_schedule = false;
    settings.density.densify_interval = 1;
    assert_eq!(Schedule::new(&settings, 43).densify_interval, 1, "the interval of the settings, without scaling");
    assert_eq!(resets(&many), [500], "500 is exactly 300 steps before 800");
}

#[test]
fn every_pass_shows_every_view_once_in_a_new_order() {
    let s = schedule(|_| {});
    let passes: Vec<Vec<usize>> = (0..50).map(|p| (1..=43).map(|i| s.view_at(43 * p + i)).collect()).collect();
    for pass in &passes {
        let mut sorted = pass.clone();
        sorted.sort_unstable();
        assert_eq!(sorted, (0..43).collect::<Vec<_>>());
    }
    for (i, a) in passes.iter().enumerate() {
        assert!(passes[i + 1..].iter().all(|b| a != b), "pass {i} repeats itself");
    }
    let other = schedule(|o| o.run.seed = 1);
    assert_ne!((1..=43).map(|i| other.view_at(i)).collect::<Vec<_>>(), passes[0]);
}

#[test]
fn first_views_are_spread_evenly() {
    // 4,300 passes over 43 views: each view comes first 100 times, standard deviation 10.
    let s = schedule(|_| {});
    let mut first = [0_i32; 43];
    (0..4300).for_each(|p| first[s.view_at(43 * p + 1)] += 1);
    let chi2: f64 = first.iter().map(|&n| f64::from(n - 100).powi(2) / 100.0).sum();
    assert!((15.0..90.0).contains(&chi2), "chi squared with 42 degrees of freedom: {chi2}");
}

#[test]
fn few_views_are_no_special_case() {
    let of = |views| Schedule::new(&Settings::default(), views);
    assert_eq!((of(0).view_at(5), of(1).view_at(5)), (0, 0));
    let two = of(2);
    assert!((0..20).all(|p| two.view_at(2 * p + 1) != two.view_at(2 * p + 2)));
}

#[test]
fn perceptual_steps_look_at_the_views_of_the_steps_before() {
    let s = schedule(|s| {
        s.run.iterations = 400;
        s.frequencies.low_stage = 0.25;
        (s.texture.lambda_perceptual, s.texture.perceptual_every, s.texture.perceptual_views) = (0.1, 10, 4);
    });
    for t in 1..=400 {
        let Some(step) = s.step(t).perceptual else {
            assert!(t <= 100 || !t.is_multiple_of(10), "step {t} has none");
            continue;
        };
        assert!(t > 100 && t.is_multiple_of(10), "step {t}");
        // Each view once, the oldest first. Where a pass over the views ends, one may be the step's own view.
        let mut wanted: Vec<usize> = Vec::new();
        for view in (t - 3..t).rev().map(|before| s.view_at(before)) {
            if view != s.view_at(t) && !wanted.contains(&view) {
                wanted.insert(0, view);
            }
        }
        assert_eq!(step.beside().iter().map(|b| b.view).collect::<Vec<_>>(), wanted, "step {t}");
        assert!(step.beside().iter().all(|b| (1..=s.step(t).seen).contains(&b.seen)));
        assert!((step.times * (1 + wanted.len()) as f64 - 10.0).abs() < 1e-12, "a step carries the weight of ten");
    }
    // With reduced photographs, and with a single view.
    let reduced = schedule(|s| {
        (s.run.iterations, s.frequencies.coarse_steps) = (400, 1.0);
        (s.texture.lambda_perceptual, s.texture.perceptual_every, s.texture.perceptual_views) = (0.1, 10, 4);
    });
    assert!((10..=400).step_by(10).all(|t| reduced.step(t).perceptual.is_some_and(|p| p.beside().is_empty())));
    let mut settings = Settings::default();
    (settings.texture.lambda_perceptual, settings.texture.perceptual_views) = (0.1, 8);
    let one = Schedule::new(&settings, 1);
    assert!((12..=240).step_by(12).all(|t| one.step(t).perceptual.is_some_and(|p| p.beside().is_empty())));
}

#[test]
fn random_backgrounds_depend_on_the_step_only() {
    let s = schedule(|o| o.model.background = Background::Random);
    let colour = s.step(7).background;
    assert_eq!(colour, s.step(7).background);
    assert_ne!(colour, s.step(8).background);
    let mean: f32 = (1..=3000).flat_map(|t| s.step(t).background).sum::<f32>() / 9000.0;
    assert!((mean - 0.5).abs() < 0.02, "mean {mean}");
    assert!((1..=3000).flat_map(|t| s.step(t).background).all(|c| (0.0..1.0).contains(&c)));
}

#[test]
fn a_limited_set_is_recycled_while_it_grows() {
    let recycled = |s: &Schedule| steps(s, |t| matches!(s.drops(t), Some(DroppedSplats::Lightest(_))));
    let s = schedule(|s| s.density.recycle_share = 0.2);
    // Three passes over 43 views are 129 steps: after every second change, except the last.
    let wanted: Vec<u32> = (600..14_900).step_by(200).map(|t| t + 1).collect();
    assert_eq!(recycled(&s), wanted);
    assert!(recycled(&schedule(|_| {})).is_empty());
    assert!(recycled(&schedule(|s| (s.density.recycle_share, s.density.no_densify) = (0.2, true))).is_empty());
    // In a scaled schedule changes are 100 steps apart: after every second change.
    let scaled = |share: f64| {
        schedule(|s| {
            (s.run.iterations, s.run.scale_schedule) = (1500, true);
            (s.density.recycle_share, s.density.prune_weight) = (share, 0.03);
        })
    };
    assert_eq!(recycled(&scaled(0.2)), [201, 401, 601]);
    // Recycling does not change the drops after growth.
    let below = |s: &Schedule| steps(s, |t| matches!(s.drops(t), Some(DroppedSplats::Below(_))));
    assert_eq!(below(&scaled(0.2)), below(&scaled(0.0)));
    assert_eq!(below(&scaled(0.2)), [750, 1201]);
    let young = |share: f64| {
        let s = schedule(|s| {
            (s.run.iterations, s.run.scale_schedule) = (1500, true);
            (s.density.prune_young, s.density.prune_weight) = (share, 0.04);
        });
        [s.drops(750), s.drops(1201)]
    };
    assert_eq!(young(0.25), [Some(DroppedSplats::Below(0.01)), Some(DroppedSplats::Below(0.04))]);
    assert_eq!(young(0.0), [None, Some(DroppedSplats::Below(0.04))], "young splats stay");
}

/// At most 100 steps lie between changes. With more photographs, some were not shown, and splats in these photographs
/// alone must not count as unseen.
#[test]
fn nothing_is_unseen_before_all_photographs_were_looked_at() {
    let seen = |views: usize, scaled: bool| {
        let mut settings = Settings::of_method(Method::Psrgs);
        settings.run.scale_schedule = scaled;
        let schedule = Schedule::new(&settings, views);
        let changes: Vec<bool> =
            (1..=30_000).filter_map(|t| schedule.step(t).densify).map(|change| change.sees_all).collect();
        assert!(changes.len() > 80, "{views}");
        // More steps lie before the first change than between later changes.
        (changes[0], changes[1..].iter().all(|all| *all), changes[1..].iter().any(|all| *all))
    };
    for scaled in [false, true] {
        assert_eq!(seen(100, scaled), (true, true, true));
        assert_eq!(seen(101, scaled), (true, false, false));
        assert_eq!(seen(500, scaled), (true, false, false));
        assert_eq!(seen(5000, scaled), (false, false, false));
    }
}

#[test]
fn bands_of_a_photograph_follow_one_another() {
    let of = |bands: u32| schedule(|s| s.run.bands = bands);
    let (whole, s) = (of(1), of(3));
    assert_eq!((whole.step(1).band, whole.step(2).seen, whole.step(44).seen), (None, 1, 2));
    for t in 1..=3 * 43 * 2 {
        let band = s.step(t).band.expect("a part");
        assert_eq!((band.index, band.of), ((t - 1) % 3, 3));
        assert_eq!(s.view_at(t), whole.view_at(t.div_ceil(3)), "step {t}");
        // Every step with the photograph counts.
        let before = (1..=t).filter(|&earlier| s.view_at(earlier) == s.view_at(t)).count();
        assert_eq!(s.step(t).seen as usize, before, "step {t}");
    }
}

/// Steps see a whole photograph where they need one: depths, gradient maps, the perceptual distance, learned widths,
/// and reduced photographs.
#[test]
fn steps_that_need_more_than_colours_see_the_whole_photograph() {
    let whole = |change: fn(&mut Settings)| {
        let s = schedule(|s| {
            (s.run.iterations, s.run.bands, s.frequencies.coarse_steps) = (600, 2, 0.0);
            change(s);
        });
        steps(&s, |t| s.step(t).band.is_none())
    };
    let every = |n: u32, from: u32, to: u32| (from..=to).filter(|t| t.is_multiple_of(n)).collect::<Vec<_>>();
    assert!(whole(|_| {}).is_empty());
    assert_eq!(whole(|s| s.frequencies.coarse_steps = 0.1), every(1, 1, 60));
    let depths = |s: &mut Settings| {
        s.geometry.depth_prior = psrgs_vk::train::settings::DepthPrior::Stereo;
        (s.geometry.depth_steps, s.geometry.depth_every) = (0.5, 4);
    };
    assert_eq!(whole(depths), every(4, 1, 300));
    let perceptual = |s: &mut Settings| (s.texture.lambda_perceptual, s.texture.perceptual_every) = (0.1, 10);
    let (got, s) = (whole(perceptual), Settings::default());
    let low = (s.frequencies.low_stage * 600.0).round() as u32;
    assert_eq!(got, every(10, low + 1, 600));
}

/// The additional views of a step are of other photographs, however many steps each photograph takes.
#[test]
fn perceptual_steps_of_bands_look_at_as_many_photographs() {
    let views = |bands: u32| {
        let s = schedule(|s| {
            (s.run.bands, s.texture.lambda_perceptual) = (bands, 0.1);
            (s.texture.perceptual_every, s.texture.perceptual_views) = (1, 4);
        });
        let at = 20_001;
        let step = s.step(at).perceptual.expect("one");
        step.beside().iter().map(|beside| beside.view).chain([s.view_at(at)]).collect::<Vec<_>>()
    };
    for bands in 1..=3 {
        let mut seen = views(bands);
        seen.sort_unstable();
        seen.dedup();
        assert_eq!(seen.len(), 4, "{bands} bands");
    }
}

/// Where steps see a band of a photograph, a pass over all photographs takes a step per band.
#[test]
fn looks_at_all_photographs_take_a_step_for_each_band() {
    let of = |bands: u32| {
        schedule(|s| (s.run.bands, s.run.iterations, s.run.scale_schedule) = (bands, 1500, true)).densify_interval
    };
    // Two bands of 43 photographs take 86 steps, and 100 lie between changes. Four bands take 172.
    assert_eq!([of(1), of(2), of(4)], [100, 100, 172]);
    let seen = |bands: u32| {
        let mut settings = Settings::of_method(Method::Psrgs);
        (settings.run.scale_schedule, settings.run.bands) = (true, bands);
        let schedule = Schedule::new(&settings, 60);
        (1..=30_000).filter_map(|t| schedule.step(t).densify).skip(1).all(|change| change.sees_all)
    };
    assert!(seen(1) && seen(2), "growth waits for the whole pass");
}

#[test]
fn relocations_are_as_published_and_for_more_in_fewer_steps() {
    let mcmc = |iterations: u32| {
        let mut s = Settings::of_method(Method::Mcmc);
        (s.run.iterations, s.run.scale_schedule) = (iterations, iterations < 30_000);
        Schedule::new(&s, 20)
    };
    let published = mcmc(30_000);
    let due = steps(&published, |t| published.relocates(t).is_some());
    assert_eq!((due[0], due[1], due[due.len() - 1], due.len()), (601, 701, 24_901, 244));
    assert!((published.relocates(601).expect("growth") - 0.05).abs() < 1e-12);
    let other = |t: u32| {
        let plan = published.step(t);
        plan.densify.is_some() || plan.reset_opacity || plan.accumulate || plan.adam != Adam::All
    };
    assert_eq!(steps(&published, other), [30_000], "the last step has no optimiser step");
    // Of a hundredth of the steps: growth as in the published steps of the same share.
    let short = mcmc(300);
    let due = steps(&short, |t| short.relocates(t).is_some());
    let growth = due.iter().map(|&t| (1.0 + short.relocates(t).expect("growth")).ln()).sum::<f64>();
    assert!((growth / (244.0 * 1.05_f64.ln()) - 1.0).abs() < 0.1, "{growth} in {due:?}");
    let still = schedule(|s| (s.density.growth, s.density.no_densify) = (Growth::Relocated, true));
    assert!(steps(&still, |t| still.relocates(t).is_some()).is_empty());
}

/// Stages are shares of all steps, so one that is over would begin again where more steps are asked for.
#[test]
fn a_stage_of_all_steps_goes_on_with_more_steps() {
    let again = |share: f64, former: u32, iterations: u32| {
        let mut settings = Settings::default();
        settings.run.iterations = iterations;
        settings.geometry.depth_prior = psrgs_vk::train::settings::DepthPrior::Stereo;
        settings.geometry.depth_steps = share;
        Schedule::begins_again(&settings, former, former)
    };
    assert_eq!(again(0.5, 40, 100), Some("that of the loss on depth and normals"));
    assert_eq!(again(0.5, 40, 60), None);
    assert_eq!(again(1.0, 40, 100), None);
}

/// A reset or a relocation makes splats fainter than the alpha cutoff of early steps: they would not come back.
#[test]
fn early_steps_end_before_splats_are_made_faint() {
    let last = |change: &dyn Fn(&mut Settings)| {
        let mut settings = Settings::of_method(Method::Psrgs);
        change(&mut settings);
        let schedule = Schedule::new(&settings, 30);
        (1..=schedule.iterations).rev().find(|t| schedule.step(*t).alpha_cutoff == Some(64))
    };
    assert_eq!(last(&|_| ()), Some(22_500));
    assert_eq!(last(&|s| s.density.opacity_reset_interval = 3000), Some(3000));
    assert_eq!(last(&|s| s.density.growth = Growth::Relocated), Some(500));
    let on_white = |s: &mut Settings| {
        s.density.opacity_reset_interval = 3000;
        s.model.background = Background::White;
    };
    assert_eq!(last(&on_white), Some(500));
}
