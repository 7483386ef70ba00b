//! The server: one thread that accepts connections, and one for each connection.

use std::net::{SocketAddr, TcpListener, TcpStream};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::thread::{self, JoinHandle};

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

fn refuse(mut connection: Connection) {
    let _ = connection.send(&Response::refusal(503, "Too many connections."), true);
}

fn serve(mut connection: Connection, site: &Site) {
    loop {
        match connection.next() {
            Ok(request) => {
                let response = site.respond(&request);
                if connection.send(&response, request.closes).is_err() || request.closes {
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
