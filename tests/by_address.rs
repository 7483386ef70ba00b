//! How `build.rs` makes the forms of a shader that reach buffers by address and read rows as texels.

// Nothing of a test binary is reachable from outside.
#![allow(unreachable_pub)]

#[path = "../build/by_address.rs"]
mod by_address;
#[path = "../build/by_texels.rs"]
mod by_texels;
#[path = "../build/declaration.rs"]
mod declaration;
#[path = "../build/unroll.rs"]
mod unroll;

use by_address::rewrite;

const SHADER: &str = "\
#version 460
// A comment about a buffer.
#extension GL_GOOGLE_include_directive : require
#define ADD(buffer, index) \\
    buffer[index] += 1u;
layout(set = 0, binding = 3) readonly buffer Keys { uint keys[]; };  // why
layout ( set=0,binding=12 )  buffer Sums{WORD sums [ ] ;} ;
layout(push_constant) uniform Push { uint count; } push;
void main() { ADD(sums, keys[0]) }
";

#[test]
fn declarations_become_references_and_the_rest_stays() {
    let found = rewrite("a.comp", SHADER).unwrap();
    let keys =
        "layout(buffer_reference, std430, buffer_reference_align = 16) readonly buffer Keys { uint keys_array[]; };
Keys keys_reference = Keys(address_table[3]);
#define keys keys_reference.keys_array
#line 7
";
    let sums = "layout(buffer_reference, std430, buffer_reference_align = 16) buffer Sums { WORD sums_array[]; };
Sums sums_reference = Sums(address_table[12]);
#define sums sums_reference.sums_array
#line 8
";
    assert!(found.contains(keys) && found.contains(sums), "{found}");
    assert!(!found.contains("binding = 3") && !found.contains("binding=12"), "{found}");
    assert!(found.starts_with(
        "#version 460\n#extension GL_EXT_buffer_reference : require\n#extension GL_EXT_buffer_reference_uvec2 : \
         require\n#line 2\n"
    ));
    let declared = |line: &str| line.trim_start().starts_with("layout") && line.contains("buffer");
    let mut lines = found.lines();
    for line in SHADER.lines().filter(|line| !declared(line)) {
        assert!(lines.any(|l| l == line), "{line} is missing or out of order:\n{found}");
    }
    // The table of addresses is declared before its first use.
    let table = found.find("{ uvec2 address_table[]; }").unwrap();
    assert!(table < found.find("address_table[3]").unwrap());
}

#[test]
fn a_file_without_buffers_stays_as_it_is() {
    let include = "#ifndef A\n#define A\nuint twice(uint x) { return 2u * x; }\n#endif\n";
    assert_eq!(rewrite("include/a.glsl", include).unwrap(), include);
}

#[test]
fn what_is_not_understood_is_refused_with_file_and_line() {
    let bad = [
        "layout(set = 0, binding = 0) buffer Keys {",
        "layout(set = 1, binding = 0) buffer Keys { uint keys[]; };",
        "layout(binding = 0) buffer Keys { uint keys[]; };",
        "layout(set = 0, binding = FIRST) buffer Keys { uint keys[]; };",
        "layout(set = 0, binding = 0) buffer Keys { uint keys[4]; };",
        "layout(set = 0, binding = 0) buffer Keys { uint keys[]; } named;",
        "layout(set = 0, binding = 0) buffer Keys { uint keys[]; }; uint other;",
        "layout(set = 0, binding = 0) buffer Keys { uint first; uint keys[]; };",
        "layout(set = 0, binding = 0) buffer Keys { highp uint keys[]; };",
        "layout(set = 0, binding = 0) shared buffer Keys { uint keys[]; };",
        "layout(set = 0, binding = 0, std140) buffer Keys { uint keys[]; };",
        "layout(set = 0, binding = 0) uniform Keys { uint keys; };",
        "layout(binding = 0) uniform sampler2D keys;",
        "buffer Keys { uint keys[]; };",
        "uint buffer;",
    ];
    for line in bad {
        let error = rewrite("glsl/bad.comp", &format!("#version 460\n\n{line}\n")).unwrap_err();
        assert!(error.starts_with("glsl/bad.comp:3: "), "{line}: {error}");
        assert!(error.contains(line), "{error}");
    }
}

#[test]
fn rows_of_four_and_the_named_ones_of_three_become_texels() {
    let text = "\
//! texels means
layout(set = 0, binding = 0) readonly buffer Rows { vec4 rows[]; };
layout(set = 0, binding = 1) buffer Means { float means[]; };
layout(set = 0, binding = 2) buffer Words { uvec4 words[]; };
layout(set = 0, binding = 3) readonly buffer Keys { uint keys[]; };
layout(set = 0, binding = 4) writeonly buffer Out { vec4 results[]; };
layout(set = 0, binding = 5) readonly buffer Other { float other[]; };
";
    let threes = by_texels::asked(text, &[]).expect("asked for");
    assert_eq!(threes, ["means"]);
    let column = ["COLUMN".to_owned()];
    assert_eq!(by_texels::asked("//! texels(COLUMN) a b", &column), Some(vec!["a".to_owned(), "b".to_owned()]));
    assert!(by_texels::asked("//! texels(COLUMN)", &["PIXEL".to_owned()]).is_none());
    assert!(by_texels::asked("// texels means", &[]).is_none());
    let mut views = Vec::new();
    let found = by_texels::rewrite("a.comp", text, &threes, &mut views).unwrap();
    let views: Vec<_> = views.iter().map(|v| (v.binding, v.at, v.format)).collect();
    assert_eq!(views, [(0, 0, "Float4"), (1, 65, "Float3"), (2, 66, "Uint4")]);
    // Buffers that are only read have no other descriptor. Written buffers keep theirs. The rest stays.
    assert!(found.contains("layout(set = 0, binding = 0) uniform samplerBuffer rows_texels;\n#line 3"), "{found}");
    assert!(!found.contains("buffer Rows"), "{found}");
    for line in text.lines().skip(2) {
        assert!(found.contains(line), "{line}: {found}");
    }
    assert!(found.contains("layout(set = 0, binding = 66) uniform usamplerBuffer words_texels;"), "{found}");
    assert_eq!(found.matches("_texels").count(), 3, "{found}");
}

#[test]
fn read_only_rows_become_texels_beside_a_table_of_addresses() {
    let text = "\
#version 460
layout(set = 0, binding = 0) readonly buffer Rows { vec4 rows[]; };
layout(set = 0, binding = 1) readonly buffer Means { float means[]; };
layout(set = 0, binding = 2) readonly buffer Keys { uint keys[]; };
layout(set = 0, binding = 3) writeonly buffer Out { vec4 results[]; };
";
    let mut views = Some(Vec::new());
    let found = by_address::rewrite_with_texels("a.comp", text, &["means".to_owned()], &mut views).unwrap();
    let views: Vec<_> = views.expect("a form").iter().map(|v| (v.binding, v.at, v.format)).collect();
    assert_eq!(views, [(0, 64, "Float4"), (1, 65, "Float3")]);
    for line in [
        "layout(set = 0, binding = 64) uniform samplerBuffer rows_texels;",
        "layout(set = 0, binding = 65) uniform samplerBuffer means_texels;",
        "Keys keys_reference = Keys(address_table[2]);",
        "Out results_reference = Out(address_table[3]);",
    ] {
        assert!(found.contains(line), "{line}: {found}");
    }
    assert!(!found.contains("Rows(") && !found.contains("buffer Means"), "{found}");
    let mut views = Some(Vec::new());
    let written = text.replace("readonly buffer Rows", "buffer Rows");
    by_address::rewrite_with_texels("a.comp", &written, &[], &mut views).unwrap();
    assert!(views.is_none(), "written rows became texels");
}

#[test]
fn marked_loops_are_written_out_where_arithmetic_is_precise() {
    let body = "[[unroll]]for(uint j = 1u;j < SIDE;++ j){ [[unroll]] for (uint k = 0u; k < 2u; ++k) s += f(x[j], k); }";
    let shader = format!("#version 460\nconst uint SIDE = 3u;\nvoid main(){{ precise float s = 0.0; {body} }}");
    let found = unroll::rewrite(&shader);
    let inner = |j: u32| {
        let one = |k: u32| format!("{{ const uint k = {k}u; s += f(x[j], k); }} ");
        format!("{{ const uint j = {j}u; {{ {{ {}{}}} }} }} ", one(0), one(1))
    };
    let want = format!(
        "#version 460\nconst uint SIDE = 3u;\nvoid main(){{ precise float s = 0.0; {{ {}{}}} }}",
        inner(1),
        inner(2)
    );
    assert_eq!(found, want);
    // Loops that need not, cannot or must not be written out stay.
    let imprecise = shader.replace("precise", "");
    assert_eq!(unroll::rewrite(&imprecise), imprecise);
    for left in [
        shader.replace("s += f(x[j], k);", "{ if (s > 1.0) break; }").replace("[[unroll]] for", "for"),
        shader.replace("const uint SIDE", "layout(constant_id = 0)const uint SIDE").replace("[[unroll]] for", "for"),
        shader.replace("++ j", "j += 2u").replace("[[unroll]] for", "for"),
    ] {
        assert_eq!(unroll::rewrite(&left), left);
    }
}
