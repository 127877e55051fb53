//! Our client and our server talk to each other: by TCP and by lob, poses by TCP and by UDP, through deaths and floods.

use super::lab::{ANY, Peer, SOON, bytes_of, counters_reach, listen, played, serve, wait, wait_greeting};
use greenstage::track::FakeSource;
use greenstage::track::device::{Link, Source};
use greenstage::track::vrpn::payload::{ForceField, MessageKind, Payload};
use greenstage::track::vrpn::{Address, Client, Transport, codec};
use nalgebra::Isometry3;
use std::io::Write;
use std::net::{TcpListener, TcpStream, UdpSocket};

fn pose(x: f64) -> Isometry3<f64> {
    Isometry3::new([x, 1.5, -0.25].into(), [0.1, x, 0.3].into())
}

/// Sensors 0 to 19, a negative one, two buttons and three valuators arrive as they were said, to the last bit.
#[test]
fn everything_arrives_by_every_way() {
    // A whole second and a quarter: as a message has it.
    let measured_s = codec::Header::now(0, 0).time_s().floor() - 3600.0 + 0.25;
    for (transport, udp) in
        [(Transport::Tcp, false), (Transport::Tcp, true), (Transport::Lob, false), (Transport::Lob, true)]
    {
        let source = FakeSource::default();
        source.change(|state| {
            state.take_button(0, false, Some(1.0));
            state.take_button(3, true, Some(1.0));
            state.take_valuator(2, -0.75, None);
        });
        let serving = serve(ANY, &source);
        let mut client = listen(serving.place, udp, transport);
        wait("the device is known", || client.latest().link == Link::Up);
        // Buttons and valuators of before the connection are told to a new client.
        wait("the button is seen", || client.latest().buttons.get(&3).is_some_and(|b| b.value));
        wait("the valuator is seen", || client.latest().valuators.get(&2).is_some_and(|v| v.value == -0.75));
        source.change(|state| state.take_button(0, true, Some(measured_s)));
        wait("the change is seen", || client.latest().buttons[&0].value);
        assert_eq!(client.latest().buttons[&0].measured_s, Some(measured_s));
        // Said again and again, since datagrams may be lost.
        let sensors: Vec<i32> = (-1..20).collect();
        let mut said = 0;
        wait("all sensors are seen", || {
            source.change(|state| {
                for sensor in &sensors {
                    state.take_pose(*sensor, pose(f64::from(*sensor)), Some(measured_s), 1.0);
                }
            });
            said += 1;
            client.latest().sensors.len() == sensors.len()
        });
        for (sensor, reading) in &client.latest().sensors {
            assert!(
                (reading.value.to_homogeneous() - pose(f64::from(*sensor)).to_homogeneous()).amax() < 1e-15
            );
            assert_eq!(reading.measured_s, Some(measured_s));
            assert!(reading.count <= said);
        }
        counters_reach(&serving, "pings came", |counters| counters.pings > 0);
        assert_eq!(serving.counters().datagrams > 0, udp, "{transport:?}");
        let counters = client.latest().counters;
        assert_eq!((counters.malformed, counters.dropped, counters.reconnects), (0, 0, 0));
    }
}

/// An untracked sensor is not sent: it only falls silent.
#[test]
fn a_sensor_that_is_not_seen_falls_silent() {
    let source = FakeSource::default();
    let serving = serve(ANY, &source);
    let mut client = listen(serving.place, false, Transport::Tcp);
    wait("the device is known", || client.latest().link == Link::Up);
    source.change(|state| state.take_pose(0, pose(1.0), None, 1.0));
    wait("the pose is seen", || client.latest().sensors.contains_key(&0));
    source.change(|state| {
        state.take_pose(0, pose(2.0), None, 0.0);
        state.take_pose(1, pose(3.0), None, 1.0);
    });
    wait("the other pose is seen", || client.latest().sensors.contains_key(&1));
    assert_eq!((client.latest().sensors[&0].count, client.latest().sensors[&0].quality), (1, 1.0));
}

#[test]
fn a_server_that_dies_and_comes_back_is_found_again() {
    for transport in [Transport::Tcp, Transport::Lob] {
        let source = FakeSource::default();
        let serving = serve(ANY, &source);
        let place = serving.place;
        let mut client = listen(place, true, transport);
        wait("the device is known", || client.latest().link == Link::Up);
        source.change(|state| state.take_button(0, true, None));
        wait("the button is seen", || client.latest().buttons.contains_key(&0));
        drop(serving);
        wait("the server is missed", || matches!(client.latest().link, Link::Down(_)));
        assert!(!client.latest().buttons[&0].value, "nobody is known to hold it");
        let serving = serve(place, &source);
        wait("it is found again", || client.latest().link == Link::Up);
        wait("it is heard again", || client.latest().buttons[&0].value);
        assert_eq!(client.latest().counters.reconnects, 1);
        drop(client);
        counters_reach(&serving, "the client has gone", |counters| counters.clients == 0);
    }
}

#[test]
fn several_clients_hear_the_same_and_a_slow_one_is_given_up() {
    let source = FakeSource::default();
    let serving = serve(ANY, &source);
    let mut clients: Vec<Client> = (0..3).map(|i| listen(serving.place, i == 0, Transport::Tcp)).collect();
    let mut slow = Peer::new(TcpStream::connect(serving.place).unwrap());
    slow.stream.write_all(&codec::cookie()).unwrap();
    counters_reach(&serving, "all are there", |counters| counters.clients == 4);
    let last_of = |client: &mut Client| client.latest().valuators.get(&127).map(|v| v.value);
    let mut value = 0.0;
    wait("the slow one is given up", || {
        // Valuators go by TCP; the slow one reads none, and the system's own buffers fill.
        for _ in 0..20 {
            value += 1.0;
            source.change(|state| (0..128).for_each(|channel| state.take_valuator(channel, value, None)));
            let deadline = std::time::Instant::now() + std::time::Duration::from_millis(5);
            while std::time::Instant::now() < deadline && last_of(&mut clients[0]) != Some(value) {
                std::thread::yield_now();
            }
        }
        // The others keep up, however long it takes them.
        for client in &mut clients {
            wait("the value is seen", || last_of(client) == Some(value));
        }
        serving.counters().slow == 1
    });
    assert_eq!(serving.counters().clients, 3);
    for client in &mut clients {
        wait("the last value is seen", || last_of(client) == Some(value));
        assert_eq!(client.latest().counters.reconnects, 0);
    }
}

#[test]
fn the_server_takes_no_more_clients_than_it_says_and_no_other_version() {
    let source = FakeSource::default();
    let serving = serve(ANY, &source);
    let cookie = |version: &str| {
        let mut cookie = codec::cookie();
        cookie[11..16].copy_from_slice(version.as_bytes());
        cookie
    };
    for (wrong, malformed) in [("06.10", 1), ("08.00", 2)] {
        let mut peer = Peer::new(TcpStream::connect(serving.place).unwrap());
        peer.stream.write_all(&cookie(wrong)).unwrap();
        counters_reach(&serving, "it is refused", |counters| counters.malformed == malformed);
        assert_eq!(peer.hear_cookie(), codec::cookie());
        while peer.hear().is_some() {}
    }
    // Half a cookie, then nothing; a message of 4 GiB; a name that is none.
    let mut half = TcpStream::connect(serving.place).unwrap();
    half.write_all(&codec::cookie()[..7]).unwrap();
    for (wrong, malformed) in [(&[0xff; 24][..], 3), (&codec_name(b"\0\0\0\x7fWand\0")[..], 4)] {
        let mut peer = TcpStream::connect(serving.place).unwrap();
        peer.write_all(&codec::cookie()).unwrap();
        peer.write_all(wrong).unwrap();
        counters_reach(&serving, "it is refused", |counters| counters.malformed == malformed);
    }
    counters_reach(&serving, "the silent one is given up", |counters| counters.silent == 1);
    let crowd: Vec<TcpStream> = (0..40).map(|_| TcpStream::connect(serving.place).unwrap()).collect();
    for mut stream in crowd.iter() {
        // Those beyond the limit may be closed already.
        let _ = stream.write_all(&codec::cookie());
    }
    counters_reach(&serving, "the crowd is refused", |counters| counters.refused == 24);
    assert_eq!(serving.counters().clients, 16);
    drop(crowd);
    counters_reach(&serving, "the crowd has gone", |counters| counters.clients == 0);
    // Other minor versions are welcome.
    let mut peer = Peer::new(TcpStream::connect(serving.place).unwrap());
    peer.stream.write_all(&cookie("07.30")).unwrap();
    counters_reach(&serving, "it is taken", |counters| counters.clients == 1);
}

fn codec_name(payload: &[u8]) -> Vec<u8> {
    let mut bytes = Vec::new();
    codec::encode(&codec::Header::now(0, codec::SENDER_DESCRIPTION), payload, &mut bytes);
    bytes
}

#[test]
fn a_lob_has_the_server_connect_to_the_asker_alone() {
    let serving = serve(ANY, &FakeSource::default());
    let udp = UdpSocket::bind(ANY).unwrap();
    for lob in [&b"127.0.0.9 5000\0"[..], b"localhost 5000\0", b"127.0.0.1 22\0", b"\0", &[b'1'; 400]] {
        udp.send_to(lob, serving.place).unwrap();
    }
    counters_reach(&serving, "the lobs are refused", |counters| counters.strange_lobs == 5);
    assert_eq!(serving.counters().accepted, 0);
}

/// A place on which a connection is neither taken nor refused, as behind a firewall that is silent: nobody accepts, and the
/// one that may wait for it waits. It is held by what comes with it.
fn silent_place() -> (std::net::SocketAddr, TcpListener, Vec<TcpStream>) {
    let listener = TcpListener::bind(ANY).unwrap();
    let place = listener.local_addr().unwrap();
    // SAFETY: takes numbers alone, and the socket is open.
    assert_eq!(unsafe { libc::listen(std::os::fd::AsRawFd::as_raw_fd(&listener), 0) }, 0);
    let wait = std::time::Duration::from_millis(100);
    let waiting: Vec<TcpStream> =
        (0..8).map_while(|_| TcpStream::connect_timeout(&place, wait).ok()).collect();
    assert!(waiting.len() < 8, "connections are taken");
    (place, listener, waiting)
}

/// Each asks once: one that is turned away is never heard of again.
#[test]
fn lobs_of_clients_that_cannot_be_reached_hold_nobody_up() {
    let serving = serve(ANY, &FakeSource::default());
    let udp = UdpSocket::bind(ANY).unwrap();
    let silent: Vec<_> = (0..6).map(|_| silent_place()).collect();
    let late = TcpListener::bind(ANY).unwrap();
    for _ in 0..3 {
        for (place, ..) in &silent {
            udp.send_to(format!("127.0.0.1 {}\0", place.port()).as_bytes(), serving.place).unwrap();
        }
    }
    let port = late.local_addr().unwrap().port();
    udp.send_to(format!("127.0.0.1 {port}\0").as_bytes(), serving.place).unwrap();
    let mut peer = Peer::accept(&late);
    assert_eq!(peer.hear_cookie(), codec::cookie());
    assert_eq!(serving.counters().refused, 0);
}

#[test]
fn a_peer_that_is_no_server_of_ours_is_told_and_asked_again() {
    for (cookie, reason) in [
        (b"vrpn: ver. 06.10  0\0\0\0\0\0", "06.10"),
        (b"vrpn: ver. 08.00  0\0\0\0\0\0", "08.00"),
        (b"HTTP/1.1 400 Bad Request", "does not speak VRPN"),
    ] {
        let listener = TcpListener::bind(ANY).unwrap();
        let mut client = listen(listener.local_addr().unwrap(), true, Transport::Tcp);
        for attempt in 1..=2 {
            let mut peer = Peer::accept(&listener);
            assert_eq!(peer.hear_cookie(), codec::cookie());
            peer.stream.write_all(cookie).unwrap();
            wait("it is refused", || client.latest().counters.malformed == attempt);
            let Link::Down(said) = &client.latest().link else { panic!("{:?}", client.latest().link) };
            assert!(said.contains(reason), "{said}");
        }
    }
}

#[test]
fn silence_is_a_warning_and_then_the_end() {
    let listener = TcpListener::bind(ANY).unwrap();
    let place = listener.local_addr().unwrap();
    let address =
        Address { device: "Wand".into(), host: place.ip().to_string(), port: place.port(), udp: true };
    let mut client = Client::with_timing(address, Transport::Tcp, SOON);
    let mut peer = None;
    let wand = |peer: &mut Peer| peer.greet("Wand");
    wait_greeting(&listener, &mut peer, wand, "the silence is noted", |_| {
        client.latest().link == Link::Quiet
    });
    wait_greeting(&listener, &mut peer, wand, "a word ends it", |peer| {
        peer.as_mut().unwrap().say(&Payload::Pong);
        client.latest().link == Link::Up
    });
    let is_down = |client: &mut Client, why: [&str; 2]| matches!(&client.latest().link, Link::Down(said) if why.iter().all(|part| said.contains(part)));
    let end = ["says nothing", ""];
    wait_greeting(&listener, &mut peer, wand, "it ends", |_| is_down(&mut client, end));
    // Asked again, it has another device.
    let wrist = |peer: &mut Peer| peer.greet("Wrist");
    let missed = ["has no device Wand", "names Wrist"];
    wait_greeting(&listener, &mut peer, wrist, "the device is missed", |_| is_down(&mut client, missed));
    // VRPN's own server names what it was asked for: without a pong that proves nothing.
    let anybody = |peer: &mut Peer| {
        let _ = peer.stream.write_all(&codec::cookie());
        for name in ["VRPN Control", "Tracker0", "Wand", "Tracker0"] {
            peer.describe(codec::SENDER_DESCRIPTION, name.len() as i32, name);
        }
    };
    let missed = ["has no device Wand", "(it names Tracker0;"];
    wait_greeting(&listener, &mut peer, anybody, "it is missed once more", |_| {
        let link = &client.latest().link;
        assert!(!matches!(link, Link::Up | Link::Quiet), "{link:?}");
        is_down(&mut client, missed)
    });
    // And at last it takes the connection and does not speak at all.
    wait_greeting(
        &listener,
        &mut peer,
        |_| {},
        "the cookie is missed",
        |_| is_down(&mut client, ["no cookie", ""]),
    );
}

/// 20,000 poses as fast as they go, of 1,000 sensors, damaged payloads: what counts is the last word, and the
/// state does not grow.
#[test]
fn a_flood_costs_counters_and_nothing_else() {
    let (listener, mut client, mut peer) = played(true);
    let say = |sensor: i32, x: f64| {
        bytes_of(&Payload::Pose { sensor, position: [x, 0.0, 0.0], quaternion: [0.0, 0.0, 0.0, 1.0] })
    };
    let mut flood = Vec::new();
    for sensor in 0..1000 {
        flood.extend(say(sensor, 1.0));
    }
    flood.extend(bytes_of(&Payload::Pose { sensor: 0, position: [f64::NAN; 3], quaternion: [0.0; 4] }));
    for _ in 0..20 {
        peer.stream.write_all(&flood).unwrap();
    }
    peer.stream.write_all(&say(0, 2.0)).unwrap();
    wait("the last word is heard", || {
        client.latest().sensors.get(&0).is_some_and(|reading| reading.value.translation.x == 2.0)
    });
    let state = client.latest();
    assert_eq!(state.sensors.len(), 256);
    assert_eq!(state.counters.malformed, 20);
    assert_eq!(state.counters.dropped, 20 * (1000 - 256));
    assert_eq!(state.counters.messages, 20 * 1001 + 2);
    assert_eq!(state.link, Link::Up);
    // Half a message is waited for; a length that cannot be ends the connection.
    let half = say(0, 3.0);
    peer.stream.write_all(&half[..50]).unwrap();
    peer.stream.write_all(&half[50..]).unwrap();
    wait("the halves are put together", || client.latest().sensors[&0].value.translation.x == 3.0);
    peer.stream.write_all(&[0xff; 8]).unwrap();
    wait("the frame is lost", || client.latest().counters.malformed == 21);
    let mut peer = Peer::accept(&listener);
    peer.greet("Wand");
    peer.stream.write_all(&say(0, 4.0)).unwrap();
    wait("it is heard again", || client.latest().sensors[&0].value.translation.x == 4.0);
}

#[test]
fn datagrams_of_strangers_are_dropped() {
    let (_listener, mut client, mut peer) = played(true);
    let port = loop {
        let (sender, kind, payload) = peer.hear().unwrap();
        if kind == codec::UDP_DESCRIPTION {
            assert_eq!(payload, b"127.0.0.1\0");
            break sender as u16;
        }
    };
    let pose = bytes_of(&Payload::Pose { sensor: 5, position: [1.0; 3], quaternion: [0.0, 0.0, 0.0, 1.0] });
    let stranger = UdpSocket::bind(("127.0.0.2", 0)).unwrap();
    wait("the stranger is counted", || {
        stranger.send_to(&pose, ("127.0.0.1", port)).unwrap();
        client.latest().counters.packets > 0 && {
            // Published with the next word of the server.
            assert!(peer.say(&Payload::Pong));
            client.latest().counters.dropped > 0
        }
    });
    assert!(client.latest().sensors.is_empty());
    let server = UdpSocket::bind(ANY).unwrap();
    let damaged = &pose[..pose.len() - 8];
    wait("the server's are taken", || {
        server.send_to(&[&pose, damaged].concat(), ("127.0.0.1", port)).unwrap();
        client.latest().sensors.contains_key(&5)
    });
    assert!(client.latest().counters.malformed > 0);
}

#[test]
fn a_force_device_is_told_how_to_push_and_tells_what_it_does() {
    let (_listener, client, mut peer) = played(false);
    let sender = client.force_sender();
    let field = ForceField {
        origin: [0.1, 0.2, 0.3],
        force: [1.0, -2.0, 3.0],
        jacobian: [[-100.0, 0.0, 0.5], [0.0, -200.0, 0.0], [0.5, 0.0, -300.0]],
        radius: 0.05,
    };
    wait("the field is taken", || sender.set(field));
    let (mut device, mut kind, mut fields) = (None, None, Vec::new());
    let mut hear = |peer: &mut Peer| {
        let (sender, number, payload) = peer.hear().unwrap();
        match number {
            codec::SENDER_DESCRIPTION if codec::decode_name(&payload) == Ok("Wand") => device = Some(sender),
            codec::TYPE_DESCRIPTION if codec::decode_name(&payload) == Ok(MessageKind::ForceField.name()) => {
                kind = Some(sender);
            }
            _ if Some(number) == kind && Some(sender) == device => {
                fields.push(Payload::decode(MessageKind::ForceField, &payload).unwrap());
            }
            _ => {}
        }
        fields.clone()
    };
    while hear(&mut peer).is_empty() {}
    // Without a sender nothing is to push.
    drop(sender);
    while hear(&mut peer).len() < 2 {}
    assert_eq!(fields, [Payload::ForceField(field), Payload::ForceField(ForceField::default())]);
    assert_eq!(client.force(), None);
    assert!(peer.say(&Payload::Force([0.5, 0.25, -1.0])));
    wait("the force is heard", || client.force() == Some([0.5, 0.25, -1.0]));
}
