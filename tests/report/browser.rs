//! The page in a browser under real input: key and mouse events come from the browser, not from a script of the page.

use std::fs::{File, OpenOptions};
use std::io::{Read, Write};
use std::path::Path;
use std::process::{Child, Command, Stdio};

use psrgs_vk::eval::write_report;
use serde_json::{Value, json};

use super::{chromium, common, example, portraits};

/// A headless browser behind two pipes, with the protocol of its developer tools (JSON, terminated by zero bytes).
struct Browser {
    process: Child,
    to: File,
    from: File,
    left: Vec<u8>,
    calls: u64,
    /// The open page.
    session: Option<String>,
}

impl Browser {
    fn open(chromium: &Path, page: &Path, profile: &Path) -> Self {
        let pipe = |name: &str| profile.join(name);
        let made = Command::new("mkfifo").args([pipe("to"), pipe("from")]).status().expect("mkfifo");
        assert!(made.success());
        // The shell opens the file descriptors 3 and 4 for the browser.
        let process = Command::new("sh")
            .args(["-c", r#"browser=$1; shift; exec "$browser" "$@" 3<"$PROFILE/to" 4>"$PROFILE/from""#, "sh"])
            .arg(chromium)
            .args(["--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run"])
            .args(["--disable-background-networking", "--disable-component-update", "--disable-sync"])
            .args(["--window-size=1400,1600", "--remote-debugging-pipe"])
            .arg(format!("--user-data-dir={}", profile.join("profile").display()))
            .env("PROFILE", profile)
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .expect("a browser");
        let to = OpenOptions::new().write(true).open(pipe("to")).expect("a pipe");
        let from = File::open(pipe("from")).expect("a pipe");
        let mut browser = Self { process, to, from, left: Vec::new(), calls: 0, session: None };
        let url = format!("file://{}", page.display());
        let target = browser.call("Target.createTarget", json!({ "url": url }))["targetId"].clone();
        let attached = browser.call("Target.attachToTarget", json!({ "targetId": target, "flatten": true }));
        browser.session = Some(attached["sessionId"].as_str().expect("a session").to_owned());
        while browser.value("document.readyState === 'complete' && location.protocol === 'file:'") != Value::Bool(true)
        {
            std::thread::yield_now();
        }
        browser
    }

    fn call(&mut self, method: &str, params: Value) -> Value {
        self.calls += 1;
        let mut message = json!({ "id": self.calls, "method": method, "params": params });
        if let Some(session) = &self.session {
            message["sessionId"] = json!(session);
        }
        self.to.write_all(format!("{message}\0").as_bytes()).expect("heard");
        loop {
            let answer = self.next();
            if answer["id"] == json!(self.calls) {
                assert!(answer["error"].is_null(), "{method}: {answer}");
                return answer["result"].clone();
            }
        }
    }

    fn next(&mut self) -> Value {
        loop {
            if let Some(end) = self.left.iter().position(|byte| *byte == 0) {
                let message: Vec<u8> = self.left.drain(..=end).collect();
                return serde_json::from_slice(&message[..end]).expect("JSON");
            }
            let mut part = [0; 1 << 14];
            let count = self.from.read(&mut part).expect("an answer");
            assert!(count > 0, "the browser went away");
            self.left.extend_from_slice(&part[..count]);
        }
    }

    fn value(&mut self, expression: &str) -> Value {
        let answer = self.call("Runtime.evaluate", json!({ "expression": expression, "returnByValue": true }));
        assert!(answer["exceptionDetails"].is_null(), "{expression}: {answer}");
        answer["result"]["value"].clone()
    }

    fn key(&mut self, name: &str, code: u32) {
        for kind in ["keyDown", "keyUp"] {
            let key = json!({ "type": kind, "key": name, "code": name, "windowsVirtualKeyCode": code });
            self.call("Input.dispatchKeyEvent", key);
        }
    }

    fn mouse(&mut self, kind: &str, [x, y]: [f64; 2], held: bool) {
        let button = if held || kind == "mouseReleased" { "left" } else { "none" };
        let buttons = u32::from(held && kind != "mouseReleased");
        let event = json!({ "type": kind, "x": x, "y": y, "button": button, "buttons": buttons, "clickCount": 1 });
        self.call("Input.dispatchMouseEvent", event);
    }
}

impl Drop for Browser {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

#[test]
fn sliders_are_moved_by_keyboard_and_by_mouse() {
    let Some(chromium) = chromium() else {
        common::skipped("no chromium in PATH");
        return;
    };
    let folder = tempfile::tempdir().expect("a temporary folder");
    let page = folder.path().join("report.html");
    write_report(&example(2, 160), &page).expect("written");
    let mut browser = Browser::open(&chromium, &page, folder.path());
    // The second slider, below the visible part of the page.
    let state = "(() => { const stage = document.querySelectorAll('.stage')[1], range = stage.querySelector('input'); \
                 return [Number(range.value), stage.style.getPropertyValue('--share'), \
                 range.getAttribute('aria-valuetext'), document.activeElement === range]; })()";
    let first = "document.querySelector('.stage input').value";
    assert_eq!(browser.value(state)[3], false);

    // The tabulator key moves the focus from slider to slider.
    for _ in 0..40 {
        browser.key("Tab", 9);
        if browser.value(state)[3] == true {
            break;
        }
    }
    assert_eq!(browser.value(state)[3], true, "the tabulator key does not reach the slider");
    assert_eq!(browser.value(state)[0], 50);
    (0..3).for_each(|_| browser.key("ArrowRight", 39));
    assert_eq!(browser.value(state), json!([53, "53%", "53 % photograph, the rest render", true]));
    browser.key("ArrowLeft", 37);
    assert_eq!(browser.value(state)[1], "52%");
    browser.key("Home", 36);
    assert_eq!(browser.value(state)[1], "0%");
    browser.key("End", 35);
    assert_eq!(browser.value(state)[1], "100%");

    let place = browser.value(
        "(() => { const range = document.querySelectorAll('.stage input')[1]; range.scrollIntoView({ block: 'center' }); \
         const b = range.getBoundingClientRect(); return [b.left, b.top, b.width, b.height]; })()",
    );
    let [left, top, width, height] = [0, 1, 2, 3].map(|k| place[k].as_f64().expect("a number"));
    assert!(width > 150.0 && height > 100.0, "{place}");

    // Pressed at 80 %, drawn to 25 % and released: the slider stays when the mouse moves on.
    let at = |share: f64| [left + share * width, top + 0.5 * height];
    let near = |found: &Value, share: f64| (found[0].as_f64().expect("a number") - share).abs() <= 2.0;
    browser.mouse("mouseMoved", at(0.8), false);
    browser.mouse("mousePressed", at(0.8), true);
    let pressed = browser.value(state);
    browser.mouse("mouseMoved", at(0.25), true);
    let drawn = browser.value(state);
    browser.mouse("mouseReleased", at(0.25), true);
    browser.mouse("mouseMoved", at(0.6), false);
    let released = browser.value(state);
    assert!(near(&pressed, 80.0) && near(&drawn, 25.0) && released == drawn, "{pressed} {drawn} {released}");
    assert_eq!(drawn[1].as_str().expect("text"), format!("{}%", drawn[0]));
    assert_eq!(browser.value(first), "50", "the other slider has stayed");
}

/// Pictures in portrait format must not leave half of their card empty.
#[test]
fn cards_are_filled_by_pictures_of_every_shape() {
    let Some(chromium) = chromium() else {
        common::skipped("no chromium in PATH");
        return;
    };
    // The share of each card that pictures cover.
    let covered = "[...document.querySelectorAll('.body')].map((body) => { \
                   const area = (e) => { const b = e.getBoundingClientRect(); return b.width * b.height; }; \
                   const pictures = [...body.querySelectorAll('.stage, .panel img')]; \
                   return pictures.map(area).reduce((a, b) => a + b, 0) / area(body); })";
    for (what, data) in [
        ("landscape", example(2, 160)),
        ("portrait", portraits(false, true)),
        ("portrait with stages", portraits(true, true)),
        ("portrait with stages and without depth", portraits(true, false)),
        ("portrait without depth", portraits(false, false)),
    ] {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let page = folder.path().join("report.html");
        write_report(&data, &page).expect("written");
        let mut browser = Browser::open(&chromium, &page, folder.path());
        let shares = browser.value(covered);
        let shares: Vec<f64> = shares.as_array().expect("cards").iter().filter_map(Value::as_f64).collect();
        assert!(shares.len() == 2 && shares.iter().all(|share| *share > 0.8), "{what}: {shares:?}");
    }
}
