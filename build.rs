//! Compiles every `glsl/*.comp` to SPIR-V with glslang and lists the modules for `src/pass/shaders.rs`. Each module has
//! two variants: as written, with a descriptor per buffer, and with buffers reached by address (`build/by_address.rs`).
//! Some have a third variant, with rows of buffers read as texels (`build/by_texels.rs`), and some also a fourth, with
//! texels and all other buffers reached by address.
//!
//! Loops of shaders with `precise` arithmetic are unrolled in the source, before the optimizer runs
//! (`build/unroll.rs`).
//!
//! A shader may be compiled several times: a line `//! variant NAME DEFINE DEFINE ...` in it adds a module called
//! `file_NAME` with those preprocessor symbols set; without such lines there is one module named after the file.

use std::cell::RefCell;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::{env, fs};

// Needed for the static archives that the crate links.
use shaderc_link as _;

#[path = "build/by_address.rs"]
mod by_address;
#[path = "build/by_texels.rs"]
mod by_texels;
#[path = "build/declaration.rs"]
mod declaration;
#[path = "build/unroll.rs"]
mod unroll;

/// How a module reaches its buffers.
#[derive(Clone, Copy)]
enum BufferAccess<'a> {
    Descriptors,
    Addresses,
    /// With the names of buffers with rows of three. Collects the texel views.
    Texels(&'a [String], &'a RefCell<Vec<by_texels::TexelView>>),
    /// Texels, and all other buffers by address. The collected views become `None` when the shader has no such variant.
    TexelsByAddress(&'a [String], &'a RefCell<Option<Vec<by_texels::TexelView>>>),
}

fn main() {
    println!("cargo:rerun-if-changed=build.rs");
    println!("cargo:rerun-if-changed=build");
    println!("cargo:rerun-if-changed=glsl");
    if let Err(message) = build() {
        eprintln!("{message}");
        std::process::exit(1);
    }
}

fn build() -> Result<(), String> {
    let out = PathBuf::from(env::var("OUT_DIR").map_err(|e| e.to_string())?);
    let compiler = shaderc::Compiler::new().map_err(|e| format!("shader compiler: {e}"))?;
    let mut sources: Vec<PathBuf> = fs::read_dir("glsl")
        .map_err(|e| format!("glsl: {e}"))?
        .filter_map(|entry| entry.ok().map(|e| e.path()))
        .filter(|path| path.extension().is_some_and(|e| e == "comp"))
        .collect();
    sources.sort();

    let mut list =
        String::from("/// Every compiled shader module, by name.\npub(crate) const MODULES: &[(&str, Spirv)] = &[\n");
    for path in sources {
        let text = fs::read_to_string(&path).map_err(|e| format!("{}: {e}", path.display()))?;
        let stem = path.file_stem().and_then(|s| s.to_str()).ok_or("shader file name is not UTF-8")?.to_owned();
        for (name, defines) in variants(&stem, &text) {
            let made = |form: BufferAccess<'_>, suffix: &str| -> Result<String, String> {
                let spirv = compile(&compiler, &path, &text, &defines, form)?;
                let file = out.join(format!("{name}.{suffix}"));
                fs::write(&file, spirv).map_err(|e| format!("{}: {e}", file.display()))?;
                Ok(format!("include_bytes!(concat!(env!(\"OUT_DIR\"), \"/{name}.{suffix}\"))"))
            };
            let descriptors = made(BufferAccess::Descriptors, "spv")?;
            let addresses = made(BufferAccess::Addresses, "address.spv")?;
            let texels = match by_texels::asked(&text, &defines) {
                Some(threes) => {
                    let views = RefCell::default();
                    let spirv = made(BufferAccess::Texels(&threes, &views), "texel.spv")?;
                    format!("Some(Texels {{ spirv: {spirv}, views: &[{}] }})", list_of(&views.into_inner()))
                }
                None => "None".to_owned(),
            };
            let both = match by_texels::asked(&text, &defines) {
                Some(threes) => match texels_by_address(&compiler, &path, &text, &defines, &threes)? {
                    Some(WithTexels { spirv, views }) => {
                        let file = out.join(format!("{name}.both.spv"));
                        fs::write(&file, spirv).map_err(|e| format!("{}: {e}", file.display()))?;
                        let spirv = format!("include_bytes!(concat!(env!(\"OUT_DIR\"), \"/{name}.both.spv\"))");
                        format!("Some(Texels {{ spirv: {spirv}, views: &[{}] }})", list_of(&views))
                    }
                    None => "None".to_owned(),
                },
                None => "None".to_owned(),
            };
            let _ = writeln!(
                list,
                "    (\"{name}\", Spirv {{ descriptors: {descriptors}, addresses: Some({addresses}), texels: {texels}, \
                 texels_by_address: {both} }}),"
            );
        }
    }
    list.push_str("];\n");
    fs::write(out.join("shaders.rs"), list).map_err(|e| e.to_string())
}

/// A module with its texel views.
struct WithTexels {
    spirv: Vec<u8>,
    views: Vec<by_texels::TexelView>,
}

/// Compiles the fourth variant; `None` when the shader has none.
fn texels_by_address(
    compiler: &shaderc::Compiler,
    path: &Path,
    text: &str,
    defines: &[String],
    threes: &[String],
) -> Result<Option<WithTexels>, String> {
    // Includes declare buffers too, so the views are complete only after compilation.
    let views = RefCell::new(Some(Vec::new()));
    let made = compile(compiler, path, text, defines, BufferAccess::TexelsByAddress(threes, &views));
    match views.into_inner() {
        Some(views) => Ok(Some(WithTexels { spirv: made?, views })),
        None => Ok(None),
    }
}

/// The views as elements of an array in Rust.
fn list_of(views: &[by_texels::TexelView]) -> String {
    let one = |v: &by_texels::TexelView| {
        format!("TexelView {{ binding: {}, at: {}, format: TexelFormat::{} }}, ", v.binding, v.at, v.format)
    };
    views.iter().map(one).collect()
}

fn variants(stem: &str, text: &str) -> Vec<(String, Vec<String>)> {
    let found: Vec<_> = text
        .lines()
        .filter_map(|line| line.strip_prefix("//! variant "))
        .filter_map(|rest| {
            let mut words = rest.split_whitespace();
            let name = words.next()?;
            Some((format!("{stem}_{name}"), words.map(str::to_owned).collect()))
        })
        .collect();
    if found.is_empty() { vec![(stem.to_owned(), Vec::new())] } else { found }
}

fn compile(
    compiler: &shaderc::Compiler,
    path: &Path,
    text: &str,
    defines: &[String],
    form: BufferAccess,
) -> Result<Vec<u8>, String> {
    let in_form = move |file: &Path, text: String| match form {
        BufferAccess::Descriptors => Ok(text),
        BufferAccess::Addresses => by_address::rewrite(&file.display().to_string(), &text),
        BufferAccess::Texels(threes, views) => {
            by_texels::rewrite(&file.display().to_string(), &text, threes, &mut views.borrow_mut())
        }
        BufferAccess::TexelsByAddress(threes, views) => {
            by_address::rewrite_with_texels(&file.display().to_string(), &text, threes, &mut views.borrow_mut())
        }
    };
    let text = in_form(path, text.to_owned())?;
    let mut options = shaderc::CompileOptions::new().map_err(|e| format!("shader compiler: {e}"))?;
    // Vulkan 1.2 rather than 1.3: for 1.3 glslang emits LocalSizeId, which needs maintenance4 on the device.
    options.set_target_env(shaderc::TargetEnv::Vulkan, shaderc::EnvVersion::Vulkan1_2 as u32);
    options.set_optimization_level(shaderc::OptimizationLevel::Performance);
    options.set_generate_debug_info();
    options.set_warnings_as_errors();
    options.set_include_callback(move |wanted, _, _, _| {
        let file = Path::new("glsl/include").join(wanted);
        let content = fs::read_to_string(&file).map_err(|e| format!("{}: {e}", file.display()))?;
        Ok(shaderc::ResolvedInclude { resolved_name: file.display().to_string(), content: in_form(&file, content)? })
    });
    if let BufferAccess::Texels(..) | BufferAccess::TexelsByAddress(..) = form {
        options.add_macro_definition("TEXELS", None);
    }
    for define in defines {
        let (name, value) = define.split_once('=').map_or((define.as_str(), None), |(n, v)| (n, Some(v)));
        options.add_macro_definition(name, value);
    }
    let file = path.display().to_string();
    compiler
        .preprocess(&text, &file, "main", Some(&options))
        .map(|whole| unroll::rewrite(&whole.as_text()))
        .and_then(|text| {
            compiler.compile_into_spirv(&text, shaderc::ShaderKind::Compute, &file, "main", Some(&options))
        })
        .map(|artifact| artifact.as_binary_u8().to_vec())
        .map_err(|e| match form {
            BufferAccess::Descriptors => e.to_string(),
            BufferAccess::Texels(..) | BufferAccess::TexelsByAddress(..) => {
                format!(
                    "variant with texels (read rows of buffers with LOAD4 or LOAD3 of glsl/include/loads.glsl):
{e}"
                )
            }
            BufferAccess::Addresses => {
                format!(
                    "variant by address (a buffer's member is a macro, so nothing after it may have the same name):
{e}"
                )
            }
        })
}
