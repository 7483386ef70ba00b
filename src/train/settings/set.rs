//! Sets single settings by key.

use super::{Key, Settings, SettingsError};

impl Settings {
    /// Every key that [`Settings::set`] takes, with the name of its group in `settings.toml`.
    pub fn all_keys() -> Vec<(&'static str, Key)> {
        let groups = [
            ("run", super::Run::keys()),
            ("photographs", super::Photographs::keys()),
            ("model", super::Model::keys()),
            ("optimiser", super::Optimiser::keys()),
            ("density", super::Density::keys()),
            ("frequencies", super::Frequencies::keys()),
            ("geometry", super::Geometry::keys()),
            ("texture", super::Texture::keys()),
            ("shortcuts", super::Shortcuts::keys()),
            ("scoring", super::Scoring::keys()),
            ("device", super::DeviceChoice::keys()),
            ("host", super::HostChoice::keys()),
            ("blending", super::BlendingVariants::keys()),
            ("stepping", super::SteppingVariants::keys()),
        ];
        groups.into_iter().flat_map(|(group, keys)| keys.into_iter().map(move |key| (group, key))).collect()
    }

    /// Sets the value of a key, such as `sample-rate` to `0.3`, in the spelling of `settings.toml`. Quotes are
    /// optional.
    pub fn set(&mut self, key: &str, value: &str) -> Result<(), SettingsError> {
        let keys = Self::all_keys();
        let Some((group, _)) = keys.iter().find(|(_, known)| known.name == key) else {
            return Err(SettingsError::UnknownKey { key: key.to_owned(), nearest: nearest(key, &keys) });
        };
        let typed = toml::from_str::<toml::Table>(&format!("value = {value}")).ok().and_then(|mut t| t.remove("value"));
        let word = toml::Value::String(value.to_owned());
        // `0` may be a number or the name of a device, and `700.0` a whole number.
        let whole = match &typed {
            Some(toml::Value::Float(number)) if number.fract() == 0.0 => Some(toml::Value::Integer(*number as i64)),
            _ => None,
        };
        let mut refused = None;
        for candidate in typed.into_iter().chain(whole).chain([word]) {
            let mut table = toml::Table::try_from(&*self)?;
            if let Some(toml::Value::Table(group)) = table.get_mut(*group) {
                group.insert(key.to_owned(), candidate);
            }
            match table.try_into::<Self>() {
                Ok(settings) => {
                    *self = settings;
                    return Ok(());
                }
                Err(error) => drop(refused.get_or_insert(error)),
            }
        }
        let message = refused.map_or_else(String::new, |error| error.message().to_owned());
        Err(SettingsError::BadValue { key: key.to_owned(), value: value.to_owned(), message })
    }
}

/// The known key with the most similar name, if any is similar.
fn nearest(key: &str, keys: &[(&'static str, Key)]) -> Option<String> {
    let closeness = |known: &str| strsim::jaro_winkler(key, known);
    let best = keys.iter().map(|(_, known)| &known.name).max_by(|a, b| closeness(a).total_cmp(&closeness(b)))?;
    (closeness(best) > 0.8).then(|| best.clone())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::train::settings::{Gate, Growth};

    #[test]
    fn a_value_is_set_by_its_key_whatever_its_kind() {
        let mut settings = Settings::default();
        for (key, value) in
            [("sample-rate", "0.3"), ("growth", "sampled"), ("max-splats", "500"), ("gate", "off"), ("device", "0")]
        {
            settings.set(key, value).unwrap_or_else(|error| panic!("{error}"));
        }
        settings.set("sigma-every", "20.0").unwrap();
        settings.set("split-along-gradient", "true").unwrap();
        assert_eq!((settings.density.sample_rate, settings.density.growth), (0.3, Growth::Sampled));
        assert_eq!((settings.density.max_splats, settings.frequencies.gate), (Some(500), Gate::Off));
        assert_eq!((settings.device.device.as_deref(), settings.frequencies.sigma_every), (Some("0"), 20));
        assert!(settings.density.split_along_gradient);
    }

    #[test]
    fn unknown_keys_and_bad_values_are_named() {
        let mut settings = Settings::default();
        let message = settings.set("sample-rat", "1").unwrap_err().to_string();
        assert!(message.contains("sample-rat") && message.contains("sample-rate"), "{message}");
        let message = settings.set("growth", "wild").unwrap_err().to_string();
        assert!(message.contains("growth") && message.contains("wild"), "{message}");
        assert!(settings.set("sample-rate", "much").unwrap_err().to_string().contains("much"));
        assert_eq!(settings, Settings::default(), "nothing was changed");
    }

    #[test]
    fn every_key_of_a_settings_file_can_be_set() {
        let table = toml::Table::try_from(Settings::default()).unwrap();
        let keys = Settings::all_keys();
        for (group, values) in table {
            for key in values.as_table().unwrap().keys() {
                assert!(keys.iter().any(|(of, known)| *of == group && known.name == *key), "{group}.{key}");
            }
        }
        let mut names: Vec<&String> = keys.iter().map(|(_, key)| &key.name).collect();
        let all = names.len();
        names.sort_unstable();
        names.dedup();
        assert_eq!(names.len(), all, "keys are unique over the groups");
    }

    #[test]
    fn defaults_are_in_their_ranges() {
        Settings::default().check().unwrap();
    }
}
