//! Every parser of packets with good packets of its kind; each keeps its state from packet to packet.

use greenstage::effect::haptics::haply_messages;
use greenstage::stage::GripButton;
use greenstage::track::device::DeviceState;
use greenstage::track::dtrack::Dtrack;
use greenstage::track::fastrak::Lines;
use greenstage::track::gamepad;
use greenstage::track::osc::{EulerOrder, Osc};
use greenstage::track::udp::Parser;
use greenstage::track::vrpn::address::{Address, decode_lob};
use greenstage::track::vrpn::codec::{self, Framer, Header};
use greenstage::track::vrpn::listener::Listener;
use greenstage::track::vrpn::payload::{ForceField, MessageKind, Payload, Rate};
use greenstage::track::vrpn::peer::Protocol;

const BUTTONS: [GripButton; 2] = [GripButton::A, GripButton::B];

/// Takes a packet; whether something of it was used, and how many channels are kept now.
type Hear = Box<dyn FnMut(&[u8]) -> (bool, usize)>;

pub struct PacketParser {
    pub name: &'static str,
    pub seeds: Vec<Vec<u8>>,
    pub hear: Hear,
}

pub fn parsers() -> Vec<PacketParser> {
    vec![
        vrpn_stream(),
        vrpn_datagrams(),
        vrpn_server(),
        vrpn_lob(),
        dtrack(),
        osc(),
        fastrak(),
        gamepad(),
        haply(),
    ]
}

/// Approximate length of a seed for which floods are measured.
const LONG: usize = 16 << 10;

/// `item(0)`, `item(1)`, … up to [`LONG`].
fn many(start: &[u8], item: impl Fn(usize) -> Vec<u8>) -> Vec<u8> {
    let mut bytes = start.to_vec();
    for i in 0.. {
        let next = item(i);
        if bytes.len() + next.len() > LONG {
            break;
        }
        bytes.extend(next);
    }
    bytes
}

fn pose_of(sensor: i32) -> Payload {
    Payload::Pose { sensor, position: [1.0, -2.0, 0.5], quaternion: [0.0, 0.6, 0.0, 0.8] }
}

fn channels(state: &DeviceState) -> usize {
    state.sensors.len() + state.buttons.len() + state.valuators.len()
}

/// One payload of every kind.
fn payloads() -> Vec<Payload> {
    let quaternion = [0.0, 0.6, 0.0, 0.8];
    let rate = Rate { sensor: 1, vector: [0.1, 0.2, 0.3], quaternion, dt: 0.01 };
    vec![
        pose_of(0),
        pose_of(3),
        Payload::Velocity(rate),
        Payload::Acceleration(rate),
        Payload::ButtonChange { button: 2, state: 1 },
        Payload::ButtonStates(vec![0, 1, 1, 0]),
        Payload::Analog(vec![0.25, -1.0]),
        Payload::Ping,
        Payload::Pong,
        Payload::Force([1.0, 2.0, 3.0]),
        Payload::ContactPoint { position: [0.0; 3], quaternion },
        Payload::ForceError(7),
        Payload::ForceField(ForceField { radius: 0.1, ..Default::default() }),
    ]
}

/// Device 0 is `Wand`; the types are numbered as in [`MessageKind::ALL`].
fn descriptions() -> Vec<u8> {
    let mut bytes = Vec::new();
    codec::encode(&Header::default(), &codec::encode_name("Wand"), &mut bytes);
    bytes[16..20].copy_from_slice(&codec::SENDER_DESCRIPTION.to_be_bytes());
    for (kind, name) in MessageKind::ALL {
        let header = Header { sender: kind as i32, kind: codec::TYPE_DESCRIPTION, ..Header::default() };
        codec::encode(&header, &codec::encode_name(name), &mut bytes);
    }
    bytes
}

fn message(payload: &Payload) -> Vec<u8> {
    let mut bytes = Vec::new();
    let header = Header { seconds: 1_700_000_000, kind: payload.kind() as i32, ..Header::default() };
    codec::encode(&header, &payload.encode(), &mut bytes);
    bytes
}

fn messages() -> Vec<Vec<u8>> {
    payloads().iter().map(message).collect()
}

/// A connection for every packet, to one listener: cookie, descriptions, readings, in two pieces.
fn vrpn_stream() -> PacketParser {
    let start = [codec::cookie().to_vec(), descriptions()].concat();
    let mut seeds = vec![[start.clone(), messages().concat()].concat()];
    seeds.extend(messages().iter().map(|message| [start.clone(), message.clone()].concat()));
    seeds.push(many(&start, |i| message(&pose_of(i as i32))));
    let long = Header { kind: 99, ..Header::default() };
    let mut skipped = start.clone();
    codec::encode(&long, &vec![7; codec::MOST_PAYLOAD], &mut skipped);
    seeds.push([skipped, message(&pose_of(5))].concat());
    let mut listener = Listener::new("Wand");
    let hear = move |bytes: &[u8]| {
        listener.connected();
        let before = listener.state.counters.messages;
        let mut framer = Framer::default();
        let mut is_greeted = false;
        let (first, second) = bytes.split_at(bytes.len() / 2);
        'pieces: for piece in first.chunks(8192).chain(second.chunks(8192)) {
            framer.space()[..piece.len()].copy_from_slice(piece);
            framer.wrote(piece.len());
            if !is_greeted {
                match framer.cookie().map(|cookie| codec::parse_cookie(&cookie)) {
                    None => continue,
                    Some(Ok(_)) => is_greeted = true,
                    Some(Err(_)) => break,
                }
            }
            loop {
                match framer.message() {
                    Ok(Some(message)) if listener.take(&message) => {}
                    Ok(None) => break,
                    _ => break 'pieces,
                }
            }
        }
        (
            listener.state.counters.messages > before,
            channels(&listener.state) + listener.why_missing(3.0).len() / 1000,
        )
    };
    PacketParser { name: "VRPN stream", seeds, hear: Box::new(hear) }
}

fn vrpn_datagrams() -> PacketParser {
    let mut seeds = messages();
    seeds.push(messages().concat());
    seeds.push(many(&[], |i| message(&pose_of(i as i32 % 300))));
    let mut listener = Listener::new("Wand");
    let descriptions = descriptions();
    for described in codec::datagram(&descriptions) {
        assert!(listener.take(&described.unwrap()));
    }
    let hear = move |bytes: &[u8]| {
        let before = listener.state.counters.messages;
        listener.take_datagram(bytes);
        (listener.state.counters.messages > before, channels(&listener.state))
    };
    PacketParser { name: "VRPN datagrams", seeds, hear: Box::new(hear) }
}

/// Bytes from a client to our server: a new client for every packet.
fn vrpn_server() -> PacketParser {
    let mut udp = Vec::new();
    let header = Header { sender: 40_000, kind: codec::UDP_DESCRIPTION, ..Header::default() };
    codec::encode(&header, b"127.0.0.1\0", &mut udp);
    let start = [codec::cookie().to_vec(), udp, descriptions()].concat();
    let ping = message(&Payload::Ping);
    let seeds = vec![[start.clone(), ping.repeat(50)].concat(), [start, messages().concat()].concat()];
    let devices = ["Wand".to_owned(), "Other".to_owned()];
    let hear = move |bytes: &[u8]| {
        let mut protocol = Protocol::new(&devices);
        let mut pings = 0;
        for piece in bytes.chunks(1000) {
            protocol.space()[..piece.len()].copy_from_slice(piece);
            match protocol.hear(piece.len(), &devices) {
                Ok(answered) => pings += answered,
                Err(_) => break,
            }
        }
        assert!(protocol.waiting.len() < 2048 + 2 * bytes.len(), "{} bytes wait", protocol.waiting.len());
        (pings > 0, 0)
    };
    PacketParser { name: "VRPN server", seeds, hear: Box::new(hear) }
}

fn vrpn_lob() -> PacketParser {
    let seeds = [&b"127.0.0.1 51234\0"[..], b"Tracker0@192.168.1.5:3883", b"tcp://host:4000/Wand"];
    let asker = [127, 0, 0, 1].into();
    let hear = move |bytes: &[u8]| {
        let name = String::from_utf8_lossy(bytes);
        (decode_lob(bytes, asker).is_some() || Address::parse(&name).is_ok(), 0)
    };
    PacketParser {
        name: "VRPN lob and names",
        seeds: seeds.map(<[u8]>::to_vec).to_vec(),
        hear: Box::new(hear),
    }
}

/// A parser of datagrams; its clock goes back now and then, as a controller's that begins anew.
fn datagrams(name: &'static str, seeds: Vec<Vec<u8>>, mut parser: impl Parser) -> PacketParser {
    let mut state = DeviceState::default();
    let hear = move |bytes: &[u8]| (parser.parse(bytes, &mut state), channels(&state));
    PacketParser { name, seeds, hear: Box::new(hear) }
}

fn dtrack() -> PacketParser {
    let body = "[0 1.000][100.0 -200.0 50.5 90.0 0.0 0.0][1.0 0.0 0.0 0.0 0.0 1.0 0.0 -1.0 0.0]";
    let unseen = "[3 -1.000][0.0 0.0 0.0 0.0 0.0 0.0][0.0 0.0 0.0 0.0 0.0 0.0 0.0 0.0 0.0]";
    let stick = "[0 1.000 8 2][1.0 2.0 3.0][1.0 0.0 0.0 0.0 1.0 0.0 0.0 0.0 1.0][5 0.25 -0.50]";
    let turned = "1.0 0.0 0.0 0.0 0.0 1.0 0.0 -1.0 0.0";
    let bodies: Vec<String> =
        (0..170).map(|id| format!("[{id} 1.000][100.0 -200.0 50.5 90.0 0.0 0.0][{turned}]")).collect();
    let seeds = [
        format!("fr 12\r\n6d {} {}\r\n", bodies.len(), bodies.join(" ")),
        format!("fr 10\r\nts 44597.741924\r\n6dcal 2\r\n6d 2 {body} {unseen}\r\n"),
        format!("fr 11\r\nts2 1700000000 123456 4000\r\n6df2 1 1 {stick}\r\n6d 0 \r\n"),
        format!("6d 1 {body}\r\n3d 2 [1 1.000][1.0 2.0 3.0] [2 1.000][4.0 5.0 6.0]\r\n6dj 0\r\ngl 0\r\n"),
        "6df 1 [0 1.000 3][1.0 2.0 3.0 0.0 0.0 0.0][1.0 0.0 0.0 0.0 1.0 0.0 0.0 0.0 1.0]\r\n".to_owned(),
    ];
    datagrams("DTrack", seeds.map(String::into_bytes).to_vec(), Dtrack::default())
}

/// An address and its floats, padded as OSC 1.0 has it.
fn osc_message(address: &str, floats: &[f32]) -> Vec<u8> {
    let padded = |text: &str| {
        let mut bytes = text.as_bytes().to_vec();
        bytes.resize(text.len() / 4 * 4 + 4, 0);
        bytes
    };
    let mut bytes = [padded(address), padded(&format!(",{}", "f".repeat(floats.len())))].concat();
    floats.iter().for_each(|float| bytes.extend(float.to_be_bytes()));
    bytes
}

fn osc() -> PacketParser {
    let place = osc_message("/tracking/trackers/1/position", &[0.5, 1.5, -0.25]);
    let turn = osc_message("/tracking/trackers/head/rotation", &[10.0, 20.0, 30.0]);
    let mut bundle = b"#bundle\0\0\0\0\0\0\0\0\x01".to_vec();
    for message in [&place, &turn] {
        bundle.extend((message.len() as u32).to_be_bytes());
        bundle.extend(message);
    }
    let mut nested = b"#bundle\0\0\0\0\0\0\0\0\x01".to_vec();
    nested.extend((bundle.len() as u32).to_be_bytes());
    nested.extend(&bundle);
    let crowd = many(b"#bundle\0\0\0\0\0\0\0\0\x01", |_| {
        [(place.len() as u32).to_be_bytes().to_vec(), place.clone()].concat()
    });
    let fits = [&crowd[..16], &crowd[16..16 + (4000 / (place.len() + 4)) * (place.len() + 4)]].concat();
    datagrams("OSC", vec![place, turn, bundle, nested, crowd, fits], Osc::new(EulerOrder::Yxz))
}

fn fastrak() -> PacketParser {
    let line = b"01   1.000  -2.000   3.500  1.00000 0.00000 0.00000 0.00000 1\r\n";
    let crowd = many(&[], |_| line.to_vec());
    let seeds = [
        &line[..],
        &crowd,
        b"02 100.000 200.000 -30.000  0.00000 0.60000 0.00000 0.80000 0\r\n012  1.0 2.0 3.0 1.0 0.0 0.0 0.0 0\r\n",
    ];
    let (mut lines, mut state) = (Lines::default(), DeviceState::default());
    let hear = move |bytes: &[u8]| (lines.take(bytes, &mut state), channels(&state));
    PacketParser { name: "FASTRAK", seeds: seeds.map(<[u8]>::to_vec).to_vec(), hear: Box::new(hear) }
}

fn gamepad() -> PacketParser {
    let seeds = [[0, 1, 0, 0, 1, 0, 1, 3], [0, 1, 0, 0, 0xff, 0x7f, 2, 0], [0, 0, 0, 0, 0, 0x80, 0x82, 1]];
    let mut state = DeviceState::default();
    let hear = move |bytes: &[u8]| {
        let records = bytes.as_chunks().0;
        records.iter().for_each(|record| gamepad::take(*record, &mut state));
        (!records.is_empty(), channels(&state))
    };
    PacketParser { name: "gamepad", seeds: seeds.map(|seed| seed.to_vec()).to_vec(), hear: Box::new(hear) }
}

/// Messages of the service of a force-feedback arm by WebSocket.
fn haply() -> PacketParser {
    let arm = r#"{"inverse3":[{"device_id":"0A1B","config":{"handedness":"right"},"state":{"cursor_position":{"x":0.01,"y":-0.12,"z":0.2}}}]}"#;
    let grip = r#"{"inverse3":[{"device_id":"0A1B"}],"wireless_verse_grip":[{"device_id":"77","state":{"orientation":{"x":0.0,"y":0.6,"z":0.0,"w":0.8},"buttons":{"a":true,"b":false}}}]}"#;
    let hear =
        |bytes: &[u8]| (haply_messages::parse(&String::from_utf8_lossy(bytes), 0.0, BUTTONS).is_ok(), 0);
    PacketParser { name: "Haply", seeds: vec![arm.into(), grip.into()], hear: Box::new(hear) }
}
