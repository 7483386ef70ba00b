//! Requests of the page and their responses.

use std::sync::Arc;
use std::time::Duration;

use serde_json::json;

use super::ask::{Ask, Channel, FrameAsk, PickAsk, Pose};
use super::board::{Board, Command, Reply};
use super::guard::{Guard, Shown, Verdict};
use super::http::{Method, Request, Response};
use super::picture;
use super::scene_info::SceneInfo;

/// Longest wait for a picture. The owner of the model may be scoring or writing results.
const LONGEST: Duration = Duration::from_secs(20);

/// Sides of photographs for the page.
const PHOTOGRAPH_SIDES: std::ops::RangeInclusive<u32> = 16..=2048;

const HTML: &str = "text/html; charset=utf-8";

/// What the threads of a server share.
pub(super) struct Site {
    pub(super) scene: SceneInfo,
    pub(super) board: Arc<Board>,
    pub(super) guard: Guard,
}

impl Site {
    /// The response to a request.
    pub(super) fn respond(&self, request: &Request) -> Response {
        let shown = Shown {
            host: request.host.as_deref(),
            origin: request.origin.as_deref(),
            cookie: request.cookie.as_deref(),
            token: request.value("token").filter(|_| request.path == "/"),
        };
        let verdict = self.guard.judge(shown);
        match (verdict, request.method) {
            (Verdict::ForeignHost, _) => Response::refusal(421, "This page is not known by that name."),
            (Verdict::NoToken, _) => {
                Response::refusal(403, "The address needs its token: open the whole address that psrgs-vk has printed.")
            }
            (Verdict::Read | Verdict::Change, Method::Get) => self.read(request),
            (Verdict::Change, Method::Post) => self.change(request),
            (Verdict::Read, Method::Post) => Response::refusal(403, "Only the page itself may change something."),
        }
    }

    fn read(&self, request: &Request) -> Response {
        match request.path.as_str() {
            "/" => Response::new(HTML, include_str!("page.html")).with("Set-Cookie", self.guard.set_cookie()),
            "/page.css" => Response::new("text/css; charset=utf-8", include_str!("page.css")),
            "/page.js" => Response::new("text/javascript; charset=utf-8", include_str!("page.js")),
            "/scene" => Response::json(&self.scene.json()),
            "/status" => Response::json(&self.board.json()),
            "/photograph" => self.photograph(request),
            "/frame" => self.frame(request),
            "/pick" => self.pick(request),
            _ => Response::refusal(404, "There is no such page."),
        }
    }

    fn change(&self, request: &Request) -> Response {
        if !self.scene.training {
            return Response::refusal(404, "No training runs here.");
        }
        match request.path.as_str() {
            "/pause" => self.board.pause(true),
            "/resume" => self.board.pause(false),
            "/save" => self.board.command(Command::Save),
            "/stop" => self.board.command(Command::Stop),
            _ => return Response::refusal(404, "There is no such command."),
        }
        Response::json(&self.board.json())
    }

    fn photograph(&self, request: &Request) -> Response {
        let index: Option<usize> = request.value("k").and_then(|k| k.parse().ok());
        let side = request.value("side").and_then(|side| side.parse().ok()).filter(|s| PHOTOGRAPH_SIDES.contains(s));
        let (Some(index), Some(side)) = (index, side) else { return Response::refusal(400, "Which photograph?") };
        let Some(shot) = self.scene.shots.get(index).filter(|shot| shot.photograph.is_some()) else {
            return Response::refusal(404, "There is no such photograph.");
        };
        match picture::photograph(shot, side) {
            Ok(bytes) => Response::new("image/jpeg", bytes),
            Err(why) => Response::refusal(503, &why),
        }
    }

    fn frame(&self, request: &Request) -> Response {
        let Some(ask) = FrameAsk::read(request).filter(|ask| ask.pose.camera(&self.scene, ask.size).is_some()) else {
            return Response::refusal(400, "The request for a picture cannot be read.");
        };
        let shot = match (&ask.pose, ask.channel) {
            (Pose::Photograph(index), Channel::Error) => {
                self.scene.shots.get(*index).filter(|shot| shot.photograph.is_some())
            }
            _ => None,
        };
        if ask.channel == Channel::Error && shot.is_none() {
            return Response::refusal(400, "An error needs a photograph: jump to one.");
        }
        match self.answer(request, Ask::Frame(ask.clone())) {
            Some(Reply::Frame(drawn)) => match picture::encode(&drawn, &ask, shot) {
                Ok(picture::Encoded { jpeg, range }) => {
                    let size = format!("{}x{}", drawn.width, drawn.height);
                    let response = Response::new("image/jpeg", jpeg).with("X-Size", size);
                    match range {
                        Some((low, high)) => response.with("X-Range", format!("{low} {high}")),
                        None => response,
                    }
                }
                Err(why) => Response::refusal(503, &why),
            },
            other => refused(other),
        }
    }

    fn pick(&self, request: &Request) -> Response {
        let Some(ask) = PickAsk::read(request).filter(|ask| ask.pose.camera(&self.scene, ask.size).is_some()) else {
            return Response::refusal(400, "The request for a point cannot be read.");
        };
        match self.answer(request, Ask::Pick(ask)) {
            Some(Reply::Point(point)) => {
                Response::json(&json!({ "scene": point, "dataset": point.map(|p| self.scene.frame.to_dataset(p)) }))
            }
            other => refused(other),
        }
    }

    fn answer(&self, request: &Request, ask: Ask) -> Option<Reply> {
        let viewer = request.value("v").and_then(|v| v.parse().ok()).unwrap_or(0);
        self.board.ask(viewer, ask).recv_timeout(LONGEST).ok()
    }
}

/// The response where there is nothing to show.
fn refused(reply: Option<Reply>) -> Response {
    match reply {
        Some(Reply::Failed(why)) => Response::refusal(503, &why),
        // A newer request of the viewer has taken the place of this one, or there was no time.
        _ => Response { code: 204, ..Response::new("text/plain", "") },
    }
}
