//! VRPN's cookies and messages as bytes: how they are framed in a TCP stream and in UDP datagrams.
//!
//! ```text
//! message = length, seconds, microseconds, sender, type, sequence   six big-endian u32, 24 bytes
//!           payload                                                 padded with zeros to a multiple of 8
//! ```
//!
//! `length` counts header and payload without the padding. Each side of a TCP connection first sends a cookie of
//! 24 bytes. No length that a peer states is ever allocated: a stream has one buffer of fixed size.
//!
//! Verified against the recorded stream of a vrpn_server 07.38 (tests/devices/vrpn.rs).

use super::address::LONGEST_NAME;
use std::time::{SystemTime, UNIX_EPOCH};

pub const COOKIE_BYTES: usize = 24;
pub const HEADER_BYTES: usize = 24;
/// The longest payload that is accepted, bytes; a tracker's messages are far shorter.
pub const MOST_PAYLOAD: usize = 64 << 10;
/// The largest datagram that fits an Ethernet frame, bytes.
pub const DATAGRAM_BYTES: usize = 1472;

/// Message types of the protocol itself; those of devices are 0 and above.
pub const SENDER_DESCRIPTION: i32 = -1;
pub const TYPE_DESCRIPTION: i32 = -2;
pub const UDP_DESCRIPTION: i32 = -3;
pub const DISCONNECT: i32 = -5;

const MAGIC: &[u8; 11] = b"vrpn: ver. ";
/// The version that this side speaks.
pub const VERSION: Version = Version { major: 7, minor: 38 };

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Version {
    pub major: u8,
    pub minor: u8,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Header {
    pub seconds: u32,
    pub microseconds: u32,
    /// The device; system messages use this field for other numbers.
    pub sender: i32,
    pub kind: i32,
    pub sequence: u32,
}

/// One message; its payload without the padding.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Message<'a> {
    pub header: Header,
    pub payload: &'a [u8],
}

/// The reason why bytes were refused.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum CodecFault {
    #[error("the peer does not speak VRPN: it began with {0:?}")]
    NoCookie(String),
    #[error("the peer speaks VRPN {0:02}.{1:02}; only 07.xx is understood")]
    Version(u8, u8),
    #[error("a message states {0} bytes; from 24 to 65560 are taken")]
    Length(u32),
    #[error("a datagram ends within a message")]
    Truncated,
    #[error(
        "a name of {0} bytes is not text that ends with NUL, has control characters, or is longer than 100"
    )]
    Name(usize),
    #[error("a message of type {0} has a payload of {1} bytes")]
    Payload(&'static str, usize),
}

/// The cookie of this side: `vrpn: ver. 07.38  0`, where the last digit asks for no logging.
pub fn cookie() -> [u8; COOKIE_BYTES] {
    let mut cookie = [0; COOKIE_BYTES];
    let text = format!("vrpn: ver. {:02}.{:02}  0", VERSION.major, VERSION.minor);
    cookie[..text.len()].copy_from_slice(text.as_bytes());
    cookie
}

/// The peer's version; 07 with any minor version is accepted.
pub fn parse_cookie(cookie: &[u8; COOKIE_BYTES]) -> Result<Version, CodecFault> {
    let no_cookie = || CodecFault::NoCookie(String::from_utf8_lossy(&cookie[..16]).into_owned());
    let [a, b, b'.', c, d] = cookie[MAGIC.len()..16] else { return Err(no_cookie()) };
    if !cookie.starts_with(MAGIC) || ![a, b, c, d].iter().all(u8::is_ascii_digit) {
        return Err(no_cookie());
    }
    let number = |tens: u8, ones: u8| 10 * (tens - b'0') + (ones - b'0');
    let version = Version { major: number(a, b), minor: number(c, d) };
    if version.major != VERSION.major {
        return Err(CodecFault::Version(version.major, version.minor));
    }
    Ok(version)
}

impl Header {
    /// A header with the time of day.
    pub fn now(sender: i32, kind: i32) -> Header {
        let since = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
        Header {
            seconds: since.as_secs() as u32,
            microseconds: since.subsec_micros(),
            sender,
            kind,
            sequence: 0,
        }
    }

    /// The time that the header states, s.
    pub fn time_s(&self) -> f64 {
        f64::from(self.seconds) + 1e-6 * f64::from(self.microseconds)
    }

    /// Sets the time to `time_s`, to the microsecond; a negative one to 0.
    pub fn at(self, time_s: f64) -> Header {
        let microseconds = (1e6 * time_s).round() as u64;
        Header {
            seconds: (microseconds / 1_000_000) as u32,
            microseconds: (microseconds % 1_000_000) as u32,
            ..self
        }
    }
}

pub fn encode(header: &Header, payload: &[u8], out: &mut Vec<u8>) {
    debug_assert!(payload.len() <= MOST_PAYLOAD);
    let Header { seconds, microseconds, sender, kind, sequence } = *header;
    let length = (HEADER_BYTES + payload.len()) as u32;
    for word in [length, seconds, microseconds, sender as u32, kind as u32, sequence] {
        out.extend(word.to_be_bytes());
    }
    out.extend(payload);
    out.resize(out.len() + payload.len().next_multiple_of(8) - payload.len(), 0);
}

/// The first message of `bytes` and how many bytes it takes with its padding; `None`: it is not complete yet.
pub fn decode(bytes: &[u8]) -> Result<Option<(Message<'_>, usize)>, CodecFault> {
    let word = |at: usize| -> Option<u32> { Some(u32::from_be_bytes(*bytes.get(4 * at..)?.first_chunk()?)) };
    let Some(length) = word(0) else { return Ok(None) };
    let taken = length as usize;
    if !(HEADER_BYTES..=HEADER_BYTES + MOST_PAYLOAD).contains(&taken) {
        return Err(CodecFault::Length(length));
    }
    let padded = taken.next_multiple_of(8);
    let (Some(seconds), Some(microseconds), Some(sender), Some(kind), Some(sequence)) =
        (word(1), word(2), word(3), word(4), word(5))
    else {
        return Ok(None);
    };
    if bytes.len() < padded {
        return Ok(None);
    }
    let header = Header { seconds, microseconds, sender: sender as i32, kind: kind as i32, sequence };
    Ok(Some((Message { header, payload: &bytes[HEADER_BYTES..taken] }, padded)))
}

/// The messages of a datagram, up to the first that is not whole.
pub fn datagram(bytes: &[u8]) -> impl Iterator<Item = Result<Message<'_>, CodecFault>> {
    let mut rest = bytes;
    std::iter::from_fn(move || {
        if rest.is_empty() {
            return None;
        }
        match decode(rest) {
            Ok(Some((message, taken))) => {
                rest = &rest[taken..];
                Some(Ok(message))
            }
            other => {
                rest = &[];
                Some(Err(other.err().unwrap_or(CodecFault::Truncated)))
            }
        }
    })
}

/// The payload of a description: the name's length with its NUL, the name, NUL.
pub fn encode_name(name: &str) -> Vec<u8> {
    let mut payload = (name.len() as u32 + 1).to_be_bytes().to_vec();
    payload.extend(name.as_bytes());
    payload.push(0);
    payload
}

/// The name in the payload of a description.
pub fn decode_name(payload: &[u8]) -> Result<&str, CodecFault> {
    let fault = CodecFault::Name(payload.len());
    let Some((length, name)) = payload.split_first_chunk() else { return Err(fault) };
    let Some((0, name)) = name.split_last().map(|(nul, name)| (*nul, name)) else { return Err(fault) };
    if name.len() > LONGEST_NAME
        || u32::from_be_bytes(*length) as usize != name.len() + 1
        || name.contains(&0)
    {
        return Err(fault);
    }
    match std::str::from_utf8(name) {
        // Names end up in messages on a terminal, so they must not contain control characters.
        Ok(name) if !name.chars().any(char::is_control) => Ok(name),
        _ => Err(fault),
    }
}

/// Collects a stream's bytes into whole messages, in one buffer of twice the longest message, allocated at the first write.
#[derive(Default)]
pub struct Framer {
    buffer: Box<[u8]>,
    first: usize,
    end: usize,
}

impl Framer {
    /// The buffer for the next bytes; never empty after [`message`](Framer::message) returned `None`.
    pub fn space(&mut self) -> &mut [u8] {
        if self.buffer.is_empty() {
            self.buffer = vec![0; 2 * (HEADER_BYTES + MOST_PAYLOAD)].into();
        }
        if self.first > 0 {
            self.buffer.copy_within(self.first..self.end, 0);
            self.end -= self.first;
            self.first = 0;
        }
        &mut self.buffer[self.end..]
    }

    /// Takes note that `bytes` bytes were written into [`space`](Framer::space).
    pub fn wrote(&mut self, bytes: usize) {
        self.end = (self.end + bytes).min(self.buffer.len());
    }

    /// Takes the cookie, once it is there.
    pub fn cookie(&mut self) -> Option<[u8; COOKIE_BYTES]> {
        let cookie = *self.buffer[self.first..self.end].first_chunk()?;
        self.first += COOKIE_BYTES;
        Some(cookie)
    }

    /// The next whole message. After an error the stream is out of step and cannot be used any more.
    pub fn message(&mut self) -> Result<Option<Message<'_>>, CodecFault> {
        let Some((message, taken)) = decode(&self.buffer[self.first..self.end])? else { return Ok(None) };
        self.first += taken;
        Ok(Some(message))
    }
}
