//! Steps that leave out a share of the splats.

use psrgs_vk::train::{Pacing, Settings};

use super::common::{self, plane_scene};
use super::{assert_same, run, settings};

const STEPS: u32 = 40;

#[test]
fn leaving_out_splats_repeats_and_ends_when_it_is_to() {
    let Some(gpu) = common::gpu() else { return };
    let input = plane_scene::input(5, 64, 48, 300);
    let trained = |share: f64, until: f64| {
        let mut settings: Settings = settings(STEPS);
        (settings.optimiser.drop_share, settings.optimiser.drop_until) = (share, until);
        run(&gpu, input.clone(), &settings, Pacing::default())
    };
    let (none, some) = (trained(0.0, 1.0), trained(0.3, 1.0));
    assert_ne!(none.losses, some.losses);
    assert_same(&some.state, &trained(0.3, 1.0).state, "the same draws again");
    assert_same(&none.state, &trained(0.3, 0.0).state, "no step leaves out splats");
    let half = trained(0.3, 0.5);
    assert_eq!(some.losses[..20], half.losses[..20]);
    assert_ne!(some.losses[20], half.losses[20]);
    common::assert_no_messages(&gpu);
}
