//! The second variant of a shader: storage buffers reached by address instead of through descriptors.
//!
//! On some devices a descriptor covers at most 128 MiB; an address reaches the whole buffer. Every declaration
//! `layout(set = 0, binding = K) QUALIFIERS buffer Name { T member[]; };` becomes a reference type, a reference made of
//! entry K of a table of addresses, and a macro under the member's name; the rest of the shader is unchanged. The table
//! is the only descriptor of the module, at binding 0. A declaration that cannot be parsed is an error, so no buffer
//! keeps its descriptor.

use crate::by_texels::{BESIDE, TexelView, texel_of};
use crate::declaration::{self, Declaration};

const EXTENSIONS: &str =
    "#extension GL_EXT_buffer_reference : require\n#extension GL_EXT_buffer_reference_uvec2 : require\n";

/// Rewrites the text of a shader, or of a file that it includes. `Err` names the file and the line.
pub(crate) fn rewrite(file: &str, text: &str) -> Result<String, String> {
    declaration::rewrite(file, text, EXTENSIONS, |out, declaration, _| push_reference(out, declaration))
}

/// The fourth variant: rows are read as texels like in the third variant, at bindings offset by [`BESIDE`], and all
/// other buffers are reached by address. A texel buffer may be larger than a storage-buffer descriptor's range. `views`
/// becomes `None` when the shader also writes a buffer that is read as texels: the macro with the member's name would
/// conflict with the texels.
pub(crate) fn rewrite_with_texels(
    file: &str,
    text: &str,
    threes: &[String],
    views: &mut Option<Vec<TexelView>>,
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
            views.push(TexelView { binding: *binding, at, format });
        }
    })
}

/// The array in the reference and the macro have different names, because a macro argument would expand an equal name
/// twice.
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
