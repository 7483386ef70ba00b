//! A set of tiles on the globe of an independent program, Cesium, in a browser without a network. `tools/readers`
//! installs Cesium.

use std::fs;
use std::io::{BufRead, BufReader, Write};
use std::net::{TcpListener, TcpStream};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use psrgs_vk::format::ply::Model;
use psrgs_vk::geodesy::Georeference;
use psrgs_vk::lod::{Content, TileSet};
use psrgs_vk::scene::{Coordinates, Gaussians, Geodetic};

use super::common::browser::{Browser, chromium};
use super::common::skipped;
use super::readers::installed;

/// A page that looks down on 8 degrees east, 47 north, with north at the top of a picture of 400 x 400.
const PAGE: &str = "<!doctype html><body style='margin:0'><div id='globe' style='width:400px;height:400px'></div>
<link rel='stylesheet' href='/cesium/Widgets/widgets.css'><script>window.CESIUM_BASE_URL = '/cesium/';</script>
<script src='/cesium/Cesium.js'></script><script>
const widget = new Cesium.CesiumWidget('globe', {
    baseLayer: false, skyBox: false, creditContainer: document.createElement('p') });
widget.scene.globe.show = false;
widget.scene.backgroundColor = Cesium.Color.BLACK;
Cesium.Cesium3DTileset.fromUrl('/tiles/tileset.json', { maximumScreenSpaceError: 0.01 }).then((tiles) => {
    widget.scene.primitives.add(tiles);
    tiles.tileFailed.addEventListener((e) => { throw new Error(e.url + ': ' + e.message); });
    tiles.allTilesLoaded.addEventListener(() => { window.loaded = tiles.statistics.numberOfTilesWithContentReady; });
    const middle = Cesium.Cartesian3.fromDegrees(8, 47, 500);
    widget.camera.lookAt(middle, new Cesium.HeadingPitchRange(0, -Cesium.Math.PI_OVER_TWO, 60));
});
</script>";

/// A plane of 40 x 40 m, metres east, north and up: red in the west, blue in the east, and green in the south east.
fn plane() -> Gaussians {
    let side = 40;
    let mut g = Gaussians::zeros(side * side);
    for i in 0..side * side {
        let (x, y) = ((i % side) as f32 - 19.5, (i / side) as f32 - 19.5);
        g.means[3 * i..3 * i + 3].copy_from_slice(&[x, y, 0.0]);
        let colour = if x < 0.0 {
            0
        } else if y < 0.0 {
            1
        } else {
            2
        };
        (0..3).for_each(|c| g.sh[0][12 * i + c] = if c == colour { 1.7 } else { -1.7 });
    }
    g.quats.iter_mut().step_by(4).for_each(|w| *w = 1.0);
    g.scales.fill(-0.4);
    g.opacities.fill(6.0);
    g
}

/// Answers requests for the page, for files of Cesium and for tiles, until the test ends.
fn serve(cesium: PathBuf, tiles: PathBuf) -> u16 {
    let listener = TcpListener::bind("127.0.0.1:0").expect("a port");
    let port = listener.local_addr().expect("an address").port();
    std::thread::spawn(move || {
        for stream in listener.incoming().flatten() {
            let (cesium, tiles) = (cesium.clone(), tiles.clone());
            std::thread::spawn(move || answer(&stream, &cesium, &tiles));
        }
    });
    port
}

fn answer(mut stream: &TcpStream, cesium: &Path, tiles: &Path) -> Option<()> {
    let mut lines = BufReader::new(stream).lines();
    let request = lines.next()?.ok()?;
    lines.by_ref().map_while(Result::ok).find(String::is_empty);
    let path = request.split(' ').nth(1)?.split('?').next()?;
    let (body, kind) = match path.split_once('/')?.1.split_once('/') {
        Some(("cesium", file)) => (fs::read(cesium.join(file)).ok(), file),
        Some(("tiles", file)) => (fs::read(tiles.join(file)).ok(), file),
        _ if path == "/" => (Some(PAGE.as_bytes().to_vec()), "page.html"),
        _ => (None, ""),
    };
    let kind = match kind.rsplit('.').next()? {
        "js" => "text/javascript",
        "css" => "text/css",
        "html" => "text/html",
        "json" => "application/json",
        "wasm" => "application/wasm",
        _ => "application/octet-stream",
    };
    let (state, body) = body.map_or(("404 Not Found", Vec::new()), |body| ("200 OK", body));
    let size = body.len();
    let head =
        format!("HTTP/1.1 {state}\r\nContent-Type: {kind}\r\nContent-Length: {size}\r\nConnection: close\r\n\r\n");
    stream.write_all(head.as_bytes()).ok()?;
    stream.write_all(&body).ok()
}

#[test]
fn cesium_draws_packed_tiles_at_their_place_and_upright() {
    let Some(cesium) = installed("node_modules/cesium/Build/Cesium", "node") else { return };
    let Some(chromium) = chromium() else { return skipped("chromium is not installed") };
    let folder = tempfile::tempdir().expect("a temporary folder");
    let tiles = folder.path().join("tiles");
    fs::create_dir(&tiles).expect("a folder");
    let origin = Geodetic { latitude: 47.0, longitude: 8.0, altitude: 500.0 };
    let georeference = Georeference::of_coordinates(&Coordinates::EastNorthUp { origin }, None).expect("a map");
    let to_earth = georeference.to_earth_at([0.0; 3]);
    let set = TileSet { folder: &tiles, content: Content::Spz, sh_degree: 0, to_earth };
    set.write(&Model { gaussians: plane(), ..Model::default() }, 500).expect("written");

    let port = serve(cesium, tiles);
    let software = ["--use-angle=swiftshader", "--enable-unsafe-swiftshader"];
    let first = folder.path().join("first.html");
    fs::write(&first, "<!doctype html><title>empty</title>").expect("written");
    let mut browser = Browser::visit(&chromium, &format!("file://{}", first.display()), folder.path(), &software);
    browser.goto(&format!("http://127.0.0.1:{port}/"));
    browser.until("window.loaded > 0");
    // Splats are sorted by a worker after they are loaded.
    let begun = Instant::now();
    let mut colours = Vec::new();
    while begun.elapsed() < Duration::from_secs(60) {
        let picture = browser.picture();
        // North west, south east, north east, and beside the plane.
        let at = [(150, 150), (250, 250), (250, 150), (8, 200)].map(|(x, y)| picture.get_pixel(x, y).0);
        colours = at.iter().map(|rgb| rgb.map(|v| v > 127)).collect();
        if colours[..3] == [[true, false, false], [false, true, false], [false, false, true]] {
            assert!(colours[3] != colours[0], "the plane has no end");
            return;
        }
        std::thread::sleep(Duration::from_millis(200));
    }
    panic!("the plane is not as it should be: {colours:?}, {:?}", browser.asked_for().1);
}
