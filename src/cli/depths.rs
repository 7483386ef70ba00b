//! Photographs of which no depth is known.

use psrgs_vk::stereo::{Skipped, WithoutDepth};

use super::console::Console;

/// Of which photographs no depth is known, a line for each reason.
pub(crate) fn without_depth(skipped: &[Skipped], console: &Console) {
    for why in WithoutDepth::ALL {
        let mut names = skipped.iter().filter(|skipped| skipped.why == why).map(|skipped| &skipped.name);
        let Some(first) = names.next() else { continue };
        let more = match names.count() {
            0 => String::new(),
            more => format!(" and {more} more"),
        };
        console.warn(format_args!("no depth is known of '{first}'{more}: {why}"));
    }
}
