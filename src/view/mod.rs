//! A page in the browser that shows a model: the server, what the page may ask for, and the rates of pictures.
//!
//! A [`Server`] answers the browser on threads of its own. Whoever has the model on a device takes what is wanted from
//! the [`Board`], draws it, and answers; nothing is drawn while nobody asks. A [`Pacer`] keeps the share of device time
//! that viewing may take.

mod ask;
mod board;
mod curves;
mod draw;
mod guard;
mod http;
mod pacer;
mod picture;
mod routes;
mod scene_info;
mod server;

pub use ask::{Ask, Channel, FrameAsk, PickAsk, Pose};
pub use board::{Board, Command, Reply, State, Status, Wanted};
pub use draw::{Drawable, answer};
pub use guard::Address;
pub use pacer::Pacer;
pub use scene_info::{SceneInfo, Shot, Source};
pub use server::Server;

/// Errors of starting a page.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// The address is none of this machine, or in use.
    #[error("cannot listen on {address}: {source}")]
    Listen {
        /// The address.
        address: String,
        /// Why.
        source: std::io::Error,
    },
    /// The text is no address.
    #[error("'{text}' is not an address: {problem}")]
    Address {
        /// The text.
        text: String,
        /// What is wrong.
        problem: &'static str,
    },
    /// The operating system gives no random bytes for the token.
    #[error("no random bytes for the page's token: {0}")]
    Random(String),
}
