//! Positions in photographs, ground control points, reference systems.

use psrgs_vk::world::{Effects, WorldParams, generate};

use crate::chosen;

/// The XMP of a drone with RTK.
const XMP: &str = r#"<x:xmpmeta><a drone-dji:GpsLatitude="+47.65" drone-dji:GpsLongitude="-10.3" drone-dji:RtkFlag="50"
    drone-dji:AbsoluteAltitude="+740.5" drone-dji:RtkStdLat="0.01" drone-dji:RtkStdLon='0.01' drone-dji:RtkStdHgt="0.02"
    Camera:GPSXYAccuracy="1.5"/><drone-dji:GpsLongtitude>5</drone-dji:GpsLongtitude></x:xmpmeta>"#;

/// The photographs of a world, as JPEG and PNG, and its control points.
fn world(jpeg_quality: u8) -> (Vec<u8>, Vec<u8>) {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let effects = Effects { jpeg_quality, ..Effects::none() };
    let params = WorldParams { images: 6, max_side: 24, offpath: 0, supersample: 1, effects, ..WorldParams::default() };
    generate(&params, folder.path(), &mut |_| {}).expect("a world");
    let name = if jpeg_quality == 0 { "images/view_0000.png" } else { "images/view_0000.jpg" };
    let read = |name| std::fs::read(folder.path().join(name)).expect("a file");
    (read(name), read("gcp_list.txt"))
}

/// Photographs with a position in EXIF, in XMP, and in both.
pub fn photographs() -> Vec<Vec<u8>> {
    let exif = world(60).0;
    let packet = [b"http://ns.adobe.com/xap/1.0/\0".as_slice(), XMP.as_bytes()].concat();
    let segment = [b"\xff\xe1".as_slice(), &(packet.len() as u16 + 2).to_be_bytes(), &packet].concat();
    let mut both = exif.clone();
    both.splice(2..2, segment.iter().copied());
    let alone = [b"\xff\xd8".as_slice(), &segment, b"\xff\xd9"].concat();
    vec![exif, both, alone, world(0).0]
}

/// The true map of a world, and check points.
pub fn rasters() -> Vec<Vec<u8>> {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let effects = Effects::none();
    let params = WorldParams { images: 6, max_side: 24, offpath: 0, supersample: 1, effects, ..WorldParams::default() };
    generate(&params, folder.path(), &mut |_| {}).expect("a world");
    let read = |name: &str| std::fs::read(folder.path().join(name)).expect("a file");
    let maps = ["dsm.tif", "orthophoto.tif", "classes.tif"].map(|name| chosen(0, read(&format!("truth/{name}"))));
    let lines = "name,E,N,H\na,500000.5,4600000,90.25\n# b\nb;1;2;3\n1 2 3\n".as_bytes().to_vec();
    let points = [read("gcp_list.txt"), lines].map(|list| chosen(1, list));
    maps.into_iter().chain(points).collect()
}

/// Control points, and reference systems.
pub fn control_points() -> Vec<Vec<u8>> {
    let systems = [
        "EPSG:32632",
        "EPSG:31370",
        "WGS84 UTM 17N",
        "+proj=utm +zone=32 +south +datum=WGS84 +units=m +no_defs",
        "+proj=tmerc +lat_0=49 +lon_0=-2 +k=0.9996012717 +x_0=400000 +y_0=-100000 +ellps=airy \
         +towgs84=446.448,-125.157,542.06,0.15,0.247,0.842,-20.489",
        "+proj=lcc +lat_1=49 +lat_2=44 +lat_0=46.5 +lon_0=3 +x_0=700000 +y_0=6600000 +ellps=GRS80 +pm=paris",
        "+proj=somerc +lat_0=46.95 +lon_0=7.44 +k_0=1 +x_0=2600000 +ellps=bessel +towgs84=674.374,15.056,405.346",
        "+proj=stere +lat_0=90 +lat_ts=70 +lon_0=-45 +ellps=WGS84 +units=m",
        "+proj=longlat +datum=WGS84",
    ];
    let marks = "EPSG:4326\n10.3 47.65 NaN 1.5 2.5 a.jpg one two\n# none\n\n10.3\t47.65\t7e2\t1\t2\tb.jpg\n";
    let lists = [world(60).1, marks.as_bytes().to_vec()];
    lists.into_iter().map(|list| chosen(0, list)).chain(systems.map(|system| chosen(1, system.to_owned()))).collect()
}
