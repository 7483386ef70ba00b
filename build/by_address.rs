//! The second form of a shader: storage buffers reached through addresses instead of descriptors.
//!
//! A descriptor of some devices covers no more than 128 MiB; an address covers all of a buffer. Every declaration
//! `layout(set = 0, binding = K) QUALIFIERS buffer Name { T member[]; };` becomes a reference type, a reference made of entry K of
//! a table of addresses, and a macro under the member's name; the rest of the shader stays as it is written. The table is the
//! only descriptor of such a module, at binding 0. What this does not understand is an error: nothing keeps its descriptor.

/// Qualifiers of a buffer that its references keep.
const QUALIFIERS: [&str; 5] = ["readonly", "writeonly", "coherent", "volatile", "restrict"];

/// A declaration of a storage buffer.
#[derive(Debug, PartialEq)]
struct Declaration {
    binding: u32,
    qualifiers: Vec<String>,
    block: String,
    element: String,
    member: String,
}

/// Rewrites the text of a shader, or of a file that it includes. `Err` names the file and the line.
pub(crate) fn rewrite(file: &str, text: &str) -> Result<String, String> {
    let mut out = String::with_capacity(2 * text.len());
    let mut in_directive = false;
    for (number, line) in (1..).zip(text.lines()) {
        let directive = in_directive || line.trim_start().starts_with('#');
        in_directive = directive && line.trim_end().ends_with('\\');
        let tokens = tokens(line);
        if !directive && concerns_descriptors(&tokens) {
            let declaration = parse(&tokens).map_err(|what| {
                format!("{file}:{number}: {what}, so that no form of it by address can be made: {}", line.trim())
            })?;
            push_reference(&mut out, &declaration);
            push_line_number(&mut out, number);
        } else {
            out.push_str(line);
            out.push('\n');
        }
        if line.starts_with("#version") {
            out.push_str(
                "#extension GL_EXT_buffer_reference : require\n#extension GL_EXT_buffer_reference_uvec2 : require\n",
            );
            push_line_number(&mut out, number);
        }
    }
    Ok(out)
}

/// Makes the line that follows count as the one after `number`.
fn push_line_number(out: &mut String, number: u32) {
    out.push_str(&format!("#line {}\n", number + 1));
}

/// The array in the reference has another name than the macro, which would be expanded twice in the argument of a macro.
fn push_reference(out: &mut String, declaration: &Declaration) {
    let Declaration { binding, qualifiers, block, element, member } = declaration;
    let qualifiers: String = qualifiers.iter().map(|q| format!("{q} ")).collect();
    out.push_str(&format!(
        "#ifndef ADDRESS_TABLE\n\
         #define ADDRESS_TABLE\n\
         layout(set = 0, binding = 0) readonly buffer AddressTable {{ uvec2 address_table[]; }};\n\
         #endif\n\
         layout(buffer_reference, std430, buffer_reference_align = 16) {qualifiers}buffer {block} {{ {element} {member}_array[]; }};\n\
         {block} {member}_reference = {block}(address_table[{binding}]);\n\
         #define {member} {member}_reference.{member}_array\n"
    ));
}

/// Words and single characters of a line, comments and white space left out.
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

/// Declares a buffer, or anything else that has a descriptor.
fn concerns_descriptors(tokens: &[&str]) -> bool {
    let described = tokens.first() == Some(&"layout") && (tokens.contains(&"set") || tokens.contains(&"binding"));
    described || tokens.contains(&"buffer")
}

fn parse(tokens: &[&str]) -> Result<Declaration, &'static str> {
    let unknown = "not a declaration `layout(set = 0, binding = K) [readonly|writeonly ..] buffer Name { T member[]; };` on one line";
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
        return Err("a qualifier that is not known");
    }
    Ok(Declaration {
        binding: binding.parse().map_err(|_| "a binding that is not a number")?,
        qualifiers: middle.iter().map(|q| (*q).to_owned()).collect(),
        block: (*block).to_owned(),
        element: (*element).to_owned(),
        member: (*member).to_owned(),
    })
}
