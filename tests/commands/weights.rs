//! `weights --fetch`: against a server on this machine.

use std::collections::HashMap;
use std::fs;
use std::io::{BufRead, BufReader, Write};
use std::net::TcpListener;

use psrgs_vk::perceptual::PUBLIC_FILES;

use crate::common;
use crate::run::{command, fails, psrgs, shared, stderr, text};

/// Serves files by name until the process ends; gives the address of the server.
fn serve(files: HashMap<String, Vec<u8>>) -> String {
    let listener = TcpListener::bind("127.0.0.1:0").expect("a port");
    let address = format!("http://{}/weights", listener.local_addr().expect("an address"));
    std::thread::spawn(move || {
        for stream in listener.incoming() {
            let Ok(mut stream) = stream else { return };
            let mut lines = BufReader::new(&stream).lines().map_while(Result::ok);
            let request = lines.next().unwrap_or_default();
            lines.take_while(|line| !line.is_empty()).for_each(drop);
            let path = request.split(' ').nth(1).unwrap_or_default();
            let found = files.iter().find(|(name, _)| path == format!("/weights/{name}"));
            let (status, body) = found.map_or(("404 Not Found", &[][..]), |(_, body)| ("200 OK", body.as_slice()));
            let head = format!("HTTP/1.1 {status}\r\nContent-Length: {}\r\nConnection: close\r\n\r\n", body.len());
            let _ = stream.write_all(head.as_bytes()).and_then(|()| stream.write_all(body));
        }
    });
    address
}

#[test]
fn what_is_not_the_published_file_is_not_kept() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let [trunk, _] = &PUBLIC_FILES;
    let address = serve(HashMap::from([(trunk.name.to_owned(), vec![7; 5000])]));
    let args = ["weights", "--dir", text(folder.path()), "--fetch", "--from", &address];
    fails(&args, 7, &[trunk.name, trunk.sha256, "5000 bytes", "nothing was kept", text(folder.path())]);
    assert_eq!(fs::read_dir(folder.path()).expect("a folder").count(), 0);
    // Both files are missing: the error names the first.
    let nowhere = serve(HashMap::new());
    fails(
        &["weights", "--dir", text(folder.path()), "--fetch", "--from", &nowhere],
        3,
        &[trunk.name, "404", "by other means"],
    );
    let port = TcpListener::bind("127.0.0.1:0").expect("a port").local_addr().expect("an address");
    let closed = format!("http://{port}");
    fails(
        &["weights", "--dir", text(folder.path()), "--fetch", "--from", &closed],
        3,
        &[trunk.name, "cannot be fetched"],
    );
}

/// Half a download in the usual folder is a warning. In a folder that the user names it is an error.
#[test]
fn weights_that_are_not_whole_stop_only_who_named_them() {
    let Some(shared) = shared() else { return };
    let home = tempfile::tempdir().expect("a temporary folder");
    let usual = home.path().join("psrgs-vk/weights");
    fs::create_dir_all(&usual).expect("a folder");
    let (model, data, out) = (shared.model(), shared.data(), home.path().join("run"));
    let eval = ["eval", text(&model), text(&data), "-q"];
    let train = ["train", text(&data), "--out", text(&out), "--iterations", "2", "-q", "--overwrite"];
    for damaged in [false, true] {
        if damaged {
            for file in &PUBLIC_FILES {
                fs::write(usual.join(file.name), "half of it").expect("written");
            }
        }
        for args in [&eval[..], &train] {
            let output = command(args).env("XDG_DATA_HOME", home.path()).output().expect("the command starts");
            let said = stderr(&output);
            assert!(output.status.success(), "{args:?}: {said}");
            for word in ["warning: lpips_squeeze is not measured", text(&usual), "psrgs-vk weights --fetch"] {
                assert!(said.contains(word), "{args:?} does not say `{word}`: {said}");
            }
        }
        fails(&[&eval[..], &["--perceptual-weights", text(&usual)]].concat(), 3, &[text(&usual)]);
        let output = command(&eval).env("PSRGS_WEIGHTS", &usual).output().expect("the command starts");
        assert_eq!(output.status.code(), Some(3), "{}", stderr(&output));
    }
}

/// The linear layers are among the shared weights; the trunk that torchvision publishes is not, and fails.
#[test]
fn what_is_published_is_fetched_and_not_fetched_again() {
    let Some(published) = common::weights("lpips_squeeze_v0.1.pth") else { return };
    let [_, linear] = &PUBLIC_FILES;
    let bytes = fs::read(published).expect("the linear layers");
    let address = serve(HashMap::from([(linear.name.to_owned(), bytes.clone())]));
    let folder = tempfile::tempdir().expect("a temporary folder");
    let inside = folder.path().join("new/weights");
    let said = stderr(&psrgs(&["weights", "--dir", text(&inside), "--fetch", "--from", &address]));
    assert!(said.contains(&format!("{}: fetched, as published", linear.name)), "{said}");
    assert_eq!(fs::read(inside.join(linear.name)).expect("fetched"), bytes);
    let said = stderr(&psrgs(&["weights", "--dir", text(&inside), "--fetch", "--from", &address]));
    assert!(said.contains(&format!("{}: there already", linear.name)), "{said}");
}

/// The trunk may come from another file than the published one.
#[test]
fn a_folder_whose_weights_can_be_read_lacks_no_file() {
    let Some(file) = common::weights("lpips_squeeze_v0.1.pth") else { return };
    let folder = text(file.parent().expect("a folder")).to_owned();
    let said = |args: &[&str]| String::from_utf8(psrgs(args).stdout).expect("text");
    let told = said(&["weights", "--dir", &folder]);
    assert!(!told.contains("not there"), "{told}");
    assert!(told.contains("not needed: ") && told.contains("\nusable: "), "{told}");
    // In an empty folder both are missing.
    let empty = tempfile::tempdir().expect("a temporary folder");
    let told = said(&["weights", "--dir", text(empty.path())]);
    assert!(told.matches("not there").count() == 2 && !told.contains("usable: "), "{told}");
}
