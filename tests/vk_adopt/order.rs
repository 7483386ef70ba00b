//! Points of the host's timelines around work of the engine, and command buffers of the host.

use psrgs_vk::raster::{MEANS, PLANES, Viewer};
use psrgs_vk::vk::SubmitSync;
use psrgs_vk::vk::ash::vk;

use super::embed::host::memory::HostBuffer;
use super::{adopt, embed, host};

/// In nanoseconds, long enough for work that does not wait to finish.
const A_WHILE: u64 = 200_000_000;

#[test]
fn a_picture_waits_for_the_host_and_signals_it() {
    let Some(host) = host() else { return };
    let gpu = adopt(&host);
    let mut viewer = Viewer::new(&gpu);
    let model = embed::model();
    let (planes, splats, shot) = (viewer.upload(&model).unwrap(), model.len() as u32, embed::shot(0));
    // The first render makes room for pairs, and pipelines.
    let expected = viewer.render(&planes, splats, &shot, true).unwrap();
    let timeline = host.timeline().unwrap();
    let (wait, signal) = ([timeline.at(1)], [timeline.at(2)]);
    let ticket = viewer.submit(&planes, splats, &shot, true, SubmitSync::new(&wait, &signal)).unwrap();
    assert!(!timeline.wait(2, A_WHILE).unwrap(), "it did not wait for the host");
    assert!(!gpu.is_done(ticket).unwrap());
    assert_eq!(viewer.fits(ticket).unwrap(), None, "the render cannot have finished yet");
    timeline.signal(1).unwrap();
    assert!(timeline.wait(2, u64::MAX).unwrap());
    gpu.wait(ticket).unwrap();
    assert_eq!(viewer.fits(ticket).unwrap(), Some(true));
    assert_eq!(viewer.collect().unwrap().unwrap(), expected);
}

#[test]
fn a_picture_that_did_not_fit_is_told_without_waiting() {
    let Some(host) = host() else { return };
    let gpu = adopt(&host);
    let mut viewer = Viewer::new(&gpu);
    // A thousand splats that cover the whole image: more pairs than any guess.
    let mut model = psrgs_vk::scene::Gaussians::zeros(1000);
    for i in 0..model.len() {
        model.means[3 * i..3 * i + 3].copy_from_slice(&[0.0, 0.0, 3.0 + i as f32 * 1e-3]);
        model.quats[4 * i] = 1.0;
        model.scales[3 * i..3 * i + 3].fill(1.0);
    }
    let (planes, shot) = (viewer.upload(&model).unwrap(), embed::shot(0));
    let mut told = Vec::new();
    while told.last() != Some(&Some(true)) {
        let ticket = viewer.submit(&planes, 1000, &shot, false, SubmitSync::default()).unwrap();
        gpu.wait(ticket).unwrap();
        told.push(viewer.fits(ticket).unwrap());
    }
    assert_eq!(told, [Some(false), Some(true)]);
    let again = viewer.render(&planes, 1000, &shot, false).unwrap();
    assert!(again.rgbt.iter().all(|v| v.is_finite()) && again.rgbt[3] < 0.01, "something opaque is in front");
}

#[test]
fn a_picture_in_the_hosts_command_buffer_is_the_engines_own() {
    let Some(host) = host() else { return };
    let gpu = adopt(&host);
    let mut viewer = Viewer::new(&gpu);
    let model = embed::model();
    let (planes, splats) = (viewer.upload(&model).unwrap(), model.len() as u32);
    let expected = [0, 3].map(|frame| viewer.render(&planes, splats, &embed::shot(frame), true).unwrap());
    let floats = expected[0].rgbt.len();
    let (timeline, pool) = (host.timeline().unwrap(), host.commands().unwrap());
    let means = planes.layout()[MEANS];
    assert_eq!((means.name, means.floats), PLANES[MEANS]);
    let shown = HostBuffer::new(&host, 2 * floats + model.means.len()).unwrap();
    for (i, expected) in expected.iter().enumerate() {
        let shot = embed::shot([0, 3][i]);
        let mut recorder = gpu.recorder("in the host's commands").unwrap();
        viewer.record(&mut recorder, &planes, splats, &shot, true).unwrap();
        let target = viewer.target().unwrap();
        let commands = pool.begin().unwrap();
        // SAFETY: the recording is kept until the point is reached; the copies are of whole buffers into one that is
        // large enough.
        let recording = unsafe {
            let recording = recorder.record_into(commands).unwrap();
            let sources = [&target.image, &target.aux, means.buffer];
            for (k, (source, count)) in sources.into_iter().zip([floats, floats, model.means.len()]).enumerate() {
                let copy =
                    vk::BufferCopy { src_offset: 0, dst_offset: 4 * (k * floats) as u64, size: 4 * count as u64 };
                host.device.cmd_copy_buffer(commands, source.raw(), shown.buffer, &[copy]);
            }
            host.device.end_command_buffer(commands).unwrap();
            recording
        };
        // Work of the engine in between, in the same buffers: the host's commands do not depend on it.
        if i == 1 {
            let mut other = gpu.recorder("in between").unwrap();
            viewer.record(&mut other, &planes, splats, &embed::shot(0), true).unwrap();
            other.submit().unwrap();
        }
        let at = i as u64;
        // SAFETY: as above.
        unsafe { host.submit(commands, timeline.at(at), timeline.at(at + 1)) }.unwrap();
        timeline.wait(at + 1, u64::MAX).unwrap();
        assert_eq!(viewer.fits(recording.finished()).unwrap(), Some(true));
        // SAFETY: the point was reached.
        let read = unsafe { shown.read() };
        assert_eq!(read[..floats], expected.rgbt);
        assert_eq!(Some(&read[floats..2 * floats]), expected.aux.as_deref());
        assert_eq!(read[2 * floats..], model.means, "the planes are as the layout says");
    }
    // The engine continues after the host's commands.
    assert_eq!(viewer.render(&planes, splats, &embed::shot(0), true).unwrap(), expected[0]);
    gpu.check_canaries().unwrap();
}
