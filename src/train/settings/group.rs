//! How a group of settings is declared.

/// Declares one group of options: the struct with its command-line options, its keys in `settings.toml` (the option names
/// without the dashes in front), and its defaults, each written once.
macro_rules! group {
    (
        $(#[$meta:meta])* pub struct $name:ident ($heading:literal) {
            $($(#[$vmeta:meta])* pub $value:ident : $vtype:ty = $default:expr,)*
        }
        flags { $($(#[$fmeta:meta])* pub $flag:ident,)* }
        optional { $($(#[$ometa:meta])* pub $option:ident : $otype:ty,)* }
    ) => {
        $(#[$meta])*
        #[derive(Clone, Debug, PartialEq, clap::Args, serde::Serialize, serde::Deserialize)]
        #[command(next_help_heading = $heading)]
        #[serde(default, deny_unknown_fields, rename_all = "kebab-case")]
        pub struct $name {
            $($(#[$vmeta])* #[arg(long, default_value_t = $default)] pub $value: $vtype,)*
            $(
                $(#[$fmeta])*
                #[arg(
                    long, value_name = "BOOL", num_args = 0..=1, require_equals = true, default_missing_value = "true",
                    default_value_t = false, action = clap::ArgAction::Set, hide_default_value = true,
                    hide_possible_values = true
                )]
                pub $flag: bool,
            )*
            $(
                $(#[$ometa])*
                #[arg(long)]
                #[serde(skip_serializing_if = "Option::is_none")]
                pub $option: Option<$otype>,
            )*
        }
        impl Default for $name {
            fn default() -> Self {
                Self { $($value: $default,)* $($flag: false,)* $($option: None,)* }
            }
        }
    };
}

pub(super) use group;
