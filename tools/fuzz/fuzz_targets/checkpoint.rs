//! Checkpoints with correct checksums, down to the state of a training.
#![no_main]

use std::sync::LazyLock;

use libfuzzer_sys::fuzz_target;
use psrgs_vk::format::checkpoint::Checkpoint;
use psrgs_vk::train::Checkpointed;
use psrgs_vk_fuzz::checkpoints::sealed;
use psrgs_vk_fuzz::{Scratch, begin, seeds, within};

static FOLDER: LazyLock<Scratch> = LazyLock::new(Scratch::new);

fuzz_target!(init: begin(seeds::runs::checkpoints), |data: &[u8]| {
    let file = FOLDER.put("input.ckpt", &sealed(data));
    within(data.len(), 64, || {
        let Ok(checkpoint) = Checkpoint::read(&file) else { return };
        let copy = FOLDER.path().join("copy.ckpt");
        checkpoint.write(&copy).expect("a checkpoint that was read can be written");
        let again = Checkpoint::read(&copy).expect("and read again");
        assert!(again.names().eq(checkpoint.names()));
        if let Ok(training) = Checkpointed::from_checkpoint(&checkpoint) {
            let state = &training.restart.state;
            assert_eq!(state.params[0].len(), 3 * state.ids.len());
        }
    });
});
