//! A host program that watches a model while it is trained: the engine trains on the host's device in one thread, and
//! the host renders frame after frame of the same model into an image of its own in another,
//! from a command buffer of its own.
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

/// What came of it.
pub struct Outcome {
    /// The host's image at the end.
    pub picture: Picture,
    /// Frames drawn before the training was over, and in all.
    pub frames: (u64, u64),
    /// Steps that were done.
    pub steps: u32,
    /// How often the planes of the model grew.
    pub grown: u32,
    /// The trained model, in scene coordinates.
    pub model: Gaussians,
}

/// What the two threads tell each other.
struct Shared {
    /// The model that is being trained.
    model: LiveModel,
    /// How it is seen.
    shot: RenderView,
    /// The last step that has been submitted, a value of the timeline of steps.
    step: u64,
    /// The last frame that has been submitted, a value of the timeline of frames.
    frame: u64,
    /// The training is over.
    over: bool,
}

fn lock(shared: &Mutex<Shared>) -> MutexGuard<'_, Shared> {
    shared.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Trains on the host's device, and draws what `camera` sees of the model meanwhile.
pub fn run(
    host: &Host,
    description: HostDevice<'_>,
    input: Input,
    settings: &Settings,
    pacing: Pacing,
    camera: Camera,
) -> Result<Outcome, Box<dyn Error>> {
    // SAFETY: the host's handles outlive `gpu` and what is made with it, which end with this function; the host submits
    // inside the lock of the description only.
    let gpu = unsafe { Gpu::adopt(description, &OpenOptions::default()) }?;
    let mut trainer = Trainer::new(&gpu, input, settings, pacing, None)?;
    let shared =
        Mutex::new(Shared { model: trainer.live_model(), shot: trainer.shot(&camera), step: 0, frame: 0, over: false });
    let (steps, frames) = (host.timeline()?, host.timeline()?);
    let mut view = View::new(host, &gpu, &frames, camera)?;
    let (done, grown) = std::thread::scope(|scope| {
        let training = scope.spawn(|| {
            // As text, because it goes from one thread to another.
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
    // The end of the training, and once more where there was no room for it.
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
/// The training thread: every step waits for the frames that were submitted before it, and signals when it is done.
/// Gives the number of steps done and how often the planes grew.
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

/// The host's frames: an image of its own, and a command buffer that the engine's commands go into.
struct View<'a> {
    host: &'a Host,
    gpu: &'a Gpu,
    /// The frames' timeline.
    points: &'a Timeline<'a>,
    viewer: Viewer,
    image: HostImage<'a>,
    commands: Commands<'a>,
    shown: HostBuffer<'a>,
    /// What the last frame refers to.
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
    /// Submits a frame; first waits for the one before.
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
        // SAFETY: `commands` is a command buffer of the host that is being recorded. The recording is kept until the
        // frame's point has been reached, and so is all else that the commands refer to.
        unsafe {
            self.recording = Some(recorder.record_into(commands)?);
            let (before, after) = (vk::ImageLayout::UNDEFINED, vk::ImageLayout::TRANSFER_DST_OPTIMAL);
            self.image.layout(commands, before, after);
            let region = [self.image.region()];
            self.host.device.cmd_copy_buffer_to_image(commands, source, self.image.image, after, &region);
            self.image.layout(commands, after, vk::ImageLayout::TRANSFER_SRC_OPTIMAL);
            self.host.device.end_command_buffer(commands)?;
        }
        // Behind the last step that was submitted; the steps to come wait for this frame.
        let mut shared = lock(shared);
        // SAFETY: as above.
        unsafe { self.host.submit(commands, steps.at(shared.step), self.points.at(shared.frame + 1)) }?;
        shared.frame += 1;
        self.frames = shared.frame;
        Ok(())
    }

    /// Waits for the last frame and frees what it referred to. False where its picture was not whole.
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
        // SAFETY: image and buffer live on; the point is waited for.
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
        // Also when something went wrong, nothing goes that a frame still needs.
        // On a lost device there is nothing to wait for.
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
