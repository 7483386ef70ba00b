//! The passes of the prefix sum: each against its twin; the chain of three, and the single pass, against a plain sum.

use psrgs_vk::pass::plan::NO_COUNTER;
use psrgs_vk::pass::scan::{
    ADD, ADD_EMULATED, LOCAL_SIZE, ONCE, ONCE_EMULATED, ONCE_RUNS, Push, REDUCE, REDUCE_EMULATED, SPINE, SPINE_EMULATED,
};
use psrgs_vk::pass::{Pass, counters};
use psrgs_vk::scene::random::Random;
use psrgs_vk::vk::{Gpu, Subgroup};

use super::harness::{self, Words, bytes, garbage};

type Constants<'a> = &'a [(&'a str, u32)];

fn chain(gpu: &Gpu, passes: [&Pass; 4], given: Constants<'_>, words: &[u32], push: &Push) {
    let items = given.iter().find(|(name, _)| *name == "ITEMS").map_or(16, |&(_, items)| items);
    let at_once = given;
    // Only the form of one pass has workgroups of other sizes.
    let given = &given.iter().copied().filter(|(name, _)| *name != "LOCAL_SIZE").collect::<Vec<_>>();
    let n = words.len();
    let blocks = n.div_ceil((LOCAL_SIZE * items) as usize);
    let what = format!("{} of {n} words, {given:?}", passes[0].kernel.name);
    let mut counts = [7u32; counters::COUNT];
    if push.source != NO_COUNTER {
        counts[push.source as usize] = n as u32;
    }
    let mut source = words.to_vec();
    source.extend(Random::new(3).words(8));
    let (source, counts) = (bytes(&source), bytes(&counts));
    // One workgroup more than needed, which must write nothing.
    let groups = blocks as u32 + 1;
    let reduce =
        harness::run(gpu, passes[0], given, &[source.clone(), counts.clone(), garbage(blocks + 8)], push, groups);
    reduce.assert_same_bits(&what);
    let spine = harness::run(gpu, passes[1], given, &[counts.clone(), reduce.device[2].clone()], push, 1);
    spine.assert_same_bits(&what);
    let add = harness::run(
        gpu,
        passes[2],
        given,
        &[source.clone(), counts.clone(), spine.device[1].clone(), garbage(n + 8)],
        push,
        groups,
    );
    add.assert_same_bits(&what);
    let mut at_once = vec![(passes[3], at_once)];
    if gpu.caps().subgroup == Subgroup::Hardware(8) {
        at_once.push((&ONCE_RUNS, &[]));
    }
    for (pass, given) in at_once {
        let once = harness::run(gpu, pass, given, &[source.clone(), counts.clone(), garbage(n + 8)], push, 2);
        let what = format!("{} of {n} words, {push:?}", pass.kernel.name);
        once.assert_same_bits(&what);
        assert_eq!(once.device[2], add.device[3], "{what}: in one pass");
        assert_eq!(once.device[1], spine.device[0], "{what}: the total in one pass");
    }
    let value = |word: u32| if push.predicate != 0 { u32::from(word != 0) } else { word };
    let (mut sum, mut exact) = (0u32, 0u64);
    for (i, (&word, prefix)) in words.iter().zip(add.device::<u32>(3)).enumerate() {
        assert_eq!(prefix, sum, "{what}: word {i}");
        sum = sum.wrapping_add(value(word));
        exact += u64::from(value(word));
    }
    let total = u32::try_from(exact).unwrap_or(u32::MAX);
    assert_eq!(spine.device::<u32>(0)[counters::SCAN_TOTAL], total, "{what}");
}

pub fn run(gpu: &Gpu) {
    let hardware = [&REDUCE, &SPINE, &ADD, &ONCE];
    let emulated = [&REDUCE_EMULATED, &SPINE_EMULATED, &ADD_EMULATED, &ONCE_EMULATED];
    // The largest words whose sum over a workgroup (1,024 words) fits a word. Sums of longer lists do not fit.
    let mut source = Random::new(11);
    let mut words_of = |n: usize| source.words(n).into_iter().map(|w| w >> 10).collect::<Vec<_>>();
    let total = counters::SCAN_TOTAL as u32;
    let host = |n: usize| Push { source: NO_COUNTER, count: n as u32, divide: 1, multiply: 1, predicate: 0, total };
    let counted = Push { source: counters::PAIRS as u32, count: 1, divide: 1, multiply: 1, predicate: 1, total };
    for n in [0, 1, 15, 16, 17, 63, 64, 65, 1023, 1024, 1025, 2047, 2049, 10_000] {
        let words = words_of(n);
        let sparse: Vec<u32> = words.iter().map(|&w| if w % 3 == 0 { 0 } else { w }).collect();
        chain(gpu, hardware, &[], &words, &host(n));
        chain(gpu, hardware, &[], &sparse, &counted);
        chain(gpu, hardware, &[("LOCAL_SIZE", 512)], &words, &host(n));
        chain(gpu, hardware, &[("LOCAL_SIZE", 512), ("ITEMS", 4)], &sparse, &counted);
        for width in [8, 16, 32, 64] {
            chain(gpu, emulated, &[("EMULATED_WIDTH", width)], &words, &host(n));
            chain(gpu, emulated, &[("EMULATED_WIDTH", width)], &sparse, &counted);
        }
    }
    // One item per thread: a spine of several iterations.
    for n in [4095, 4096, 4097, 64 * 64 * 3 + 1] {
        let words = words_of(n);
        chain(gpu, hardware, &[("ITEMS", 1)], &words, &host(n));
        chain(gpu, hardware, &[("ITEMS", 1), ("LOCAL_SIZE", 512)], &words, &host(n));
        chain(gpu, emulated, &[("ITEMS", 1), ("EMULATED_WIDTH", 32)], &words, &counted_words(&counted));
    }
    // A count of words from a counter's table: ceil(n / 10) * 4.
    let table = Push { source: NO_COUNTER, count: 41, divide: 10, multiply: 4, predicate: 0, total };
    chain(gpu, hardware, &[], &words_of(20), &table);
    // More blocks than one iteration of the default spine.
    let many = words_of((1 << 20) + 3 * 1024 + 5);
    chain(gpu, hardware, &[], &many, &host(many.len()));
    // The largest sum of a word, and one more through the first word of a later iteration.
    let mut edge = vec![1 << 20; 4096];
    edge[4095] -= 1;
    for more in [0, 1] {
        edge[2048] = (1 << 20) + more;
        for passes in [hardware, emulated] {
            chain(gpu, passes, &[], &edge, &host(edge.len()));
        }
    }
}

fn counted_words(push: &Push) -> Push {
    Push { predicate: 0, ..*push }
}
