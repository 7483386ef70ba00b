//! Names the static archives that a distribution's `libshaderc` depends on, where they are installed.

use std::path::Path;

/// In link order: each archive needs symbols only from those after it.
const ARCHIVES: [&str; 9] = [
    "SPIRV",
    "glslang",
    "MachineIndependent",
    "GenericCodeGen",
    "OSDependent",
    "OGLCompiler",
    "HLSL",
    "SPIRV-Tools-opt",
    "SPIRV-Tools",
];

/// Folders where distributions install static libraries.
const FOLDERS: [&str; 5] =
    ["/usr/lib/x86_64-linux-gnu", "/usr/lib/aarch64-linux-gnu", "/usr/lib64", "/usr/lib", "/usr/local/lib"];

fn main() {
    println!("cargo:rerun-if-changed=build.rs");
    println!("cargo:rerun-if-env-changed=SHADERC_LIB_DIR");
    if std::env::var_os("CARGO_FEATURE_SKIP").is_some() {
        return;
    }
    let own = std::env::var("SHADERC_LIB_DIR").ok();
    let folders = own.iter().map(String::as_str).chain(FOLDERS);
    for folder in folders {
        // A combined archive from shaderc's own build contains glslang. Only a split installation has this file.
        if !Path::new(folder).join("libMachineIndependent.a").exists() {
            continue;
        }
        println!("cargo:rustc-link-search=native={folder}");
        for archive in ARCHIVES {
            if Path::new(folder).join(format!("lib{archive}.a")).exists() {
                println!("cargo:rustc-link-lib=static={archive}");
            }
        }
        println!("cargo:rustc-link-lib=dylib=stdc++");
        return;
    }
}
