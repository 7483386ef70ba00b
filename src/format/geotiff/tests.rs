use super::*;

fn keys() -> GeoKeys {
    GeoKeys { system: System::Code(32_632), citation: "WGS 84 / UTM zone 32N".into() }
}

fn picture(width: u32, height: u32, kind: Kind) -> Picture {
    let (corner, gsd) = ([500_000.5, 5_000_000.25], 0.25);
    Picture { width, height, kind, descriptions: vec!["height".into()], corner, gsd, keys: keys() }
}

/// Heights that name their place, with a hole.
fn heights(at: (u32, u32)) -> Samples {
    let value = |k: u32| {
        let (x, y) = (at.0 * TILE + k % TILE, at.1 * TILE + k / TILE);
        if (600..604).contains(&x) && (20..24).contains(&y) { NO_DATA } else { x as f32 + 0.001 * y as f32 }
    };
    Samples::Floats((0..TILE * TILE).map(value).collect())
}

#[test]
fn tiles_come_back_as_they_were_added() {
    let folder = tempfile::tempdir().unwrap();
    let mut writer = Writer::new(&folder.path().join("a.tif"), picture(1100, 700, Kind::Float(1))).unwrap();
    assert_eq!(writer.tiles(), (3, 2));
    writer.add(vec![((1, 0), heights((1, 0)))]).unwrap();
    assert_eq!(writer.tile(1, 0).unwrap(), heights((1, 0)));
    assert_eq!(writer.tile(0, 1).unwrap(), Samples::empty(Kind::Float(1)));
    let colours = Samples::Bytes((0..4 * TILE * TILE).map(|k| (u64::from(k) * u64::from(k) % 251) as u8).collect());
    assert_eq!(Samples::unpacked(Kind::Rgba8, &colours.packed(Kind::Rgba8)).unwrap(), colours);
    assert!(Samples::unpacked(Kind::Rgba8, &colours.packed(Kind::Rgba8)[..100]).is_err());
    let pairs = Samples::Floats((0..2 * TILE * TILE).map(|k| (k as f32).sin()).collect());
    assert_eq!(Samples::unpacked(Kind::Float(2), &pairs.packed(Kind::Float(2))).unwrap(), pairs);
}

/// In any order of the tiles, and with no more of the overviews in memory than those that wait.
#[test]
fn order_of_the_tiles_does_not_change_the_file() {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, order: &[(u32, u32)]| {
        let file = folder.path().join(name);
        let mut writer = Writer::new(&file, picture(1100, 700, Kind::Float(1))).unwrap();
        order.iter().for_each(|at| writer.add(vec![(*at, heights(*at))]).unwrap());
        assert!(writer.pending.is_empty(), "tiles of overviews still wait");
        writer.finish().unwrap();
        std::fs::read(file).unwrap()
    };
    let rows = write("rows.tif", &[(0, 0), (1, 0), (2, 0), (0, 1), (1, 1), (2, 1)]);
    let mixed = write("mixed.tif", &[(2, 1), (0, 0), (1, 1), (2, 0), (0, 1), (1, 0)]);
    assert!(rows == mixed && rows.starts_with(b"II\x2a\0"));
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 2, "temporary files stay");
}

#[test]
fn overviews_are_means_of_what_has_data() {
    let mut whole = Samples::empty(Kind::Float(1));
    let Samples::Floats(values) = &mut whole else { unreachable!() };
    (values[0], values[1], values[TILE as usize]) = (1.0, 4.0, NO_DATA);
    (values[2], values[3]) = (f32::NAN, 8.0);
    let Samples::Floats(half) = whole.halved(Kind::Float(1)) else { unreachable!() };
    assert_eq!((half[0], half[1], half[2]), (2.5, 8.0, NO_DATA));
    let mut colours = Samples::empty(Kind::Rgba8);
    let Samples::Bytes(values) = &mut colours else { unreachable!() };
    values[..8].copy_from_slice(&[10, 20, 30, 255, 13, 20, 30, 255]);
    let Samples::Bytes(half) = colours.halved(Kind::Rgba8) else { unreachable!() };
    assert_eq!(half[..8], [12, 20, 30, 255, 0, 0, 0, 0]);
}

/// Sizes that force the big format are made up: no tile is stored.
#[test]
fn files_over_4_gigabytes_take_the_big_format() {
    let picture = picture(40_000, 40_000, Kind::Rgba8);
    let mut levels = Level::all(picture.width, picture.height);
    levels.iter_mut().flat_map(|level| &mut level.places).for_each(|place| place.bytes = 700_000);
    let header = Header::new(&picture, &levels).bytes;
    assert!(header.starts_with(b"II\x2b\0\x08\0\0\0"));
    let word = |at: usize| u64::from_le_bytes(header[at..at + 8].try_into().unwrap());
    let begin = word(8) as usize;
    let rows = (0..word(begin) as usize).map(|k| begin + 8 + 20 * k);
    let offsets = rows.into_iter().find(|at| header[*at..*at + 2] == 324u16.to_le_bytes()).unwrap();
    assert_eq!(word(offsets + 4), 79 * 79);
    let first = word(word(offsets + 12) as usize);
    let of_overviews: u64 = levels[1..].iter().map(|level| 700_000 * level.places.len() as u64).sum();
    assert_eq!(first, header.len() as u64 + of_overviews, "the full picture lies behind its overviews");
    levels.iter_mut().flat_map(|level| &mut level.places).for_each(|place| place.bytes = 7_000);
    assert!(Header::new(&picture, &levels).bytes.starts_with(b"II\x2a\0"));
}

#[test]
fn pictures_without_pixels_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let refused = Writer::new(&folder.path().join("a.tif"), picture(0, 5, Kind::Rgba8));
    assert!(refused.is_err_and(|error| error.to_string().contains("no pixels")));
    assert!(Writer::new(&folder.path().join("none").join("a.tif"), picture(5, 5, Kind::Rgba8)).is_err());
}
