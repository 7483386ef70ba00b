//! `settings.toml`.
#![no_main]

use std::path::Path;
use std::sync::LazyLock;

use libfuzzer_sys::fuzz_target;
use psrgs_vk::train::Settings;
use psrgs_vk_fuzz::{Scratch, begin, seeds, within};

static FOLDER: LazyLock<Scratch> = LazyLock::new(Scratch::new);

fuzz_target!(init: begin(seeds::documents::settings), |data: &[u8]| {
    let file = FOLDER.put("settings.toml", data);
    within(data.len(), 1024, || {
        let _ = Settings::keys(&file);
        let Ok(settings) = Settings::read(&file) else { return };
        if settings.check().is_ok() {
            let text = settings.to_toml().expect("settings that make sense can be written");
            let again = Settings::from_toml(&text, Path::new("copy.toml")).expect("and read again");
            assert_eq!(again, settings, "{text}");
        }
    });
});
