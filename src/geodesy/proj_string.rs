//! PROJ strings: which of them are taken, and what they are called.

use super::Error;

/// Parameters that ask for files that are not read, and what the files hold.
const FILES: [(&str, &str); 7] = [
    ("geoidgrids", "a geoid"),
    ("nadgrids", "a grid of datum shifts"),
    ("grids", "a grid"),
    ("xy_grids", "a grid"),
    ("z_grids", "a grid"),
    ("file", "a file"),
    ("geoid_crs", "a geoid"),
];
/// Ellipsoids that differ from that of WGS 84 by less than a millimetre.
const GEOCENTRIC: [&str; 2] = ["WGS84", "GRS80"];

/// The words of a PROJ string.
pub(super) struct Words<'a>(Vec<(&'a str, &'a str)>);

impl<'a> Words<'a> {
    pub(super) fn of(text: &'a str) -> Self {
        let words = text.split_whitespace().map(|word| word.trim_start_matches('+'));
        Self(words.map(|word| word.split_once('=').unwrap_or((word, ""))).collect())
    }

    pub(super) fn get(&self, name: &str) -> Option<&'a str> {
        self.0.iter().find(|(key, _)| *key == name).map(|(_, value)| *value)
    }

    fn number(&self, name: &str) -> Option<f64> {
        self.get(name)?.parse().ok()
    }
}

/// Refuses what a PROJ string asks for and is not there.
pub(super) fn check(system: &str, text: &str) -> Result<(), Error> {
    let refuse = |problem: String| Err(Error::Unfit { system: system.to_owned(), problem });
    if !text.is_ascii() {
        return refuse("a PROJ string has letters of ASCII only: write degrees as numbers".to_owned());
    }
    let words = Words::of(text);
    for (name, what) in FILES {
        if let Some(value) = words.get(name).filter(|value| *value != "@null") {
            return refuse(format!(
                "+{name}={value} asks for {what}, and none is read: leave the word out where metres do not matter, or \
                 convert to a system on WGS 84 or ETRS89 by a GIS first"
            ));
        }
    }
    if let Some(name) =
        ["vunits", "vto_meter"].iter().find(|name| words.get(name).is_some_and(|v| v != "m" && v != "1"))
    {
        return refuse(format!("+{name} is of heights in other units: heights are in metres; leave the word out"));
    }
    if words.get("axis").is_some_and(|axis| axis != "enu") {
        return refuse("its axes are not east, north and up (+axis): leave the word out, or choose another".to_owned());
    }
    match words.get("proj") {
        Some("geocent" | "cart") => refuse("its axes lie in the Earth: choose a map's system, such as UTM".to_owned()),
        Some("pipeline") => refuse("a pipeline is no reference system: name the system itself".to_owned()),
        None => refuse("the word +proj=.. is missing".to_owned()),
        Some(_) => tied(&words).or_else(refuse),
    }
}

/// Whether the datum is tied to WGS 84.
fn tied(words: &Words<'_>) -> Result<(), String> {
    if words.get("towgs84").is_some() || words.get("nadgrids").is_some() {
        return Ok(());
    }
    match (words.get("datum"), words.get("ellps")) {
        (Some("NAD27"), _) => {
            Err("the datum NAD27 needs a grid of datum shifts, and none is read: choose a system on \
             NAD83 or WGS 84"
                .to_owned())
        }
        (Some(_), _) => Ok(()),
        (None, Some(ellipsoid)) if GEOCENTRIC.contains(&ellipsoid) => Ok(()),
        (None, None) if ["a", "R", "b", "rf", "f"].iter().all(|name| words.get(name).is_none()) => Ok(()),
        (None, _) => {
            Err("nothing ties its ellipsoid to WGS 84: add +towgs84=.. with the shift, or choose a system on \
             WGS 84 or ETRS89"
                .to_owned())
        }
    }
}

/// Whether the way from WGS 84 is a shift by a few parameters, which is true to some metres.
pub(super) fn shifts(text: &str) -> bool {
    let words = Words::of(text);
    let zero = |shift: &str| shift.split(',').all(|number| number.trim().parse() == Ok(0.0));
    match (words.get("towgs84"), words.get("datum")) {
        (Some(shift), _) => !zero(shift),
        (None, Some(datum)) => !["WGS84", "NAD83"].contains(&datum),
        (None, None) => false,
    }
}

/// Refuses a system that no map is drawn in.
pub(super) fn check_map(system: &str, text: &str) -> Result<(), Error> {
    let refuse = |problem: String| Err(Error::Unfit { system: system.to_owned(), problem });
    let words = Words::of(text);
    if matches!(words.get("proj"), Some("longlat" | "latlong" | "lonlat" | "latlon")) {
        return refuse(
            "a map is drawn in metres, and this system is in degrees: choose a projected one, such as UTM".to_owned(),
        );
    }
    let unit = words.get("units").unwrap_or("m");
    if unit != "m" || words.number("to_meter").is_some_and(|metres| metres != 1.0) {
        return refuse(format!(
            "a map is drawn in metres, and this system is in other units (+units={unit}): choose its form in metres"
        ));
    }
    Ok(())
}

/// The EPSG code of a UTM zone on WGS 84, or on ETRS89 where the string says GRS80 without datum shift.
pub(super) fn utm_code(text: &str) -> Option<u32> {
    let words = Words::of(text);
    let zone: u32 = words.get("zone")?.parse().ok().filter(|zone| (1..=60).contains(zone))?;
    let plain = ["towgs84", "x_0", "y_0", "lon_0", "pm", "a", "b"].iter().all(|name| words.get(name).is_none());
    let wgs84 = matches!(
        (words.get("datum"), words.get("ellps")),
        (Some("WGS84"), None | Some("WGS84")) | (None, Some("WGS84"))
    );
    let south = words.get("south").is_some();
    let metres = words.get("units").is_none_or(|unit| unit == "m") && words.get("to_meter").is_none();
    (words.get("proj") == Some("utm") && plain && wgs84 && metres).then_some(if south { 32_700 } else { 32_600 } + zone)
}
