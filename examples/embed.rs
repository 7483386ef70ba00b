//! A host program that renders a Gaussian model on its own `VkDevice`. The host creates instance, device and queue with
//! only the features that the engine requires, and lends an allocator. Host and engine submit work from separate
//! threads, ordered by a timeline semaphore. At the end the host writes the render to a file.
//!
//! ```text
//! cargo run --example embed -- picture.png
//! ```

pub mod host;

use std::error::Error;
use std::sync::mpsc;
use std::sync::{Mutex, PoisonError};

use host::Host;
use host::memory::{Allocator, HostBuffer};
use psrgs_vk::format::image_out;
use psrgs_vk::pass::camera::Projection;
use psrgs_vk::raster::{Picture, RenderView, Viewer};
use psrgs_vk::scene::init::SH_C0;
use psrgs_vk::scene::{Camera, Gaussians, SH_GROUP_FLOATS};
use psrgs_vk::vk::ash::vk;
use psrgs_vk::vk::{Gpu, HostDevice, OpenOptions, SubmitSync};

/// (mean, colour) of the splats of [`model`].
pub const SPLATS: [([f32; 3], [f32; 3]); 3] =
    [([-1.5, 0.0, 4.0], [1.0, 0.1, 0.1]), ([0.0, 0.5, 4.0], [0.1, 1.0, 0.1]), ([1.5, 0.0, 4.0], [0.1, 0.1, 1.0])];

/// A red, a green and a blue ball. To load a file, use `psrgs_vk::format::ply::read(file)?.gaussians`.
pub fn model() -> Gaussians {
    let mut model = Gaussians::zeros(SPLATS.len());
    for (i, (mean, colour)) in SPLATS.into_iter().enumerate() {
        model.means[3 * i..3 * i + 3].copy_from_slice(&mean);
        model.quats[4 * i] = 1.0;
        model.scales[3 * i..3 * i + 3].fill(0.3_f32.ln());
        // A logit: almost opaque.
        model.opacities[i] = 5.0;
        for (k, value) in colour.into_iter().enumerate() {
            model.sh[0][SH_GROUP_FLOATS * i + k] = (value - 0.5) / SH_C0 as f32;
        }
    }
    model
}

/// The view of frame `frame`: along z, from beside the origin, and in the last frame from the origin.
pub fn shot(frame: u64) -> RenderView {
    let rotation = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    let aside = 0.2 * (FRAMES - 1 - frame) as f64;
    let (width, height) = (96, 64);
    let camera =
        Camera { rotation, translation: [aside, 0.0, 0.0], fx: 80.0, fy: 80.0, cx: 48.0, cy: 32.0, width, height };
    RenderView { camera, projection: Projection::default(), background: [0.0; 3] }
}

/// Number of frames.
pub const FRAMES: u64 = 4;

/// Results of the example.
pub struct Outcome {
    /// The render of the last frame, as read by the host. The host has overwritten the first row.
    pub picture: Picture,
    /// Number of submits by the engine.
    pub submits: u64,
    /// Number of submits by the host.
    pub host_submits: u64,
}

/// Draws the frames on the host's device. Two threads submit to one queue, and no thread waits for the queue to be
/// idle.
pub fn run(host: &Host, description: HostDevice<'_>) -> Result<Outcome, Box<dyn Error>> {
    // ANCHOR: adopt
    // SAFETY: the host's handles outlive `gpu` and everything made with it, which end with this function. The host
    // submits only inside the lock that it handed over.
    let gpu = unsafe { Gpu::adopt(description, &OpenOptions::default()) }?;
    let viewer = Viewer::new(&gpu);
    let model = model();
    let (planes, splats) = (viewer.upload(&model)?, model.len() as u32);
    let viewer = Mutex::new(viewer);
    // ANCHOR_END: adopt
    let Camera { width, height, .. } = shot(0).camera;
    let floats = 4 * width as usize * height as usize;
    let shown = HostBuffer::new(host, 2 * floats)?;
    let commands = host.commands()?;
    // Frame f of the host's timeline: begun at 3 f + 1, rendered at 3 f + 2, shown at 3 f + 3.
    let timeline = host.timeline()?;
    let mut host_submits = 0;
    let mut first = 0;
    loop {
        let last = first + FRAMES;
        // A submit may wait only for earlier submits of the queue, so each thread tells the other when it has
        // submitted.
        let (begun, to_draw) = mpsc::channel();
        let (drawn, to_show) = mpsc::channel();
        let ticket = std::thread::scope(|scope| -> Result<_, Box<dyn Error>> {
            let (gpu, viewer, planes, timeline) = (&gpu, &viewer, &planes, &timeline);
            // ANCHOR: engine
            // The engine's thread: a frame is rendered after the host's part has run, and signals when complete.
            let engine = scope.spawn(move || {
                let mut ticket = gpu.last_ticket();
                for frame in to_draw {
                    let (wait, signal) = ([timeline.at(3 * frame + 1)], [timeline.at(3 * frame + 2)]);
                    let order = SubmitSync::new(&wait, &signal);
                    let mut viewer = viewer.lock().unwrap_or_else(PoisonError::into_inner);
                    ticket = viewer.submit(planes, splats, &shot(frame % FRAMES), true, order)?;
                    let target = viewer.target().map(|target| (target.image.clone(), target.aux.clone()));
                    if drawn.send(target).is_err() {
                        break;
                    }
                }
                Ok::<_, psrgs_vk::vk::Error>(ticket)
            });
            // ANCHOR_END: engine
            // ANCHOR: host
            // The host's thread: first the host's part of the frame (here a clear), then the display of the render.
            for frame in first..last {
                let clear = commands.begin()?;
                // SAFETY: `clear` is being recorded, and the buffer lives until the last point is reached.
                unsafe {
                    host.device.cmd_fill_buffer(clear, shown.buffer, 0, vk::WHOLE_SIZE, 0);
                    host.device.end_command_buffer(clear)?;
                    host.submit(clear, timeline.at(3 * frame), timeline.at(3 * frame + 1))?;
                }
                begun.send(frame)?;
                let Some((image, aux)) = to_show.recv()? else { continue };
                let show = commands.begin()?;
                // SAFETY: as above; the engine's buffers live as long as their handles,
                // which outlive the point waited for below.
                unsafe {
                    let bytes = 4 * floats as u64;
                    let copy = |to| [vk::BufferCopy { src_offset: 0, dst_offset: to, size: bytes }];
                    host.device.cmd_copy_buffer(show, image.raw(), shown.buffer, &copy(0));
                    host.device.cmd_copy_buffer(show, aux.raw(), shown.buffer, &copy(bytes));
                    overlay(host, show, &shown, width);
                    host.device.end_command_buffer(show)?;
                    host.submit(show, timeline.at(3 * frame + 2), timeline.at(3 * frame + 3))?;
                }
                host_submits += 2;
            }
            // ANCHOR_END: host
            drop(begun);
            Ok(engine.join().map_err(|_| "the engine's thread panicked")??)
        })?;
        // Only the reader of the result waits.
        timeline.wait(3 * last, u64::MAX)?;
        first = last;
        // ANCHOR: fits
        // If the (splat, tile) pairs did not fit, the viewer has more room now, and the frames are drawn again.
        if viewer.lock().unwrap_or_else(PoisonError::into_inner).fits(ticket)? == Some(true) {
            break;
        }
        // ANCHOR_END: fits
    }
    // SAFETY: the last point was reached.
    let read = unsafe { shown.read() };
    let (rgbt, aux) = read.split_at(floats);
    let picture = Picture { width, height, rgbt: rgbt.to_vec(), aux: Some(aux.to_vec()) };
    gpu.check_canaries()?;
    Ok(Outcome { picture, submits: gpu.stats().submits, host_submits })
}

/// Draws a white line along the first row, as a host might draw its controls.
///
/// # Safety
/// `commands` is being recorded.
unsafe fn overlay(host: &Host, commands: vk::CommandBuffer, shown: &HostBuffer<'_>, width: u32) {
    let copied = [vk::MemoryBarrier2::default()
        .src_stage_mask(vk::PipelineStageFlags2::ALL_TRANSFER)
        .src_access_mask(vk::AccessFlags2::TRANSFER_WRITE)
        .dst_stage_mask(vk::PipelineStageFlags2::ALL_TRANSFER)
        .dst_access_mask(vk::AccessFlags2::TRANSFER_WRITE)];
    let info = vk::DependencyInfo::default().memory_barriers(&copied);
    // SAFETY: the caller's promise; the row is inside the buffer.
    unsafe {
        host.device.cmd_pipeline_barrier2(commands, &info);
        host.device.cmd_fill_buffer(commands, shown.buffer, 0, 16 * u64::from(width), 1.0_f32.to_bits());
    }
}

#[allow(dead_code)]
fn main() -> Result<(), Box<dyn Error>> {
    let Some(host) = Host::new()? else {
        println!("no Vulkan driver");
        return Ok(());
    };
    let allocator = Allocator::new(&host);
    let Outcome { picture, submits, host_submits } = run(&host, host.describe(Some(allocator.clone())))?;
    let file = std::env::args().nth(1).unwrap_or_else(|| "embed.png".to_owned());
    image_out::write_png(file.as_ref(), picture.width, picture.height, &picture.rgb8())?;
    let (left, most) = allocator.lent();
    println!("{file}: {submits} submits of the engine and {host_submits} of the host on one queue");
    println!("{most} blocks of the host's memory were lent, {left} are left");
    Ok(())
}
