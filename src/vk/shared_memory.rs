//! Size of a module's shared memory, computed from its SPIR-V.

use std::collections::HashMap;

/// Storage class of shared memory.
const WORKGROUP: u32 = 4;

/// Size and alignment of a type in the std430 layout, an upper bound for every driver.
#[derive(Clone, Copy)]
struct TypeExtent {
    bytes: u64,
    alignment: u64,
}

impl TypeExtent {
    const fn of(bytes: u64) -> Self {
        Self { bytes, alignment: if bytes == 0 { 1 } else { bytes } }
    }

    /// Distance in bytes between elements of an array.
    fn stride(self) -> u64 {
        self.bytes.next_multiple_of(self.alignment)
    }

    fn vector(self, count: u64) -> Self {
        let places = if count == 3 { 4 } else { count };
        Self { bytes: self.bytes * count, alignment: self.alignment * places }
    }

    fn array(self, count: u64) -> Self {
        Self { bytes: self.stride() * count, alignment: self.alignment }
    }

    fn all(members: impl Iterator<Item = Self>) -> Self {
        let (bytes, alignment) = members
            .fold((0u64, 1), |(end, most), m| (end.next_multiple_of(m.alignment) + m.bytes, most.max(m.alignment)));
        Self { bytes: bytes.next_multiple_of(alignment), alignment }
    }
}

/// Bytes of the shared variables of a module (SPIR-V words). `special` returns the value of a specialization constant
/// by its `constant_id`, or `None` for the default. `None` for a module that the function cannot parse.
pub(super) fn bytes(words: &[u32], special: impl Fn(u32) -> Option<u32>) -> Option<u64> {
    // Opcodes from the SPIR-V specification, section 3.42; the operands follow the first word.
    let mut types: HashMap<u32, TypeExtent> = HashMap::new();
    let mut pointees: HashMap<u32, u32> = HashMap::new();
    let mut constants: HashMap<u32, u32> = HashMap::new();
    let mut ids: HashMap<u32, u32> = HashMap::new();
    let mut variables = Vec::new();
    let mut rest = words.get(5..)?;
    while let Some(&first) = rest.first() {
        let length = (first >> 16) as usize;
        let operands = rest.get(1..length)?;
        rest = &rest[length..];
        match (first & 0xffff, operands) {
            // OpDecorate SpecId
            (71, &[target, 1, id]) => drop(ids.insert(target, id)),
            // OpTypeBool, OpTypeInt, OpTypeFloat
            (20, &[id]) => drop(types.insert(id, TypeExtent::of(4))),
            (21, &[id, width, _]) | (22, &[id, width]) => drop(types.insert(id, TypeExtent::of(u64::from(width / 8)))),
            // OpTypeVector
            (23, &[id, of, count]) => {
                let of = *types.get(&of)?;
                types.insert(id, of.vector(u64::from(count)));
            }
            // OpTypeArray: an unknown length or element type matters only for a variable of this type.
            (28, &[id, of, length]) => {
                if let (Some(of), Some(&count)) = (types.get(&of).copied(), constants.get(&length)) {
                    types.insert(id, of.array(u64::from(count)));
                }
            }
            // OpTypeStruct
            (30, &[id, ref members @ ..]) => {
                if let Some(members) = members.iter().map(|m| types.get(m).copied()).collect::<Option<Vec<_>>>() {
                    types.insert(id, TypeExtent::all(members.into_iter()));
                }
            }
            // OpTypePointer
            (32, &[id, WORKGROUP, to]) => drop(pointees.insert(id, to)),
            // OpConstant, OpSpecConstant
            (43, &[_, id, value]) => drop(constants.insert(id, value)),
            (50, &[_, id, default]) => {
                constants.insert(id, ids.get(&id).and_then(|id| special(*id)).unwrap_or(default));
            }
            // OpSpecConstantOp: OpIAdd, OpISub, OpIMul, OpUDiv, OpUGreaterThan, OpULessThan
            (52, &[_, id, operation, a, b]) => {
                if let (Some(&a), Some(&b)) = (constants.get(&a), constants.get(&b)) {
                    let value = match operation {
                        128 => a.checked_add(b),
                        130 => a.checked_sub(b),
                        132 => a.checked_mul(b),
                        134 => a.checked_div(b),
                        172 => Some(u32::from(a > b)),
                        176 => Some(u32::from(a < b)),
                        _ => None,
                    };
                    value.map(|value| constants.insert(id, value));
                }
            }
            // OpSpecConstantOp: OpSelect
            (52, &[_, id, 169, which, a, b]) => {
                if let (Some(&which), Some(&a), Some(&b)) =
                    (constants.get(&which), constants.get(&a), constants.get(&b))
                {
                    constants.insert(id, if which != 0 { a } else { b });
                }
            }
            // OpVariable
            (59, &[pointer, _, WORKGROUP, ..]) => variables.push(pointer),
            // OpFunction: declarations end here.
            (54, _) => break,
            _ => {}
        }
    }
    let extents = variables.iter().map(|pointer| pointees.get(pointer).and_then(|to| types.get(to)).copied());
    Some(TypeExtent::all(extents.collect::<Option<Vec<_>>>()?.into_iter()).bytes)
}

#[cfg(test)]
mod tests {
    use super::bytes;
    use crate::pass::ALL;

    #[test]
    fn the_shared_memory_of_every_pass_is_known() {
        let named = |name: &str| ALL.iter().find(|pass| pass.kernel.name == name)?.kernel.shared_bytes(&[]);
        for pass in ALL {
            assert!(pass.kernel.shared_bytes(&[]).is_some_and(|bytes| bytes < 32 << 10), "{}", pass.kernel.name);
        }
        assert_eq!(named("fill"), Some(0));
        // vec4 sums[64]
        assert_eq!(named("part_sum"), Some(64 * 16));
        // float sums[64], float fresh[12]
        assert_eq!(named("exposure_step"), Some((64 + 12) * 4));
        // float subgroup_sums[16 * 128], uint subgroup_has[128]; staged: three vec4 [128], vec2 [128], two float [128],
        // uint [128]; uint touched[32 * 4]; uint most; in all a multiple of 16
        let staged: u32 = 128 * (3 * 16 + 8 + 2 * 4 + 4);
        let sums = 17 * 128 * 4;
        assert_eq!(named("blend_backward_pixel_slots"), Some((sums + staged + 512 + 4).next_multiple_of(16)));
    }

    #[test]
    fn lengths_follow_constants_and_truncated_modules_have_none() {
        let op = |code: u32, operands: &[u32]| -> Vec<u32> {
            let mut words = vec![(operands.len() as u32 + 1) << 16 | code];
            words.extend(operands);
            words
        };
        let module = [
            vec![0x0723_0203, 0x0001_0500, 0, 20, 0],
            op(71, &[3, 1, 7]),           // constant 3 has SpecId 7
            op(21, &[1, 32, 0]),          // 1: uint
            op(22, &[2, 32]),             // 2: float
            op(50, &[1, 3, 10]),          // 3: uint, 10 by default
            op(23, &[4, 2, 3]),           // 4: vec3
            op(43, &[1, 10, 2]),          // 10: 2
            op(52, &[1, 11, 132, 3, 10]), // 11: twice constant 3
            op(28, &[5, 4, 11]),          // 5: vec3[11]
            op(30, &[6, 2, 5, 1]),        // 6: float, vec3[], uint
            op(32, &[8, 4, 6]),           // 8: pointer to type 6
            op(59, &[8, 9, 4]),           // 9: the variable
        ]
        .concat();
        assert_eq!(bytes(&module, |_| None), Some(16 + 20 * 16 + 16));
        assert_eq!(bytes(&module, |id| (id == 7).then_some(2)), Some(16 + 4 * 16 + 16));
        assert_eq!(bytes(&module[..module.len() - 1], |_| None), None);
        assert_eq!(bytes(&module[..4], |_| None), None);
    }
}
