//! Unrolls loops marked `[[unroll]]` in the source of shaders with `precise` arithmetic.
//!
//! The optimizer would unroll the loops too, but only the first copy of a loop's body keeps NoContraction (SPIRV-Tools
//! clones the instructions without decorations). Then the device's compiler would decide whether two kernels compute
//! equal values.

/// Rewrites a preprocessed shader. Unrolls loops with a header `for (uint NAME = BEGIN; NAME < END; ++NAME)`, where
/// BEGIN and END are literals or `const uint`s, and without an early exit from the body.
pub(crate) fn rewrite(text: &str) -> String {
    if !words(text).any(|(_, word)| word == "precise") {
        return text.to_owned();
    }
    let mut out = text.to_owned();
    // Inner loops are found again in the copies of the outer loops' bodies.
    let mut from = 0;
    while let Some(at) = out[from..].find("[[unroll]]").map(|at| from + at) {
        match parsed(&out, at) {
            Some(found) => {
                let copies: String = (found.begin..found.end)
                    .map(|i| format!("{{ const uint {} = {i}u; {} }} ", found.name, found.body))
                    .collect();
                out.replace_range(at..found.stop, &format!("{{ {copies}}}"));
            }
            None => from = at + 1,
        }
    }
    out
}

struct Unrolled {
    name: String,
    begin: u32,
    end: u32,
    body: String,
    /// End of the loop's text.
    stop: usize,
}

/// Words, numbers and other single characters, with their byte offsets.
fn words(text: &str) -> impl Iterator<Item = (usize, &str)> {
    let part = |c: char| c.is_ascii_alphanumeric() || c == '_';
    let mut at = 0;
    std::iter::from_fn(move || {
        at += text[at..].len() - text[at..].trim_start().len();
        let rest = &text[at..];
        let first = rest.chars().next()?;
        let length = if part(first) { rest.find(|c| !part(c)).unwrap_or(rest.len()) } else { first.len_utf8() };
        at += length;
        Some((at - length, &rest[..length]))
    })
}

fn parsed(text: &str, at: usize) -> Option<Unrolled> {
    let mut tokens = words(&text[at..]);
    let mut next = || tokens.next().map(|(_, word)| word);
    let mut expect = |wanted: &str| wanted.split(' ').all(|w| next() == Some(w)).then_some(());
    expect("[ [ unroll ] ] for ( uint")?;
    let name = next()?;
    (next()? == "=").then_some(())?;
    let begin = number(text, next()?)?;
    (next()? == ";" && next()? == name && next()? == "<").then_some(())?;
    let end = number(text, next()?)?;
    (next()? == ";" && next()? == "+" && next()? == "+" && next()? == name && next()? == ")").then_some(())?;
    let (start, first) = tokens.next()?;
    let start = at + start;
    // A block, or one statement.
    let mut depth = 0;
    for (place, word) in words(&text[start..]) {
        match word {
            "break" | "continue" | "return" => return None,
            "{" | "(" => depth += 1,
            "}" | ")" => depth -= 1,
            _ => {}
        }
        let last = if first == "{" { "}" } else { ";" };
        if depth == 0 && word == last {
            let stop = start + place + 1;
            return Some(Unrolled { name: name.to_owned(), begin, end, body: text[start..stop].to_owned(), stop });
        }
    }
    None
}

/// The value of a literal or of a constant of the shader.
fn number(text: &str, word: &str) -> Option<u32> {
    if word.starts_with(|c: char| c.is_ascii_digit()) {
        return word.trim_end_matches('u').parse().ok();
    }
    let all: Vec<&str> = words(text).map(|(_, word)| word).collect();
    let mut values = all.windows(7).filter_map(|w| match w {
        // After a parenthesis follows a specialization constant.
        [before, "const", "uint", name, "=", value, ";"] if *name == word && *before != ")" => Some(*value),
        _ => None,
    });
    let value = values.next()?;
    (value.starts_with(|c: char| c.is_ascii_digit()) && values.all(|v| v == value)).then(|| number(text, value))?
}
