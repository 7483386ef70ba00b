//! `psrgs-vk bench --sort`: keys sorted per second.

use psrgs_vk::bench;

use super::{Args, failure, write};
use crate::cli::console::{self, Console};

pub(super) fn run(args: &Args, keys: u32, console: &Console) -> anyhow::Result<()> {
    let gpu = args.open(console)?;
    let report = bench::sort(&gpu, keys, args.bits, args.steps).map_err(failure)?;
    if let Some(file) = &args.json {
        write(file, &report, args.validate)?;
    }
    let text = format!(
        "{} keys with values by {} bits ({}, {} dispatches), sorted as they should be: {:.3} ms [{:.3}, {:.3}], {:.4} \
         10^9 keys per second\n{}",
        report.keys,
        report.bits,
        report.shape,
        report.dispatches,
        report.ms.median,
        report.ms.q1,
        report.ms.q3,
        report.gkeys_per_s,
        report.passes.iter().map(|(pass, ms)| format!("{pass} {ms:.3} ms\n")).collect::<String>(),
    );
    console::print(&text)
}
