//! Some properties of the vertices, as numbers: for files that are no models.

use std::path::Path;

use super::read::open;
use crate::format::{At, Error, Tally};

/// For each vertex the properties of these names, the `needed` ones first: an error when one of those is missing, `None` for one of the
/// `others` that the file does not have. Vertices with a needed one that is not finite are counted as bad.
pub(super) fn columns(
    file: &Path,
    needed: &[&str],
    others: &[&str],
    tally: &mut Tally<Error>,
) -> Result<Vec<Vec<Option<f64>>>, Error> {
    let (header, vertices, mut rows) = open(file)?;
    let vertex = &header.elements[vertices];
    let place = |name: &&str| vertex.properties.iter().position(|p| p.name == **name);
    if let Some(missing) = needed.iter().find(|name| place(name).is_none()) {
        let problem = format!("the property '{missing}' is missing");
        return Err(Error::malformed(file, "element vertex", At::Byte(vertex.at), problem));
    }
    let places: Vec<Option<usize>> = needed.iter().chain(others).map(place).collect();
    rows.go_to(&header, vertices)?;
    let mut out = Vec::with_capacity(usize::try_from(vertex.count).unwrap_or(0));
    let mut row = vec![0.0; vertex.properties.len()];
    for i in 0..vertex.count {
        if let Err(error) = rows.row(vertex, i, |p, value| row[p] = value) {
            if !rows.can_go_on() {
                return Err(error);
            }
            tally.bad(format_args!("vertex {i}"), error)?;
            continue;
        }
        let values: Vec<Option<f64>> = places.iter().map(|place| place.map(|p| row[p])).collect();
        let bad = values.iter().take(needed.len()).position(|v| v.is_none_or(|v| !v.is_finite()));
        if let Some(k) = bad {
            let field = format_args!("{} of vertex {i}", needed[k]);
            tally.bad(format_args!("vertex {i}"), Error::malformed(file, field, rows.place(), "is not finite"))?;
            continue;
        }
        out.push(values);
    }
    Ok(out)
}
