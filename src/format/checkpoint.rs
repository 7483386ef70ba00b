//! The state of a training in one file.
//!
//! All numbers are little endian. Header: the eight bytes `PSRGS-VK`, u32 version, u32 number of sections. Each
//! section, in the order of the names: u32 length of the name, the name, u64 length of the content, u32 CRC-32 of the
//! content, the content. End: u32 CRC-32 of everything before. The trainer defines the contents of the sections.

mod store;

use std::collections::BTreeMap;
use std::io::{self, Write};
use std::path::{Path, PathBuf};

use crc32fast::Hasher;

use super::source::Source;
use super::{Error, atomic};

pub use store::{Latest, file_name, latest, newest, save, told_apart};

const MAGIC: [u8; 8] = *b"PSRGS-VK";
/// Version of the layout. Other versions are refused.
pub const VERSION: u32 = 1;

/// Named sections of bytes.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Checkpoint {
    sections: BTreeMap<String, Vec<u8>>,
    /// The file it was read from, for errors.
    file: PathBuf,
}

/// A number that a section can hold.
pub trait Value: bytemuck::Pod {
    /// Converts between native and little endian byte order.
    fn little_endian(self) -> Self;
}

impl Value for u32 {
    fn little_endian(self) -> Self {
        self.to_le()
    }
}

impl Value for u64 {
    fn little_endian(self) -> Self {
        self.to_le()
    }
}

impl Value for f32 {
    fn little_endian(self) -> Self {
        Self::from_bits(self.to_bits().to_le())
    }
}

impl Value for f64 {
    fn little_endian(self) -> Self {
        Self::from_bits(self.to_bits().to_le())
    }
}

impl Checkpoint {
    /// A checkpoint without sections.
    pub fn new() -> Self {
        Self::default()
    }

    /// Names of the sections.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        self.sections.keys().map(String::as_str)
    }

    /// Adds or replaces a section.
    pub fn put(&mut self, section: &str, content: Vec<u8>) {
        self.sections.insert(section.to_owned(), content);
    }

    /// Adds or replaces a section of numbers.
    pub fn put_values<T: Value>(&mut self, section: &str, values: &[T]) {
        let bytes = if cfg!(target_endian = "little") {
            bytemuck::cast_slice(values).to_vec()
        } else {
            values.iter().flat_map(|v| bytemuck::bytes_of(&v.little_endian()).to_vec()).collect()
        };
        self.put(section, bytes);
    }

    /// Adds or replaces a section of text.
    pub fn put_text(&mut self, section: &str, text: &str) {
        self.put(section, text.as_bytes().to_vec());
    }

    /// The bytes of a section.
    pub fn bytes(&self, section: &str) -> Result<&[u8], Error> {
        let found = self.sections.get(section).map(Vec::as_slice);
        found.ok_or_else(|| Error::NoSection { file: self.file.clone(), section: section.to_owned() })
    }

    /// The numbers of a section.
    pub fn values<T: Value>(&self, section: &str) -> Result<Vec<T>, Error> {
        let bytes = self.bytes(section)?;
        if bytes.len() % size_of::<T>() != 0 {
            let problem = format!("{} bytes are not a number of values of {}", bytes.len(), size_of::<T>());
            return Err(self.wrong(section, problem));
        }
        let read = |chunk: &[u8]| bytemuck::pod_read_unaligned::<T>(chunk).little_endian();
        Ok(bytes.chunks_exact(size_of::<T>()).map(read).collect())
    }

    /// The single number of a section.
    pub fn value<T: Value>(&self, section: &str) -> Result<T, Error> {
        match self.values(section)?.as_slice() {
            [value] => Ok(*value),
            values => Err(self.wrong(section, format!("{} values where there should be one", values.len()))),
        }
    }

    /// The text of a section.
    pub fn text(&self, section: &str) -> Result<&str, Error> {
        std::str::from_utf8(self.bytes(section)?).map_err(|_| self.wrong(section, "is not UTF-8".to_owned()))
    }

    fn wrong(&self, section: &str, problem: String) -> Error {
        // Byte offset of the section in the file as read: sections are in the order of their names.
        let before: usize =
            self.sections.range(..section.to_owned()).map(|(name, content)| name.len() + content.len() + 16).sum();
        let at = super::At::Byte((16 + before) as u64);
        Error::malformed(&self.file, format_args!("section '{section}'"), at, problem)
    }

    /// Writes the file, whole or not at all.
    pub fn write(&self, file: &Path) -> Result<(), Error> {
        let count = u32::try_from(self.sections.len()).ok();
        let names: Option<Vec<u32>> = self.sections.keys().map(|name| u32::try_from(name.len()).ok()).collect();
        let (Some(count), Some(names)) = (count, names) else {
            let problem = "there are too many of them, or a name is too long".to_owned();
            return Err(Error::Unwritable { file: file.to_owned(), what: "the sections", problem });
        };
        atomic::write(file, |out| {
            let mut out = Summed { out, sum: Hasher::new() };
            out.write_all(&MAGIC)?;
            out.write_all(&VERSION.to_le_bytes())?;
            out.write_all(&count.to_le_bytes())?;
            for ((name, content), length) in self.sections.iter().zip(names) {
                out.write_all(&length.to_le_bytes())?;
                out.write_all(name.as_bytes())?;
                out.write_all(&(content.len() as u64).to_le_bytes())?;
                out.write_all(&crc32fast::hash(content).to_le_bytes())?;
                out.write_all(content)?;
            }
            let sum = out.sum.clone().finalize();
            out.write_all(&sum.to_le_bytes())
        })
    }

    /// Reads a file and checks its checksums.
    pub fn read(file: &Path) -> Result<Self, Error> {
        let mut source = Source::open(file)?;
        let mut sum = Hasher::new();
        let magic: [u8; 8] = source.array("magic")?;
        if magic != MAGIC {
            return Err(source.error(0, "magic", "this is not a checkpoint of psrgs-vk"));
        }
        let version = source.u32("version")?;
        if version != VERSION {
            return Err(source.error(8, "version", format_args!("is {version}, this program reads {VERSION}")));
        }
        let count = source.u32("number of sections")?;
        sum.update(&magic);
        sum.update(&version.to_le_bytes());
        sum.update(&count.to_le_bytes());
        let mut sections = BTreeMap::new();
        for i in 0..count {
            let (name, content) = section(&mut source, &mut sum, i)?;
            sections.insert(name, content);
        }
        let at = source.at();
        let expected = source.u32("checksum of the file")?;
        if expected != sum.finalize() {
            return Err(source.error(at, "checksum of the file", "does not match: the file is damaged"));
        }
        source.end("end of the sections")?;
        Ok(Self { sections, file: file.to_owned() })
    }
}

fn section(source: &mut Source, sum: &mut Hasher, i: u32) -> Result<(String, Vec<u8>), Error> {
    let length = source.u32(format_args!("length of the name of section {i}"))?;
    let at = source.at();
    let name = source.bytes(u64::from(length), format_args!("name of section {i}"))?;
    sum.update(&length.to_le_bytes());
    sum.update(&name);
    let name =
        String::from_utf8(name).map_err(|_| source.error(at, format_args!("name of section {i}"), "is not UTF-8"))?;
    let length = source.u64(format_args!("length of section '{name}'"))?;
    let expected = source.u32(format_args!("checksum of section '{name}'"))?;
    let at = source.at();
    let content = source.bytes(length, format_args!("section '{name}'"))?;
    if crc32fast::hash(&content) != expected {
        return Err(source.error(at, format_args!("section '{name}'"), "the checksum does not match: it is damaged"));
    }
    sum.update(&length.to_le_bytes());
    sum.update(&expected.to_le_bytes());
    sum.update(&content);
    Ok((name, content))
}

/// Passes bytes on and computes their checksum.
struct Summed<'a> {
    out: &'a mut dyn Write,
    sum: Hasher,
}

impl Write for Summed<'_> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let written = self.out.write(bytes)?;
        self.sum.update(&bytes[..written]);
        Ok(written)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.out.flush()
    }
}
