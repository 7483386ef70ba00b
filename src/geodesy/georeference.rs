//! The way from a dataset's coordinates to a map's, and back.

use super::{Error, ReferenceSystem, Tangent, VerticalDatum};
use crate::scene::{Coordinates, FittedPlane, Geodetic, MapFrame, Similarity};

/// Half the distance in metres over which the best similarity is taken.
const REACH: f64 = 20.0;
/// A map whose lengths differ by more than this share from those on the ground is no map of the place.
const MOST_STRETCH: f64 = 0.01;

/// What says where the dataset lies.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum KnownFrom {
    /// The files of the dataset.
    Dataset,
    /// The positions that the photographs note.
    Gps,
    /// Ground control points.
    ControlPoints,
    /// Nothing: the dataset's coordinates are taken as they are.
    Nothing,
}

impl KnownFrom {
    const ALL: [(Self, &str); 4] = [
        (Self::Dataset, "dataset"),
        (Self::Gps, "gps"),
        (Self::ControlPoints, "control-points"),
        (Self::Nothing, "nothing"),
    ];

    fn word(self) -> &'static str {
        Self::ALL.iter().find(|(from, _)| *from == self).map_or("nothing", |(_, word)| word)
    }
}

/// From dataset coordinates towards the Earth.
#[derive(Clone, Debug)]
enum Lift {
    /// The dataset's coordinates are those of the map, less an offset.
    Offset([f64; 2]),
    /// A similarity leads to metres east, north and up.
    Plane { tangent: Tangent, similarity: Similarity },
    /// Easting and northing in another system, less an offset. Control points may move them further.
    Grid { system: Box<ReferenceSystem>, offset: [f64; 2], moved: Option<(Tangent, Similarity)> },
}

/// Leads from dataset coordinates to easting, northing and height, and back.
#[derive(Clone, Debug)]
pub struct Georeference {
    lift: Lift,
    system: Option<ReferenceSystem>,
    known_from: KnownFrom,
    /// The fit, as files keep it.
    fitted: Option<FittedPlane>,
}

impl Georeference {
    /// A local engineering system: the dataset's coordinates as they are, z up.
    pub fn local() -> Self {
        Self { lift: Lift::Offset([0.0; 2]), system: None, known_from: KnownFrom::Nothing, fitted: None }
    }

    /// From a dataset's own coordinates to `system`: by default its own grid, or the UTM zone of its origin.
    pub fn of_coordinates(coordinates: &Coordinates, system: Option<ReferenceSystem>) -> Result<Self, Error> {
        match coordinates {
            Coordinates::EastNorthUp { origin } => Self::on_plane(Tangent::at(*origin), &Similarity::IDENTITY, system),
            Coordinates::Grid { offset, .. } => {
                let own = match (grid_system(coordinates), &system) {
                    (Ok(own), _) => own,
                    // The user says what the dataset's files cannot.
                    (Err(_), Some(told)) => told.clone(),
                    (Err(problem), None) => return Err(problem),
                };
                let system = system.unwrap_or_else(|| own.clone());
                let lift = match system.is_same_plane(&own) {
                    true => Lift::Offset(*offset),
                    false => Lift::Grid { system: Box::new(own), offset: *offset, moved: None },
                };
                let at = Self { lift, system: Some(system), known_from: KnownFrom::Dataset, fitted: None };
                at.checked([0.0; 3])
            }
        }
        .map(|found| Self { known_from: KnownFrom::Dataset, ..found })
    }

    /// From what `frame.json` keeps: its record, and the dataset's own coordinates.
    pub fn of_record(record: &MapFrame, coordinates: Option<&Coordinates>) -> Result<Self, Error> {
        let system = match record.epsg {
            Some(code) => ReferenceSystem::epsg(code),
            None => ReferenceSystem::parse(&record.proj),
        }?;
        let system = Some(system.with_heights(VerticalDatum::parse(&record.heights)));
        let grid = coordinates.filter(|coordinates| matches!(coordinates, Coordinates::Grid { .. }));
        let found = match (grid, &record.fitted) {
            (Some(grid), None) => Self::of_coordinates(grid, system),
            (grid, Some(fitted)) => {
                let [a, b, c, _] = fitted.similarity;
                let by = Similarity::from_rows(&[a, b, c]).map_err(|problem| Error::Nowhere(problem.to_string()))?;
                let tangent = Tangent::at(fitted.origin);
                match grid {
                    Some(grid) => Self::of_coordinates(grid, None)?.moved(tangent, &by, system),
                    None => Self::on_plane(tangent, &by, system),
                }
            }
            (None, None) => Self::of_shift(record, system),
        }?;
        let word = |(_, word): &&(KnownFrom, &str)| *word == record.known_from;
        let from = KnownFrom::ALL.iter().find(word).map_or(KnownFrom::Dataset, |(from, _)| *from);
        Ok(found.known_by(from))
    }

    /// A grid that is the map's own, without the dataset's coordinates: these are easting and northing less an offset.
    fn of_shift(record: &MapFrame, system: Option<ReferenceSystem>) -> Result<Self, Error> {
        let [a, b, c, _] = record.dataset_to_map;
        match Similarity::from_rows(&[a, b, c]) {
            Ok(way) if way == (Similarity { translation: way.translation, ..Similarity::IDENTITY }) => {
                let [east, north, _] = way.translation;
                let lift = Lift::Offset([east, north]);
                Self { lift, system, known_from: KnownFrom::Dataset, fitted: None }.checked([0.0; 3])
            }
            _ => Err(Error::Unplaced),
        }
    }

    /// By a similarity from the dataset to the plane that touches the Earth.
    pub fn on_plane(tangent: Tangent, similarity: &Similarity, system: Option<ReferenceSystem>) -> Result<Self, Error> {
        let origin = tangent.origin();
        let system = system.map_or_else(|| ReferenceSystem::utm_at(origin), Ok)?;
        let fitted = Some(FittedPlane { origin, similarity: similarity.rows() });
        let lift = Lift::Plane { tangent, similarity: *similarity };
        let made = Self { lift, system: Some(system), known_from: KnownFrom::Dataset, fitted };
        made.checked(similarity.inverse().point([0.0; 3]))
    }

    /// The same, moved by a similarity in a plane that touches the Earth, as control points want it. For datasets in a
    /// grid of their own.
    pub fn moved(self, tangent: Tangent, by: &Similarity, system: Option<ReferenceSystem>) -> Result<Self, Error> {
        let (own, offset) = match (self.lift, self.system) {
            (Lift::Offset(offset), Some(own)) => (Box::new(own), offset),
            (Lift::Grid { system, offset, .. }, _) => (system, offset),
            (Lift::Offset(_), None) | (Lift::Plane { .. }, _) => return Err(Error::Unplaced),
        };
        let system = system.unwrap_or_else(|| (*own).clone());
        let fitted = Some(FittedPlane { origin: tangent.origin(), similarity: by.rows() });
        let lift = Lift::Grid { system: own, offset, moved: Some((tangent, *by)) };
        Self { lift, system: Some(system), known_from: self.known_from, fitted }.checked([0.0; 3])
    }

    /// The same with heights of another datum. Heights stay as they are.
    pub fn with_heights(self, heights: VerticalDatum) -> Self {
        Self { system: self.system.map(|system| system.with_heights(heights)), ..self }
    }

    /// The same with another note on what it is known from.
    pub fn known_by(self, known_from: KnownFrom) -> Self {
        Self { known_from, ..self }
    }

    /// Refuses a system that no map of the place is drawn in.
    fn checked(self, at: [f64; 3]) -> Result<Self, Error> {
        let Some(system) = &self.system else { return Ok(self) };
        system.check_map()?;
        let Some(place) = self.to_geodetic(at).filter(is_place) else {
            return Err(Error::Nowhere(format!("{at:?} in {system}")));
        };
        let instead =
            || ReferenceSystem::utm_at(place).map_or_else(|_| "a polar one".to_owned(), |zone| zone.to_string());
        let (system_name, shown) = (system.to_string(), place.to_string());
        if !system.from_geodetic(place).iter().all(|v| v.is_finite()) {
            return Err(Error::Outside { system: system_name, place: shown, instead: instead() });
        }
        let stretches = stretches(system, place);
        let worst = stretches.into_iter().max_by(|a, b| (a - 1.0).abs().total_cmp(&(b - 1.0).abs())).unwrap_or(1.0);
        if (worst - 1.0).abs() > MOST_STRETCH || !worst.is_finite() {
            return Err(Error::Stretched { system: system_name, stretch: worst, place: shown, instead: instead() });
        }
        Ok(self)
    }

    /// Easting, northing and height of a dataset point. Not numbers where the map's system has no such place.
    pub fn to_map(&self, p: [f64; 3]) -> [f64; 3] {
        match (&self.lift, &self.system) {
            (Lift::Offset([east, north]), _) => [p[0] + east, p[1] + north, p[2]],
            (_, Some(system)) => match self.to_geodetic(p) {
                Some(place) => system.from_geodetic(place),
                None => [f64::NAN; 3],
            },
            (_, None) => p,
        }
    }

    /// The inverse of [`Self::to_map`].
    pub fn to_dataset(&self, q: [f64; 3]) -> [f64; 3] {
        if let Lift::Offset([east, north]) = self.lift {
            return [q[0] - east, q[1] - north, q[2]];
        }
        self.system.as_ref().map_or(q, |system| self.dataset_at(system.to_geodetic(q)))
    }

    /// The place of a dataset point on Earth; `None` in a local system.
    pub fn to_geodetic(&self, p: [f64; 3]) -> Option<Geodetic> {
        let plain = |offset: &[f64; 2]| [p[0] + offset[0], p[1] + offset[1], p[2]];
        match &self.lift {
            Lift::Offset(offset) => self.system.as_ref().map(|system| system.to_geodetic(plain(offset))),
            Lift::Plane { tangent, similarity } => Some(tangent.to_geodetic(similarity.point(p))),
            Lift::Grid { system, offset, moved } => {
                let place = system.to_geodetic(plain(offset));
                Some(match moved {
                    Some((tangent, by)) => tangent.to_geodetic(by.point(tangent.from_geodetic(place))),
                    None => place,
                })
            }
        }
    }

    /// The dataset point at a place on Earth, which is not known in a local system.
    fn dataset_at(&self, place: Geodetic) -> [f64; 3] {
        let plain = |system: &ReferenceSystem, offset: &[f64; 2], place| {
            let [x, y, z] = system.from_geodetic(place);
            [x - offset[0], y - offset[1], z]
        };
        match (&self.lift, &self.system) {
            (Lift::Offset(offset), Some(system)) => plain(system, offset, place),
            (Lift::Offset(_), None) => [f64::NAN; 3],
            (Lift::Plane { tangent, similarity }, _) => similarity.inverse().point(tangent.from_geodetic(place)),
            (Lift::Grid { system, offset, moved }, _) => {
                let before = match moved {
                    Some((tangent, by)) => tangent.to_geodetic(by.inverse().point(tangent.from_geodetic(place))),
                    None => place,
                };
                plain(system, offset, before)
            }
        }
    }

    /// The similarity from dataset to map coordinates that is best about a dataset point. Its turn has the convergence
    /// of the map's meridians, and its scale is that of lengths along the map. It is exact at the point.
    pub fn similarity_at(&self, p: [f64; 3]) -> Similarity {
        if let Lift::Offset([east, north]) = self.lift {
            return Similarity { translation: [east, north, 0.0], ..Similarity::IDENTITY };
        }
        let linear = self.linear_at(p, |at| self.to_map(at));
        let length = |row: &[f64; 3]| row.iter().map(|v| v * v).sum::<f64>().sqrt();
        let scale = (length(&linear[0]) * length(&linear[1])).sqrt();
        let rotation = nearest_rotation(linear);
        let turned = Similarity { rotation, scale, translation: [0.0; 3] };
        let (at, from) = (self.to_map(p), turned.point(p));
        Similarity { translation: std::array::from_fn(|k| at[k] - from[k]), ..turned }
    }

    /// The similarity from dataset coordinates to the axes of the Earth (ECEF, metres) that is best about a dataset
    /// point, and exact there. `None` in a local system.
    pub fn to_earth_at(&self, p: [f64; 3]) -> Option<Similarity> {
        // About the point numbers are small, and differences of places keep their digits.
        let tangent = Tangent::at(self.to_geodetic(p)?);
        let local = |at: [f64; 3]| self.to_geodetic(at).map_or([f64::NAN; 3], |place| tangent.from_geodetic(place));
        let linear = self.linear_at(p, local);
        let squares: f64 = linear.iter().flatten().map(|v| v * v).sum();
        let turned =
            Similarity { rotation: nearest_rotation(linear), scale: (squares / 3.0).sqrt(), translation: [0.0; 3] };
        Some(turned.after_shift(p.map(|v| -v)).then(&tangent.to_earth()))
    }

    /// The derivative of a map of dataset points at a point; rows are the coordinates of the target.
    fn linear_at(&self, p: [f64; 3], map: impl Fn([f64; 3]) -> [f64; 3]) -> [[f64; 3]; 3] {
        let step = REACH / self.unit();
        let mut columns = [[0.0; 3]; 3];
        for (axis, column) in columns.iter_mut().enumerate() {
            let beside = |by: f64| {
                let mut at = p;
                at[axis] += by;
                map(at)
            };
            let (ahead, behind) = (beside(step), beside(-step));
            *column = std::array::from_fn(|row| (ahead[row] - behind[row]) / (2.0 * step));
        }
        std::array::from_fn(|row| std::array::from_fn(|axis| columns[axis][row]))
    }

    /// Metres per unit of the dataset.
    fn unit(&self) -> f64 {
        match &self.lift {
            Lift::Plane { similarity, .. } => similarity.scale,
            Lift::Offset(_) | Lift::Grid { .. } => 1.0,
        }
    }

    /// The reference system; `None` for a local one.
    pub fn system(&self) -> Option<&ReferenceSystem> {
        self.system.as_ref()
    }

    /// What heights are measured from.
    pub fn heights(&self) -> VerticalDatum {
        self.system.as_ref().map(|system| system.vertical().clone()).unwrap_or_default()
    }

    /// What says where the dataset lies.
    pub fn known_from(&self) -> KnownFrom {
        self.known_from
    }

    /// What files keep of it, with the best similarity about a dataset point. `None` in a local system.
    pub fn record(&self, at: [f64; 3]) -> Option<MapFrame> {
        let (system, origin) = (self.system.as_ref()?, self.to_geodetic(at)?);
        Some(MapFrame {
            system: system.name().to_owned(),
            epsg: system.code(),
            proj: system.proj().to_owned(),
            heights: system.vertical().to_string(),
            known_from: self.known_from.word().to_owned(),
            origin,
            at,
            dataset_to_map: self.similarity_at(at).rows(),
            fitted: self.fitted.clone(),
        })
    }
}

/// The system of a dataset's grid: by its code, else by its PROJ string, else by its name.
fn grid_system(coordinates: &Coordinates) -> Result<ReferenceSystem, Error> {
    let Coordinates::Grid { crs, epsg, proj, .. } = coordinates else { return Err(Error::Unplaced) };
    match (epsg, proj) {
        (Some(code), _) => ReferenceSystem::epsg(*code),
        (None, Some(proj)) => ReferenceSystem::parse(proj),
        (None, None) => ReferenceSystem::parse(crs),
    }
}

fn is_place(place: &Geodetic) -> bool {
    place.latitude.abs() <= 90.0 && place.longitude.is_finite() && place.altitude.is_finite()
}

/// Metres on the map per metre on the ground, towards east and north.
fn stretches(system: &ReferenceSystem, place: Geodetic) -> [f64; 2] {
    let tangent = Tangent::at(place);
    let at = |east: f64, north: f64| system.from_geodetic(tangent.to_geodetic([east, north, 0.0]));
    let length = |a: [f64; 3], b: [f64; 3]| (a[0] - b[0]).hypot(a[1] - b[1]) / (2.0 * REACH);
    [length(at(REACH, 0.0), at(-REACH, 0.0)), length(at(0.0, REACH), at(0.0, -REACH))]
}

/// The rotation nearest to a matrix that is almost a scaled rotation: the mean with the inverse of the transpose, until
/// nothing changes (Higham 1986).
fn nearest_rotation(linear: [[f64; 3]; 3]) -> [[f64; 3]; 3] {
    let length = linear.iter().flatten().map(|v| v * v).sum::<f64>().sqrt() / 3.0_f64.sqrt();
    let mut m = glam::DMat3::from_cols_array_2d(&linear).transpose() * (1.0 / length);
    for _ in 0..8 {
        m = (m + m.inverse().transpose()) * 0.5;
    }
    m.transpose().to_cols_array_2d()
}

#[cfg(test)]
mod tests;
