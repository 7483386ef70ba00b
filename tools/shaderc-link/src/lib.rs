//! Debian splits `libshaderc` from glslang and SPIRV-Tools; linking it statically needs their archives too.
//! This crate has no code: its build script names those archives.
