//! The third variant of a shader: rows of a buffer read as texels.
//!
//! A software rasterizer loads from storage buffers word by word and lane by lane, but fetches texels of all lanes at
//! once. So a shader with a line `//! texels` has a variant where every `vec4` or `uvec4` buffer that it reads is also
//! a uniform texel buffer; so is each buffer of floats named in the line, in rows of three. In a read-only buffer the
//! texel descriptor replaces the buffer's descriptor. For a buffer that is also written, the texel descriptor is at the
//! buffer's binding plus [`BESIDE`]. The shader reads through the macros of `glsl/include/loads.glsl`.

use crate::declaration::{self, Declaration};

/// Offset from the binding of a buffer that is also written to the binding of its texels.
pub(crate) const BESIDE: u32 = 64;

/// A buffer that is read as texels.
pub(crate) struct TexelView {
    /// Binding of the buffer in the variant with a descriptor per buffer.
    pub(crate) binding: u32,
    /// Binding of the texels.
    pub(crate) at: u32,
    /// Variant of `TexelFormat`.
    pub(crate) format: &'static str,
}

/// The buffers with rows of three from a shader's line `//! texels NAME ...`. `None` without the line. A line `//!
/// texels(SYMBOL) NAME ...` holds only for variants with the symbol.
pub(crate) fn asked(text: &str, defines: &[String]) -> Option<Vec<String>> {
    let line = text.lines().find_map(|line| line.strip_prefix("//! texels"))?;
    let names = match line.strip_prefix('(').and_then(|rest| rest.split_once(')')) {
        Some((symbol, names)) if defines.iter().any(|define| define == symbol) => names,
        Some(_) => return None,
        None => line,
    };
    Some(names.split_whitespace().map(str::to_owned).collect())
}

/// Sampler type and variant of `TexelFormat` for a buffer. `None` for a buffer that is not read as texels.
pub(crate) fn texel_of(declaration: &Declaration, threes: &[String]) -> Option<(&'static str, &'static str)> {
    let Declaration { qualifiers, element, member, .. } = declaration;
    if qualifiers.iter().any(|q| q == "writeonly") {
        return None;
    }
    match element.as_str() {
        "vec4" => Some(("samplerBuffer", "Float4")),
        "uvec4" => Some(("usamplerBuffer", "Uint4")),
        "float" if threes.contains(member) => Some(("samplerBuffer", "Float3")),
        _ => None,
    }
}

/// Rewrites the text of a shader, or of a file that it includes, and collects the texel views. `Err` names the file and
/// the line.
pub(crate) fn rewrite(file: &str, text: &str, threes: &[String], views: &mut Vec<TexelView>) -> Result<String, String> {
    declaration::rewrite(file, text, "", |out, declaration, line| {
        let Declaration { binding, qualifiers, member, .. } = declaration;
        let read_only = qualifiers.iter().any(|q| q == "readonly");
        let Some((sampler, format)) = texel_of(declaration, threes) else {
            out.push_str(&format!("{line}\n"));
            return;
        };
        let at = if read_only { *binding } else { binding + BESIDE };
        if !read_only {
            out.push_str(&format!("{line}\n"));
        }
        out.push_str(&format!("layout(set = 0, binding = {at}) uniform {sampler} {member}_texels;\n"));
        views.push(TexelView { binding: *binding, at, format });
    })
}
