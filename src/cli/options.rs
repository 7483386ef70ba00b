//! `psrgs-vk options`: a document of all options of all commands, and the settings of the methods.

use std::collections::{BTreeMap, BTreeSet};

use clap::{Arg, Command};
use psrgs_vk::train::Settings;
use psrgs_vk::train::settings::{self, Method};

use super::console;

/// Print every option of every command as one document (Markdown), and what each method sets
#[derive(clap::Args)]
pub(crate) struct Args {}

/// A command that shares more options than this with `train` has all settings of a training.
const SHARED: usize = 20;
/// Heading of options without a heading of their own.
const PLAIN: &str = "Options";

const OPENING: &str = "\
# Options

The options of every command, as `psrgs-vk options` prints them; `psrgs-vk COMMAND --help` shows the same texts with examples. Options
without a default are off or unset. In every command `-q` prints errors alone and `-v` prints more.

Every setting of a training is a key of `settings.toml`. Most keys are set by `train --set KEY=VALUE` alone: [Keys](#keys). The options of
`train`, but for those of its files, are keys too, without the dashes in front.
";

const KEYS: &str = "
## Keys

Settings of a training that are no options: `train --set KEY=VALUE`, or lines of a settings file under their group.

| group | key | default | takes | |
|---|---|---|---|---|
";

const METHODS: &str = "
## What the methods set

Keys to which methods give another value than the default, in a schedule of 30,000 steps. A key that is named, as an option or by `--set`,
wins over its method. With fewer steps `lean`, `psrgs` and `psrgs-paper` scale their schedule too.
";

/// Prints the document of the program's options.
pub(crate) fn run(mut program: Command) -> anyhow::Result<()> {
    program.build();
    let mut text = OPENING.to_owned();
    let train = program.find_subcommand("train");
    let mut commands: Vec<&Command> = program.get_subcommands().collect();
    commands.sort_by_key(|command| command.get_display_order());
    for command in commands {
        text += &section(command, command.get_name(), None);
        for part in command.get_subcommands() {
            text += &section(part, &format!("{} {}", command.get_name(), part.get_name()), train);
        }
    }
    text += &keys(&program);
    text += &methods()?;
    console::print(&text)
}

/// The keys of `train` without an option.
fn keys(program: &Command) -> String {
    let train = program.find_subcommand("train");
    let is_option = |name: &str| {
        let long = |arg: &Arg| arg.get_long() == Some(name);
        train.is_some_and(|train| train.get_arguments().any(long))
    };
    let keys = Settings::all_keys().into_iter().filter(|(_, key)| !is_option(&key.name));
    let row = |(group, key): (&str, settings::Key)| {
        let (default, takes) =
            (cell(&key.default), cell(&key.range.map_or_else(|| words_of(&key.name), str::to_owned)));
        format!("| `[{group}]` | `{}` | {default} | {takes} | {} |\n", key.name, cell(&paragraph(key.help)))
    };
    KEYS.to_owned() + &keys.map(row).collect::<String>()
}

/// The options of a command. Those of `whole`, which it may share, are named together.
fn section(command: &Command, name: &str, whole: Option<&Command>) -> String {
    let is_shared = |arg: &Arg| {
        whole.is_some_and(|whole| whole.get_arguments().any(|of| of.get_id() == arg.get_id() && same_help(of, arg)))
    };
    let shares = command.get_arguments().filter(|arg| is_shared(arg)).count() > SHARED;
    let about = command.get_long_about().or(command.get_about()).map(ToString::to_string).unwrap_or_default();
    let mut text = format!("\n## `{name}`\n\n{}\n", about.trim());
    if let Some(whole) = whole.filter(|_| shares) {
        text += &format!("\nThe settings of `{}` are options of this command too.\n", whole.get_name());
    }
    for (heading, mut args) in groups(command) {
        args.retain(|arg| !(shares && is_shared(arg)));
        if args.is_empty() {
            continue;
        }
        if heading != PLAIN {
            text += &format!("\n### {heading}\n");
        }
        text += "\n| option | default | |\n|---|---|---|\n";
        for arg in args {
            text += &row(arg);
        }
    }
    text
}

fn same_help(a: &Arg, b: &Arg) -> bool {
    let help = |arg: &Arg| arg.get_help().map(ToString::to_string);
    help(a) == help(b)
}

/// The arguments of a command under their headings.
fn groups(command: &Command) -> Vec<(&str, Vec<&Arg>)> {
    let mut groups: Vec<(&str, Vec<&Arg>)> = Vec::new();
    let shown = command.get_arguments().filter(|arg| !arg.is_hide_set() && !arg.is_global_set());
    for arg in shown.filter(|arg| arg.get_id() != "help") {
        let heading = arg.get_help_heading().unwrap_or(PLAIN);
        match groups.iter_mut().find(|(known, _)| *known == heading) {
            Some((_, args)) => args.push(arg),
            None => groups.push((heading, vec![arg])),
        }
    }
    // In the order of `--help`: first the options without a heading, and among them first the positional arguments.
    groups.sort_by_key(|(heading, _)| *heading != PLAIN);
    for (_, args) in &mut groups {
        args.sort_by_key(|arg| !arg.is_positional());
    }
    groups
}

fn row(arg: &Arg) -> String {
    let values = arg.get_value_names().unwrap_or_default();
    let takes = arg.get_action().takes_values() && !arg.is_hide_possible_values_set();
    let value = match (takes, values.is_empty()) {
        (false, _) => String::new(),
        (true, false) => values.join(" "),
        (true, true) => arg.get_id().as_str().to_uppercase(),
    };
    let name = match arg.get_long() {
        Some(long) => format!("--{long} {value}"),
        None => value,
    };
    let defaults: Vec<String> = match arg.is_hide_default_value_set() || !arg.get_action().takes_values() {
        true => Vec::new(),
        false => arg.get_default_values().iter().map(|value| value.to_string_lossy().into_owned()).collect(),
    };
    let help = arg.get_long_help().or(arg.get_help()).map(ToString::to_string).unwrap_or_default();
    format!("| `{}` | {} | {} |\n", name.trim().replace('|', "\\|"), cell(&defaults.join(" ")), cell(&paragraph(&help)))
}

/// Lines of help joined into one paragraph.
fn paragraph(help: &str) -> String {
    help.split_whitespace().collect::<Vec<_>>().join(" ")
}

fn cell(text: &str) -> String {
    text.replace('|', "\\|").replace('<', "&lt;")
}

/// The values of a key without a range, taken from the error message for a wrong value.
fn words_of(key: &str) -> String {
    let told = Settings::default().set(key, "?").err().map(|error| error.to_string()).unwrap_or_default();
    let words = told.rsplit_once("it is ").or_else(|| told.rsplit_once("expected ")).map_or("", |(_, words)| words);
    match words.trim() {
        "u32" | "u64" => "a whole number".to_owned(),
        "a boolean" => "true or false".to_owned(),
        words => words.replace('`', ""),
    }
}

/// A table of the values that each method sets.
fn methods() -> anyhow::Result<String> {
    let defaults = values(&Settings::default())?;
    let names = Method::ALL.map(|(_, name)| name);
    let mut set = Vec::new();
    for (method, _) in Method::ALL {
        let mut settings = Settings::default();
        method.apply(&mut settings, |_| false);
        set.push(values(&settings)?);
    }
    let mut text =
        format!("{METHODS}\n| key | default | `{}` |\n|---|---|{}\n", names.join("` | `"), "---|".repeat(names.len()));
    let keys: BTreeSet<&String> = set.iter().flat_map(BTreeMap::keys).collect();
    for key in keys.into_iter().filter(|key| *key != "method") {
        let default = defaults.get(key);
        let cells: Vec<&str> = set
            .iter()
            .map(|of| of.get(key).filter(|value| Some(*value) != default).map_or("", String::as_str))
            .collect();
        if cells.iter().any(|cell| !cell.is_empty()) {
            text += &format!("| `{key}` | {} | {} |\n", default.map_or("", String::as_str), cells.join(" | "));
        }
    }
    Ok(text)
}

/// The values of settings by key.
fn values(settings: &Settings) -> anyhow::Result<BTreeMap<String, String>> {
    let mut values = BTreeMap::new();
    for (key, value) in toml::Table::try_from(settings)? {
        match value {
            toml::Value::Table(group) => values.extend(group.into_iter().map(|(key, value)| (key, plain(&value)))),
            value => drop(values.insert(key, plain(&value))),
        }
    }
    Ok(values)
}

/// A value in the spelling of the command line.
fn plain(value: &toml::Value) -> String {
    match value {
        toml::Value::String(word) => word.clone(),
        toml::Value::Boolean(true) => "on".to_owned(),
        toml::Value::Boolean(false) => "off".to_owned(),
        value => value.to_string(),
    }
}
