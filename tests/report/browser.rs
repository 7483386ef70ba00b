//! The report in a browser under real input.

use psrgs_vk::eval::write_report;
use serde_json::{Value, json};

use super::common::browser::{Browser, chromium};
use super::{common, example, portraits};

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

/// The model of a report is unpacked when it is asked for, in a frame of its own, and asks for nothing outside.
#[cfg(feature = "html-viewer")]
#[test]
fn report_shows_its_model_when_asked_and_lets_go_of_it() {
    let Some(chromium) = chromium() else {
        common::skipped("no chromium in PATH");
        return;
    };
    let hostile = "</script><img src=x onerror=window.ran=1>";
    let mut data = example(1, 160);
    data.title = hostile.into();
    data.views[0].name = hostile.into();
    data.model = Some(common::splats::page(hostile));
    let folder = tempfile::tempdir().expect("a temporary folder");
    let (empty, page) = (folder.path().join("empty.html"), folder.path().join("report.html"));
    std::fs::write(&empty, "<!doctype html><title>empty</title>").expect("written");
    write_report(&data, &page).expect("written");
    let software = ["--use-angle=swiftshader", "--enable-unsafe-swiftshader"];
    let mut browser = Browser::visit(&chromium, &format!("file://{}", empty.display()), folder.path(), &software);
    browser.goto(&format!("file://{}", page.display()));
    let state = "[document.querySelectorAll('iframe').length, typeof window.ran, \
                 document.querySelector('.look iframe')?.contentDocument?.body?.className ?? '', \
                 typeof document.querySelector('.look iframe')?.contentWindow?.ran]";
    browser.until("document.querySelector('.look')?.hidden === false");
    assert_eq!(browser.value(state), json!([0, "undefined", "", "undefined"]));
    browser.click(".look .open");
    browser.until("document.querySelector('.look iframe')?.contentDocument?.body?.className === 'shown'");
    assert_eq!(browser.value(state), json!([1, "undefined", "shown", "undefined"]));
    assert_eq!(browser.value("document.querySelector('.look iframe').contentDocument.title"), hostile);
    browser.click(".look-hint .close");
    assert_eq!(browser.value(state), json!([0, "undefined", "", "undefined"]));
    assert_eq!(browser.value("document.activeElement.className"), "open", "the button has the focus again");
    let (asked, problems) = browser.asked_for();
    let local = |url: &String| ["file:", "data:", "blob:"].iter().any(|of| url.starts_with(of));
    assert!(asked.iter().all(local) && asked.iter().filter(|url| url.starts_with("file:")).count() == 1, "{asked:?}");
    assert!(problems.iter().all(|text| text.contains("adapter")), "{problems:?}");
}
