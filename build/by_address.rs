//! The second form of a shader: storage buffers reached through addresses instead of descriptors.
//!
//! A descriptor of some devices covers no more than 128 MiB; an address covers all of a buffer. Every declaration
//! `layout(set = 0, binding = K) QUALIFIERS buffer Name { T member[]; };` becomes a reference type, a reference made of
//! entry K of a table of addresses, and a macro under the member's name; the rest of the shader stays as it is written.
//! The table is the only descriptor of such a module, at binding 0. What this does not understand is an error:
//! nothing keeps its descriptor.

use crate::by_texels::{BESIDE, View, texel_of};
use crate::declaration::{self, Declaration};

const EXTENSIONS: &str =
    "#extension GL_EXT_buffer_reference : require\n#extension GL_EXT_buffer_reference_uvec2 : require\n";

/// Rewrites the text of a shader, or of a file that it includes. `Err` names the file and the line.
pub(crate) fn rewrite(file: &str, text: &str) -> Result<String, String> {
    declaration::rewrite(file, text, EXTENSIONS, |out, declaration, _| push_reference(out, declaration))
}

/// The fourth form: rows that are read as texels in the third one are so here too, [`BESIDE`] bindings further on, and
/// everything else is reached by address. Texels cover more than a descriptor of a buffer does. `views` becomes `None`
/// where such rows are written as well, for which there is no such form:
/// a macro of the member's name stands in the way of its texels.
pub(crate) fn rewrite_with_texels(
    file: &str,
    text: &str,
    threes: &[String],
    views: &mut Option<Vec<View>>,
) -> Result<String, String> {
    declaration::rewrite(file, text, EXTENSIONS, |out, declaration, _| {
        let Some((sampler, format)) = texel_of(declaration, threes) else {
            push_reference(out, declaration);
            return;
        };
        let (Declaration { binding, qualifiers, member, .. }, at) = (declaration, declaration.binding + BESIDE);
        out.push_str(&format!("layout(set = 0, binding = {at}) uniform {sampler} {member}_texels;\n"));
        if !qualifiers.iter().any(|q| q == "readonly") {
            *views = None;
        }
        if let Some(views) = views {
            views.push(View { binding: *binding, at, format });
        }
    })
}

/// The array in the reference has another name than the macro, which would be expanded twice in the argument of a
/// macro.
fn push_reference(out: &mut String, declaration: &Declaration) {
    let Declaration { binding, qualifiers, block, element, member } = declaration;
    let qualifiers: String = qualifiers.iter().map(|q| format!("{q} ")).collect();
    out.push_str(&format!(
        "#ifndef ADDRESS_TABLE\n\
         #define ADDRESS_TABLE\n\
         layout(set = 0, binding = 0) readonly buffer AddressTable {{ uvec2 address_table[]; }};\n\
         #endif\n\
         layout(buffer_reference, std430, buffer_reference_align = 16) {qualifiers}buffer {block} \
         {{ {element} {member}_array[]; }};\n\
         {block} {member}_reference = {block}(address_table[{binding}]);\n\
         #define {member} {member}_reference.{member}_array\n"
    ));
}
