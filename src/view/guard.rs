//! Who may use the page: the token, the names of this machine, and the origin of changes.

use std::net::{IpAddr, SocketAddr, ToSocketAddrs};

use super::Error;

/// Port where none is named.
const PORT: u16 = 8765;

/// Names of this machine for its own programs.
const LOOPBACK: [&str; 3] = ["localhost", "127.0.0.1", "[::1]"];

/// Where a page listens.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Address {
    /// Host as it was named: a name, an IPv4 address, or an IPv6 address in brackets.
    pub host: String,
    /// Port; 0 takes any free one.
    pub port: u16,
    /// Whether the port was named. Another one is taken if a port that was not named is in use.
    pub port_named: bool,
}

impl Default for Address {
    fn default() -> Self {
        Self { host: LOOPBACK[1].to_owned(), port: PORT, port_named: false }
    }
}

impl std::str::FromStr for Address {
    type Err = Error;

    /// `PORT`, `HOST`, `HOST:PORT` or `[IPV6]:PORT`.
    fn from_str(text: &str) -> Result<Self, Error> {
        let wrong = |problem| Error::Address { text: text.to_owned(), problem };
        if let Ok(port) = text.parse() {
            return Ok(Self { port, port_named: true, ..Self::default() });
        }
        let (host, port) = match text.rsplit_once(':') {
            Some((host, port)) if !host.contains(':') || host.ends_with(']') => {
                let port = port.parse().map_err(|_| wrong("the port is no number from 0 to 65535"))?;
                (host, Some(port))
            }
            _ => (text, None),
        };
        let bare = host.trim_start_matches('[').trim_end_matches(']');
        let host = match bare.parse::<IpAddr>() {
            Ok(ip) if ip.is_unspecified() => {
                return Err(wrong("name the address by which the browser reaches this machine, as 192.168.1.5:8765"));
            }
            Ok(IpAddr::V6(ip)) => format!("[{ip}]"),
            Ok(ip) => ip.to_string(),
            Err(_) => bare.to_ascii_lowercase(),
        };
        let named = |c: char| c.is_ascii_alphanumeric() || "-._[]:".contains(c);
        if host.is_empty() || !host.chars().all(named) {
            return Err(wrong("it has the form PORT, HOST or HOST:PORT"));
        }
        Ok(Self { host, port: port.unwrap_or(PORT), port_named: port.is_some() })
    }
}

impl Address {
    /// The socket addresses of the host.
    pub(super) fn sockets(&self, port: u16) -> std::io::Result<Vec<SocketAddr>> {
        let host = self.host.trim_start_matches('[').trim_end_matches(']');
        Ok((host, port).to_socket_addrs()?.collect())
    }

    /// Whether only programs of this machine reach the address.
    pub fn is_loopback(&self) -> bool {
        self.sockets(self.port).is_ok_and(|found| !found.is_empty() && found.iter().all(|at| at.ip().is_loopback()))
    }
}

/// What a request shows of itself.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Shown<'a> {
    /// The header `Host`.
    pub(super) host: Option<&'a str>,
    /// The header `Origin`.
    pub(super) origin: Option<&'a str>,
    /// The headers `Cookie`.
    pub(super) cookie: Option<&'a str>,
    /// The token in the address.
    pub(super) token: Option<&'a str>,
}

/// What a request may do.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Verdict {
    /// Nothing: it came by a foreign name of this machine.
    ForeignHost,
    /// Nothing: it has no token.
    NoToken,
    /// Read.
    Read,
    /// Read and change.
    Change,
}

/// The rules of a server.
pub(super) struct Guard {
    token: String,
    /// The host that the server was told to listen on.
    host: String,
    port: u16,
}

impl Guard {
    /// Rules with a new token: 128 bits of the operating system's randomness.
    pub(super) fn new(host: &str, port: u16) -> Result<Self, Error> {
        let mut bytes = [0_u8; 16];
        getrandom::fill(&mut bytes).map_err(|error| Error::Random(error.to_string()))?;
        let token = bytes.iter().map(|byte| format!("{byte:02x}")).collect();
        Ok(Self { token, host: host.to_owned(), port })
    }

    /// The token.
    pub(super) fn token(&self) -> &str {
        &self.token
    }

    /// Name of the cookie. Browsers keep cookies by host, not by port, so the name has the port.
    fn cookie_name(&self) -> String {
        format!("psrgs_{}", self.port)
    }

    /// The header that gives the browser its cookie.
    pub(super) fn set_cookie(&self) -> String {
        format!("{}={}; HttpOnly; SameSite=Strict; Path=/", self.cookie_name(), self.token)
    }

    /// What a request may do.
    pub(super) fn judge(&self, shown: Shown<'_>) -> Verdict {
        let Some(host) = shown.host.filter(|host| self.knows(host)) else { return Verdict::ForeignHost };
        let name = self.cookie_name();
        let cookie = shown.cookie.into_iter().flat_map(|all| all.split(';')).find_map(|pair| {
            let (key, value) = pair.trim().split_once('=')?;
            (key == name).then_some(value)
        });
        let known = [cookie, shown.token].into_iter().flatten().any(|token| equal(token, &self.token));
        match (known, shown.origin) {
            (false, _) => Verdict::NoToken,
            (true, Some(origin)) if origin.strip_prefix("http://").is_some_and(|o| o.eq_ignore_ascii_case(host)) => {
                Verdict::Change
            }
            (true, _) => Verdict::Read,
        }
    }

    /// Whether a `Host` is a name of this machine, with any port: tunnels change ports.
    fn knows(&self, host: &str) -> bool {
        let name = match host.rsplit_once(':') {
            Some((name, port)) if !port.is_empty() && port.bytes().all(|b| b.is_ascii_digit()) => name,
            _ => host,
        };
        LOOPBACK.iter().any(|known| known.eq_ignore_ascii_case(name)) || self.host.eq_ignore_ascii_case(name)
    }
}

/// Compares in a time that does not depend on where the texts differ.
fn equal(a: &str, b: &str) -> bool {
    a.len() == b.len() && a.bytes().zip(b.bytes()).fold(0, |sum, (x, y)| sum | (x ^ y)) == 0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn addresses_are_ports_hosts_or_both() {
        let read = |text: &str| text.parse::<Address>().map(|a| (a.host, a.port, a.port_named));
        let loopback = "127.0.0.1".to_owned();
        assert_eq!(read("9000").expect("a port"), (loopback, 9000, true));
        assert_eq!(read("Localhost").expect("a host"), ("localhost".to_owned(), PORT, false));
        assert_eq!(read("192.168.1.5:80").expect("both"), ("192.168.1.5".to_owned(), 80, true));
        assert_eq!(read("[::1]:81").expect("IPv6"), ("[::1]".to_owned(), 81, true));
        assert_eq!(read("::1").expect("IPv6"), ("[::1]".to_owned(), PORT, false));
        for text in ["", "0.0.0.0", "[::]:80", "host:port", "host:70000", "a b", "http://host"] {
            assert!(read(text).is_err(), "{text}");
        }
        assert!("localhost".parse::<Address>().expect("a host").is_loopback());
        assert!(!"192.0.2.1".parse::<Address>().expect("an address").is_loopback());
    }

    #[test]
    fn only_token_host_and_origin_together_may_change() {
        let guard = Guard::new("192.168.1.5", 8765).expect("random bytes");
        assert_eq!(guard.token().len(), 32);
        assert_ne!(guard.token(), Guard::new("h", 1).expect("random bytes").token());
        let cookie = format!("other=1; psrgs_8765={}", guard.token());
        let with = |host, origin, cookie, token| guard.judge(Shown { host, origin, cookie, token });
        let (host, good) = (Some("localhost:9999"), Some(cookie.as_str()));
        assert_eq!(with(host, None, good, None), Verdict::Read);
        assert_eq!(with(host, None, None, Some(guard.token())), Verdict::Read);
        assert_eq!(with(host, Some("http://localhost:9999"), good, None), Verdict::Change);
        assert_eq!(with(Some("[::1]:1"), Some("http://[::1]:1"), good, None), Verdict::Change);
        assert_eq!(with(Some("192.168.1.5"), Some("http://192.168.1.5"), good, None), Verdict::Change);
        for origin in ["http://localhost:9998", "https://localhost:9999", "http://evil.example", "null", ""] {
            assert_eq!(with(host, Some(origin), good, None), Verdict::Read, "{origin}");
        }
        for host in [None, Some("evil.example:8765"), Some("localhost.evil.example"), Some("127.0.0.2"), Some("")] {
            assert_eq!(with(host, None, good, None), Verdict::ForeignHost, "{host:?}");
        }
        let wrong = "0".repeat(32);
        let elsewhere = format!("psrgs_8766={}", guard.token());
        for cookie in [None, Some(elsewhere.as_str()), Some(wrong.as_str()), Some("psrgs_8765=")] {
            assert_eq!(with(host, None, cookie, Some(&wrong)), Verdict::NoToken, "{cookie:?}");
        }
    }
}
