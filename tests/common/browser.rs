//! Pages in a browser under real input: key and mouse events come from the browser, not from a script of the page.

use std::fs::{File, OpenOptions};
use std::io::{Read, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};

use serde_json::{Value, json};

/// The browser on this machine.
pub fn chromium() -> Option<PathBuf> {
    let names = ["chromium", "chromium-browser", "google-chrome"];
    std::env::split_paths(&std::env::var_os("PATH")?).flat_map(|dir| names.map(|n| dir.join(n))).find(|p| p.is_file())
}

/// A headless browser behind two pipes, with the protocol of its developer tools (JSON, terminated by zero bytes).
pub struct Browser {
    process: Child,
    to: File,
    from: File,
    left: Vec<u8>,
    calls: u64,
    /// The open page.
    session: Option<String>,
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
        let from = File::open(pipe("from")).expect("a pipe");
        let mut browser = Self { process, to, from, left: Vec::new(), calls: 0, session: None };
        let target = browser.call("Target.createTarget", json!({ "url": url }))["targetId"].clone();
        let attached = browser.call("Target.attachToTarget", json!({ "targetId": target, "flatten": true }));
        browser.session = Some(attached["sessionId"].as_str().expect("a session").to_owned());
        while browser.value("document.readyState === 'complete' && location.protocol !== 'about:'") != Value::Bool(true)
        {
            std::thread::yield_now();
        }
        browser
    }

    /// Calls a method of the protocol and returns the result. Events that arrive meanwhile are dropped.
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

    /// The value of an expression in the page.
    pub fn value(&mut self, expression: &str) -> Value {
        let answer = self.call("Runtime.evaluate", json!({ "expression": expression, "returnByValue": true }));
        assert!(answer["exceptionDetails"].is_null(), "{expression}: {answer}");
        answer["result"]["value"].clone()
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

impl Drop for Browser {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}
