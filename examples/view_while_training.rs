//! A host program that views a model in training. In one thread the engine trains on the host's device. In another
//! thread the host renders frames of the model into its own image, from its own command buffer.
//!
//! ```text
//! cargo run --example view_while_training -- DATA picture.png [STEPS]
//! ```

pub mod host;

use std::error::Error;
use std::path::Path;
use std::sync::{Mutex, MutexGuard, PoisonError};

use host::memory::{Allocator, HostBuffer, HostImage};
use host::{Commands, Host, Timeline};
use psrgs_vk::dataset::Dataset;
use psrgs_vk::format::image_out;
use psrgs_vk::raster::{LiveModel, Picture, RenderView, Viewer};
use psrgs_vk::scene::{Camera, Gaussians};
use psrgs_vk::train::{Input, Message, Pacing, Settings, Trainer, prepare};
use psrgs_vk::vk::ash::vk;
use psrgs_vk::vk::{Gpu, HostDevice, HostRecording, OpenOptions, SubmitSync};

/// Results of the example.
pub struct Outcome {
    /// The host's image at the end.
    pub picture: Picture,
    /// Number of frames drawn during the training, and in total.
    pub frames: (u64, u64),
    /// Number of training steps.
    pub steps: u32,
    /// Number of times that the planes of the model grew.
    pub grown: u32,
    /// The trained model, in scene coordinates.
    pub model: Gaussians,
}

/// State shared by the two threads.
struct Shared {
    /// The model in training.
    model: LiveModel,
    /// The view of the model.
    shot: RenderView,
    /// The last submitted step, as a value of the timeline of steps.
    step: u64,
    /// The last submitted frame, as a value of the timeline of frames.
    frame: u64,
    /// Whether the training is over.
    over: bool,
}

fn lock(shared: &Mutex<Shared>) -> MutexGuard<'_, Shared> {
    shared.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Trains on the host's device, and meanwhile draws the view of `camera`.
pub fn run(
    host: &Host,
    description: HostDevice<'_>,
    input: Input,
    settings: &Settings,
    pacing: Pacing,
    camera: Camera,
) -> Result<Outcome, Box<dyn Error>> {
    // SAFETY: the host's handles outlive `gpu` and everything made with it, which end with this function. The host
    // submits only inside the lock that it handed over.
    let gpu = unsafe { Gpu::adopt(description, &OpenOptions::default()) }?;
    let mut trainer = Trainer::new(&gpu, input, settings, pacing, None)?;
    let shared =
        Mutex::new(Shared { model: trainer.live_model(), shot: trainer.shot(&camera), step: 0, frame: 0, over: false });
    let (steps, frames) = (host.timeline()?, host.timeline()?);
    let mut view = View::new(host, &gpu, &frames, camera)?;
    let (done, grown) = std::thread::scope(|scope| {
        let training = scope.spawn(|| {
            // As text, because the error crosses threads.
            let done = train(&mut trainer, &shared, &camera, &steps, &frames).map_err(|error| error.to_string());
            lock(&shared).over = true;
            done
        });
        while !lock(&shared).over {
            view.draw(&shared, &steps)?;
        }
        let done = training.join().map_err(|_| "the training thread panicked")??;
        Ok::<_, Box<dyn Error>>(done)
    })?;
    let during = view.frames;
    // Draw the trained model; draw again if the pairs did not fit.
    loop {
        view.draw(&shared, &steps)?;
        if view.finish()? {
            break;
        }
    }
    let picture = view.read()?;
    let model = trainer.model()?;
    Ok(Outcome { picture, frames: (during, view.frames), steps: done, grown, model })
}

// ANCHOR: train
/// The training thread. Every step waits for the frames submitted before, and signals its end. Returns the number of
/// steps, and the number of times that the planes grew.
fn train(
    trainer: &mut Trainer,
    shared: &Mutex<Shared>,
    camera: &Camera,
    steps: &Timeline<'_>,
    frames: &Timeline<'_>,
) -> Result<(u32, u32), Box<dyn Error>> {
    let (mut done, mut grown, mut submitted) = (0, 0, 0);
    loop {
        let (wait, signal) = ([frames.at(lock(shared).frame)], [steps.at(submitted + 1)]);
        let going = trainer.step(SubmitSync::new(&wait, &signal))?.is_some();
        submitted += u64::from(going);
        let mut new_planes = false;
        while let Some(message) = trainer.poll()? {
            match message {
                Message::Step { step, .. } => done = step,
                Message::Grown { .. } => new_planes = true,
                Message::Warning(text) => println!("warning: {text}"),
                _ => {}
            }
        }
        grown += u32::from(new_planes);
        let mut shared = lock(shared);
        (shared.step, shared.shot) = (submitted, trainer.shot(camera));
        if new_planes {
            shared.model = trainer.live_model();
        }
        if !going {
            return Ok((done, grown));
        }
    }
}
// ANCHOR_END: train

/// Frame drawing of the host: its image, and the command buffer that the engine records into.
struct View<'a> {
    host: &'a Host,
    gpu: &'a Gpu,
    /// The timeline of frames.
    points: &'a Timeline<'a>,
    viewer: Viewer,
    image: HostImage<'a>,
    commands: Commands<'a>,
    shown: HostBuffer<'a>,
    /// Recording of the last frame, which keeps the frame's objects alive.
    recording: Option<HostRecording>,
    frames: u64,
}

impl<'a> View<'a> {
    fn new(host: &'a Host, gpu: &'a Gpu, points: &'a Timeline<'a>, camera: Camera) -> Result<Self, Box<dyn Error>> {
        Ok(Self {
            host,
            gpu,
            points,
            viewer: Viewer::new(gpu),
            image: HostImage::new(host, camera.width, camera.height)?,
            commands: host.commands()?,
            shown: HostBuffer::new(host, 4 * camera.width as usize * camera.height as usize)?,
            recording: None,
            frames: 0,
        })
    }

    // ANCHOR: draw
    /// Waits for the previous frame, then submits a frame.
    fn draw(&mut self, shared: &Mutex<Shared>, steps: &Timeline<'_>) -> Result<(), Box<dyn Error>> {
        self.finish()?;
        let (model, shot) = {
            let shared = lock(shared);
            (shared.model.clone(), shared.shot)
        };
        let mut recorder = self.gpu.recorder("frame")?;
        self.viewer.record_live(&mut recorder, &model, &shot, false)?;
        let Some(target) = self.viewer.target() else { return Err("nothing was recorded".into()) };
        let source = target.image.raw();
        let commands = self.commands.begin()?;
        // SAFETY: `commands` is a command buffer of the host that is being recorded. The recording and everything else
        // that the commands refer to are kept until the frame's semaphore value is reached.
        unsafe {
            self.recording = Some(recorder.record_into(commands)?);
            let (before, after) = (vk::ImageLayout::UNDEFINED, vk::ImageLayout::TRANSFER_DST_OPTIMAL);
            self.image.layout(commands, before, after);
            let region = [self.image.region()];
            self.host.device.cmd_copy_buffer_to_image(commands, source, self.image.image, after, &region);
            self.image.layout(commands, after, vk::ImageLayout::TRANSFER_SRC_OPTIMAL);
            self.host.device.end_command_buffer(commands)?;
        }
        // After the last submitted step. Later steps wait for this frame.
        let mut shared = lock(shared);
        // SAFETY: as above.
        unsafe { self.host.submit(commands, steps.at(shared.step), self.points.at(shared.frame + 1)) }?;
        shared.frame += 1;
        self.frames = shared.frame;
        Ok(())
    }

    /// Waits for the last frame and frees its objects. Returns false when the render was incomplete.
    fn finish(&mut self) -> Result<bool, Box<dyn Error>> {
        let Some(recording) = self.recording.take() else { return Ok(false) };
        self.points.wait(self.frames, u64::MAX)?;
        let executed = recording.finished();
        // SAFETY: the frame has run.
        unsafe { self.commands.reset() }?;
        Ok(self.viewer.fits(executed)? == Some(true))
    }
    // ANCHOR_END: draw

    /// The host's image, after the last frame.
    fn read(&mut self) -> Result<Picture, Box<dyn Error>> {
        let commands = self.commands.begin()?;
        let layout = vk::ImageLayout::TRANSFER_SRC_OPTIMAL;
        // SAFETY: image and buffer outlive the call, which waits for the semaphore value.
        let rgbt = unsafe {
            let region = [self.image.region()];
            self.host.device.cmd_copy_image_to_buffer(commands, self.image.image, layout, self.shown.buffer, &region);
            self.host.device.end_command_buffer(commands)?;
            self.host.submit(commands, self.points.at(self.frames), self.points.at(self.frames + 1))?;
            self.frames += 1;
            self.points.wait(self.frames, u64::MAX)?;
            self.shown.read()
        };
        Ok(Picture { width: self.image.width, height: self.image.height, rgbt, aux: None })
    }
}

impl Drop for View<'_> {
    fn drop(&mut self) {
        // Even after an error, keep everything that a frame still needs. On a lost device there is nothing to wait for.
        let _ = self.points.wait(self.frames, u64::MAX);
    }
}

#[allow(dead_code)]
fn main() -> Result<(), Box<dyn Error>> {
    let mut args = std::env::args().skip(1);
    let (Some(data), Some(file)) = (args.next(), args.next()) else {
        return Err("usage: view_while_training DATA PICTURE.png [STEPS]".into());
    };
    let Some(host) = Host::new()? else {
        println!("no Vulkan driver");
        return Ok(());
    };
    let mut settings = Settings::default();
    settings.run.iterations = args.next().map_or(Ok(500), |steps| steps.parse())?;
    settings.run.scale_schedule = true;
    settings.check()?;
    let dataset = Dataset::load(Path::new(&data), &prepare::load_options_of(&settings))?;
    let input = prepare::input(&dataset, &settings)?;
    let camera = input.held_out.first().or(input.train.first()).ok_or("no photograph")?.camera;
    let allocator = Allocator::new(&host);
    let description = host.describe(Some(allocator));
    let Outcome { picture, frames, steps, .. } = run(&host, description, input, &settings, Pacing::default(), camera)?;
    image_out::write_png(file.as_ref(), picture.width, picture.height, &picture.rgb8())?;
    println!("{file}: {steps} steps, {} frames while they went on", frames.0);
    Ok(())
}
