//! Where the threads of the server and the owner of the model meet: what is wanted, and how things stand.

use std::collections::VecDeque;
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use serde_json::{Value, json};

use super::ask::Ask;
use super::curves::Curves;
use crate::raster::Picture;

/// Something that a viewer waits for.
pub struct Wanted {
    /// What.
    pub ask: Ask,
    viewer: u64,
    reply: SyncSender<Reply>,
}

impl Wanted {
    /// Answers. A viewer that has gone hears nothing.
    pub fn answer(self, reply: Reply) {
        let _ = self.reply.try_send(reply);
    }
}

/// An answer.
#[derive(Clone, Debug)]
pub enum Reply {
    /// A picture.
    Frame(Picture),
    /// A point of the surface, in scene coordinates; `None` where there is none.
    Point(Option<[f64; 3]>),
    /// Nothing, and why.
    Failed(String),
}

/// What a viewer wants of the training.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Command {
    /// Write a checkpoint.
    Save,
    /// Write a checkpoint and end.
    Stop,
}

/// How far the work is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum State {
    /// The training runs, or is about to.
    #[default]
    Training,
    /// The results are being written.
    Writing,
    /// The model is final.
    Final,
}

/// How things stand.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Status {
    /// How far the work is.
    pub state: State,
    /// Last step.
    pub step: u32,
    /// Steps of the training.
    pub steps: u32,
    /// Last step of the low-frequency stage; 0 without it.
    pub low_until: u32,
    /// Splats.
    pub splats: u32,
    /// Seconds of training.
    pub seconds: f64,
    /// Expected seconds to the end.
    pub left: Option<f64>,
    /// The last thing to know: a checkpoint, a warning.
    pub note: String,
}

#[derive(Default)]
struct Inner {
    wanted: VecDeque<Wanted>,
    commands: VecDeque<Command>,
    paused: bool,
    status: Status,
    curves: Curves,
    /// Pictures drawn.
    drawn: u64,
    /// Time that the threads of the server have worked, not yet taken.
    served: Duration,
}

/// Shared by the server and the owner of the model.
#[derive(Default)]
pub struct Board {
    inner: Mutex<Inner>,
    changed: Condvar,
}

impl Board {
    fn lock(&self) -> MutexGuard<'_, Inner> {
        self.inner.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Asks for something. A viewer's newer request takes the place of an older one that nobody has begun.
    pub(super) fn ask(&self, viewer: u64, ask: Ask) -> Receiver<Reply> {
        let (reply, answer) = sync_channel(1);
        let mut inner = self.lock();
        let same = |w: &Wanted| w.viewer == viewer && matches!((&w.ask, &ask), (Ask::Frame(_), Ask::Frame(_)));
        let wanted = Wanted { viewer, reply, ask: ask.clone() };
        match inner.wanted.iter_mut().find(|w| same(w)) {
            Some(older) => *older = wanted,
            None => inner.wanted.push_back(wanted),
        }
        self.changed.notify_all();
        answer
    }

    pub(super) fn command(&self, command: Command) {
        self.lock().commands.push_back(command);
        self.changed.notify_all();
    }

    pub(super) fn pause(&self, paused: bool) {
        self.lock().paused = paused;
        self.changed.notify_all();
    }

    /// Whether somebody waits for something.
    pub fn is_wanted(&self) -> bool {
        !self.lock().wanted.is_empty()
    }

    /// Takes what has been wanted for the longest time.
    pub fn take(&self) -> Option<Wanted> {
        self.lock().wanted.pop_front()
    }

    /// The oldest command.
    pub fn take_command(&self) -> Option<Command> {
        self.lock().commands.pop_front()
    }

    /// Whether the training is to rest.
    pub fn paused(&self) -> bool {
        self.lock().paused
    }

    /// Waits until something is wanted, or changes, for at most `longest`.
    pub fn wait(&self, longest: Duration) {
        let inner = self.lock();
        if inner.wanted.is_empty() && inner.commands.is_empty() {
            drop(self.changed.wait_timeout(inner, longest));
        }
    }

    /// Changes how things stand.
    pub fn tell(&self, change: impl FnOnce(&mut Status)) {
        change(&mut self.lock().status);
    }

    /// Adds a value to a curve.
    pub fn add(&self, curve: &'static str, step: u32, value: f64) {
        self.lock().curves.add(curve, step, value);
    }

    /// Counts a picture.
    pub fn drew(&self) {
        self.lock().drawn += 1;
    }

    /// Tells that a thread of the server has worked for some time.
    pub(super) fn served(&self, worked: Duration) {
        self.lock().served += worked;
    }

    /// The time that the threads of the server have worked since this was last asked: encoding of pictures, decoding of
    /// photographs, answers.
    pub fn take_served(&self) -> Duration {
        std::mem::take(&mut self.lock().served)
    }

    /// Pictures drawn so far.
    pub fn drawn(&self) -> u64 {
        self.lock().drawn
    }

    pub(super) fn json(&self) -> Value {
        let inner = self.lock();
        let status = &inner.status;
        json!({
            "state": match status.state {
                State::Training if inner.paused => "paused",
                State::Training => "training",
                State::Writing => "writing",
                State::Final => "final",
            },
            "step": status.step,
            "steps": status.steps,
            "lowUntil": status.low_until,
            "splats": status.splats,
            "seconds": status.seconds,
            "left": status.left,
            "note": status.note,
            "drawn": inner.drawn,
            "curves": inner.curves.json(),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::super::ask::{Channel, FrameAsk, PickAsk, Pose};
    use super::*;

    fn frame(width: u32) -> Ask {
        let pose = Pose::Photograph(0);
        Ask::Frame(FrameAsk { pose, size: (width, 1), channel: Channel::Colour, part: None, moving: false })
    }

    #[test]
    fn viewers_take_turns_and_old_wishes_are_dropped() {
        let board = Board::default();
        assert!(!board.is_wanted() && board.take().is_none());
        let old = board.ask(1, frame(1));
        let other = board.ask(2, frame(2));
        let new = board.ask(1, frame(3));
        let point = board.ask(1, Ask::Pick(PickAsk { pose: Pose::Photograph(0), size: (1, 1), at: [0.0; 2] }));
        assert!(old.recv().is_err(), "the older request of a viewer has ended");
        let order: Vec<Ask> = std::iter::from_fn(|| board.take())
            .map(|w| {
                let ask = w.ask.clone();
                w.answer(Reply::Failed("no".to_owned()));
                ask
            })
            .collect();
        assert_eq!(order[..2], [frame(3), frame(2)]);
        assert!(matches!(order[2], Ask::Pick(_)) && order.len() == 3);
        for answer in [new, other, point] {
            assert!(matches!(answer.recv(), Ok(Reply::Failed(_))));
        }
        // A viewer that has gone.
        drop(board.ask(3, frame(1)));
        board.take().expect("a wish").answer(Reply::Point(None));
    }
}
