//! Whether a splat shows in a pixel or a tile must come out alike in every kernel that decides it. So the arithmetic of
//! these decisions may not be contracted into fused operations. `precise` forbids contraction: each operation has
//! NoContraction in the SPIR-V.

use std::collections::{HashMap, HashSet};

use psrgs_vk::pass;
use rspirv::dr::{Instruction, Module, Operand, load_bytes};
use rspirv::spirv::{Decoration, Op, StorageClass};

/// The kernels that count the tiles that a splat touches.
const PROJECTIONS: [&str; 3] = ["project", "project_half", "project_sparse"];

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

fn ids(instruction: &Instruction) -> Vec<u32> {
    instruction.operands.iter().filter_map(|o| if let Operand::IdRef(id) = o { Some(*id) } else { None }).collect()
}

/// A value, or a component of it.
type Part = (u32, Vec<u32>);

/// A position in a variable, and the value that was stored there.
type Kept = (Vec<Option<u32>>, u32);

/// A module with the origins of its values.
struct Flow<'a> {
    module: &'a Module,
    made: HashMap<u32, &'a Instruction>,
    /// Values stored in variables of the shader, with their position; `None` stands for any element.
    kept: HashMap<u32, Vec<Kept>>,
    /// Parts of values that are written to buffers.
    written: HashSet<Part>,
    precise: HashSet<u32>,
}

impl<'a> Flow<'a> {
    fn new(module: &'a Module) -> Self {
        let all = || module.types_global_values.iter().chain(instructions(module));
        let made = all().filter_map(|i| Some((i.result_id?, i))).collect();
        let precise =
            module.annotations.iter().filter(|a| a.operands.contains(&Operand::Decoration(Decoration::NoContraction)));
        let precise = precise.map(|a| id(&a.operands[0])).collect();
        let mut flow = Self { module, made, kept: HashMap::new(), written: HashSet::new(), precise };
        for store in instructions(module).filter(|i| i.class.opcode == Op::Store) {
            let [to, value] = [id(&store.operands[0]), id(&store.operands[1])];
            match flow.place(to) {
                Some((variable, at)) => flow.kept.entry(variable).or_default().push((at, value)),
                None => {
                    let parts: Vec<Part> = flow.parts(value).iter().map(|part| flow.origin(part.clone())).collect();
                    flow.written.extend(parts);
                }
            }
        }
        flow
    }

    /// The shader's variable that a pointer leads into, with the position; `None` for buffers.
    fn place(&self, pointer: u32) -> Option<(u32, Vec<Option<u32>>)> {
        let i = self.made.get(&pointer)?;
        match i.class.opcode {
            Op::Variable => {
                let class = &i.operands[0];
                let own = [StorageClass::Function, StorageClass::Private, StorageClass::Workgroup];
                own.iter().any(|own| *class == Operand::StorageClass(*own)).then(|| (pointer, Vec::new()))
            }
            Op::AccessChain | Op::InBoundsAccessChain => {
                let (variable, mut at) = self.place(id(&i.operands[0]))?;
                at.extend(i.operands[1..].iter().map(|index| {
                    let index = self.made[&id(index)];
                    (index.class.opcode == Op::Constant).then(|| word(&index.operands[0]))
                }));
                Some((variable, at))
            }
            _ => None,
        }
    }

    /// Number of components: of a vector, else 1.
    fn components(&self, value: u32) -> Option<u32> {
        let kind = self.made.get(&self.made[&value].result_type?)?;
        (kind.class.opcode == Op::TypeVector).then(|| word(&kind.operands[1]))
    }

    fn parts(&self, value: u32) -> Vec<Part> {
        self.components(value).map_or(vec![(value, vec![])], |n| (0..n).map(|c| (value, vec![c])).collect())
    }

    /// One step back through an operation that only composes or extracts values.
    fn through(&self, (value, at): &Part) -> Option<Part> {
        let i = self.made[value];
        match i.class.opcode {
            Op::CopyObject => Some((id(&i.operands[0]), at.clone())),
            Op::CompositeExtract => {
                let inner = i.operands[1..].iter().map(word).chain(at.iter().copied()).collect();
                Some((id(&i.operands[0]), inner))
            }
            Op::CompositeConstruct => {
                let (first, rest) = at.split_first()?;
                if self.components(*value).is_none() {
                    return Some((id(&i.operands[*first as usize]), rest.to_vec()));
                }
                let mut left = *first;
                for part in i.operands.iter().map(id) {
                    let n = self.components(part);
                    if left < n.unwrap_or(1) {
                        return Some((part, n.map_or(vec![], |_| vec![left])));
                    }
                    left -= n.unwrap_or(1);
                }
                panic!("component {first} of %{value}")
            }
            Op::CompositeInsert => {
                let place: Vec<u32> = i.operands[2..].iter().map(word).collect();
                if let Some(inner) = at.strip_prefix(place.as_slice()) {
                    return Some((id(&i.operands[0]), inner.to_vec()));
                }
                (!place.starts_with(at)).then(|| (id(&i.operands[1]), at.clone()))
            }
            Op::VectorShuffle => {
                let taken = word(&i.operands[2 + *at.first()? as usize]);
                let [first, second] = [id(&i.operands[0]), id(&i.operands[1])];
                let n = self.components(first)?;
                Some(if taken < n { (first, vec![taken]) } else { (second, vec![taken - n]) })
            }
            _ => None,
        }
    }

    fn origin(&self, mut part: Part) -> Part {
        while let Some(next) = self.through(&part) {
            part = next;
        }
        part
    }

    /// All operations on whose results a value depends, back to reads and writes of buffers.
    fn behind(&self, value: u32) -> Vec<&'a Instruction> {
        let (mut found, mut seen) = (HashMap::new(), HashSet::new());
        let mut open = self.parts(value);
        while let Some(part) = open.pop() {
            let part = self.origin(part);
            if self.written.contains(&part) || !seen.insert(part.clone()) {
                continue;
            }
            let (value, at) = part;
            if at.is_empty() && self.components(value).is_some() {
                open.extend(self.parts(value));
                continue;
            }
            let i = self.made[&value];
            found.insert(value, i);
            match i.class.opcode {
                Op::FunctionCall | Op::FunctionParameter => panic!("functions were meant to be inlined"),
                Op::Load => {
                    let Some((variable, place)) = self.place(id(&i.operands[0])) else { continue };
                    if self.passes_words(variable) {
                        continue;
                    }
                    let place: Vec<_> = place.into_iter().chain(at.into_iter().map(Some)).collect();
                    for (to, value) in self.kept.get(&variable).into_iter().flatten() {
                        let same = to.iter().zip(&place).all(|(a, b)| a.is_none() || b.is_none() || a == b);
                        let inner: Option<Vec<u32>> = place.iter().skip(to.len()).copied().collect();
                        if same {
                            open.push((*value, inner.unwrap_or_default()));
                        }
                    }
                }
                // The values alone, not their blocks.
                Op::Phi => open.extend(ids(i).into_iter().step_by(2).map(|v| (v, at.clone()))),
                Op::Select => {
                    let [condition, yes, no] = ids(i)[..] else { panic!("{i:?}") };
                    let of_condition = self.components(condition).map_or(vec![], |_| at.clone());
                    open.extend([(condition, of_condition), (yes, at.clone()), (no, at)]);
                }
                _ => {
                    for operand in
                        ids(i).into_iter().filter(|v| self.made.get(v).is_some_and(|i| i.result_type.is_some()))
                    {
                        let alike = self.components(operand) == self.components(value);
                        open.push((operand, if alike { at.clone() } else { vec![] }));
                    }
                }
            }
        }
        found.into_values().collect()
    }

    /// Whether the variable is the shared array through which all shuffles of emulated subgroups pass.
    fn passes_words(&self, variable: u32) -> bool {
        let pointer = self.made[&self.made[&variable].result_type.unwrap()];
        let pointee = self.made[&id(&pointer.operands[1])];
        pointer.operands[0] == Operand::StorageClass(StorageClass::Workgroup)
            && pointee.class.opcode == Op::TypeArray
            && self.made[&id(&pointee.operands[0])].class.opcode == Op::TypeInt
    }

    fn is_a_number_but_zero(&self, value: u32) -> bool {
        let i = self.made[&value];
        match i.class.opcode {
            Op::Constant => word(&i.operands[0]) != 0,
            Op::SpecConstant => true,
            _ => false,
        }
    }

    /// Values that decide: those that become a tile's number and, with `compared`, those compared with a threshold.
    fn decisions(&self, compared: bool) -> Vec<u32> {
        let mut found = Vec::new();
        for i in instructions(self.module) {
            let operands = ids(i);
            match i.class.opcode {
                Op::FOrdLessThan
                | Op::FOrdLessThanEqual
                | Op::FOrdGreaterThan
                | Op::FOrdGreaterThanEqual
                | Op::FUnordLessThan
                | Op::FUnordLessThanEqual
                | Op::FUnordGreaterThan
                | Op::FUnordGreaterThanEqual
                    if compared && operands.iter().any(|v| self.is_a_number_but_zero(*v)) =>
                {
                    found.extend(operands);
                }
                Op::ConvertFToU | Op::ConvertFToS => found.extend(operands),
                _ => {}
            }
        }
        found
    }
}

fn instructions(module: &Module) -> impl Iterator<Item = &Instruction> {
    module.functions.iter().flat_map(|f| &f.blocks).flat_map(|block| &block.instructions)
}

fn is_product(i: &Instruction) -> bool {
    matches!(i.class.opcode, Op::FMul | Op::VectorTimesScalar)
}

impl Flow<'_> {
    fn is_loose(&self, i: &Instruction) -> bool {
        !self.precise.contains(&i.result_id.unwrap())
    }

    /// Whether a sum may be fused with a product that it adds: neither has NoContraction.
    fn may_contract(&self, i: &Instruction) -> bool {
        let sums = match i.class.opcode {
            Op::FAdd | Op::FSub => self.is_loose(i),
            Op::Dot => return self.is_loose(i),
            _ => false,
        };
        let of_sum = |value: u32| {
            self.parts(value).into_iter().any(|part| {
                let mut made = self.made[&self.origin(part).0];
                while made.class.opcode == Op::FNegate {
                    made = self.made[&id(&made.operands[0])];
                }
                is_product(made) && self.is_loose(made)
            })
        };
        sums && ids(i).into_iter().any(of_sum)
    }
}

#[test]
fn what_decides_is_not_contracted() {
    let (mut wrong, mut seen) = (Vec::new(), 0);
    let deciding = |name: &str| name.starts_with("blend_") || name.starts_with("emit") || PROJECTIONS.contains(&name);
    for kernel in pass::ALL.iter().map(|pass| &pass.kernel).filter(|kernel| deciding(kernel.name)) {
        let texels = kernel.spirv.texels.map(|texels| texels.spirv);
        let forms = [Some(kernel.spirv.descriptors), kernel.spirv.addresses, texels];
        for spirv in forms.into_iter().flatten() {
            seen += 1;
            let module = load_bytes(spirv).unwrap();
            let flow = Flow::new(&module);
            let mut decides = HashMap::new();
            // No other kernel repeats the projection's own comparisons.
            for value in flow.decisions(!PROJECTIONS.contains(&kernel.name)) {
                decides.extend(flow.behind(value).into_iter().map(|i| (i.result_id, i)));
            }
            // Sums of products, such as the exponent's two squares and the ends of a tile's row.
            let sums = |i: &&Instruction| matches!(i.class.opcode, Op::FAdd | Op::FSub);
            let sums_of_products = decides
                .values()
                .copied()
                .filter(sums)
                .filter(|i| ids(i).into_iter().any(|v| self::is_product(flow.made[&flow.origin((v, vec![])).0])));
            assert!(sums_of_products.count() >= 2, "{}: nothing decides", kernel.name);
            let loose = decides.into_values().filter(|i| flow.may_contract(i));
            wrong.extend(loose.map(|i| format!("{}: {:?} %{}", kernel.name, i.class.opcode, i.result_id.unwrap())));
        }
    }
    assert!(seen > 30, "only {seen} modules");
    wrong.sort();
    assert!(wrong.is_empty(), "{} operations may be contracted:\n{}", wrong.len(), wrong.join("\n"));
}
