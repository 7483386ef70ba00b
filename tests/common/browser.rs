//! Pages in a browser under real input: key and mouse events come from the browser, not from a script of the page.

use std::fs::{File, OpenOptions};
use std::io::{BufRead, BufReader, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::mpsc::{Receiver, channel};
use std::time::{Duration, Instant};

use base64::prelude::{BASE64_STANDARD, Engine};
use serde_json::{Value, json};

/// Far longer than any wait here.
const PATIENCE: Duration = Duration::from_secs(60);

/// The browser on this machine.
pub fn chromium() -> Option<PathBuf> {
    let names = ["chromium", "chromium-browser", "google-chrome"];
    std::env::split_paths(&std::env::var_os("PATH")?).flat_map(|dir| names.map(|n| dir.join(n))).find(|p| p.is_file())
}

/// A headless browser behind two pipes, with the protocol of its developer tools (JSON, terminated by zero bytes).
pub struct Browser {
    process: Child,
    to: File,
    from: Receiver<Vec<u8>>,
    calls: u64,
    /// The open page.
    session: Option<String>,
    /// Events that arrived since the browser was asked to tell of the network.
    events: Option<Vec<Value>>,
}

impl Browser {
    /// Opens a page of this machine. `profile` is an empty folder for the browser's own files.
    pub fn open(chromium: &Path, page: &Path, profile: &Path) -> Self {
        Self::visit(chromium, &format!("file://{}", page.display()), profile, &[])
    }

    /// Opens an address and waits until the page is there. `extra` are further arguments of the browser.
    pub fn visit(chromium: &Path, url: &str, profile: &Path, extra: &[&str]) -> Self {
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
            .args(extra)
            .arg(format!("--user-data-dir={}", profile.join("profile").display()))
            .env("PROFILE", profile)
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .expect("a browser");
        let to = OpenOptions::new().write(true).open(pipe("to")).expect("a pipe");
        let from = messages(File::open(pipe("from")).expect("a pipe"));
        let mut browser = Self { process, to, from, calls: 0, session: None, events: None };
        let target = browser.call("Target.createTarget", json!({ "url": url }))["targetId"].clone();
        let attached = browser.call("Target.attachToTarget", json!({ "targetId": target, "flatten": true }));
        browser.session = Some(attached["sessionId"].as_str().expect("a session").to_owned());
        while browser.value("document.readyState === 'complete' && location.protocol !== 'about:'") != Value::Bool(true)
        {
            std::thread::yield_now();
        }
        browser
    }

    /// Calls a method of the protocol and returns the result. Events that arrive meanwhile are dropped, if nobody
    /// [listens](Self::goto).
    pub fn call(&mut self, method: &str, params: Value) -> Value {
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
            self.events.iter_mut().for_each(|events| events.push(answer.clone()));
        }
    }

    fn next(&mut self) -> Value {
        let message = self.from.recv_timeout(PATIENCE).expect("the browser went away or says nothing");
        serde_json::from_slice(&message).expect("JSON")
    }

    /// Goes to another page and listens to what the page asks for, see [`Self::asked_for`].
    pub fn goto(&mut self, url: &str) {
        self.events = Some(Vec::new());
        for domain in ["Network", "Log", "Runtime"] {
            self.call(&format!("{domain}.enable"), json!({}));
        }
        self.call("Page.navigate", json!({ "url": url }));
    }

    /// The addresses that the page of [`Self::goto`] has asked for, and the problems that it has met.
    pub fn asked_for(&self) -> (Vec<String>, Vec<String>) {
        let of = |method: &str| -> Vec<&Value> {
            let events = self.events.iter().flatten();
            events.filter(|event| event["method"] == method).map(|event| &event["params"]).collect()
        };
        let text = |value: &Value| value.as_str().unwrap_or_default().to_owned();
        let asked = of("Network.requestWillBeSent").into_iter().map(|event| text(&event["request"]["url"]));
        let wrong =
            of("Log.entryAdded").into_iter().map(|event| &event["entry"]).filter(|entry| entry["level"] == "error");
        let problems = wrong.map(|entry| text(&entry["text"]));
        let thrown = of("Runtime.exceptionThrown").into_iter().map(Value::to_string);
        (asked.collect(), problems.chain(thrown).collect())
    }

    /// A picture of the visible part of the page.
    pub fn picture(&mut self) -> image::RgbImage {
        let data = self.call("Page.captureScreenshot", json!({ "format": "png" }))["data"].clone();
        let png = BASE64_STANDARD.decode(data.as_str().expect("a picture")).expect("base64");
        image::load_from_memory(&png).expect("a PNG").to_rgb8()
    }

    /// The value of an expression in the page.
    pub fn value(&mut self, expression: &str) -> Value {
        let answer = self.call("Runtime.evaluate", json!({ "expression": expression, "returnByValue": true }));
        assert!(answer["exceptionDetails"].is_null(), "{expression}: {answer}");
        answer["result"]["value"].clone()
    }

    /// Waits until an expression of the page is true.
    pub fn until(&mut self, expression: &str) {
        let begun = Instant::now();
        while self.value(expression) != Value::Bool(true) {
            assert!(begun.elapsed() < PATIENCE, "never: {expression}; {:?}", self.asked_for().1);
            std::thread::sleep(Duration::from_millis(50));
        }
    }

    /// Clicks the middle of the element of a selector.
    pub fn click(&mut self, selector: &str) {
        let at = self.middle(selector);
        for kind in ["mouseMoved", "mousePressed", "mouseReleased"] {
            self.mouse(kind, at, kind == "mousePressed");
        }
    }

    /// Presses and releases a key.
    pub fn key(&mut self, name: &str, code: u32) {
        for kind in ["keyDown", "keyUp"] {
            let key = json!({ "type": kind, "key": name, "code": name, "windowsVirtualKeyCode": code });
            self.call("Input.dispatchKeyEvent", key);
        }
    }

    /// Sends a mouse event; `held` says whether the left button is down.
    pub fn mouse(&mut self, kind: &str, [x, y]: [f64; 2], held: bool) {
        let button = if held || kind == "mouseReleased" { "left" } else { "none" };
        let buttons = u32::from(held && kind != "mouseReleased");
        let event = json!({ "type": kind, "x": x, "y": y, "button": button, "buttons": buttons, "clickCount": 1 });
        self.call("Input.dispatchMouseEvent", event);
    }
}

impl Browser {
    /// The middle of an element, after it was scrolled into sight.
    #[track_caller]
    pub fn middle(&mut self, selector: &str) -> [f64; 2] {
        let place = self.value(&format!(
            "(() => {{ const e = document.querySelector({}); e.scrollIntoView({{ block: 'center' }}); \
             const b = e.getBoundingClientRect(); return [b.left + b.width / 2, b.top + b.height / 2]; }})()",
            json!(selector)
        ));
        [0, 1].map(|k| place[k].as_f64().expect("a number"))
    }

    /// Presses the left button at a position, moves by steps to another one, and releases the button.
    pub fn drag(&mut self, from: [f64; 2], to: [f64; 2]) {
        self.mouse("mouseMoved", from, false);
        self.mouse("mousePressed", from, true);
        for k in 1..=5 {
            let share = f64::from(k) / 5.0;
            self.mouse("mouseMoved", [0, 1].map(|i| from[i] + share * (to[i] - from[i])), true);
        }
        self.mouse("mouseReleased", to, true);
    }

    /// Turns the wheel by some pixels.
    pub fn wheel(&mut self, [x, y]: [f64; 2], pixels: f64) {
        let event = json!({ "type": "mouseWheel", "x": x, "y": y, "deltaX": 0, "deltaY": pixels });
        self.call("Input.dispatchMouseEvent", event);
    }

    /// A touch event with fingers at some positions.
    pub fn touch(&mut self, kind: &str, fingers: &[[f64; 2]]) {
        let points: Vec<Value> =
            fingers.iter().enumerate().map(|(id, [x, y])| json!({ "id": id, "x": x, "y": y })).collect();
        self.call("Input.dispatchTouchEvent", json!({ "type": kind, "touchPoints": points }));
    }
}

/// What a browser says, without the zero bytes. A thread reads, as a read from a pipe has no limit of time.
fn messages(from: File) -> Receiver<Vec<u8>> {
    let (said, heard) = channel();
    std::thread::spawn(move || {
        for message in BufReader::new(from).split(0).map_while(Result::ok) {
            if said.send(message).is_err() {
                return;
            }
        }
    });
    heard
}

impl Drop for Browser {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}
