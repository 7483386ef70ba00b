//! `plan` and `finish`: counts around the edges of workgroups and axes, capacities, and a status that stays.

use psrgs_vk::pass::counters;
use psrgs_vk::pass::finish;
use psrgs_vk::pass::plan::{Entry, MOST_ON_AXIS, NO_COUNTER, PASS, Push};
use psrgs_vk::vk::Gpu;

use super::harness::{self, Outcome, bytes, garbage};

fn case(gpu: &Gpu, status: u32, count: u32, push: &Push) -> Outcome {
    let mut counts = [7u32; counters::COUNT];
    counts[counters::STATUS] = status;
    counts[counters::PAIRS] = count;
    counts[counters::WANT_PAIRS] = 1000;
    let outcome = harness::run(gpu, &PASS, &[], &[bytes(&counts), garbage(32 * 4)], push, 1);
    outcome.assert_same_bits(&format!("plan of {count} with status {status}"));
    outcome
}

/// Earlier entries are cleared exactly when the event is void.
fn voids(gpu: &Gpu, status: u32, count: u32, push: &Push) {
    let outcome = case(gpu, status, count, push);
    let (before, after) = (outcome.device::<[u32; 4]>(1), case(gpu, status, count, &push.voiding(0)).device(1));
    let void = outcome.device::<u32>(0)[counters::STATUS] != 0;
    for (i, (entry, kept)) in before.into_iter().zip(after).enumerate() {
        let own = (push.first..push.first + push.entries).contains(&(i as u32));
        let expected = if void && (own || i < 20) { [0; 4] } else { kept };
        assert_eq!(entry, expected, "entry {i} for {count} with status {status}");
    }
}

pub fn run(gpu: &Gpu) {
    let entries = [
        Entry::items(1),
        Entry::items(64),
        Entry::items(1024),
        Entry::fixed(1),
        Entry::fixed(100_000),
        Entry { divide: 1024, multiply: 256, items: 1024 },
        Entry { divide: 3, multiply: 5, items: 7 },
        Entry::items(u32::MAX),
    ];
    let source = counters::PAIRS as u32;
    let want = counters::WANT_PAIRS as u32;
    let capacity = 1 << 27;
    for count in
        [0, 1, 2, 63, 64, 65, 1023, 1024, 1025, 32_767, 32_768, 32_769, 65_536, 70_000, 1 << 26, capacity, capacity + 1]
    {
        for status in [0, counters::PAIRS_BIT, counters::SPLATS_BIT] {
            let push = Push::unlimited(source, 3, &entries).limited(capacity, counters::PAIRS_BIT, want);
            voids(gpu, status, count, &push.voiding(20));
            let outcome = case(gpu, status, count, &push);
            let counts = outcome.device::<u32>(0);
            let args = outcome.device::<[u32; 4]>(1);
            let expected = if status != 0 { status } else { u32::from(count > capacity) * counters::PAIRS_BIT };
            assert_eq!(counts[counters::STATUS], expected);
            let seen = if status == 0 { count.max(1000) } else { 1000 };
            assert_eq!(counts[counters::WANT_PAIRS], seen);
            for entry in &args[3..11] {
                assert!(expected == 0 || *entry == [0; 4], "a void event runs {entry:?}");
                assert!(entry[0] <= MOST_ON_AXIS && entry[1] <= 65_535);
            }
            if expected == 0 {
                let groups = |i: usize| u64::from(args[3 + i][0]) * u64::from(args[3 + i][1]);
                let exact = u64::from(count).div_ceil(64);
                assert!(groups(1) >= exact && groups(1) <= exact + exact / 32_768 + 1, "{count}: {:?}", args[4]);
                assert_eq!(args[6], [1, 1, 1, 0]);
                assert!(groups(4) >= 100_000);
            }
        }
    }
    case(gpu, 0, u32::MAX, &Push::unlimited(source, 0, &[Entry::items(64)]));
    case(gpu, 0, 5000, &Push { want: NO_COUNTER, ..Push::unlimited(source, 31, &[Entry::items(64)]) });
    case(gpu, 0, 5000, &Push::unlimited(source, 0, &[]));

    for (status, constrain, caught_up) in
        [(0, 0, finish::NOT_CAUGHT_UP), (0, 1, 123), (counters::SPLATS_BIT, 1, 123), (0, 0, 0)]
    {
        let mut counts = [7u32; counters::COUNT];
        (counts[counters::STATUS], counts[counters::NEXT_ID]) = (status, 31);
        let push = finish::Push { event: 99, constrain, caught_up };
        let buffers = [bytes(&counts), bytes(&[0.75f32, 0.5, 0.25, -1.0]), garbage(finish::REPORT_WORDS + 5)];
        let outcome = harness::run(gpu, &finish::PASS, &[], &buffers, &push, 1);
        outcome.assert_same_bits("finish");
        let (after, report) = (outcome.device::<u32>(0), outcome.device::<u32>(2));
        assert_eq!(after[counters::DONE], if status == 0 { 99 } else { 7 });
        assert_eq!(after[counters::CONSTRAINED], if status == 0 && constrain == 1 { 31 } else { 7 });
        let kept = status != 0 || caught_up == finish::NOT_CAUGHT_UP;
        assert_eq!(after[counters::CAUGHT_UP], if kept { 7 } else { caught_up });
        assert_eq!((report[counters::BAD_SPLATS], after[counters::BAD_SPLATS]), (7, 0), "reported once");
        assert_eq!(report[counters::COUNT..finish::REPORT_WORDS], [0.75f32, 0.5, 0.25].map(f32::to_bits));
    }
}
