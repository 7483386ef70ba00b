//! The server: one thread that accepts connections, and one for each connection.

use std::net::{SocketAddr, TcpListener, TcpStream};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::thread::{self, JoinHandle};
use std::time::Duration;

use super::Error;
use super::board::Board;
use super::guard::{Address, Guard};
use super::http::{Connection, NoRequest, Response};
use super::routes::Site;
use super::scene_info::SceneInfo;

/// Most connections at a time.
const MOST_CONNECTIONS: usize = 64;

/// A page that is being served. Ends when dropped.
pub struct Server {
    site: Arc<Site>,
    address: Address,
    at: SocketAddr,
    ends: Arc<AtomicBool>,
    accepting: Option<JoinHandle<()>>,
}

impl Server {
    /// Fails where [`Self::start`] would not get the address now.
    pub fn check(address: &Address) -> Result<(), Error> {
        listen(address).map(drop)
    }

    /// Serves a page about a scene. Another port is taken if the usual one is in use and none was named.
    pub fn start(address: &Address, scene: SceneInfo) -> Result<Self, Error> {
        let listener = listen(address)?;
        let failed = |source| Error::Listen { address: format!("{}:{}", address.host, address.port), source };
        let at = listener.local_addr().map_err(failed)?;
        let guard = Guard::new(&address.host, at.port())?;
        let site = Arc::new(Site { scene, board: Arc::new(Board::default()), guard });
        let ends = Arc::new(AtomicBool::new(false));
        let accepting = {
            let (site, ends) = (site.clone(), ends.clone());
            thread::Builder::new()
                .name("page".to_owned())
                .spawn(move || accept(&listener, &site, &ends))
                .map_err(failed)?
        };
        Ok(Self { site, address: address.clone(), at, ends, accepting: Some(accepting) })
    }

    /// The address of the page, with its token.
    pub fn url(&self) -> String {
        format!("http://{}:{}/?token={}", self.address.host, self.at.port(), self.site.guard.token())
    }

    /// Where the server and the owner of the model meet.
    pub fn board(&self) -> Arc<Board> {
        self.site.board.clone()
    }

    /// The scene that is shown.
    pub fn scene(&self) -> &SceneInfo {
        &self.site.scene
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        self.ends.store(true, Ordering::SeqCst);
        // Wakes the thread that accepts.
        if TcpStream::connect(self.at).is_ok()
            && let Some(accepting) = self.accepting.take()
        {
            let _ = accepting.join();
        }
    }
}

fn listen(address: &Address) -> Result<TcpListener, Error> {
    let on = |port| address.sockets(port).and_then(|found| TcpListener::bind(&found[..]));
    let listener = match on(address.port) {
        Err(error) if !address.port_named && error.kind() == std::io::ErrorKind::AddrInUse => on(0),
        other => other,
    };
    listener.map_err(|source| Error::Listen { address: format!("{}:{}", address.host, address.port), source })
}

/// One of the connections that are counted.
struct Counted(Arc<AtomicUsize>);

impl Drop for Counted {
    fn drop(&mut self) {
        self.0.fetch_sub(1, Ordering::SeqCst);
    }
}

fn accept(listener: &TcpListener, site: &Arc<Site>, ends: &AtomicBool) {
    let open = Arc::new(AtomicUsize::new(0));
    for stream in listener.incoming() {
        if ends.load(Ordering::SeqCst) {
            return;
        }
        let Ok(connection) = stream.and_then(Connection::new) else { continue };
        let before = open.fetch_add(1, Ordering::SeqCst);
        let counted = Counted(open.clone());
        if before >= MOST_CONNECTIONS {
            refuse(connection);
            continue;
        }
        let site = site.clone();
        // Without a thread the connection just ends.
        let _ = thread::Builder::new().name("viewer".to_owned()).spawn(move || {
            let _counted = counted;
            serve(connection, &site);
        });
    }
}

/// Time for which this thread has worked, waits left out.
#[cfg(unix)]
fn worked() -> Duration {
    let time = rustix::time::clock_gettime(rustix::time::ClockId::ThreadCPUTime);
    let seconds = u64::try_from(time.tv_sec).unwrap_or(0);
    Duration::new(seconds, u32::try_from(time.tv_nsec).unwrap_or(0))
}

/// Where the system does not tell, work of the server counts for nothing.
#[cfg(not(unix))]
fn worked() -> Duration {
    Duration::ZERO
}

fn refuse(mut connection: Connection) {
    let _ = connection.send(&Response::refusal(503, "Too many connections."), true);
}

fn serve(mut connection: Connection, site: &Site) {
    loop {
        match connection.next() {
            Ok(request) => {
                let before = worked();
                let response = site.respond(&request);
                let sent = connection.send(&response, request.closes);
                site.board.served(worked().saturating_sub(before));
                if sent.is_err() || request.closes {
                    return;
                }
            }
            Err(NoRequest::Refused(code)) => {
                let _ = connection.send(&Response::refusal(code, super::http::reason(code)), true);
                return;
            }
            Err(NoRequest::Over) => return,
        }
    }
}

#[cfg(all(test, unix))]
mod tests {
    use std::io::{Read as _, Write as _};

    use super::super::board::Reply;
    use super::super::scene_info::Shot;
    use super::*;
    use crate::raster::Picture;
    use crate::scene::{Camera, Frame};

    #[test]
    fn encoding_counts_as_work_and_waiting_does_not() {
        let (width, height) = (640, 480);
        let turn = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        let camera =
            Camera { rotation: turn, translation: [0.0; 3], fx: 500.0, fy: 500.0, cx: 320.0, cy: 240.0, width, height };
        let shot = Shot { name: "a".to_owned(), camera, held_out: false, photograph: None };
        let scene = SceneInfo::new("scene", Frame::IDENTITY).with_shots(vec![shot]);
        let server = Server::start(&"0".parse().expect("an address"), scene).expect("a server");
        let board = server.board();
        let (port, token) = (server.at.port(), server.site.guard.token());
        let mut stream = TcpStream::connect(server.at).expect("a connection");
        let head = format!("Host: localhost:{port}\r\nCookie: psrgs_{port}={token}\r\nConnection: close\r\n\r\n");
        let request = format!("GET /frame?w=640&h=480&k=0&c=colour&s=full&m=1 HTTP/1.1\r\n{head}");
        stream.write_all(request.as_bytes()).expect("sent");
        let slow = Duration::from_secs(1);
        let wanted = std::iter::repeat_with(|| board.take()).flatten().next().expect("a wish");
        thread::sleep(slow);
        let rgbt = (0..4 * width * height).map(|k| (k % 251) as f32 / 251.0).collect();
        wanted.answer(Reply::Frame(Picture { width, height, rgbt, aux: None }));
        let mut answer = Vec::new();
        stream.read_to_end(&mut answer).expect("an answer");
        assert!(answer.starts_with(b"HTTP/1.1 200"), "{}", String::from_utf8_lossy(&answer[..200.min(answer.len())]));
        // The thread tells of its work after it has sent the answer.
        let worked = std::iter::repeat_with(|| board.take_served()).find(|t| !t.is_zero()).expect("some time");
        assert!(worked < slow, "{worked:?}");
        assert_eq!(board.take_served(), Duration::ZERO);
    }
}
