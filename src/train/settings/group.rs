//! Declares groups of settings.

/// A key of `settings.toml`.
#[derive(Clone, Debug)]
pub struct Key {
    /// Name, such as `max-side`.
    pub name: String,
    /// Help text.
    pub help: &'static str,
    /// Default; empty for none.
    pub default: String,
    /// The values that it takes, worded to follow "must be".
    pub range: Option<&'static str>,
}

/// A value as in `settings.toml`, without quotes.
pub(super) fn spelled(value: &impl serde::Serialize) -> String {
    match toml::Value::try_from(value) {
        Ok(toml::Value::String(word)) => word,
        Ok(value) => value.to_string(),
        Err(_) => String::new(),
    }
}

/// Declares a group of settings, each with documentation, default and range (`; Range`).
///
/// `options`, `flags` and `optional` are command-line options and keys of `settings.toml`; the key is the option's name
/// without its dashes. `constants` and `unset` are keys only: methods choose their values, and `--set KEY=VALUE`
/// changes them. `optional` and `unset` have no default.
macro_rules! group {
    (
        $(#[$meta:meta])* pub struct $name:ident ($heading:literal)
        options { $($(#[doc = $vdoc:literal])+ #[arg($($varg:tt)*)] pub $value:ident : $vtype:ty = $default:expr $(; $vrange:expr)?,)* }
        flags { $($(#[doc = $fdoc:literal])+ $(#[arg($($farg:tt)*)])? pub $flag:ident,)* }
        optional { $($(#[doc = $odoc:literal])+ #[arg($($oarg:tt)*)] pub $option:ident : $otype:ty $(; $orange:expr)?,)* }
        constants { $($(#[doc = $cdoc:literal])+ pub $constant:ident : $ctype:ty = $cdefault:expr $(; $crange:expr)?,)* }
        unset { $($(#[doc = $udoc:literal])+ pub $unset:ident : $utype:ty $(; $urange:expr)?,)* }
    ) => {
        $(#[$meta])*
        #[derive(Clone, Debug, PartialEq, clap::Args, serde::Serialize, serde::Deserialize)]
        #[command(next_help_heading = $heading)]
        #[serde(default, deny_unknown_fields, rename_all = "kebab-case")]
        pub struct $name {
            $($(#[doc = $vdoc])+ #[arg(long, default_value_t = $default, $($varg)*)] pub $value: $vtype,)*
            $(
                $(#[doc = $fdoc])+
                #[arg(
                    long, value_name = "BOOL", num_args = 0..=1, require_equals = true, default_missing_value = "true",
                    default_value_t = false, action = clap::ArgAction::Set, hide_default_value = true,
                    hide_possible_values = true
                )]
                $(#[arg($($farg)*)])?
                pub $flag: bool,
            )*
            $(
                $(#[doc = $odoc])+
                #[arg(long, $($oarg)*)]
                #[serde(skip_serializing_if = "Option::is_none")]
                pub $option: Option<$otype>,
            )*
            $($(#[doc = $cdoc])+ #[arg(skip = { let value: $ctype = $cdefault; value })] pub $constant: $ctype,)*
            $(
                $(#[doc = $udoc])+
                #[arg(skip)]
                #[serde(skip_serializing_if = "Option::is_none")]
                pub $unset: Option<$utype>,
            )*
        }

        impl Default for $name {
            fn default() -> Self {
                Self {
                    $($value: $default,)*
                    $($flag: false,)*
                    $($option: None,)*
                    $($constant: $cdefault,)*
                    $($unset: None,)*
                }
            }
        }

        impl $name {
            /// The keys of this group.
            pub(super) fn keys() -> Vec<crate::train::settings::Key> {
                #[allow(unused_variables)]
                let key = |field: &str, help: &'static str, default: String, ranges: &[crate::train::settings::Range]| crate::train::settings::Key {
                    name: field.replace('_', "-"),
                    help: help.trim(),
                    default,
                    range: ranges.first().map(|range| range.words()),
                };
                vec![
                    $({
                        let default: $vtype = $default;
                        key(stringify!($value), concat!($($vdoc, "\n"),+), crate::train::settings::group::spelled(&default), &[$($vrange)?])
                    },)*
                    $(key(stringify!($flag), concat!($($fdoc, "\n"),+), "false".into(), &[]),)*
                    $(key(stringify!($option), concat!($($odoc, "\n"),+), String::new(), &[$($orange)?]),)*
                    $({
                        let default: $ctype = $cdefault;
                        key(stringify!($constant), concat!($($cdoc, "\n"),+), crate::train::settings::group::spelled(&default), &[$($crange)?])
                    },)*
                    $(key(stringify!($unset), concat!($($udoc, "\n"),+), String::new(), &[$($urange)?]),)*
                ]
            }

            /// Whether every value is in its range.
            pub(super) fn in_range(&self) -> Result<(), crate::train::settings::SettingsError> {
                #[allow(unused_variables)]
                let holds = |key: &str, value: f64, range: crate::train::settings::Range| match range.contains(value) {
                    true => Ok(()),
                    false => Err(crate::train::settings::SettingsError::Value { key: key.replace('_', "-"), want: range.words() }),
                };
                $($(holds(stringify!($value), crate::train::settings::range::Number::number(self.$value), $vrange)?;)?)*
                $($(if let Some(value) = self.$option {
                    holds(stringify!($option), crate::train::settings::range::Number::number(value), $orange)?;
                })?)*
                $($(holds(stringify!($constant), crate::train::settings::range::Number::number(self.$constant), $crange)?;)?)*
                $($(if let Some(value) = self.$unset {
                    holds(stringify!($unset), crate::train::settings::range::Number::number(value), $urange)?;
                })?)*
                Ok(())
            }
        }
    };
}

pub(super) use group;
