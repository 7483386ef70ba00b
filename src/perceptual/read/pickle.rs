//! The part of Python's pickle format that stores tensors. Nothing is ever called: a call is kept as its function and
//! arguments.

use std::path::Path;
use std::rc::Rc;

use super::{at_byte, slice};
use crate::perceptual::Error;

/// A value on the stack. Values with parts are kept in [`Pickle::objects`].
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Value {
    None,
    Bool(bool),
    Int(i64),
    /// A number of more than 64 bits, little-endian.
    Big(Rc<[u8]>),
    Float(f64),
    Text(Rc<str>),
    /// Module and name of a function or class.
    Global(Rc<str>),
    /// Index in [`Pickle::objects`].
    Object(usize),
}

/// A value with parts.
#[derive(Clone, Debug)]
pub(super) enum Object {
    Tuple(Vec<Value>),
    List(Vec<Value>),
    Dict(Vec<(Value, Value)>),
    /// A reference to data outside the pickle.
    Persistent(Value),
    /// A call, with the items set on its result.
    Call {
        function: Value,
        arguments: Value,
        items: Vec<(Value, Value)>,
    },
}

/// A parsed pickle.
#[derive(Debug)]
pub(super) struct Pickle {
    pub(super) top: Value,
    pub(super) objects: Vec<Object>,
    /// Byte offset of the end.
    pub(super) end: usize,
}

impl Pickle {
    /// The parts of a tuple or a list.
    pub(super) fn parts(&self, value: &Value) -> Option<&[Value]> {
        match self.object(value)? {
            Object::Tuple(parts) | Object::List(parts) => Some(parts),
            _ => None,
        }
    }

    pub(super) fn object(&self, value: &Value) -> Option<&Object> {
        match value {
            Value::Object(at) => self.objects.get(*at),
            _ => None,
        }
    }
}

/// Limit of the memory for a pickle's objects: `PER_BYTE` bytes for each byte of the pickle, plus `AT_LEAST` for small
/// pickles. An instruction of one byte can create an object of a hundred bytes.
const PER_BYTE: usize = 16;
const AT_LEAST: usize = 1 << 20;

struct Machine<'a> {
    file: &'a Path,
    bytes: &'a [u8],
    at: usize,
    stack: Vec<Value>,
    marks: Vec<usize>,
    memo: std::collections::BTreeMap<u32, Value>,
    objects: Vec<Object>,
    /// Number of values in objects, spare capacity included.
    parts: usize,
    /// Bytes of memory that all values and objects may take.
    room: usize,
}

/// Reads the pickle that begins at byte `at`.
pub(super) fn read(file: &Path, bytes: &[u8], at: usize) -> Result<Pickle, Error> {
    let (stack, marks, objects) = (Vec::new(), Vec::new(), Vec::new());
    let room = bytes.len().saturating_mul(PER_BYTE).saturating_add(AT_LEAST);
    let mut machine = Machine { file, bytes, at, stack, marks, memo: Default::default(), objects, parts: 0, room };
    while machine.step()? {
        machine.pay()?;
    }
    let top = machine.pop()?;
    Ok(Pickle { top, objects: machine.objects, end: machine.at })
}

impl<'a> Machine<'a> {
    fn error(&self, problem: impl std::fmt::Display) -> Error {
        at_byte(self.file, self.at, "pickle", problem)
    }

    fn take(&mut self, count: usize) -> Result<&'a [u8], Error> {
        let taken = slice(self.file, self.bytes, self.at, count, "pickle")?;
        self.at += count;
        Ok(taken)
    }

    fn array<const N: usize>(&mut self) -> Result<[u8; N], Error> {
        let mut out = [0; N];
        out.copy_from_slice(self.take(N)?);
        Ok(out)
    }

    fn byte(&mut self) -> Result<u8, Error> {
        Ok(self.array::<1>()?[0])
    }

    fn word(&mut self) -> Result<u32, Error> {
        self.array().map(u32::from_le_bytes)
    }

    fn text(&mut self, count: usize) -> Result<Value, Error> {
        let text = std::str::from_utf8(self.take(count)?).map(Rc::from);
        text.map(Value::Text).map_err(|_| self.error("has text that is not UTF-8"))
    }

    /// Text up to the end of the line.
    fn line(&mut self) -> Result<&'a str, Error> {
        let rest = self.bytes.get(self.at..).unwrap_or_default();
        let end = rest.iter().position(|b| *b == b'\n').ok_or_else(|| self.error("has a line without an end"))?;
        let line = self.take(end + 1)?;
        std::str::from_utf8(&line[..end]).map_err(|_| self.error("has a name that is not UTF-8"))
    }

    /// Fails where values, objects and memo exceed the memory limit. Capacities count, because vectors grow by
    /// doubling.
    fn pay(&mut self) -> Result<(), Error> {
        const MADE: usize = 2 * (size_of::<Value>() + size_of::<Object>());
        let held = self.stack.capacity() * size_of::<Value>()
            + self.objects.capacity() * size_of::<Object>()
            + self.marks.capacity() * size_of::<usize>()
            + self.memo.len() * MADE
            + self.parts * size_of::<Value>();
        if held > self.room {
            let problem = format_args!("takes more than {} bytes of memory, which is too much for its size", self.room);
            return Err(self.error(problem));
        }
        Ok(())
    }

    fn pop(&mut self) -> Result<Value, Error> {
        let floor = self.marks.last().copied().unwrap_or(0);
        let popped = if self.stack.len() > floor { self.stack.pop() } else { None };
        popped.ok_or_else(|| self.error("takes a value from an empty stack"))
    }

    /// Takes the values above the last mark off the stack.
    fn since_mark(&mut self) -> Result<Vec<Value>, Error> {
        let mark = self.marks.pop().ok_or_else(|| self.error("has no mark on the stack"))?;
        Ok(self.stack.split_off(mark.min(self.stack.len())))
    }

    fn several(&mut self, count: usize) -> Result<Vec<Value>, Error> {
        let mut out = (0..count).map(|_| self.pop()).collect::<Result<Vec<_>, _>>()?;
        out.reverse();
        Ok(out)
    }

    fn push(&mut self, object: Object) {
        if let Object::Tuple(parts) | Object::List(parts) = &object {
            self.parts += parts.capacity();
        }
        self.stack.push(Value::Object(self.objects.len()));
        self.objects.push(object);
    }

    fn put(&mut self, place: u32) -> Result<(), Error> {
        let value = self.stack.last().cloned().ok_or_else(|| self.error("stores a value from an empty stack"))?;
        self.memo.insert(place, value);
        Ok(())
    }

    fn get(&mut self, place: u32) -> Result<(), Error> {
        let value = self
            .memo
            .get(&place)
            .cloned()
            .ok_or_else(|| self.error(format_args!("loads from the empty place {place}")))?;
        self.stack.push(value);
        Ok(())
    }

    fn append(&mut self, values: Vec<Value>) -> Result<(), Error> {
        let place = self.stack.last().cloned();
        match place.and_then(|v| if let Value::Object(at) = v { self.objects.get_mut(at) } else { None }) {
            Some(Object::List(list)) => {
                self.parts += values.len();
                list.extend(values);
            }
            _ => return Err(self.error("appends to a value that is no list")),
        }
        Ok(())
    }

    fn set_items(&mut self, values: Vec<Value>) -> Result<(), Error> {
        let place = self.stack.last().cloned();
        let pairs = values.chunks_exact(2).map(|pair| (pair[0].clone(), pair[1].clone()));
        match place.and_then(|v| if let Value::Object(at) = v { self.objects.get_mut(at) } else { None }) {
            Some(Object::Dict(items) | Object::Call { items, .. }) => {
                self.parts += values.len();
                items.extend(pairs);
            }
            _ => return Err(self.error("sets items of a value that is no dictionary")),
        }
        Ok(())
    }

    fn global(&mut self, module: &str, name: &str) {
        self.stack.push(Value::Global(format!("{module}.{name}").into()));
    }

    /// Runs one instruction; false after the last.
    fn step(&mut self) -> Result<bool, Error> {
        let opcode = self.byte()?;
        match opcode {
            0x80 => drop(self.byte()?),
            0x95 => drop(self.take(8)?),
            b'.' => return Ok(false),
            b'(' => self.marks.push(self.stack.len()),
            b'}' => self.push(Object::Dict(Vec::new())),
            b']' => self.push(Object::List(Vec::new())),
            b')' => self.push(Object::Tuple(Vec::new())),
            b't' => {
                let parts = self.since_mark()?;
                self.push(Object::Tuple(parts));
            }
            0x85..=0x87 => {
                let parts = self.several(usize::from(opcode - 0x84))?;
                self.push(Object::Tuple(parts));
            }
            b'a' => {
                let value = self.pop()?;
                self.append(vec![value])?;
            }
            b'e' => {
                let values = self.since_mark()?;
                self.append(values)?;
            }
            b's' => {
                let pair = self.several(2)?;
                self.set_items(pair)?;
            }
            b'u' => {
                let values = self.since_mark()?;
                self.set_items(values)?;
            }
            b'q' => {
                let place = self.byte()?;
                self.put(place.into())?;
            }
            b'r' => {
                let place = self.word()?;
                self.put(place)?;
            }
            0x94 => {
                let place = self.memo.len() as u32;
                self.put(place)?;
            }
            b'h' => {
                let place = self.byte()?;
                self.get(place.into())?;
            }
            b'j' => {
                let place = self.word()?;
                self.get(place)?;
            }
            b'c' => {
                let (module, name) = (self.line()?, self.line()?);
                self.global(module, name);
            }
            0x93 => match self.several(2)?.as_slice() {
                [Value::Text(module), Value::Text(name)] => self.global(module, name),
                _ => return Err(self.error("has a name that is no text")),
            },
            b'Q' => {
                let value = self.pop()?;
                self.push(Object::Persistent(value));
            }
            b'R' => {
                let arguments = self.pop()?;
                let function = self.pop()?;
                self.push(Object::Call { function, arguments, items: Vec::new() });
            }
            // An object's state (BUILD) holds no tensors.
            b'b' => drop(self.pop()?),
            _ => {
                let value = self.literal(opcode)?;
                self.stack.push(value);
            }
        }
        Ok(true)
    }

    fn literal(&mut self, opcode: u8) -> Result<Value, Error> {
        Ok(match opcode {
            b'N' => Value::None,
            0x88 | 0x89 => Value::Bool(opcode == 0x88),
            b'K' => Value::Int(self.byte()?.into()),
            b'M' => Value::Int(u16::from_le_bytes(self.array()?).into()),
            b'J' => Value::Int(i32::from_le_bytes(self.array()?).into()),
            b'G' => Value::Float(f64::from_be_bytes(self.array()?)),
            0x8a => {
                let count = usize::from(self.byte()?);
                let bytes = self.take(count)?;
                let negative = bytes.last().is_some_and(|b| b & 0x80 != 0);
                match count {
                    0..=8 => {
                        let mut wide = [if negative { 0xff } else { 0 }; 8];
                        wide[..count].copy_from_slice(bytes);
                        Value::Int(i64::from_le_bytes(wide))
                    }
                    _ => Value::Big(bytes.into()),
                }
            }
            b'U' | 0x8c => {
                let count = self.byte()?;
                self.text(count.into())?
            }
            b'T' | b'X' => {
                let count = self.word()?;
                self.text(count as usize)?
            }
            _ => {
                self.at -= 1;
                return Err(self.error(format_args!("has the instruction {opcode:#04x}, which tensors do not need")));
            }
        })
    }
}
