//! The tables as Markdown.

use std::fmt::Write;

use super::Table;
use crate::numbers::fraction;

/// A number with about four significant digits.
pub(super) fn number(v: f64) -> String {
    if v == 0.0 || (0.01..1e6).contains(&v.abs()) {
        let digits = if v.abs() >= 1000.0 || v == 0.0 { 0 } else { 3 };
        fraction(v, digits)
    } else {
        format!("{v:.1e}")
    }
}

/// The tables, one after the other.
pub fn markdown(tables: &[Table]) -> String {
    let mut out = String::new();
    for table in tables {
        let _ = writeln!(out, "## {}\n", table.title);
        let _ = write!(out, "| # | setting | options | {} | {} |", table.time, table.error);
        table.columns.iter().for_each(|column| out += &format!(" {column} |"));
        out += " front |\n|---|---|---|---|---|";
        out += &"---|".repeat(table.columns.len() + 1);
        out += "\n";
        for (s, row) in table.settings.iter().zip(1..) {
            let options = if s.options.is_empty() { String::new() } else { format!("`{}`", s.options) };
            let name = if s.default { format!("**{}**", s.name) } else { s.name.clone() };
            let error = s.error.map_or(String::new(), number);
            let _ = write!(out, "| {row} | {name} | {options} | {} | {error} |", number(s.time));
            s.more.iter().for_each(|v| out += &format!(" {} |", number(*v)));
            out += if s.dominated { " dominated" } else { " yes" };
            out += if s.reproducible { " |\n" } else { ", not to the bit |\n" };
        }
        out += "\n";
        if let Some(default) = table.default_off_the_front() {
            let _ = writeln!(out, "The default ({}) is dominated here.\n", default.name);
        }
    }
    out
}
