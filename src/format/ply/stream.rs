//! The splats of a model file of this program one after the other, so that no more than one is in memory.

use std::fs::File;
use std::io::{self, BufReader, Read};
use std::path::{Path, PathBuf};

use super::header::{self, Encoding, Header, Kind};
use super::write::{header as written_header, properties};
use super::{Model, REST_BY_DEGREE, read};
use crate::format::{At, Error, atomic, source};

/// Bytes of a splat with spherical harmonics of degree 3.
pub const SPLAT_BYTES: usize = 4 * 62;

/// Bytes of a splat as they are in the file.
pub type SplatBytes = [u8; SPLAT_BYTES];

/// The position of a splat in the file's coordinates.
pub fn position(splat: &SplatBytes) -> [f32; 3] {
    std::array::from_fn(|k| f32::from_le_bytes([splat[4 * k], splat[4 * k + 1], splat[4 * k + 2], splat[4 * k + 3]]))
}

/// Gives a splat another position.
pub fn set_position(splat: &mut SplatBytes, place: [f32; 3]) {
    for (to, value) in splat.chunks_exact_mut(4).zip(place) {
        to.copy_from_slice(&value.to_le_bytes());
    }
}

/// A model file of this program that is read splat by splat.
#[derive(Debug)]
pub struct Splats {
    file: PathBuf,
    reader: BufReader<File>,
    /// Splats of the file.
    pub count: u64,
    left: u64,
    /// Vector from positions in the file to dataset coordinates.
    pub shift: [f64; 3],
    /// Whether opacities carry the anti-aliasing factor, if the file says so.
    pub antialias: Option<bool>,
}

impl Splats {
    /// Opens a file. An error if it has another layout than this program writes, or is longer or shorter than its
    /// header says.
    pub fn open(file: &Path) -> Result<Self, Error> {
        let (opened, bytes) = source::open(file)?;
        let mut reader = BufReader::with_capacity(1 << 18, opened);
        let header = header::read(file, bytes, &mut reader)?;
        let count = splats(file, &header, bytes)?;
        let mut model = Model::default();
        let told = Header { comments: other_comments(&header), ..header };
        read::read_comments(file, &told, &mut model)?;
        let (shift, antialias) = (model.shift, model.antialias);
        Ok(Self { file: file.to_owned(), reader, count, left: count, shift, antialias })
    }

    /// The next splat; `None` after the last.
    pub fn next_splat(&mut self) -> Result<Option<SplatBytes>, Error> {
        if self.left == 0 {
            return Ok(None);
        }
        let mut splat = [0; SPLAT_BYTES];
        self.reader.read_exact(&mut splat).map_err(Error::io(&self.file, "read"))?;
        self.left -= 1;
        Ok(Some(splat))
    }
}

/// The number of splats of a file with the usual layout.
fn splats(file: &Path, header: &Header, bytes: u64) -> Result<u64, Error> {
    let fail = |at: u64, problem: String| Err(Error::malformed(file, "header", At::Byte(at), problem));
    let usual = properties(REST_BY_DEGREE[3]);
    let vertex = match header.elements.as_slice() {
        [vertex] if vertex.name == "vertex" && header.encoding == Encoding::LittleEndian => vertex,
        _ => return fail(0, "a model of psrgs-vk is one binary little-endian element 'vertex'".to_owned()),
    };
    let of_program = vertex.properties.len() == usual.len()
        && vertex
            .properties
            .iter()
            .zip(&usual)
            .all(|(p, name)| p.name == *name && p.kind == Kind::F32 && p.count.is_none());
    if !of_program {
        return fail(vertex.at, "the properties are not those of a model of psrgs-vk of degree 3".to_owned());
    }
    let data = bytes.saturating_sub(header.bytes);
    if vertex.count.checked_mul(SPLAT_BYTES as u64) == Some(data) {
        return Ok(vertex.count);
    }
    let problem = format!("{} splats of {SPLAT_BYTES} bytes are not the {data} bytes of data", vertex.count);
    fail(vertex.at, problem)
}

/// The comments but the one on the stages, which says nothing of splats one by one.
fn other_comments(header: &Header) -> Vec<(u64, String)> {
    let others = header.comments.iter().filter(|(_, comment)| !comment.starts_with("psrgs-vk constrained "));
    others.cloned().collect()
}

/// Writes a file of `count` splats, which `splats` writes one after the other. The file is written whole or not at all,
/// and not at all if there are more or fewer splats.
pub fn write_splats(
    file: &Path,
    count: u64,
    (shift, antialias): ([f64; 3], Option<bool>),
    splats: impl FnOnce(&mut dyn FnMut(&SplatBytes) -> io::Result<()>) -> Result<(), Error>,
) -> Result<(), Error> {
    let version = Some(env!("CARGO_PKG_VERSION").to_owned());
    let model = Model { sh_degree: 3, shift, antialias, version, ..Model::default() };
    let mut failed = None;
    let written = atomic::write(file, |out| {
        out.write_all(written_header(&model, count, REST_BY_DEGREE[3]).as_bytes())?;
        let mut done = 0;
        let outcome = splats(&mut |splat| {
            done += 1;
            out.write_all(splat)
        });
        if let Err(error) = outcome {
            failed = Some(error);
            return Err(io::Error::other("the splats cannot be read"));
        }
        match done == count {
            true => Ok(()),
            false => Err(io::Error::other(format!("{done} splats came where {count} were counted"))),
        }
    });
    failed.map_or(written, Err)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::format::ply;
    use crate::scene::Gaussians;

    fn model(n: usize) -> Model {
        let mut gaussians = Gaussians::zeros(n);
        gaussians.means = (0..3 * n).map(|k| k as f32 * 0.37 - 1.0).collect();
        gaussians.sh[3].iter_mut().enumerate().for_each(|(k, v)| *v = k as f32);
        let shift = [5e5, 4.6e6, 100.0];
        let (antialias, version) = (Some(true), Some(env!("CARGO_PKG_VERSION").to_owned()));
        Model { gaussians, sh_degree: 3, shift, antialias, version, ..Model::default() }
    }

    #[test]
    fn splats_pass_through_with_equal_bytes() {
        let folder = tempfile::tempdir().unwrap();
        let [from, to] = ["a.ply", "b.ply"].map(|name| folder.path().join(name));
        ply::write(&from, &Model { constrained: Some(3), ..model(7) }).unwrap();
        let mut splats = Splats::open(&from).unwrap();
        assert_eq!((splats.count, splats.shift, splats.antialias), (7, model(7).shift, Some(true)));
        write_splats(&to, splats.count, (splats.shift, splats.antialias), |each| {
            while let Some(splat) = splats.next_splat()? {
                each(&splat).map_err(Error::io(&to, "write"))?;
            }
            Ok(())
        })
        .unwrap();
        ply::write(&from, &model(7)).unwrap();
        assert_eq!(std::fs::read(&from).unwrap(), std::fs::read(&to).unwrap());
    }

    #[test]
    fn a_count_that_is_not_met_leaves_no_file() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("a.ply");
        for count in [0, 2] {
            let one = |each: &mut dyn FnMut(&SplatBytes) -> io::Result<()>| {
                each(&[0; SPLAT_BYTES]).map_err(Error::io(&file, "write"))
            };
            assert!(write_splats(&file, count, ([0.0; 3], None), one).is_err());
            assert!(!file.exists());
        }
    }

    #[test]
    fn a_file_of_another_length_or_layout_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("a.ply");
        ply::write(&file, &model(4)).unwrap();
        let whole = std::fs::read(&file).unwrap();
        for bytes in [&whole[..whole.len() - 1], &whole[..whole.len() - SPLAT_BYTES], &[&whole[..], &[0]].concat()] {
            std::fs::write(&file, bytes).unwrap();
            let problem = Splats::open(&file).unwrap_err().to_string();
            assert!(problem.contains("a.ply") && problem.contains("4 splats of 248 bytes"), "{problem}");
        }
        ply::write_degree(&file, &model(4), 1).unwrap();
        assert!(Splats::open(&file).unwrap_err().to_string().contains("properties"));
    }

    #[test]
    fn a_position_is_read_as_it_was_set() {
        let mut splat = [7; SPLAT_BYTES];
        set_position(&mut splat, [1.5, -2.0, 1e9]);
        assert_eq!((position(&splat), splat[12]), ([1.5, -2.0, 1e9], 7));
    }
}
