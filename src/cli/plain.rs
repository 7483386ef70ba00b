//! Text without control characters of terminals. File names and words in JSON come from strangers. Escape sequences in
//! them could set titles, move the cursor or hide messages, and marks of writing direction could reverse a name.

use std::borrow::Cow;
use std::fmt::Write as _;

/// Whether a terminal would act on the character instead of showing it.
fn is_obeyed(c: char) -> bool {
    let direction =
        matches!(c, '\u{61c}' | '\u{200e}' | '\u{200f}' | '\u{202a}'..='\u{202e}' | '\u{2066}'..='\u{2069}');
    // This program lays out text with newlines and tabs only.
    (c.is_control() && c != '\n' && c != '\t') || direction || matches!(c, '\u{2028}' | '\u{2029}' | '\u{feff}')
}

/// The text with control characters escaped as in JSON (`\u001b`), so that JSON stays valid.
pub(crate) fn plain(text: &str) -> Cow<'_, str> {
    if !text.chars().any(is_obeyed) {
        return Cow::Borrowed(text);
    }
    let mut out = String::with_capacity(text.len() + 16);
    for c in text.chars() {
        if is_obeyed(c) {
            // Writing to a String cannot fail. All these characters have four hexadecimal digits.
            let _ = write!(out, "\\u{:04x}", u32::from(c));
        } else {
            out.push(c);
        }
    }
    Cow::Owned(out)
}

/// A message with its further lines indented, so that no line from a file name looks like a message of this program.
pub(crate) fn message(text: &str) -> String {
    let (before, rest) = text.split_at(text.len() - text.trim_start_matches('\n').len());
    let mut out = before.to_owned();
    for (i, line) in rest.split('\n').enumerate() {
        if i > 0 {
            out.push('\n');
            if !line.is_empty() && !line.starts_with(' ') {
                out.push_str("  ");
            }
        }
        out.push_str(&plain(line));
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn characters_that_terminals_obey_are_spelled() {
        assert!(matches!(plain("a b\tc\nd \u{fc} \u{1f600}"), Cow::Borrowed(_)));
        let name = "\u{1b}]0;title\u{7}\r\u{9b}31m\u{7f}\u{202e}gpj.exe\u{2066}";
        assert_eq!(plain(name), "\\u001b]0;title\\u0007\\u000d\\u009b31m\\u007f\\u202egpj.exe\\u2066");
        let json = serde_json::to_string(name).unwrap();
        assert_eq!(serde_json::from_str::<String>(&plain(&json)).unwrap(), name);
    }

    #[test]
    fn a_line_within_a_message_is_set_in() {
        assert_eq!(
            message("\nstopped\npsrgs-vk: all is well\n  as it was"),
            "\nstopped\n  psrgs-vk: all is well\n  as it was"
        );
    }
}
