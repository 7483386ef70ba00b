//! Reference systems by name.

use std::fmt;

use proj4rs::Proj;
use proj4rs::transform::transform;

use super::Error;
use super::proj_string::{self, Words};
use crate::scene::Geodetic;

/// Rounds of the way back through a shift of the datum; each leaves some 1e-5 of what was missing.
const ROUNDS: usize = 3;

/// What heights are measured from. No height is ever converted.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum VerticalDatum {
    /// The ellipsoid of WGS 84.
    #[default]
    Ellipsoid,
    /// What the user says that the heights are.
    Stated {
        /// The datum's name.
        name: String,
        /// Its EPSG code, if one was named.
        epsg: Option<u32>,
    },
}

impl VerticalDatum {
    /// From a name, or an EPSG code of a vertical system (`EPSG:5773`).
    pub fn parse(text: &str) -> Self {
        let name = text.trim();
        match name.to_ascii_lowercase().as_str() {
            "" | "ellipsoid" | "ellipsoidal" | "ellipsoid of wgs 84" => Self::Ellipsoid,
            _ => Self::Stated { name: name.to_owned(), epsg: code(name) },
        }
    }
}

impl fmt::Display for VerticalDatum {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Ellipsoid => f.write_str("ellipsoid of WGS 84"),
            Self::Stated { name, .. } => f.write_str(name),
        }
    }
}

/// A horizontal reference system: a map projection on a datum, or latitude and longitude.
#[derive(Clone)]
pub struct ReferenceSystem {
    name: String,
    epsg: Option<u32>,
    proj: String,
    wkt: Option<&'static str>,
    vertical: VerticalDatum,
    /// Whether the datum is shifted by parameters.
    shifted: bool,
    projection: Proj,
    /// Latitude and longitude on WGS 84.
    geographic: Proj,
}

impl fmt::Debug for ReferenceSystem {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{self}, {}", self.proj)
    }
}

impl PartialEq for ReferenceSystem {
    fn eq(&self, other: &Self) -> bool {
        self.is_same_plane(other) && self.vertical == other.vertical
    }
}

/// The number of `EPSG:32632`.
fn code(text: &str) -> Option<u32> {
    let (authority, number) = text.trim().split_once(':')?;
    authority.trim().eq_ignore_ascii_case("epsg").then(|| number.trim().parse().ok())?
}

impl ReferenceSystem {
    /// From an EPSG code (`EPSG:32632`), a PROJ string, or a zone as OpenDroneMap writes them (`WGS84 UTM 32N`).
    pub fn parse(text: &str) -> Result<Self, Error> {
        let text = text.trim();
        if text.len() >= 5 && text.is_char_boundary(5) && text[..5].eq_ignore_ascii_case("epsg:") {
            if let Some((part, _)) = text.split_once('+') {
                return Err(Error::Compound { text: text.to_owned(), part: part.trim().to_owned() });
            }
            return code(text).map(Self::epsg).unwrap_or_else(|| Err(Error::Unnamed { text: text.to_owned() }));
        }
        if text.contains("+proj") || text.contains("+init") {
            return Self::of_proj(text);
        }
        match zone(text) {
            Some(code) => Self::epsg(code),
            None => Err(Error::Unnamed { text: text.to_owned() }),
        }
    }

    /// From an EPSG code.
    pub fn epsg(code: u32) -> Result<Self, Error> {
        let known = u16::try_from(code).ok().and_then(crs_definitions::from_code);
        let def = known.filter(|def| !def.proj4.is_empty()).ok_or(Error::UnknownCode { code })?;
        let name = def.wkt.split('"').nth(1).unwrap_or("unnamed").to_owned();
        if def.wkt.starts_with("COMPD_CS") || def.wkt.starts_with("VERT_CS") {
            return Err(Error::UnknownCode { code });
        }
        Self::new(name, Some(code), def.proj4, Some(def.wkt))
    }

    fn of_proj(text: &str) -> Result<Self, Error> {
        if let Some(code) = Words::of(text).get("init").and_then(code) {
            return Self::epsg(code);
        }
        proj_string::check(text, text)?;
        match proj_string::utm_code(text) {
            Some(code) => Self::epsg(code),
            None => Self::new(text.to_owned(), None, text, None),
        }
    }

    fn new(name: String, epsg: Option<u32>, proj: &str, wkt: Option<&'static str>) -> Result<Self, Error> {
        let shown = epsg.map_or_else(|| name.clone(), |code| format!("{name} (EPSG:{code})"));
        proj_string::check(&shown, proj)?;
        let unfit = |problem: proj4rs::errors::Error| Error::Unfit {
            system: shown.clone(),
            problem: format!("its PROJ string is not understood ({problem}): {proj}"),
        };
        let projection = Proj::from_proj_string(proj).map_err(unfit)?;
        let geographic = Proj::from_proj_string("+proj=longlat +datum=WGS84").map_err(unfit)?;
        let (vertical, shifted) = (VerticalDatum::Ellipsoid, proj_string::shifts(proj));
        Ok(Self { name, epsg, proj: proj.to_owned(), wkt, vertical, shifted, projection, geographic })
    }

    /// The UTM zone of a place, with the exceptions of Norway and Svalbard.
    pub fn utm_at(place: Geodetic) -> Result<Self, Error> {
        let (latitude, longitude) = (place.latitude, place.longitude);
        if !(-80.0..=84.0).contains(&latitude) || !longitude.is_finite() {
            return Err(Error::NoZone { place: place.to_string() });
        }
        let east = (longitude + 180.0).rem_euclid(360.0);
        let mut zone = (east / 6.0).floor().min(59.0) as u32 + 1;
        if (56.0..64.0).contains(&latitude) && (3.0..12.0).contains(&longitude) {
            zone = 32;
        }
        if latitude >= 72.0 && (0.0..42.0).contains(&longitude) {
            let east_of = |degrees: f64| u32::from(longitude >= degrees);
            zone = 31 + 2 * (east_of(9.0) + east_of(21.0) + east_of(33.0));
        }
        Self::epsg(if latitude < 0.0 { 32_700 } else { 32_600 } + zone)
    }

    /// The same system with heights of another datum. Heights stay as they are.
    pub fn with_heights(mut self, vertical: VerticalDatum) -> Self {
        self.vertical = vertical;
        self
    }

    /// Refuses a system that no map is drawn in: of degrees or feet.
    pub fn check_map(&self) -> Result<(), Error> {
        proj_string::check_map(&self.to_string(), &self.proj)
    }

    /// Its name.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Its EPSG code, if one is known.
    pub fn code(&self) -> Option<u32> {
        self.epsg
    }

    /// Its PROJ string.
    pub fn proj(&self) -> &str {
        &self.proj
    }

    /// Its text in WKT 1, for files. A system without EPSG code is given by its PROJ string, as GDAL does.
    pub fn wkt(&self) -> String {
        match self.wkt {
            // A shift by nothing would make readers take the system for one that is bound to another.
            Some(wkt) => wkt.replace(",TOWGS84[0,0,0,0,0,0,0]", ""),
            None => format!(
                "PROJCS[\"unnamed\",GEOGCS[\"WGS 84\",DATUM[\"WGS_1984\",SPHEROID[\"WGS 84\",6378137,298.257223563]],\
                 PRIMEM[\"Greenwich\",0],UNIT[\"degree\",0.0174532925199433]],PROJECTION[\"custom_proj4\"],\
                 UNIT[\"metre\",1],AXIS[\"Easting\",EAST],AXIS[\"Northing\",NORTH],EXTENSION[\"PROJ4\",\"{}\"]]",
                self.proj.replace('"', "")
            ),
        }
    }

    /// The text for files with heights: with what heights are measured from, where that is not the ellipsoid.
    pub fn wkt_with_heights(&self) -> String {
        let VerticalDatum::Stated { name, epsg } = &self.vertical else { return self.wkt() };
        let name = name.replace('"', "");
        let code = epsg.map(|code| format!(",AUTHORITY[\"EPSG\",\"{code}\"]")).unwrap_or_default();
        format!(
            "COMPD_CS[\"{} + {name}\",{},VERT_CS[\"{name}\",VERT_DATUM[\"{name}\",2005],UNIT[\"metre\",1],\
             AXIS[\"Up\",UP]{code}]]",
            self.name.replace('"', ""),
            self.wkt()
        )
    }

    /// What heights are measured from.
    pub fn vertical(&self) -> &VerticalDatum {
        &self.vertical
    }

    /// Whether its datum is reached from WGS 84 by a shift of few parameters, which is true to some metres.
    pub fn is_shifted(&self) -> bool {
        self.shifted
    }

    /// Whether easting and northing are the same as in another system.
    pub fn is_same_plane(&self, other: &Self) -> bool {
        (self.epsg.is_some() && self.epsg == other.epsg) || self.proj == other.proj
    }

    /// Easting and northing (or longitude and latitude in degrees) of a place, and its altitude as it is. Not numbers
    /// where the system has no such place.
    pub fn from_geodetic(&self, place: Geodetic) -> [f64; 3] {
        // A shift of the datum would turn the height into one above another ellipsoid: the height stays.
        let mut at = (place.longitude.to_radians(), place.latitude.to_radians(), place.altitude);
        match transform(&self.geographic, &self.projection, &mut at) {
            Ok(()) if self.projection.is_latlong() => [at.0.to_degrees(), at.1.to_degrees(), place.altitude],
            Ok(()) => [at.0, at.1, place.altitude],
            Err(_) => [f64::NAN; 3],
        }
    }

    /// The inverse of [`Self::from_geodetic`].
    pub fn to_geodetic(&self, [x, y, z]: [f64; 3]) -> Geodetic {
        let Some(mut place) = self.inverse([x, y, z]) else {
            return Geodetic { latitude: f64::NAN, longitude: f64::NAN, altitude: z };
        };
        if self.shifted {
            // The height above the datum's own ellipsoid is unknown, and turns there and back are approximate: what is
            // missing on the map is added until nothing is.
            let mut from = [x, y, z];
            for _ in 0..ROUNDS {
                let [u, v, _] = self.from_geodetic(Geodetic { altitude: z, ..place });
                from = [from[0] + x - u, from[1] + y - v, from[2] + z - place.altitude];
                place = self.inverse(from).unwrap_or(place);
            }
        }
        Geodetic { altitude: z, ..place }
    }

    /// The place of a point by the projection and the shift of the datum, its altitude shifted too.
    fn inverse(&self, [x, y, z]: [f64; 3]) -> Option<Geodetic> {
        let is_geographic = self.projection.is_latlong();
        let mut at = if is_geographic { (x.to_radians(), y.to_radians(), z) } else { (x, y, z) };
        transform(&self.projection, &self.geographic, &mut at).ok()?;
        Some(Geodetic { latitude: at.1.to_degrees(), longitude: at.0.to_degrees(), altitude: at.2 })
    }
}

/// The EPSG code of `WGS84 UTM 17N`.
fn zone(text: &str) -> Option<u32> {
    let upper = text.to_ascii_uppercase().replace("WGS 84", "WGS84").replace(['/', ','], " ");
    let words: Vec<&str> = upper.split_whitespace().filter(|word| *word != "ZONE").collect();
    let (zone, side) = match words.as_slice() {
        ["WGS84", "UTM", zone] => zone.split_at_checked(zone.len().checked_sub(1)?)?,
        ["WGS84", "UTM", zone, side] => (*zone, *side),
        _ => return None,
    };
    let zone: u32 = zone.parse().ok().filter(|zone| (1..=60).contains(zone))?;
    match side {
        "N" => Some(32_600 + zone),
        "S" => Some(32_700 + zone),
        _ => None,
    }
}

impl fmt::Display for ReferenceSystem {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.epsg {
            Some(code) => write!(f, "{} (EPSG:{code})", self.name),
            None => f.write_str(&self.name),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn refused(text: &str) -> String {
        let read = ReferenceSystem::parse(text).and_then(|system| system.check_map());
        read.expect_err(text).to_string()
    }

    #[test]
    fn systems_have_several_names() {
        for (text, code, name) in [
            ("EPSG:32632", Some(32_632), "WGS 84 / UTM zone 32N"),
            (" epsg:25832 ", Some(25_832), "ETRS89 / UTM zone 32N"),
            ("WGS84 UTM 17N", Some(32_617), "WGS 84 / UTM zone 17N"),
            ("WGS84 UTM 17 S", Some(32_717), "WGS 84 / UTM zone 17S"),
            ("WGS 84 / UTM zone 5S", Some(32_705), "WGS 84 / UTM zone 5S"),
            ("+proj=utm +zone=56 +south +datum=WGS84 +units=m +no_defs", Some(32_756), "WGS 84 / UTM zone 56S"),
            ("+proj=tmerc +lon_0=9 +k=1 +x_0=3500000 +ellps=GRS80", None, "+proj=tmerc"),
            ("+init=epsg:31370", Some(31_370), "Belge 1972 / Belgian Lambert 72"),
        ] {
            let system = ReferenceSystem::parse(text).unwrap();
            assert_eq!(system.code(), code, "{text}");
            assert!(system.name().starts_with(name), "{text}: {}", system.name());
            system.check_map().unwrap();
        }
    }

    #[test]
    fn systems_without_remedy_are_refused_with_one() {
        for (text, want) in [
            ("EPSG:4326", "in degrees: choose a projected one, such as UTM"),
            ("EPSG:2263", "in metres, and this system is in other units"),
            ("+proj=utm +zone=17 +datum=WGS84 +units=us-ft", "in metres, and this system is in other units"),
            ("+proj=utm +zone=17 +datum=WGS84 +to_meter=0.3048", "in metres, and this system is in other units"),
            ("EPSG:25832+5783", "name the horizontal part alone (EPSG:25832)"),
            ("EPSG:5773", "vertical and compound systems are not taken"),
            ("EPSG:7415", "vertical and compound systems are not taken"),
            ("EPSG:99999999999", "names no reference system"),
            ("EPSG:", "names no reference system"),
            ("UTM", "names no reference system"),
            ("WGS84 UTM 61N", "names no reference system"),
            ("EPSG:é", "names no reference system"),
            ("", "names no reference system"),
            ("+proj=utm +zone=32 +datum=WGS84 +geoidgrids=egm96_15.gtx", "+geoidgrids=egm96_15.gtx asks for a geoid"),
            ("+proj=tmerc +ellps=bessel +nadgrids=BETA2007.gsb", "a grid of datum shifts"),
            ("EPSG:27200", "a grid of datum shifts"),
            ("+proj=utm +zone=17 +datum=NAD27", "NAD27 needs a grid of datum shifts"),
            ("+proj=tmerc +lon_0=9 +ellps=bessel", "add +towgs84="),
            ("+proj=utm +zone=32 +datum=WGS84 +vunits=ft", "heights are in metres"),
            ("+proj=tmerc +ellps=GRS80 +axis=wsu", "its axes are not east, north and up"),
            ("+proj=geocent +datum=WGS84", "its axes lie in the Earth"),
            ("+proj=pipeline +step +proj=utm +zone=32", "a pipeline is no reference system"),
            ("+proj=nothing", "is not understood"),
            ("+proj=utm +zone=99 +datum=WGS84", "is not understood"),
            ("+proj=tmerc +lon_0=1\u{b0}2' +ellps=GRS80", "letters of ASCII only"),
        ] {
            let problem = refused(text);
            assert!(problem.contains(want), "{text}: {problem}");
        }
    }

    #[test]
    fn heights_stay_through_a_shift_of_the_datum() {
        // PROJ 9.5.1: the shift of British National Grid by seven parameters.
        let text = "+proj=tmerc +lat_0=49 +lon_0=-2 +k=0.9996012717 +x_0=400000 +y_0=-100000 +ellps=airy \
                    +towgs84=446.448,-125.157,542.06,0.15,0.247,0.842,-20.489 +units=m";
        let system = ReferenceSystem::parse(text).unwrap();
        let place = Geodetic { latitude: 52.5, longitude: -1.5, altitude: 0.0 };
        let [x, y, z] = system.from_geodetic(place);
        assert!((x - 434_039.457_29).abs() < 1e-3 && (y - 289_239.281_09).abs() < 1e-3 && z == 0.0, "{x} {y} {z}");
        assert!(system.is_shifted() && !ReferenceSystem::epsg(25_832).unwrap().is_shifted());
        let high = Geodetic { altitude: 812.5, ..place };
        let back = system.to_geodetic(system.from_geodetic(high));
        assert!((back.latitude - 52.5).abs() < 1e-9 && (back.longitude + 1.5).abs() < 1e-9, "{back:?}");
        assert_eq!(back.altitude, 812.5);
    }

    #[test]
    fn vertical_datum_is_the_ellipsoid_unless_told() {
        let system = ReferenceSystem::epsg(32_632).unwrap();
        assert_eq!(system.vertical().to_string(), "ellipsoid of WGS 84");
        let told = system.with_heights(VerticalDatum::parse("EPSG:5773"));
        assert_eq!(told.vertical(), &VerticalDatum::Stated { name: "EPSG:5773".into(), epsg: Some(5773) });
        assert_eq!(VerticalDatum::parse("DHHN2016"), VerticalDatum::Stated { name: "DHHN2016".into(), epsg: None });
    }

    /// Words changed, left out and doubled: a system, or an error.
    #[test]
    fn damaged_proj_strings_do_no_harm() {
        let whole = [
            "+proj=tmerc +lat_0=49 +lon_0=-2 +k=0.9996 +x_0=4e5 +y_0=-1e5 +ellps=airy +towgs84=446,-125,542,0.1,0.2,0.8,-20",
            "+proj=lcc +lat_1=49 +lat_2=44 +lat_0=46.5 +lon_0=3d10'5\" +x_0=700000 +a=6378137 +rf=298.25 +towgs84=0,0,0",
            "+proj=somerc +lat_0=46.95 +lon_0=7.44 +k_0=1 +ellps=bessel +towgs84=674,15,405 +pm=paris +units=m +no_defs",
            "+proj=omerc +lat_0=4 +lonc=102.25 +alpha=323.02 +k=0.99984 +gamma=323.13 +ellps=GRS80 +no_uoff",
            "+proj=utm +zone=32 +south +datum=WGS84 +to_meter=1 +over +geoc +R=6371000",
        ];
        let other = ["0", "-1", "1e300", "nan", "inf", "", "90", "1e-300", "180w", "5'", "\u{b0}", "@null", "a,b,c"];
        let names =
            ["laea", "stere", "aea", "cass", "poly", "krovak", "geos", "tpers", "moll", "eqc", "sterea", "gnom"];
        let mut random = crate::scene::random::Random::new(6);
        let mut taken = 0;
        for text in whole.iter().cycle().take(4000) {
            let mut words: Vec<String> = text.split(' ').map(str::to_owned).collect();
            for _ in 0..2 {
                let at = (random.unit() * words.len() as f64) as usize;
                let name = words[at].split('=').next().unwrap_or_default().to_owned();
                words[at] = match (name.as_str(), random.chance(0.2)) {
                    (_, true) => String::new(),
                    ("+proj", _) => format!("+proj={}", random.pick(&names)),
                    _ => format!("{name}={}", random.pick(&other)),
                };
            }
            let Ok(system) = ReferenceSystem::parse(&words.join(" ")) else { continue };
            taken += 1;
            let place = Geodetic { latitude: 47.5, longitude: 8.5, altitude: 400.0 };
            system.to_geodetic(system.from_geodetic(place));
        }
        assert!(taken > 500, "{taken}");
    }
}
