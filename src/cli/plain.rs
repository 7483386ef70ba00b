//! Text without characters that a terminal obeys. Names of files and words of JSON come from strangers: escape
//! sequences in them could set titles, move the cursor or hide what is said,
//! and marks of writing direction could turn a name round.

use std::borrow::Cow;
use std::fmt::Write as _;

/// Whether a terminal would do something other than show the character.
fn is_obeyed(c: char) -> bool {
    let direction =
        matches!(c, '\u{61c}' | '\u{200e}' | '\u{200f}' | '\u{202a}'..='\u{202e}' | '\u{2066}'..='\u{2069}');
    // Lines and columns are the only ones that texts of this program are laid out with.
    (c.is_control() && c != '\n' && c != '\t') || direction || matches!(c, '\u{2028}' | '\u{2029}' | '\u{feff}')
}

/// The text with such characters spelled as JSON spells them (`\u001b`), so that JSON stays what it is.
pub(crate) fn plain(text: &str) -> Cow<'_, str> {
    if !text.chars().any(is_obeyed) {
        return Cow::Borrowed(text);
    }
    let mut out = String::with_capacity(text.len() + 16);
    for c in text.chars() {
        if is_obeyed(c) {
            // Writing to a String cannot fail; all of them have four digits.
            let _ = write!(out, "\\u{:04x}", u32::from(c));
        } else {
            out.push(c);
        }
    }
    Cow::Owned(out)
}

/// A message: further lines are set in, so that none that comes from a name looks like one of this program's.
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
