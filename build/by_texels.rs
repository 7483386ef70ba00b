//! The third form of a shader: rows of a buffer read as texels.
//!
//! A software rasterizer loads from storage buffers word by word and lane by lane, but fetches texels of all lanes at
//! once. So a shader with a line `//! texels` comes in a form in which every buffer of `vec4` or `uvec4` that it reads
//! is also a uniform texel buffer, and so is each buffer of floats named in that line, in rows of three. A buffer that
//! is only read has the texel descriptor in place of its own; of one that is written as well, it stands [`BESIDE`]
//! bindings further on. The shader reads through the macros of `glsl/include/loads.glsl`.

use crate::declaration::{self, Declaration};

/// From the binding of a buffer that is written, too, to that of its texels.
pub(crate) const BESIDE: u32 = 64;

/// A buffer that is read as texels.
pub(crate) struct View {
    /// Binding of the buffer in the form with a descriptor per buffer.
    pub(crate) binding: u32,
    /// Binding of the texels.
    pub(crate) at: u32,
    /// Variant of `TexelFormat`.
    pub(crate) format: &'static str,
}

/// The buffers with rows of three that a shader's line `//! texels NAME ...` names. `None` without such a line, and
/// where it is `//! texels(SYMBOL) NAME ...` for variants without that symbol.
pub(crate) fn asked(text: &str, defines: &[String]) -> Option<Vec<String>> {
    let line = text.lines().find_map(|line| line.strip_prefix("//! texels"))?;
    let names = match line.strip_prefix('(').and_then(|rest| rest.split_once(')')) {
        Some((symbol, names)) if defines.iter().any(|define| define == symbol) => names,
        Some(_) => return None,
        None => line,
    };
    Some(names.split_whitespace().map(str::to_owned).collect())
}

/// What a buffer is read as: the sampler's type and the variant of `TexelFormat`. `None` where it is not read,
/// or not in rows.
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

/// Rewrites the text of a shader, or of a file that it includes, and notes the views.
/// `Err` names the file and the line.
pub(crate) fn rewrite(file: &str, text: &str, threes: &[String], views: &mut Vec<View>) -> Result<String, String> {
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
        views.push(View { binding: *binding, at, format });
    })
}
