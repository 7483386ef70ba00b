//! Declarations of storage buffers in shaders, which other variants of a shader replace.

/// Qualifiers of a buffer that its references keep.
const QUALIFIERS: [&str; 5] = ["readonly", "writeonly", "coherent", "volatile", "restrict"];

/// A declaration of a storage buffer.
#[derive(Debug, PartialEq)]
pub(crate) struct Declaration {
    pub(crate) binding: u32,
    pub(crate) qualifiers: Vec<String>,
    pub(crate) block: String,
    pub(crate) element: String,
    pub(crate) member: String,
}

/// Copies the lines of a shader, or of an included file, and passes declarations of buffers to `replace`.
/// `after_version` follows the `#version` line. `Err` names the file and the line.
pub(crate) fn rewrite(
    file: &str,
    text: &str,
    after_version: &str,
    mut replace: impl FnMut(&mut String, &Declaration, &str),
) -> Result<String, String> {
    let mut out = String::with_capacity(2 * text.len());
    let mut in_directive = false;
    for (number, line) in (1..).zip(text.lines()) {
        let directive = in_directive || line.trim_start().starts_with('#');
        in_directive = directive && line.trim_end().ends_with('\\');
        let tokens = tokens(line);
        if !directive && concerns_descriptors(&tokens) {
            let declaration = parse(&tokens).map_err(|what| {
                format!("{file}:{number}: {what}, so the shader's other variants cannot be made: {}", line.trim())
            })?;
            replace(&mut out, &declaration, line);
            push_line_number(&mut out, number);
        } else {
            out.push_str(line);
            out.push('\n');
        }
        if line.starts_with("#version") && !after_version.is_empty() {
            out.push_str(after_version);
            push_line_number(&mut out, number);
        }
    }
    Ok(out)
}

/// Gives the next line the number after `number`.
fn push_line_number(out: &mut String, number: u32) {
    out.push_str(&format!("#line {}\n", number + 1));
}

/// Words and single characters of a line, without comments and white space.
fn tokens(line: &str) -> Vec<&str> {
    let mut rest = line.split("//").next().unwrap_or(line);
    let mut found = Vec::new();
    while let Some(first) = rest.chars().next() {
        let is_word = |c: char| c.is_ascii_alphanumeric() || c == '_';
        let end = if is_word(first) { rest.find(|c| !is_word(c)).unwrap_or(rest.len()) } else { first.len_utf8() };
        let (token, after) = rest.split_at(end);
        if !first.is_whitespace() {
            found.push(token);
        }
        rest = after;
    }
    found
}

/// Whether the line declares a buffer or another object with a descriptor.
fn concerns_descriptors(tokens: &[&str]) -> bool {
    let described = tokens.first() == Some(&"layout") && (tokens.contains(&"set") || tokens.contains(&"binding"));
    described || tokens.contains(&"buffer")
}

fn parse(tokens: &[&str]) -> Result<Declaration, &'static str> {
    let unknown = "not a declaration `layout(set = 0, binding = K) [readonly|writeonly ..] buffer Name \
        { T member[]; };` on one line";
    let [
        "layout",
        "(",
        "set",
        "=",
        "0",
        ",",
        "binding",
        "=",
        binding,
        ")",
        middle @ ..,
        "buffer",
        block,
        "{",
        element,
        member,
        "[",
        "]",
        ";",
        "}",
        ";",
    ] = tokens
    else {
        return Err(unknown);
    };
    let name = |token: &str| token.starts_with(|c: char| c.is_ascii_alphabetic() || c == '_');
    if ![block, element, member].into_iter().all(|token| name(token)) {
        return Err(unknown);
    }
    if middle.iter().any(|qualifier| !QUALIFIERS.contains(qualifier)) {
        return Err("an unknown qualifier");
    }
    Ok(Declaration {
        binding: binding.parse().map_err(|_| "a binding number that is not a number")?,
        qualifiers: middle.iter().map(|q| (*q).to_owned()).collect(),
        block: (*block).to_owned(),
        element: (*element).to_owned(),
        member: (*member).to_owned(),
    })
}
