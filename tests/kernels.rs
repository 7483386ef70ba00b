//! The tables of the passes against their SPIR-V: bindings with access, push constants, specialization constants,
//! workgroup size. Both forms of a module are checked, and every entry of the table of addresses. Every shader file
//! must be used by a registered pass.

use std::collections::{BTreeMap, BTreeSet};

use psrgs_vk::pass::{self, Pass};
use psrgs_vk::vk::Access;
use rspirv::binary::parse_bytes;
use rspirv::dr::{Instruction, Loader, Module, Operand};
use rspirv::spirv::{Decoration, ExecutionMode, Op, StorageClass};

fn id(operand: &Operand) -> u32 {
    match operand {
        Operand::IdRef(id) => *id,
        other => panic!("not an id: {other:?}"),
    }
}

fn word(operand: &Operand) -> u32 {
    match operand {
        Operand::LiteralBit32(word) => *word,
        other => panic!("not a word: {other:?}"),
    }
}

/// A module with its decorations by target.
struct Reflection {
    module: Module,
    names: BTreeMap<u32, String>,
    member_names: BTreeMap<(u32, u32), String>,
}

impl Reflection {
    fn new(spirv: &[u8]) -> Reflection {
        let mut loader = Loader::new();
        parse_bytes(spirv, &mut loader).unwrap();
        let module = loader.module();
        let mut names = BTreeMap::new();
        let mut member_names = BTreeMap::new();
        for name in &module.debug_names {
            match (name.class.opcode, name.operands.as_slice()) {
                (Op::Name, [target, Operand::LiteralString(text)]) => {
                    names.insert(id(target), text.clone());
                }
                (Op::MemberName, [target, member, Operand::LiteralString(text)]) => {
                    member_names.insert((id(target), word(member)), text.clone());
                }
                _ => {}
            }
        }
        Reflection { module, names, member_names }
    }

    fn decoration(&self, target: u32, wanted: Decoration) -> Option<&[Operand]> {
        self.module.annotations.iter().find_map(|a| match a.operands.as_slice() {
            [t, Operand::Decoration(d), rest @ ..]
                if a.class.opcode == Op::Decorate && id(t) == target && *d == wanted =>
            {
                Some(rest)
            }
            _ => None,
        })
    }

    fn member_decoration(&self, target: u32, member: u32, wanted: Decoration) -> Option<&[Operand]> {
        self.module.annotations.iter().find_map(|a| match a.operands.as_slice() {
            [t, m, Operand::Decoration(d), rest @ ..]
                if a.class.opcode == Op::MemberDecorate && id(t) == target && word(m) == member && *d == wanted =>
            {
                Some(rest)
            }
            _ => None,
        })
    }

    fn global(&self, wanted: u32) -> &Instruction {
        self.module.types_global_values.iter().find(|i| i.result_id == Some(wanted)).unwrap()
    }

    /// Variables of a storage class, with the struct they point at.
    fn variables(&self, class: StorageClass) -> Vec<(u32, u32)> {
        self.module
            .types_global_values
            .iter()
            .filter(|i| i.class.opcode == Op::Variable && i.operands[0] == Operand::StorageClass(class))
            .map(|i| (i.result_id.unwrap(), id(&self.global(i.result_type.unwrap()).operands[1])))
            .collect()
    }

    /// Access that the decorations allow, on the variable or on every member of its block.
    fn access(&self, variable: u32, block: u32) -> Access {
        let members = self.global(block).operands.len() as u32;
        let says = |d| {
            self.decoration(variable, d).is_some()
                || (0..members).all(|m| self.member_decoration(block, m, d).is_some())
        };
        match (says(Decoration::NonWritable), says(Decoration::NonReadable)) {
            (true, false) => Access::Read,
            (false, true) => Access::Write,
            (false, false) => Access::ReadWrite,
            (true, true) => panic!("neither readable nor writable"),
        }
    }

    /// Size in bytes of a scalar, vector or array type.
    fn bytes(&self, ty: u32) -> u32 {
        let stride = self.decoration(ty, Decoration::ArrayStride).map(|o| word(&o[0]));
        let ty = self.global(ty);
        match ty.class.opcode {
            Op::TypeInt | Op::TypeFloat => word(&ty.operands[0]) / 8,
            Op::TypeVector => word(&ty.operands[1]) * self.bytes(id(&ty.operands[0])),
            Op::TypeArray => word(&self.global(id(&ty.operands[1])).operands[0]) * stride.unwrap(),
            other => panic!("a push constant of type {other:?}"),
        }
    }
}

/// Every pass with each variant of its module.
fn forms() -> impl Iterator<Item = (&'static Pass, Reflection)> {
    pass::ALL.iter().flat_map(|&pass| {
        let addresses = pass.kernel.spirv.addresses.expect("build.rs makes both forms");
        [pass.kernel.spirv.descriptors, addresses].map(|spirv| (pass, Reflection::new(spirv)))
    })
}

#[test]
fn bindings_and_their_access_are_as_declared() {
    let mut wrong = Vec::new();
    for pass in pass::ALL {
        let kernel = &pass.kernel;
        let spirv = Reflection::new(kernel.spirv.descriptors);
        let mut found = BTreeMap::new();
        for (variable, block) in spirv.variables(StorageClass::StorageBuffer) {
            let set = word(&spirv.decoration(variable, Decoration::DescriptorSet).unwrap()[0]);
            let binding = word(&spirv.decoration(variable, Decoration::Binding).unwrap()[0]);
            assert_eq!(set, 0, "{}: descriptor set", kernel.name);
            let name = spirv.member_names.get(&(block, 0)).cloned().unwrap_or_default();
            found.insert(binding, (spirv.access(variable, block), name));
        }
        for (i, binding) in kernel.bindings.iter().enumerate() {
            match found.remove(&(i as u32)) {
                Some((access, _)) if access == binding.access => {}
                Some((access, name)) => wrong.push(format!(
                    "{}: binding {i} ({}, in the shader {name}) is {:?} in the table and {access:?} in the shader",
                    kernel.name, binding.name, binding.access
                )),
                None => wrong.push(format!("{}: the shader does not use binding {i} ({})", kernel.name, binding.name)),
            }
        }
        for (i, (_, name)) in found {
            wrong.push(format!("{}: binding {i} ({name}) of the shader is not in the table", kernel.name));
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

impl Reflection {
    fn instructions(&self) -> impl Iterator<Item = &Instruction> {
        self.module.functions.iter().flat_map(|f| &f.blocks).flat_map(|block| &block.instructions)
    }

    fn constant(&self, wanted: u32) -> u32 {
        word(&self.global(wanted).operands[0])
    }

    /// The entries of the table of addresses that are read, each with the struct of its reference.
    fn entries(&self, table: u32) -> Vec<(u32, u32)> {
        let mut places = BTreeMap::new();
        let mut words = BTreeMap::new();
        let mut found = Vec::new();
        for i in self.instructions() {
            match (i.class.opcode, i.operands.as_slice()) {
                (Op::AccessChain | Op::InBoundsAccessChain, [base, member, entry]) if id(base) == table => {
                    assert_eq!(self.constant(id(member)), 0);
                    places.insert(i.result_id.unwrap(), self.constant(id(entry)));
                }
                (Op::Load, [from, ..]) => {
                    places.get(&id(from)).map(|entry| words.insert(i.result_id.unwrap(), *entry));
                }
                (Op::Bitcast, [from]) => {
                    if let Some(entry) = words.get(&id(from)) {
                        let pointer = self.global(i.result_type.unwrap());
                        assert_eq!(pointer.operands[0], Operand::StorageClass(StorageClass::PhysicalStorageBuffer));
                        found.push((*entry, id(&pointer.operands[1])));
                    }
                }
                _ => {}
            }
        }
        assert_eq!(found.len(), places.len(), "an entry is read that becomes no reference");
        found
    }
}

#[test]
fn modules_with_texels_have_a_descriptor_per_buffer_and_view() {
    let mut with_texels = 0;
    for pass in pass::ALL {
        let kernel = &pass.kernel;
        let Some(texels) = kernel.spirv.texels else { continue };
        with_texels += 1;
        let spirv = Reflection::new(texels.spirv);
        let bindings = |class| -> BTreeSet<u32> {
            let of = |(variable, _)| word(&spirv.decoration(variable, Decoration::Binding).unwrap()[0]);
            spirv.variables(class).into_iter().map(of).collect()
        };
        let (buffers, rows) = (bindings(StorageClass::StorageBuffer), bindings(StorageClass::UniformConstant));
        let views: BTreeSet<u32> = texels.views.iter().map(|view| view.at).collect();
        assert_eq!((rows, views.len()), (views.clone(), texels.views.len()), "{}: texels", kernel.name);
        for (i, binding) in (0..).zip(kernel.bindings) {
            let only_as_texels = views.contains(&i);
            assert_eq!(buffers.contains(&i), !only_as_texels, "{}: {}", kernel.name, binding.name);
            assert!(!only_as_texels || binding.access == Access::Read, "{}: {}", kernel.name, binding.name);
        }
        assert!(buffers.iter().all(|i| (*i as usize) < kernel.bindings.len()), "{}", kernel.name);
    }
    assert!(with_texels > 0);
}

#[test]
fn modules_by_address_have_the_table_and_reach_what_is_declared() {
    let mut wrong = Vec::new();
    for pass in pass::ALL {
        let kernel = &pass.kernel;
        let spirv = Reflection::new(kernel.spirv.addresses.expect("build.rs makes both forms"));
        for class in [StorageClass::Uniform, StorageClass::UniformConstant] {
            assert!(spirv.variables(class).is_empty(), "{}: {class:?}", kernel.name);
        }
        let tables = spirv.variables(StorageClass::StorageBuffer);
        let [(table, block)] = tables[..] else { panic!("{}: descriptors {tables:?}", kernel.name) };
        for decoration in [Decoration::DescriptorSet, Decoration::Binding] {
            assert_eq!(word(&spirv.decoration(table, decoration).unwrap()[0]), 0, "{}", kernel.name);
        }
        assert_eq!(spirv.access(table, block), Access::Read, "{}: the table", kernel.name);
        let element = id(&spirv.global(id(&spirv.global(block).operands[0])).operands[0]);
        assert_eq!(spirv.bytes(element), 8, "{}: an address has 64 bits", kernel.name);

        let mut reached = BTreeSet::new();
        for (entry, block) in spirv.entries(table) {
            reached.insert(entry);
            let access = spirv.access(0, block);
            match kernel.bindings.get(entry as usize) {
                Some(binding) if binding.access == access => {}
                Some(binding) => wrong.push(format!(
                    "{}: entry {entry} ({}) is {:?} in the table of the pass and {access:?} in the shader",
                    kernel.name, binding.name, binding.access
                )),
                None => wrong.push(format!("{}: entry {entry} is not in the table of the pass", kernel.name)),
            }
        }
        let unreached: Vec<_> = (0..kernel.bindings.len() as u32).filter(|i| !reached.contains(i)).collect();
        if !unreached.is_empty() {
            wrong.push(format!("{}: entries {unreached:?} are not used", kernel.name));
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn push_constants_are_as_declared() {
    let mut wrong = Vec::new();
    for (pass, spirv) in forms() {
        let kernel = &pass.kernel;
        let blocks = spirv.variables(StorageClass::PushConstant);
        let mut shader = Vec::new();
        if let Some(&(_, block)) = blocks.first() {
            for (m, ty) in spirv.global(block).operands.iter().enumerate() {
                let member = (block, m as u32);
                let name = spirv.member_names.get(&member).cloned().unwrap_or_default();
                let offset = word(&spirv.member_decoration(member.0, member.1, Decoration::Offset).unwrap()[0]);
                shader.push((name, offset, spirv.bytes(id(ty))));
            }
        }
        let table: Vec<_> = pass.push.iter().map(|f| (f.name.to_owned(), f.offset, f.bytes)).collect();
        // A variant that reads no push constant has no block.
        if shader != table && !blocks.is_empty() {
            wrong.push(format!("{}: shader {shader:?}, table {table:?}", kernel.name));
        }
        let end = pass.push.iter().map(|f| f.offset + f.bytes).max().unwrap_or(0);
        if end > kernel.push_bytes || kernel.push_bytes > 128 || blocks.len() > 1 {
            wrong.push(format!("{}: {} bytes declared, fields end at {end}", kernel.name, kernel.push_bytes));
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn constants_are_as_declared() {
    let mut wrong = Vec::new();
    for (pass, spirv) in forms() {
        let kernel = &pass.kernel;
        let mut shader = BTreeMap::new();
        for value in &spirv.module.types_global_values {
            let Some(result) = value.result_id else { continue };
            let Some(operands) = spirv.decoration(result, Decoration::SpecId) else { continue };
            let default = match value.class.opcode {
                Op::SpecConstantTrue => 1,
                Op::SpecConstantFalse => 0,
                _ => word(&value.operands[0]),
            };
            // A workgroup size that is set by a constant has no name in the shader.
            let name = spirv.names.get(&result).filter(|n| !n.is_empty()).map_or("LOCAL_SIZE", String::as_str);
            shader.insert(word(&operands[0]), (name.to_owned(), default));
        }
        let table: BTreeMap<u32, (String, u32)> =
            kernel.constants.iter().map(|c| (c.id, (c.name.to_owned(), c.default))).collect();
        if table.len() != kernel.constants.len() {
            wrong.push(format!("{}: two constants of one id", kernel.name));
        }
        if shader != table {
            wrong.push(format!("{}: shader {shader:?}, table {table:?}", kernel.name));
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn workgroup_sizes_are_as_declared() {
    let mut wrong = Vec::new();
    for (pass, spirv) in forms() {
        let kernel = &pass.kernel;
        let size = spirv.module.execution_modes.iter().find_map(|mode| match mode.operands.as_slice() {
            [_, Operand::ExecutionMode(ExecutionMode::LocalSize), x, y, z] => Some((word(x), word(y), word(z))),
            _ => None,
        });
        // A workgroup size by specialization constant is a decorated composite, which wins over the execution mode.
        let open = spirv.module.types_global_values.iter().any(|v| {
            v.class.opcode == Op::SpecConstantComposite
                && v.result_id.is_some_and(|id| spirv.decoration(id, Decoration::BuiltIn).is_some())
        });
        match (kernel.local_size, size) {
            (Some(declared), Some(size)) if !open && size == (declared, 1, 1) => {}
            (None, _) if open && kernel.constants.iter().any(|c| c.name == "LOCAL_SIZE") => {}
            (declared, size) => {
                wrong.push(format!("{}: table {declared:?}, shader {size:?}, open {open}", kernel.name));
            }
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn names_are_unique_and_every_shader_is_used() {
    let names: BTreeSet<&str> = pass::ALL.iter().map(|pass| pass.kernel.name).collect();
    assert_eq!(names.len(), pass::ALL.len(), "two passes of one name");
    let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/glsl");
    let mut unused = Vec::new();
    let mut modules = 0;
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.extension().is_none_or(|e| e != "comp") {
            continue;
        }
        let stem = path.file_stem().unwrap().to_str().unwrap().to_owned();
        let text = std::fs::read_to_string(&path).unwrap();
        let variants: Vec<String> = text
            .lines()
            .filter_map(|line| {
                line.strip_prefix("//! variant ")?.split_whitespace().next().map(|v| format!("{stem}_{v}"))
            })
            .collect();
        for name in if variants.is_empty() { vec![stem] } else { variants } {
            modules += 1;
            let spirv = pass::module(&name);
            if !pass::ALL.iter().any(|pass| pass.kernel.spirv.descriptors == spirv.descriptors) {
                unused.push(name);
            }
        }
    }
    assert!(modules > 0);
    assert!(unused.is_empty(), "shaders that no registered pass uses: {unused:?}");
}
