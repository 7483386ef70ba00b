//! Reads models, also of other programs: any order of properties, further properties, other number types, degrees 0 to
//! 3.

use std::fs::File;
use std::io::{BufRead, BufReader, Read};
use std::ops::Range;
use std::path::Path;

use super::header::{self, Element, Encoding, Header, Kind};
use super::{Model, REST_BY_DEGREE, compressed};
use crate::format::{At, Error, Tally, source};
use crate::numbers::counted;
use crate::scene::{Gaussians, SH_GROUP_FLOATS};

/// Largest logit of an opacity. Files hold infinite logits for opacities of exactly 0 or 1, which no gradient can move.
/// The sigmoid of 16 is 1 in f32.
const MAX_LOGIT: f32 = 16.0;

/// Reads a model. A few splats that are not finite are left out, see [`Model::left_out`].
pub fn read(file: &Path) -> Result<Model, Error> {
    read_with(file, false)
}

/// Reads a model. Splats that are not finite are an error where `strict` is set or where they are more than one in ten.
pub fn read_with(file: &Path, strict: bool) -> Result<Model, Error> {
    let (header, vertices, mut rows) = open(file)?;
    let vertex = &header.elements[vertices];
    if compressed::is_compressed(vertex) {
        return compressed::read(file, &header, &mut rows, strict);
    }
    let columns = Columns::find(file, vertex)?;
    rows.go_to(&header, vertices)?;
    let mut tally = Tally::new(strict);
    let (gaussians, bad) = read_splats(&mut rows, vertex, &columns, &mut tally)?;
    let mut model = Model { gaussians, sh_degree: columns.degree, ..Model::default() };
    read_comments(file, &header, &mut model)?;
    if !bad.is_empty() {
        let good = (0..model.gaussians.len() as u32).filter(|row| bad.binary_search(row).is_err());
        model = model.rows(&good.collect::<Vec<_>>());
    }
    model.left_out = tally.end(file, "splats", model.gaussians.len())?;
    Ok(model)
}

/// The header, the index of the vertex element, and the data.
pub(super) fn open(file: &Path) -> Result<(Header, usize, Rows<'_>), Error> {
    let (opened, len) = source::open(file)?;
    let mut reader = BufReader::with_capacity(1 << 18, opened);
    let header = header::read(file, len, &mut reader)?;
    let Some(vertices) = header.elements.iter().position(|e| e.name == "vertex") else {
        return Err(Error::malformed(file, "header", At::Byte(header.bytes), "there is no element 'vertex'"));
    };
    let rows = Rows::new(file, reader, &header, len);
    Ok((header, vertices, rows))
}

/// Destination of a property.
#[derive(Clone, Copy)]
enum Column {
    Mean(usize),
    /// Coefficient and channel of spherical harmonics.
    Sh(usize, usize),
    Opacity,
    Scale(usize),
    Quat(usize),
    Ignored,
}

struct Columns {
    /// Destinations in the order of the file.
    columns: Vec<Column>,
    degree: u32,
}

impl Columns {
    fn find(file: &Path, vertex: &Element) -> Result<Self, Error> {
        let fail = |problem: String| Error::malformed(file, "element vertex", At::Byte(vertex.at), problem);
        let has = |name: &str| vertex.properties.iter().any(|p| p.name == name);
        let required = ["x", "y", "z", "f_dc_0", "f_dc_1", "f_dc_2", "opacity", "scale_0", "scale_1", "scale_2"];
        if let Some(name) = required.iter().chain(&["rot_0", "rot_1", "rot_2", "rot_3"]).find(|name| !has(name)) {
            return Err(fail(format!("the property '{name}' is missing: this is not a 3D Gaussian model")));
        }
        let rest = vertex.properties.iter().filter(|p| p.name.starts_with("f_rest_")).count();
        let degree = REST_BY_DEGREE
            .iter()
            .position(|n| 3 * n == rest)
            .filter(|_| (0..rest).all(|k| has(&format!("f_rest_{k}"))))
            .ok_or_else(|| fail(format!("{rest} properties f_rest_N are not those of a degree from 0 to 3")))?;
        let per_channel = REST_BY_DEGREE[degree].max(1);
        let column = |name: &str| match name.rsplit_once('_').map(|(base, k)| (base, k.parse::<usize>())) {
            Some(("f_dc", Ok(k @ 0..3))) => Column::Sh(0, k),
            Some(("f_rest", Ok(k))) => Column::Sh(1 + k % per_channel, k / per_channel),
            Some(("scale", Ok(k @ 0..3))) => Column::Scale(k),
            Some(("rot", Ok(k @ 0..4))) => Column::Quat(k),
            _ => match name {
                "x" => Column::Mean(0),
                "y" => Column::Mean(1),
                "z" => Column::Mean(2),
                "opacity" => Column::Opacity,
                _ => Column::Ignored,
            },
        };
        let columns = vertex.properties.iter().map(|p| column(&p.name)).collect();
        Ok(Self { columns, degree: degree as u32 })
    }
}

/// The splats of the file, and the numbers of those that are not finite.
fn read_splats(
    rows: &mut Rows<'_>,
    vertex: &Element,
    columns: &Columns,
    tally: &mut Tally<Error>,
) -> Result<(Gaussians, Vec<u32>), Error> {
    let fail = |problem: &str| Error::malformed(rows.file, "element vertex", At::Byte(vertex.at), problem);
    let n = u32::try_from(vertex.count).map_err(|_| fail("there are more vertices than can be numbered"))? as usize;
    let (mut out, mut all_bad) = (Gaussians::zeros(n), Vec::new());
    for i in 0..n {
        let mut bad = None;
        let read = rows.row(vertex, i as u64, |p, value| {
            let value = value as f32;
            match columns.columns[p] {
                Column::Mean(k) => out.means[3 * i + k] = value,
                Column::Sh(k, c) => out.sh[k / 4][SH_GROUP_FLOATS * i + 3 * (k % 4) + c] = value,
                Column::Scale(k) => out.scales[3 * i + k] = value,
                Column::Quat(k) => out.quats[4 * i + k] = value,
                Column::Opacity if value.is_infinite() => {
                    out.opacities[i] = MAX_LOGIT.copysign(value);
                    return;
                }
                Column::Opacity => out.opacities[i] = value,
                Column::Ignored => return,
            }
            if !value.is_finite() {
                bad = bad.or(Some((p, value)));
            }
        });
        let error = match (read, bad) {
            (Err(error), _) if !rows.can_go_on() => return Err(error),
            (Err(error), _) => error,
            (Ok(()), None) => continue,
            (Ok(()), Some((p, value))) => not_finite(rows, vertex, i, p, value),
        };
        tally.bad(format_args!("vertex {i}"), error)?;
        all_bad.push(i as u32);
    }
    Ok((out, all_bad))
}

/// The error for a value of the last row that is not finite.
fn not_finite(rows: &Rows<'_>, vertex: &Element, i: usize, p: usize, value: f32) -> Error {
    let before: usize = vertex.properties[..p].iter().map(|q| q.kind.bytes()).sum();
    let at = match rows.encoding {
        Encoding::Ascii => At::Line(rows.line),
        _ => At::Byte(rows.at - vertex.row_bytes() as u64 + before as u64),
    };
    Error::malformed(
        rows.file,
        format_args!("{} of vertex {i}", vertex.properties[p].name),
        at,
        format_args!("is {value}"),
    )
}

/// The data after the header, read row by row.
pub(super) struct Rows<'a> {
    file: &'a Path,
    reader: BufReader<File>,
    encoding: Encoding,
    at: u64,
    line: u64,
    /// Whether the last row was a complete line of text, so that the next row begins after it whatever it held.
    line_read: bool,
    len: u64,
}

impl<'a> Rows<'a> {
    /// Starts after a header.
    fn new(file: &'a Path, reader: BufReader<File>, header: &Header, len: u64) -> Self {
        Self { file, reader, encoding: header.encoding, at: header.bytes, line: header.lines, line_read: false, len }
    }

    /// Skips the elements before number `element`, and checks that the file can hold that element.
    pub(super) fn go_to(&mut self, header: &Header, element: usize) -> Result<(), Error> {
        self.skip(header, 0..element)?;
        self.check_fits(&header.elements[element])
    }

    /// Skips the elements of a range, of which the first comes next.
    pub(super) fn skip(&mut self, header: &Header, elements: Range<usize>) -> Result<(), Error> {
        for before in header.elements.get(elements).unwrap_or_default() {
            self.check_fits(before)?;
            if !self.takes_nothing(before) {
                (0..before.count).try_for_each(|i| self.row(before, i, |_, _| ()))?;
            }
        }
        Ok(())
    }

    /// Skips an element that may have lists.
    pub(super) fn pass_over_lists(&mut self, element: &Element) -> Result<(), Error> {
        if self.takes_nothing(element) {
            return Ok(());
        }
        (0..element.count).try_for_each(|i| self.list_row(element, i, usize::MAX, &mut Vec::new()))
    }

    /// Whether an element's rows take no bytes, so that any number of them would fit.
    fn takes_nothing(&self, element: &Element) -> bool {
        element.properties.is_empty() && self.encoding != Encoding::Ascii
    }

    /// Whether the next row can be read after a bad one.
    pub(super) fn can_go_on(&self) -> bool {
        self.encoding == Encoding::Ascii && self.line_read
    }

    /// Position after the last row.
    pub(super) fn place(&self) -> At {
        if self.encoding == Encoding::Ascii { At::Line(self.line) } else { At::Byte(self.at) }
    }

    /// Checks that the file can hold all rows of an element, before memory is allocated.
    pub(super) fn check_fits(&self, element: &Element) -> Result<(), Error> {
        let field = || format!("element {}", element.name);
        if element.has_list && (self.encoding != Encoding::Ascii || element.name == "vertex") {
            let problem = "lists are not supported in or before the vertices";
            return Err(Error::malformed(self.file, field(), At::Byte(element.at), problem));
        }
        let row = match self.encoding {
            // At least one digit and a separator per value.
            Encoding::Ascii => 2 * element.properties.len().max(1) as u64 - 1,
            _ => element.row_bytes() as u64,
        };
        let left = self.len.saturating_sub(self.at);
        if element.count.checked_mul(row.max(1)).is_some_and(|bytes| bytes <= left) {
            return Ok(());
        }
        let problem = format!("{} rows of at least {row} bytes do not fit the {left} bytes of data", element.count);
        Err(Error::malformed(self.file, field(), At::Byte(element.at), problem))
    }

    /// Reads row `i` of an element. Passes its values with the positions of their properties.
    pub(super) fn row(&mut self, element: &Element, i: u64, mut value: impl FnMut(usize, f64)) -> Result<(), Error> {
        match self.encoding {
            Encoding::Ascii => self.text_row(element, i, value),
            encoding => {
                for (p, property) in element.properties.iter().enumerate() {
                    let decoded = self.number(encoding, property.kind).map_err(|e| {
                        let field = format!("{} of {} {i}", property.name, element.name);
                        match e.kind() {
                            std::io::ErrorKind::UnexpectedEof => {
                                Error::malformed(self.file, field, At::Byte(self.at), "the file ends here")
                            }
                            _ => Error::io(self.file, "read")(e),
                        }
                    })?;
                    value(p, decoded);
                }
                Ok(())
            }
        }
    }

    /// Reads row `i` of an element with lists, and keeps the numbers of property `wanted`.
    pub(super) fn list_row(
        &mut self,
        element: &Element,
        i: u64,
        wanted: usize,
        kept: &mut Vec<f64>,
    ) -> Result<(), Error> {
        kept.clear();
        let file = self.file;
        let wrong = |at: At, problem: &str| Error::malformed(file, format_args!("{} {i}", element.name), at, problem);
        if self.encoding == Encoding::Ascii {
            let mut raw = String::new();
            let read = self.reader.read_line(&mut raw).map_err(Error::io(file, "read"))?;
            self.at += read as u64;
            self.line += 1;
            let at = At::Line(self.line);
            if read == 0 {
                return Err(wrong(at, "the file ends here"));
            }
            let mut words = raw.split_whitespace();
            let mut number =
                || words.next().and_then(|w| w.parse::<f64>().ok()).ok_or_else(|| wrong(at, "a number is missing"));
            for (p, property) in element.properties.iter().enumerate() {
                let count = if property.count.is_some() { number()? as u64 } else { 1 };
                for _ in 0..count {
                    let value = number()?;
                    if p == wanted {
                        kept.push(value);
                    }
                }
            }
            return Ok(());
        }
        for (p, property) in element.properties.iter().enumerate() {
            let ended = |e: std::io::Error, at: u64| match e.kind() {
                std::io::ErrorKind::UnexpectedEof => wrong(At::Byte(at), "the file ends here"),
                _ => Error::io(file, "read")(e),
            };
            let count = match property.count {
                Some(kind) => self.number(self.encoding, kind).map_err(|e| ended(e, self.at))? as u64,
                None => 1,
            };
            for _ in 0..count {
                let value = self.number(self.encoding, property.kind).map_err(|e| ended(e, self.at))?;
                if p == wanted {
                    kept.push(value);
                }
            }
        }
        Ok(())
    }

    fn number(&mut self, encoding: Encoding, kind: Kind) -> std::io::Result<f64> {
        let mut bytes = [0; 8];
        let used = &mut bytes[..kind.bytes()];
        self.reader.read_exact(used)?;
        if encoding == Encoding::BigEndian {
            used.reverse();
        }
        self.at += kind.bytes() as u64;
        Ok(kind.decode(bytes))
    }

    fn text_row(&mut self, element: &Element, i: u64, mut value: impl FnMut(usize, f64)) -> Result<(), Error> {
        let (mut raw, mut read) = (Vec::new(), 1);
        self.line_read = false;
        // Empty lines between rows are skipped, but a row without properties is an empty line.
        while read > 0 && raw.trim_ascii().is_empty() {
            raw.clear();
            read = self.reader.read_until(b'\n', &mut raw).map_err(Error::io(self.file, "read"))?;
            self.at += read as u64;
            self.line += 1;
            if element.properties.is_empty() {
                break;
            }
        }
        let at = At::Line(self.line);
        let fail = |field: String, problem: &str| Error::malformed(self.file, field, at, problem);
        if read == 0 {
            return Err(fail(format!("{} {i}", element.name), "the file ends here"));
        }
        // A last line without a newline may be truncated.
        self.line_read = raw.ends_with(b"\n");
        let text = std::str::from_utf8(&raw).map_err(|_| fail(format!("{} {i}", element.name), "is not text"))?;
        if element.has_list {
            return Ok(());
        }
        let mut words = text.split_whitespace();
        for (p, property) in element.properties.iter().enumerate() {
            let field = || format!("{} of {} {i}", property.name, element.name);
            let word = words.next().ok_or_else(|| fail(field(), "is missing"))?;
            value(p, word.parse().map_err(|_| fail(field(), "is not a number"))?);
        }
        Ok(())
    }
}

/// Whether a comment of another program says that the model has the anti-aliasing factor: Brush's `SplatRenderMode:
/// mip`, Postshot's `antialiased 1`.
fn render_mode(comment: &str) -> Option<bool> {
    let (key, value) = comment.split_once([':', ' '])?;
    match (key.trim(), value.trim_start_matches(':').trim()) {
        ("SplatRenderMode", "mip") | ("antialiased", "1") => Some(true),
        ("SplatRenderMode", "default") | ("antialiased", "0") => Some(false),
        _ => None,
    }
}

/// Reads this program's comments, and those of other programs about anti-aliasing. Other comments are ignored.
pub(super) fn read_comments(file: &Path, header: &Header, model: &mut Model) -> Result<(), Error> {
    for (at, comment) in &header.comments {
        if let Some(antialias) = render_mode(comment) {
            model.antialias = Some(antialias);
        }
        let mut words = comment.split_whitespace();
        if words.next() != Some("psrgs-vk") {
            continue;
        }
        let (key, values): (_, Vec<&str>) = (words.next(), words.collect());
        let wrong = || {
            let problem = format!("'{comment}' is not understood");
            Error::malformed(file, "comment", At::Byte(*at), problem)
        };
        match (key, values.as_slice()) {
            (Some("version"), [version, ..]) => model.version = Some((*version).to_owned()),
            (Some("antialias"), ["0"]) => model.antialias = Some(false),
            (Some("antialias"), ["1"]) => model.antialias = Some(true),
            (Some("offset"), [x, y, z]) => {
                for (out, word) in model.shift.iter_mut().zip([x, y, z]) {
                    *out = word.parse().ok().filter(|v: &f64| v.is_finite()).ok_or_else(wrong)?;
                }
            }
            (Some("constrained"), [count]) => {
                let all = model.gaussians.len();
                let count = count.parse().map_err(|_| wrong())?;
                if count > all {
                    let problem = format!(
                        "'{comment}', of {}: another program has left some out; remove that line to read the rest",
                        counted(all, "splat")
                    );
                    return Err(Error::malformed(file, "comment", At::Byte(*at), problem));
                }
                model.constrained = Some(count);
            }
            (Some("antialias" | "offset" | "constrained"), _) => return Err(wrong()),
            _ => {}
        }
    }
    Ok(())
}
