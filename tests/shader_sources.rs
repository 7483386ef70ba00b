//! Portability rules that are checked in shader sources, and in the header and capabilities of their SPIR-V.

#[path = "shader_sources/decisions.rs"]
mod decisions;

use std::fs;
use std::path::Path;

use psrgs_vk::pass::{self, Pass};
use rspirv::spirv::Capability;

/// Every shader and include with its text, comments left out.
fn sources() -> Vec<(String, String)> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("glsl");
    let mut found = Vec::new();
    for folder in [root.clone(), root.join("include")] {
        for entry in fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_file() {
                let text = fs::read_to_string(&path).unwrap();
                let code: Vec<&str> = text.lines().map(|line| line.split("//").next().unwrap_or(line)).collect();
                found.push((path.file_name().unwrap().to_string_lossy().into_owned(), code.join("\n")));
            }
        }
    }
    assert!(found.len() > 30, "only {} shaders were found", found.len());
    found.sort();
    found
}

/// The three parts of the header of each `for`.
fn loops(code: &str) -> Vec<Vec<String>> {
    code.match_indices("for (")
        .map(|(at, start)| {
            let mut depth = 1;
            let body = &code[at + start.len()..];
            let end = body.find(|c| {
                depth += i32::from(c == '(') - i32::from(c == ')');
                depth == 0
            });
            body[..end.expect("a header ends")].split(';').map(|part| part.trim().to_owned()).collect()
        })
        .collect()
}

/// Whether the loop at the start of `code` is `do { ... ++k; ... } while (k < BOUND);`, or counts down with `k -= n;
/// ... k > 0u`: every iteration moves a count towards the bound.
fn counts_to_a_bound(code: &str) -> bool {
    let Some(code) = code.strip_prefix("do {") else { return false };
    let mut depth = 1;
    let end = code.find(|c| {
        depth += i32::from(c == '{') - i32::from(c == '}');
        depth == 0
    });
    let (body, rest) = code.split_at(end.expect("a body ends"));
    let Some((_, last)) = body.trim_end().rsplit_once('\n') else { return false };
    let indent = &last[..last.len() - last.trim_start().len()];
    let every_turn: Vec<&str> =
        body.lines().filter_map(|l| l.strip_prefix(indent)).filter(|l| !l.starts_with(' ')).collect();
    let condition = rest.lines().next().and_then(|l| l.strip_prefix("} while (")).and_then(|l| l.strip_suffix(");"));
    let Some(condition) = condition else { return false };
    !body.contains("continue")
        && !condition.contains("||")
        && condition.split(" && ").any(|part| match (part.split_once(" < "), part.strip_suffix(" > 0u")) {
            (Some((k, _)), _) => {
                every_turn.iter().any(|l| *l == format!("++{k};") || l.starts_with(&format!("{k} += ")))
            }
            (None, Some(k)) => every_turn.iter().any(|l| l.starts_with(&format!("{k} -= "))),
            (None, None) => false,
        })
}

#[test]
fn loops_are_bounded_before_they_start() {
    let mut seen = 0;
    for (file, code) in sources() {
        for header in loops(&code) {
            let [_, condition, step] = header.as_slice() else { panic!("{file}: for ({})", header.join("; ")) };
            let compares = condition.contains('<') || condition.contains('>');
            let moves = step.starts_with("++") || step.contains("+=") || step.contains("-=");
            assert!(compares && moves, "{file}: for ({})", header.join("; "));
            seen += 1;
        }
        let ends = code.matches("while (").count();
        // Compare-and-swap repeats until it succeeds. Each time it fails, another thread has succeeded.
        let swaps = code.matches("} while (seen != expected);").count();
        let bounded = code.match_indices("do {").filter(|(at, _)| counts_to_a_bound(&code[*at..])).count();
        assert_eq!(bounded + swaps, ends, "{file}: a loop without a bound");
        seen += bounded;
    }
    assert!(seen > 30, "only {seen} loops were found");
}

/// The functions of a source, each as the text between its outermost braces.
fn bodies(code: &str) -> Vec<&str> {
    let (mut depth, mut start, mut found) = (0, 0, Vec::new());
    for (at, c) in code.char_indices() {
        match c {
            '{' => {
                if depth == 0 {
                    start = at;
                }
                depth += 1;
            }
            '}' => {
                depth -= 1;
                if depth == 0 {
                    found.push(&code[start..=at]);
                }
            }
            _ => {}
        }
    }
    assert_eq!(depth, 0, "braces do not match");
    found
}

#[test]
fn no_thread_returns_before_a_barrier() {
    let mut seen = 0;
    for (file, code) in sources() {
        for body in bodies(&code) {
            // Operations that all threads of a workgroup or subgroup must reach together.
            let last = ["barrier()", " workgroup_", " subgroup_", "(subgroup_", "(workgroup_"]
                .iter()
                .filter_map(|call| body.rfind(call))
                .max();
            let Some(last) = last else { continue };
            seen += 1;
            // `return subgroup_sum(x);` at the end of a function is no early return.
            let early = body[..last].match_indices("return").any(|(at, _)| body[at..last].contains(';'));
            assert!(!early, "{file}: returns before a barrier or subgroup operation:\n{body}");
        }
    }
    assert!(seen > 10, "only {seen} functions with barriers were found");
}

#[test]
fn buffers_hold_no_three_component_vectors() {
    for (file, code) in sources() {
        for line in code.lines().filter(|line| line.contains(" buffer ")) {
            assert!(!line.contains("vec3"), "{file}: {line}");
        }
    }
}

#[test]
fn modules_target_vulkan_1_2_and_declare_known_capabilities() {
    const KNOWN: &[Capability] = &[
        Capability::Shader,
        Capability::GroupNonUniform,
        Capability::GroupNonUniformVote,
        Capability::GroupNonUniformArithmetic,
        Capability::GroupNonUniformBallot,
        Capability::GroupNonUniformShuffle,
        Capability::GroupNonUniformShuffleRelative,
        Capability::AtomicFloat32AddEXT,
        // Texels.
        Capability::SampledBuffer,
    ];
    let forms = |pass: &'static Pass| {
        let spirv = pass.kernel.spirv;
        let texels = [(false, spirv.texels), (true, spirv.texels_by_address)];
        [(false, spirv.descriptors), (true, spirv.addresses.expect("build.rs makes both forms"))]
            .into_iter()
            .chain(texels.into_iter().filter_map(|(by_address, form)| Some((by_address, form?.spirv))))
            .map(|(by_address, spirv)| (pass.kernel.name, by_address, spirv))
            .collect::<Vec<_>>()
    };
    for (name, by_address, spirv) in pass::ALL.iter().copied().flat_map(forms) {
        let version = u32::from_le_bytes(spirv[4..8].try_into().unwrap());
        assert!(version <= 0x0001_0500, "{name}: SPIR-V {version:#x} is newer than Vulkan 1.2");
        let module = rspirv::dr::load_bytes(spirv).unwrap();
        let mut addresses = false;
        for capability in &module.capabilities {
            let rspirv::dr::Operand::Capability(capability) = capability.operands[0] else { panic!("{name}") };
            if capability == Capability::PhysicalStorageBufferAddresses {
                addresses = true;
                continue;
            }
            assert!(KNOWN.contains(&capability), "{name} needs {capability:?}");
            let hardware = !matches!(capability, Capability::Shader | Capability::SampledBuffer);
            assert!(!(hardware && name.contains("emulated")), "{name} is emulated and needs {capability:?}");
        }
        assert_eq!(addresses, by_address, "{name}");
    }
}
