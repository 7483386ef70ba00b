//! `view` and `train --view`: the page under real input, strangers, and trainings that keep their bits while watched.

use std::io::{BufRead as _, BufReader, Read as _, Write as _};
use std::net::TcpStream;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::{Duration, Instant};

use psrgs_vk::format::ply;
use serde_json::Value;

use crate::common::browser::{Browser, chromium};
use crate::common::skipped;
use crate::run::{STEPS, Shared, command, copy_of, shared, text, works};
use crate::training::same_model;
use crate::viewing::rgb;

/// Far longer than any wait here.
const PATIENCE: Duration = Duration::from_secs(60);

/// A program that serves a page.
struct Page {
    child: Child,
    url: String,
    port: u16,
    token: String,
}

impl Page {
    fn open(args: &[&str]) -> Self {
        let mut child = command(args).stdout(Stdio::piped()).stderr(Stdio::null()).spawn().expect("it starts");
        let mut line = String::new();
        BufReader::new(child.stdout.take().expect("a pipe")).read_line(&mut line).expect("a line");
        let url = line.trim().strip_prefix("page: ").unwrap_or_else(|| panic!("no page: {line}")).to_owned();
        let (place, token) = url.split_once("/?token=").expect("a token");
        let port = place.rsplit(':').next().and_then(|port| port.parse().ok()).expect("a port");
        let token = token.to_owned();
        Self { child, url, port, token }
    }

    /// Sends a request and returns status code, headers and body. The connection ends.
    fn ask(&self, request: &str) -> (u16, String, Vec<u8>) {
        let mut stream = TcpStream::connect(("127.0.0.1", self.port)).expect("a connection");
        stream.set_read_timeout(Some(PATIENCE)).expect("a limit");
        stream.write_all(request.as_bytes()).expect("sent");
        let mut whole = Vec::new();
        let _ = stream.read_to_end(&mut whole);
        let end = whole.windows(4).position(|four| four == b"\r\n\r\n").map_or(whole.len(), |at| at + 4);
        let head = String::from_utf8_lossy(&whole[..end]).into_owned();
        let code = head.split(' ').nth(1).and_then(|code| code.parse().ok()).unwrap_or(0);
        (code, head, whole.split_off(end))
    }

    /// A request with the cookie.
    fn request(&self, method: &str, path: &str, more: &str) -> (u16, String, Vec<u8>) {
        let (port, token) = (self.port, &self.token);
        self.ask(&format!(
            "{method} {path} HTTP/1.1\r\nHost: localhost:{port}\r\nCookie: psrgs_{port}={token}\r\n{more}Connection: \
             close\r\n\r\n"
        ))
    }

    fn get(&self, path: &str) -> Vec<u8> {
        let (code, head, body) = self.request("GET", path, "");
        assert_eq!(code, 200, "{path}: {head}{}", String::from_utf8_lossy(&body));
        body
    }

    fn post(&self, path: &str) {
        let (code, head, _) = self.request("POST", path, &format!("Origin: http://localhost:{}\r\n", self.port));
        assert_eq!(code, 200, "{path}: {head}");
    }

    fn status(&self) -> Value {
        serde_json::from_slice(&self.get("/status")).expect("JSON")
    }

    #[track_caller]
    fn wait_for(&self, what: &str, done: impl Fn(&Value) -> bool) -> Value {
        let begun = Instant::now();
        loop {
            let status = self.status();
            if done(&status) {
                return status;
            }
            assert!(begun.elapsed() < PATIENCE, "{what} has not come: {status}");
            thread::sleep(Duration::from_millis(10));
        }
    }

    /// Waits for the end, doing something now and then; gives the exit code.
    #[track_caller]
    fn ends(mut self, mut meanwhile: impl FnMut()) -> Option<i32> {
        let begun = Instant::now();
        loop {
            if let Some(status) = self.child.try_wait().expect("a child") {
                return status.code();
            }
            assert!(begun.elapsed() < PATIENCE, "the program goes on: {}", self.status());
            meanwhile();
            thread::sleep(Duration::from_millis(100));
        }
    }

    /// Ctrl-C; gives the exit code.
    #[track_caller]
    fn end(self) -> Option<i32> {
        assert!(Command::new("kill").args(["-INT", &self.child.id().to_string()]).status().expect("kill").success());
        self.ends(|| ())
    }
}

impl Drop for Page {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

const FRAME: &str = "/frame?w=64&h=48&k=0&c=colour&s=full&m=1";

fn view_of(shared: &Shared) -> Page {
    Page::open(&["view", text(&shared.model()), "--cameras", text(&shared.data()), "--address", "0"])
}

fn watched(shared: &Shared, out: &Path, more: &[&str]) -> Page {
    let settings = shared.run().join("settings.toml");
    let mut args = vec!["train", "--config", text(&settings), "--out", text(out), "--view", "0"];
    args.extend(more);
    Page::open(&args)
}

/// Two viewers, one that vanishes, fifty slow connections, a pause and a checkpoint.
#[test]
fn a_watched_training_keeps_its_bits() {
    let Some(shared) = shared() else { return };
    let folder = tempfile::tempdir().expect("a temporary folder");
    let out = folder.path().join("watched");
    let page = watched(shared, &out, &[]);
    // They send a part of a head and no more.
    let slow: Vec<TcpStream> = (0..50)
        .map(|_| {
            let mut stream = TcpStream::connect(("127.0.0.1", page.port)).expect("a connection");
            stream.write_all(b"GET / HTTP/1.1\r\nHo").expect("sent");
            stream
        })
        .collect();
    let over = AtomicBool::new(false);
    thread::scope(|scope| {
        for viewer in [1, 2] {
            let (page, over) = (&page, &over);
            scope.spawn(move || {
                let channels = ["colour", "depth", "normals", "outlines", "error"];
                for channel in channels.iter().cycle() {
                    if over.load(Ordering::SeqCst) {
                        return;
                    }
                    let path = format!("/frame?v={viewer}&w=64&h=48&k={viewer}&c={channel}&s=low&m=1");
                    let (code, head, _) = page.request("GET", &path, "");
                    assert!(code == 200 || code == 204, "{head}");
                }
            });
        }
        // A viewer that asks and is gone.
        let mut gone = TcpStream::connect(("127.0.0.1", page.port)).expect("a connection");
        let cookie = format!("Cookie: psrgs_{}={}", page.port, page.token);
        gone.write_all(format!("GET {FRAME} HTTP/1.1\r\nHost: localhost\r\n{cookie}\r\n\r\n").as_bytes())
            .expect("sent");
        drop(gone);
        page.post("/pause");
        let paused = page.wait_for("a pause", |s| s["state"] == "paused" && s["step"].as_u64() > Some(0));
        page.post("/save");
        let saved = page.wait_for("a checkpoint", |s| s["note"].as_str().is_some_and(|n| n.contains("Saved")));
        assert!(saved["step"].as_u64() <= paused["step"].as_u64().map(|step| step + 10), "{saved}");
        assert_eq!(page.get("/pick?v=3&w=64&h=48&k=0&at=0.5,0.5").first(), Some(&b'{'));
        page.post("/resume");
        page.wait_for("the end", |s| s["state"] == "final");
        over.store(true, Ordering::SeqCst);
    });
    assert!(page.get(FRAME).starts_with(&[0xff, 0xd8]), "a JPEG file of the final model");
    let last = page.status();
    assert_eq!(last["step"], STEPS);
    assert!(last["curves"]["loss"].as_array().is_some_and(|points| points.len() > 1), "{last}");
    drop(slow);
    assert_eq!(page.end(), Some(0));
    same_model(shared, &out, "watched");
}

#[test]
fn a_page_that_is_not_asked_draws_nothing() {
    let Some(shared) = shared() else { return };
    let folder = tempfile::tempdir().expect("a temporary folder");
    let page = watched(shared, &folder.path().join("alone"), &[]);
    let last = page.wait_for("the end", |s| s["state"] == "final");
    assert_eq!(last["drawn"], 0);
    page.get(FRAME);
    assert_eq!(page.status()["drawn"], 1);
}

#[test]
fn strangers_are_refused() {
    let Some(shared) = shared() else { return };
    let page = view_of(shared);
    let (port, token) = (page.port, page.token.clone());
    let code = |request: String| page.ask(&request).0;
    let (good, head, body) =
        page.ask(&format!("GET /?token={token} HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\nConnection: close\r\n\r\n"));
    assert!(good == 200 && String::from_utf8_lossy(&body).contains("<canvas"), "{head}");
    for promise in
        ["HttpOnly; SameSite=Strict", "frame-ancestors 'none'", "no-referrer", "nosniff", "default-src 'none'"]
    {
        assert!(head.contains(promise), "{promise}: {head}");
    }
    let host = format!("Host: localhost:{port}\r\nConnection: close\r\n");
    let cookie = format!("Cookie: psrgs_{port}={token}\r\n");
    let wrong = "0".repeat(32);
    for (request, want) in [
        (format!("GET / HTTP/1.1\r\n{host}\r\n"), 403),
        (format!("GET /?token={wrong} HTTP/1.1\r\n{host}\r\n"), 403),
        (format!("GET /status?token={token} HTTP/1.1\r\n{host}\r\n"), 403),
        (format!("GET /status HTTP/1.1\r\n{host}Cookie: psrgs_{port}={wrong}\r\n\r\n"), 403),
        (format!("GET /status HTTP/1.1\r\nHost: evil.example:{port}\r\nConnection: close\r\n{cookie}\r\n"), 421),
        (format!("GET /status HTTP/1.1\r\nConnection: close\r\n{cookie}\r\n"), 421),
        (format!("POST /stop HTTP/1.1\r\n{host}{cookie}\r\n"), 403),
        (format!("POST /stop HTTP/1.1\r\n{host}{cookie}Origin: http://evil.example\r\n\r\n"), 403),
        (format!("POST /stop HTTP/1.1\r\n{host}{cookie}Origin: http://localhost:{port}\r\n\r\n"), 404),
        (format!("GET /../../etc/passwd HTTP/1.1\r\n{host}{cookie}\r\n"), 404),
        (format!("GET /photograph?k=..%2f&side=64 HTTP/1.1\r\n{host}{cookie}\r\n"), 400),
        (format!("GET /photograph?k=999&side=64 HTTP/1.1\r\n{host}{cookie}\r\n"), 404),
        (format!("GET /photograph?k=0&side=64 HTTP/1.1\r\n{host}{cookie}\r\n"), 200),
        (format!("GET /frame?w=9999999&h=1&k=0&c=colour&s=full HTTP/1.1\r\n{host}{cookie}\r\n"), 400),
        (format!("GET /?{} HTTP/1.1\r\n{host}\r\n", "a".repeat(9000)), 431),
        (format!("POST /stop HTTP/1.1\r\n{host}{cookie}Content-Length: 9\r\n\r\nsome body"), 413),
        ("nonsense\r\n\r\n".to_owned(), 400),
    ] {
        assert_eq!(code(request.clone()), want, "{request}");
    }
    // A head that does not come is told after five seconds; the 65th connection at once.
    let held: Vec<TcpStream> =
        (0..64).map(|_| TcpStream::connect(("127.0.0.1", port)).expect("a connection")).collect();
    thread::sleep(Duration::from_millis(200));
    assert_eq!(code(format!("GET / HTTP/1.1\r\n{host}\r\n")), 503);
    drop(held);
    thread::sleep(Duration::from_millis(200));
    let begun = Instant::now();
    assert_eq!(code("GET / HTTP".to_owned()), 408);
    assert!((4..20).contains(&begun.elapsed().as_secs()), "{:?}", begun.elapsed());
    assert_eq!(page.end(), Some(0));
}

#[test]
fn a_port_in_use_is_an_error_that_names_it() {
    let Some(shared) = shared() else { return };
    let taken = std::net::TcpListener::bind(("127.0.0.1", 0)).expect("a port");
    let port = taken.local_addr().expect("an address").port().to_string();
    crate::run::fails(&["view", text(&shared.model()), "--address", &port], 2, &["cannot listen on 127.0.0.1", &port]);
    let words = ["192.168.1.5:8765"];
    crate::run::fails(&["view", text(&shared.model()), "--address", "0.0.0.0"], 2, &words);
}

/// Numbers about the origin of a map have 32 bits on the device: splats are drawn about an origin near them.
#[test]
fn a_model_on_a_map_is_viewed_as_one_at_the_origin() {
    let Some(shared) = shared() else { return };
    let folder = tempfile::tempdir().expect("a temporary folder");
    let mut model = ply::read(&shared.model()).expect("a model");
    let mut scene = |shift: [f64; 3]| -> Value {
        let file = folder.path().join("model.ply");
        model.shift = shift;
        ply::write(&file, &model).expect("written");
        let page = Page::open(&["view", text(&file), "--address", "0"]);
        serde_json::from_slice(&page.get("/scene")).expect("JSON")
    };
    let (near, far) = (scene([0.0; 3]), scene([597_627.25, 5_278_219.5, 700.0]));
    assert_eq!((&near["center"], &near["radius"]), (&far["center"], &far["radius"]));
    assert_eq!(far["offset"], serde_json::json!([597_627.25, 5_278_219.5, 700.0]));
}

/// Pixels of the last picture on the page.
const PIXELS: &str = "(() => { const c = new OffscreenCanvas(bitmap.width, bitmap.height), p = c.getContext('2d'); \
    p.drawImage(bitmap, 0, 0); return [bitmap.width, bitmap.height, \
    Array.from(p.getImageData(0, 0, bitmap.width, bitmap.height).data)]; })()";

#[test]
fn a_page_moves_by_mouse_wheel_touch_and_keys() {
    let Some(shared) = shared() else { return };
    let Some(chromium) = chromium() else { return skipped("no chromium in PATH") };
    let folder = tempfile::tempdir().expect("a temporary folder");
    // A name that would run as markup.
    let run = folder.path().join("<img src=x onerror='window.ran=1'>");
    std::fs::create_dir(&run).expect("a folder");
    std::fs::copy(shared.model(), run.join("point_cloud.ply")).expect("copied");
    let page =
        Page::open(&["view", text(&run.join("point_cloud.ply")), "--cameras", text(&shared.data()), "--address", "0"]);
    let mut browser = Browser::visit(&chromium, &page.url, folder.path(), &[]);
    browser.until("bitmap !== null && served === wish");
    assert_eq!(browser.value("location.search"), "", "the token is gone from the address");
    assert!(browser.value("document.querySelector('h1').textContent").as_str().is_some_and(|t| t.starts_with("<img")));
    assert!(browser.value("window.ran").is_null() && browser.value("document.querySelector('h1 img')").is_null());

    // The first picture is that of the first camera, as `render` draws it.
    let rendered = folder.path().join("renders");
    works(&["render", text(&shared.model()), "--cameras", text(&shared.data()), "--out", text(&rendered), "-q"]);
    let mut files: Vec<_> = std::fs::read_dir(&rendered).expect("renders").map(|e| e.expect("a file").path()).collect();
    files.sort();
    let shot = browser.value("[scene.shots[0].width, scene.shots[0].height]");
    let size = [0, 1].map(|k| shot[k].as_u64().expect("a number"));
    let path = format!("/frame?w={}&h={}&k=0&c=colour&s=full&m=0", size[0], size[1]);
    let seen = image::load_from_memory(&page.get(&path)).expect("a JPEG file").to_rgb8().into_raw();
    let truth = rgb(&files[0]);
    assert_eq!(seen.len(), truth.len());
    let mean = seen.iter().zip(&truth).map(|(a, b)| f64::from(a.abs_diff(*b))).sum::<f64>() / truth.len() as f64;
    assert!(mean <= 2.0, "mean difference of {mean} / 255");
    let shown = browser.value(PIXELS);
    assert!(shown[0].as_u64() >= Some(size[0]) && shown[2][3] == 255, "{} x {}", shown[0], shown[1]);

    let middle = browser.middle("#picture");
    let place = "JSON.stringify([camera.position, camera.rows, camera.distance])";
    let mut before = browser.value(place);
    let mut changes = |browser: &mut Browser, what: &str| {
        browser.until("served === wish");
        let now = browser.value(place);
        assert_ne!(now, before, "{what} moves nothing");
        before = now;
    };
    browser.drag(middle, [middle[0] + 60.0, middle[1] + 20.0]);
    changes(&mut browser, "the mouse");
    assert_eq!(browser.value("camera.at"), Value::Null, "a free view");
    browser.wheel(middle, 120.0);
    changes(&mut browser, "the wheel");
    browser.value("document.getElementById('picture').focus()");
    let key = |kind: &str| serde_json::json!({ "type": kind, "key": "w", "code": "KeyW", "windowsVirtualKeyCode": 87 });
    browser.call("Input.dispatchKeyEvent", key("keyDown"));
    thread::sleep(Duration::from_millis(150));
    browser.call("Input.dispatchKeyEvent", key("keyUp"));
    changes(&mut browser, "a key");
    // The view turns to where the arrow points.
    for (arrow, code, axis, sign) in
        [("ArrowRight", 39, 0, 1.0), ("ArrowLeft", 37, 0, -1.0), ("ArrowDown", 40, 1, 1.0), ("ArrowUp", 38, 1, -1.0)]
    {
        browser.value("window.before = camera.rows, 0");
        let key = |kind: &str| serde_json::json!({ "type": kind, "key": arrow, "code": arrow, "windowsVirtualKeyCode": code });
        browser.call("Input.dispatchKeyEvent", key("keyDown"));
        browser.until(&format!("Math.abs(dot(camera.rows[2], before[{axis}])) > 1e-3"));
        browser.call("Input.dispatchKeyEvent", key("keyUp"));
        let turned = browser.value(&format!("dot(camera.rows[2], before[{axis}])")).as_f64().expect("a number");
        assert!(turned * sign > 0.0, "{arrow} turns by {turned}");
        changes(&mut browser, arrow);
    }
    let [x, y] = middle;
    browser.touch("touchStart", &[[x - 40.0, y], [x + 40.0, y]]);
    browser.touch("touchMove", &[[x - 80.0, y], [x + 80.0, y]]);
    browser.touch("touchEnd", &[]);
    changes(&mut browser, "two fingers");
    browser.touch("touchStart", &[middle]);
    browser.touch("touchMove", &[[x + 50.0, y]]);
    browser.touch("touchEnd", &[]);
    changes(&mut browser, "a finger");

    // To a photograph and over to it; its error; a distance.
    browser.click("#next");
    browser.until("camera.at === 0 && photograph !== null && served === wish");
    browser.click("[data-channel=error]");
    browser.until("served === wish && document.getElementById('high').textContent.includes('255')");
    for channel in ["depth", "normals", "outlines", "colour"] {
        browser.click(&format!("[data-channel={channel}]"));
        browser.until("served === wish");
    }
    browser.click("[data-drag=measure]");
    let wide = browser.value("wanted()");
    let surfaces: Vec<[f64; 2]> = (0..64)
        .map(|k| [k % 8, k / 8].map(|at| (f64::from(at) + 0.5) / 8.0))
        .filter(|[u, v]| {
            let found = page.get(&format!("/pick?w={}&h={}&k=0&at={u},{v}", wide[0], wide[1]));
            !serde_json::from_slice::<Value>(&found).expect("JSON")["scene"].is_null()
        })
        .collect();
    assert!(surfaces.len() > 1, "{} places with a surface", surfaces.len());
    let corner = browser.value(
        "(() => { const b = canvas.getBoundingClientRect(), s = canvas.width / canvas.clientWidth; \
        const [l, t, w, h] = place(); return [b.left + l / s, b.top + t / s, w / s, h / s]; })()",
    );
    let [left, top, width, height] = [0, 1, 2, 3].map(|k| corner[k].as_f64().expect("a number"));
    for (count, [u, v]) in [surfaces[0], surfaces[surfaces.len() - 1]].into_iter().enumerate() {
        let at = [left + u * width, top + v * height];
        browser.mouse("mouseMoved", at, false);
        browser.mouse("mousePressed", at, true);
        browser.mouse("mouseReleased", at, true);
        browser.until(&format!("points.length === {}", count + 1));
    }
    browser.until("document.getElementById('measured').textContent.startsWith('Distance')");
    // Marks lie where the clicks were.
    let marks = browser.value("points.map((p) => project(p.scene)).concat([place()])");
    for (k, place) in [surfaces[0], surfaces[surfaces.len() - 1]].into_iter().enumerate() {
        for axis in 0..2 {
            let [mark, corner, side] =
                [&marks[k][axis], &marks[2][axis], &marks[2][2 + axis]].map(|value| value.as_f64().expect("a number"));
            assert!(((mark - corner) / side - place[axis]).abs() < 0.02, "{marks}: {place:?}");
        }
    }
    assert_eq!(page.end(), Some(0));
    browser.until("!document.getElementById('message').hidden || (moved(), false)");
}

/// Where a page looks from, as text.
const PLACE: &str = "JSON.stringify([camera.position, camera.rows, camera.distance])";

#[test]
fn two_browsers_look_at_one_training_apart_from_each_other() {
    let Some(shared) = shared() else { return };
    let Some(chromium) = chromium() else { return skipped("no chromium in PATH") };
    let folder = tempfile::tempdir().expect("a temporary folder");
    let page = watched(shared, &folder.path().join("watched"), &["--iterations", "100000", "--eval-every", "0"]);
    let visit = |name: &str| {
        let profile = folder.path().join(name);
        std::fs::create_dir(&profile).expect("a folder");
        Browser::visit(&chromium, &page.url, &profile, &[])
    };
    let (mut one, mut two) = (visit("one"), visit("two"));
    for browser in [&mut one, &mut two] {
        browser.until("bitmap !== null && served === wish");
    }
    let rests = two.value(PLACE);
    assert_eq!(one.value(PLACE), rests, "both begin at the first photograph");
    let middle = one.middle("#picture");
    one.drag(middle, [middle[0] + 80.0, middle[1] + 20.0]);
    let moved = one.value(PLACE);
    assert_ne!(moved, rests, "the mouse moves nothing");
    assert_eq!(two.value(PLACE), rests, "the other page was moved too");
    two.click("#next");
    two.until("camera.at !== null && served === wish");
    let jumped = two.value(PLACE);
    assert_eq!(one.value(PLACE), moved, "the first page was moved too");
    one.until("served === wish");

    // The one goes away in the middle of a move; the other goes on, and so does the training.
    one.mouse("mousePressed", middle, true);
    one.mouse("mouseMoved", [middle[0] - 90.0, middle[1]], true);
    drop(one);
    let step = page.status()["step"].as_u64().expect("a number");
    let drawn = page.status()["drawn"].as_u64().expect("a number");
    let middle = two.middle("#picture");
    two.drag(middle, [middle[0] - 60.0, middle[1]]);
    assert_ne!(two.value(PLACE), jumped);
    two.until(&format!("served === wish && status.step > {step} && status.drawn > {drawn}"));
    assert!(two.value("document.getElementById('message').hidden").as_bool() == Some(true), "a complaint");
    page.post("/stop");
    assert_eq!(page.ends(|| ()), Some(130));
}

/// Gives the first photographs of a dataset other names, in its files and in its model. A name that leads out of the
/// folder gets no file of its own.
fn rename(data: &Path, names: &[&str]) {
    let model = data.join("sparse/0/images.bin");
    let mut bytes = std::fs::read(&model).expect("a model");
    for (number, name) in names.iter().enumerate() {
        let old = format!("view_{number:04}.jpg\0");
        let at = bytes.windows(old.len()).position(|part| part == old.as_bytes()).expect("a photograph");
        bytes.splice(at..at + old.len(), format!("{name}\0").bytes());
        if !name.starts_with("../") {
            let to = data.join("images").join(name);
            std::fs::create_dir_all(to.parent().expect("a folder")).expect("a folder");
            std::fs::rename(data.join("images").join(old.trim_end_matches('\0')), to).expect("renamed");
        }
    }
    std::fs::write(&model, bytes).expect("written");
}

/// Names of photographs come from other people's datasets.
#[test]
fn hostile_names_of_photographs_are_text_on_the_page() {
    let Some(shared) = shared() else { return };
    let Some(chromium) = chromium() else { return skipped("no chromium in PATH") };
    let folder = tempfile::tempdir().expect("a temporary folder");
    let hostile = [
        "<img src=x onerror=window.ran=1>.jpg",
        "\"'></option><script>window.ran=2</script>&amp;.jpg",
        // Found inside of the folder, and called by the name that it has there.
        "../view_0002.jpg",
    ];
    let data = copy_of(&shared.data());
    rename(data.path(), &hostile);
    let page = Page::open(&["view", text(&shared.model()), "--cameras", text(data.path()), "--address", "0"]);
    let mut browser = Browser::visit(&chromium, &page.url, folder.path(), &[]);
    browser.until("bitmap !== null && served === wish");
    let shown = browser.value("Array.from(document.getElementById('photograph').options, (o) => o.textContent)");
    assert!(!shown.to_string().contains(".."), "{shown}");
    for name in hostile.map(|name| name.trim_start_matches("../")) {
        let at = shown.as_array().expect("names").iter().position(|s| s.as_str().is_some_and(|s| s.contains(name)));
        let at = at.unwrap_or_else(|| panic!("{name} is not in {shown}"));
        browser.value(&format!("jump({})", at - 1));
        browser.until(&format!("camera.at === {} && photograph !== null && served === wish", at - 1));
    }
    assert!(browser.value("window.ran").is_null(), "a name has run");
    assert!(browser.value("document.querySelector('[onerror], option *, #photograph img')").is_null());
    assert_eq!(page.end(), Some(0));
}

/// A training whose photographs are scored after each step is scoring most of the time.
#[test]
fn a_stop_that_comes_while_photographs_are_scored_is_kept() {
    let Some(shared) = shared() else { return };
    let folder = tempfile::tempdir().expect("a temporary folder");
    let page = watched(shared, &folder.path().join("scored"), &["--iterations", "100000", "--eval-every", "1"]);
    page.wait_for("some steps", |status| status["step"].as_u64() > Some(3));
    page.post("/stop");
    assert_eq!(page.ends(|| ()), Some(130));
}

#[test]
fn a_training_is_paused_and_stopped_on_its_page() {
    let Some(shared) = shared() else { return };
    let Some(chromium) = chromium() else { return skipped("no chromium in PATH") };
    let folder = tempfile::tempdir().expect("a temporary folder");
    let out = folder.path().join("stopped");
    let long = ["--iterations", "100000", "--eval-every", "40"];
    let page = watched(shared, &out, &long);
    let mut browser = Browser::visit(&chromium, &page.url, folder.path(), &[]);
    browser.until("bitmap !== null && status !== null && status.step > 60");
    browser.until("document.querySelectorAll('figure').length === 3");
    let points = "Number(document.querySelector('figure[data-curve=loss]').dataset.points)";
    let few = browser.value(points).as_u64().expect("a number");
    browser.until(&format!("{points} > {few}"));
    browser.click("#pause");
    browser.until("status.state === 'paused' && document.getElementById('pause').textContent === 'Go on'");
    thread::sleep(Duration::from_millis(300));
    let rests = page.status()["step"].clone();
    thread::sleep(Duration::from_millis(300));
    assert_eq!(page.status()["step"], rests, "a paused training goes on");
    browser.click("#pause");
    browser.until(&format!("status.state === 'training' && status.step > {rests}"));
    browser.click("#save");
    browser.until("document.getElementById('note').textContent.startsWith('Saved')");
    browser.click("#stop");
    browser.until("document.getElementById('stop').textContent.startsWith('Really')");
    // On a busy machine the second click may come when the question is over, and asks again.
    let mut clicked: Option<Instant> = None;
    let code = page.ends(|| {
        if clicked.is_none_or(|at| at.elapsed() > Duration::from_secs(2)) {
            browser.click("#stop");
            clicked = Some(Instant::now());
        }
    });
    assert_eq!(code, Some(130));
    assert!(out.join("checkpoints").read_dir().expect("checkpoints").count() > 0);
}

#[test]
fn a_view_within_a_budget_shows_the_scene_from_fewer_splats() {
    let Some(shared) = shared() else { return };
    let splats = view_of(shared).wait_for("the model", |status| status["splats"].as_u64() > Some(0))["splats"].clone();
    let most = (splats.as_u64().expect("a count") / 2).max(100).to_string();
    let (model, data) = (shared.model(), shared.data());
    let args = ["view", text(&model), "--cameras", text(&data), "--address", "0"];
    let picture = |more: &[&str]| {
        let page = Page::open(&[&args[..], more].concat());
        let picture = page.get(&FRAME.replace("m=1", "m=0"));
        assert_eq!(page.end(), Some(0));
        image::load_from_memory(&picture).expect("a picture").to_rgb8().into_raw()
    };
    let (all, few) = (picture(&[]), picture(&["--max-splats", &most]));
    assert_eq!(all.len(), few.len());
    let squares = all.iter().zip(&few).map(|(a, b)| f64::from(a.abs_diff(*b)).powi(2));
    let psnr = -10.0 * (squares.sum::<f64>() / all.len() as f64 / 255.0_f64.powi(2)).log10();
    assert!(all != few && psnr > 15.0, "{psnr} dB");
}
