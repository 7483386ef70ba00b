//! Reads some vertex properties as numbers, for files that are no models.

use std::path::Path;

use super::read::open;
use crate::format::{At, Error, Tally};

/// Passes the named properties of each vertex to `each`, the `needed` ones first. A missing needed property is an
/// error, and a missing one of `others` is NaN. Vertices with a needed value that is not finite count as bad.
pub(super) fn for_each(
    file: &Path,
    needed: &[&str],
    others: &[&str],
    tally: &mut Tally<Error>,
    mut each: impl FnMut(u64, &[f64]) -> Result<(), Error>,
) -> Result<(), Error> {
    let (header, vertices, mut rows) = open(file)?;
    let vertex = &header.elements[vertices];
    let place = |name: &&str| vertex.properties.iter().position(|p| p.name == **name);
    if let Some(missing) = needed.iter().find(|name| place(name).is_none()) {
        let problem = format!("the property '{missing}' is missing");
        return Err(Error::malformed(file, "element vertex", At::Byte(vertex.at), problem));
    }
    let places: Vec<Option<usize>> = needed.iter().chain(others).map(place).collect();
    rows.go_to(&header, vertices)?;
    let (mut row, mut values) = (vec![0.0; vertex.properties.len()], vec![f64::NAN; places.len()]);
    for i in 0..vertex.count {
        if let Err(error) = rows.row(vertex, i, |p, value| row[p] = value) {
            if !rows.can_go_on() {
                return Err(error);
            }
            tally.bad(format_args!("vertex {i}"), error)?;
            continue;
        }
        for (value, place) in values.iter_mut().zip(&places) {
            *value = place.map_or(f64::NAN, |p| row[p]);
        }
        if let Some(k) = values.iter().take(needed.len()).position(|v| !v.is_finite()) {
            let field = format_args!("{} of vertex {i}", needed[k]);
            tally.bad(format_args!("vertex {i}"), Error::malformed(file, field, rows.place(), "is not finite"))?;
            continue;
        }
        each(i, &values)?;
    }
    Ok(())
}
