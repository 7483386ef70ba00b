//! Requests and responses of HTTP/1.1, within bounds: heads of 8 KB that arrive in 5 seconds, and no bodies.

use std::io::{self, Read, Write};
use std::net::TcpStream;
use std::time::{Duration, Instant};

/// Most bytes of a head.
const MOST_HEAD: usize = 8192;

/// Most headers of a request.
const MOST_HEADERS: usize = 64;

/// Longest time for a head to arrive, and for a connection to stay idle.
const PATIENCE: Duration = Duration::from_secs(5);

/// Longest time for a part of a response to be taken.
const WRITING: Duration = Duration::from_secs(10);

/// Method of a request.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Method {
    Get,
    Post,
}

/// A request.
#[derive(Clone, Debug)]
pub(super) struct Request {
    pub(super) method: Method,
    /// The path, without the query.
    pub(super) path: String,
    /// The query.
    pub(super) query: String,
    pub(super) host: Option<String>,
    pub(super) origin: Option<String>,
    pub(super) cookie: Option<String>,
    /// Whether the connection ends after the response.
    pub(super) closes: bool,
}

impl Request {
    /// The value of a key of the query. Nothing that the page sends needs decoding.
    pub(super) fn value(&self, key: &str) -> Option<&str> {
        self.query.split('&').filter_map(|pair| pair.split_once('=')).find(|(k, _)| *k == key).map(|(_, v)| v)
    }
}

/// Why there is no request.
#[derive(Debug, PartialEq, Eq)]
pub(super) enum NoRequest {
    /// The connection is over, or was idle for too long.
    Over,
    /// The response to a request that is refused.
    Refused(u16),
}

/// A connection, with bytes of the next request that have arrived.
pub(super) struct Connection {
    stream: TcpStream,
    ahead: Vec<u8>,
}

impl Connection {
    pub(super) fn new(stream: TcpStream) -> io::Result<Self> {
        stream.set_nodelay(true)?;
        stream.set_write_timeout(Some(WRITING))?;
        Ok(Self { stream, ahead: Vec::new() })
    }

    /// Reads the next request.
    pub(super) fn next(&mut self) -> Result<Request, NoRequest> {
        let end = Instant::now() + PATIENCE;
        loop {
            match parse(&self.ahead) {
                Parsed::Whole(request, length) => {
                    self.ahead.drain(..length);
                    return Ok(request);
                }
                Parsed::Wrong(code) => return Err(NoRequest::Refused(code)),
                Parsed::Part if self.ahead.len() >= MOST_HEAD => return Err(NoRequest::Refused(431)),
                Parsed::Part => {}
            }
            let left = end.saturating_duration_since(Instant::now());
            if left.is_zero() {
                // An idle connection just ends; a head that does not come is told.
                return Err(if self.ahead.is_empty() { NoRequest::Over } else { NoRequest::Refused(408) });
            }
            let mut part = [0; 2048];
            let room = part.len().min(MOST_HEAD - self.ahead.len());
            let read = self.stream.set_read_timeout(Some(left)).and_then(|()| self.stream.read(&mut part[..room]));
            match read {
                Ok(0) => return Err(NoRequest::Over),
                Ok(count) => self.ahead.extend_from_slice(&part[..count]),
                Err(error) if is_late(&error) => {}
                Err(_) => return Err(NoRequest::Over),
            }
        }
    }

    /// Sends a response. `closes` ends the connection.
    pub(super) fn send(&mut self, response: &Response, closes: bool) -> io::Result<()> {
        let mut head = format!(
            "HTTP/1.1 {} {}\r\nContent-Type: {}\r\nContent-Length: {}\r\nConnection: {}\r\n{SAFETY}",
            response.code,
            reason(response.code),
            response.kind,
            response.body.len(),
            if closes { "close" } else { "keep-alive" }
        );
        for (name, value) in &response.headers {
            head.push_str(&format!("{name}: {value}\r\n"));
        }
        head.push_str("\r\n");
        let mut whole = head.into_bytes();
        whole.extend_from_slice(&response.body);
        self.stream.write_all(&whole)
    }
}

fn is_late(error: &io::Error) -> bool {
    matches!(error.kind(), io::ErrorKind::WouldBlock | io::ErrorKind::TimedOut | io::ErrorKind::Interrupted)
}

/// Headers of every response. The page loads nothing from elsewhere, is in no frame of another page, and tells no other
/// page its address.
const SAFETY: &str = "Content-Security-Policy: default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' \
    blob: data:; connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'\r\n\
    Referrer-Policy: no-referrer\r\nX-Content-Type-Options: nosniff\r\nCross-Origin-Resource-Policy: same-origin\r\n\
    Cache-Control: no-store\r\n";

/// A response.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Response {
    pub(super) code: u16,
    pub(super) kind: &'static str,
    pub(super) headers: Vec<(&'static str, String)>,
    pub(super) body: Vec<u8>,
}

impl Response {
    pub(super) fn new(kind: &'static str, body: impl Into<Vec<u8>>) -> Self {
        Self { code: 200, kind, headers: Vec::new(), body: body.into() }
    }

    pub(super) fn json(value: &serde_json::Value) -> Self {
        Self::new("application/json", value.to_string())
    }

    /// A refusal with one line of text.
    pub(super) fn refusal(code: u16, text: &str) -> Self {
        Self { code, ..Self::new("text/plain; charset=utf-8", format!("{text}\n")) }
    }

    pub(super) fn with(mut self, name: &'static str, value: String) -> Self {
        self.headers.push((name, value));
        self
    }
}

/// The words of a status code.
pub(super) fn reason(code: u16) -> &'static str {
    match code {
        200 => "OK",
        204 => "No Content",
        400 => "Bad Request",
        403 => "Forbidden",
        404 => "Not Found",
        405 => "Method Not Allowed",
        408 => "Request Timeout",
        413 => "Content Too Large",
        421 => "Misdirected Request",
        431 => "Request Header Fields Too Large",
        _ => "Service Unavailable",
    }
}

enum Parsed {
    Whole(Request, usize),
    Part,
    Wrong(u16),
}

/// A request from the bytes that have arrived.
fn parse(bytes: &[u8]) -> Parsed {
    let mut headers = [httparse::EMPTY_HEADER; MOST_HEADERS];
    let mut request = httparse::Request::new(&mut headers);
    let length = match request.parse(bytes) {
        Ok(httparse::Status::Complete(length)) => length,
        Ok(httparse::Status::Partial) => return Parsed::Part,
        Err(httparse::Error::TooManyHeaders) => return Parsed::Wrong(431),
        Err(_) => return Parsed::Wrong(400),
    };
    let method = match request.method {
        Some("GET") => Method::Get,
        Some("POST") => Method::Post,
        _ => return Parsed::Wrong(405),
    };
    let text = |name: &str| {
        let found: Vec<&str> = request
            .headers
            .iter()
            .filter(|header| header.name.eq_ignore_ascii_case(name))
            .filter_map(|header| std::str::from_utf8(header.value).ok())
            .collect();
        (!found.is_empty()).then(|| found.join("; "))
    };
    let body = text("content-length").is_some_and(|length| length.trim() != "0");
    if body || text("transfer-encoding").is_some() {
        return Parsed::Wrong(413);
    }
    let target = request.path.unwrap_or_default();
    let (path, query) = target.split_once('?').unwrap_or((target, ""));
    let closes = request.version == Some(0) || text("connection").is_some_and(|c| c.eq_ignore_ascii_case("close"));
    let request = Request {
        method,
        path: path.to_owned(),
        query: query.to_owned(),
        host: text("host"),
        origin: text("origin"),
        cookie: text("cookie"),
        closes,
    };
    Parsed::Whole(request, length)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn code(bytes: &[u8]) -> u16 {
        match parse(bytes) {
            Parsed::Whole(..) => 200,
            Parsed::Part => 0,
            Parsed::Wrong(code) => code,
        }
    }

    #[test]
    fn requests_are_read_by_field() {
        let text = b"POST /stop?a=1&v=x HTTP/1.1\r\nhost: localhost:1\r\nOrigin: o\r\nCookie: a=b\r\n\r\nGET";
        let Parsed::Whole(request, length) = parse(text) else { panic!("no request") };
        assert_eq!((request.method, request.path.as_str(), length), (Method::Post, "/stop", text.len() - 3));
        assert_eq!((request.value("v"), request.value("a"), request.value("b")), (Some("x"), Some("1"), None));
        assert_eq!((request.host.as_deref(), request.origin.as_deref()), (Some("localhost:1"), Some("o")));
        assert!(!request.closes);
    }

    #[test]
    fn two_hosts_are_no_host_of_this_machine() {
        let Parsed::Whole(request, _) = parse(b"GET / HTTP/1.1\r\nHost: localhost\r\nHost: evil\r\n\r\n") else {
            panic!("no request")
        };
        assert_eq!(request.host.as_deref(), Some("localhost; evil"));
    }

    #[test]
    fn requests_with_bodies_or_faults_are_refused() {
        assert_eq!(code(b"GET / HTTP/1.1\r\nHost: a\r\n"), 0);
        assert_eq!(code(b"PUT / HTTP/1.1\r\n\r\n"), 405);
        assert_eq!(code(b"\x00\x01\x02\r\n\r\n"), 400);
        assert_eq!(code(b"POST / HTTP/1.1\r\nContent-Length: 5\r\n\r\nhello"), 413);
        assert_eq!(code(b"POST / HTTP/1.1\r\nContent-Length: 0\r\n\r\n"), 200);
        assert_eq!(code(b"POST / HTTP/1.1\r\nTransfer-Encoding: chunked\r\n\r\n"), 413);
        let many = format!("GET / HTTP/1.1\r\n{}\r\n", "a: b\r\n".repeat(MOST_HEADERS + 1));
        assert_eq!(code(many.as_bytes()), 431);
    }
}
