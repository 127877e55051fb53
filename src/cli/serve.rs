//! `greenstage track --serve`: passes the poses of a stage's trackers, or of a script, on by VRPN.
//!
//! In: the newest states of the trackers' sources, or of a script. Out: a VRPN server, one device for every tracker.

use crate::base::diagnostic::notice;
use crate::base::failure::Failure;
use crate::stage::Stage;
use crate::track::device::now_s;
use crate::track::vrpn::address::PORT;
use crate::track::vrpn::{Server, ServerCounters};
use crate::track::{Script, StandIn, TrackerSet};
use std::net::{Ipv4Addr, SocketAddr};
use std::time::Duration;

/// Default address of `--serve`: this machine alone can reach it.
pub const DEFAULT_PLACE: &str = "127.0.0.1:3883";
/// Time between two polls of sources and clients while serving, s.
pub const STEP_S: f64 = 0.001;

/// A running server, and the notices that were given about its clients.
pub struct Service {
    server: Server,
    told: ServerCounters,
    /// The number in the server of each device that was asked for; `None` where an earlier one has its name.
    devices: Vec<Option<usize>>,
}

/// `address:port`, or a port of this machine's own address.
pub fn place(text: &str) -> Result<SocketAddr, String> {
    let own =
        || text.trim_start_matches(':').parse().ok().map(|port: u16| (Ipv4Addr::LOCALHOST, port).into());
    text.parse()
        .ok()
        .or_else(own)
        .ok_or_else(|| format!("an address with its port, as {DEFAULT_PLACE}, or a port"))
}

impl Service {
    /// Listens, and prints the address by which a client names each device.
    pub fn open<'a>(
        place: SocketAddr,
        devices: impl IntoIterator<Item = &'a str>,
    ) -> Result<Service, Failure> {
        let mut names: Vec<&str> = Vec::new();
        let devices = devices.into_iter().map(|name| {
            (!names.contains(&name)).then(|| {
                names.push(name);
                names.len() - 1
            })
        });
        let devices = devices.collect();
        let server = Server::bind(place, names).map_err(|error| {
            let advice = "is another VRPN server running? `--serve ADDRESS:PORT` names another place";
            Failure::wrong(format!("cannot serve at {place}: {error}; {advice}"))
        })?;
        for address in server.addresses() {
            notice!("serving {address}");
        }
        if !server.place.ip().is_loopback() {
            notice!("note: whoever reaches {} can listen; VRPN has no passwords", server.place);
        }
        Ok(Service { server, told: ServerCounters::default(), devices })
    }

    /// Passes on the news of trackers, whose devices were given to [`open`](Service::open) in their order. Returns notices about
    /// clients.
    pub fn pass_on(&mut self, trackers: &mut TrackerSet) -> Vec<String> {
        for (device, state) in self.devices.iter().zip(trackers.devices()) {
            device.iter().for_each(|&device| self.server.publish(device, state));
        }
        self.tick()
    }

    fn tick(&mut self) -> Vec<String> {
        self.server.tick();
        let (now, mut notices) = (self.server.counters, Vec::new());
        if now.clients != self.told.clients {
            notices.push(format!("VRPN clients: {}", now.clients));
        }
        let turned_away = |counters: &ServerCounters| {
            let ServerCounters { refused, slow, malformed, silent, strange_lobs, .. } = *counters;
            refused + slow + malformed + silent + strange_lobs
        };
        // Whoever floods the server with bad connections must not flood the terminal: powers of two are told.
        if turned_away(&now).checked_ilog2() != turned_away(&self.told).checked_ilog2() {
            let ServerCounters { refused, slow, malformed, silent, strange_lobs, .. } = now;
            notices.push(format!(
                "VRPN clients turned away: {refused} too many, {slow} slow, {malformed} malformed, {silent} silent, \
                 {strange_lobs} strange lobs"
            ));
        }
        self.told = now;
        notices
    }
}

/// Serves a script again and again in place of the trackers of `stage`, for `limit_s` or for ever.
pub fn script(
    place: SocketAddr,
    name: &str,
    stage: Stage,
    rate_hz: f64,
    limit_s: Option<f64>,
) -> Result<(), Failure> {
    let script = Script::find(name).map_err(Failure::request)?;
    let mut stand_in = StandIn::new(script, stage, rate_hz);
    let mut service = Service::open(place, stand_in.devices.iter().map(|device| device.name.as_str()))?;
    stand_in.legend().iter().for_each(|line| notice!("  {line}"));
    for left_out in &stand_in.left_out {
        notice!("note: the script moves {left_out}");
    }
    let trackers: Vec<&String> = stand_in.devices.iter().flat_map(|device| &device.trackers).collect();
    if !trackers.is_empty() {
        let here =
            if place.ip().is_unspecified() { "THIS-MACHINE".to_owned() } else { place.ip().to_string() };
        let here = if place.port() == PORT { here } else { format!("{here}:{}", place.port()) };
        let options: Vec<String> = trackers.iter().map(|name| format!("--tracker {name}={here}")).collect();
        notice!("note: track, view and stage-view take the poses from here with {}", options.join(" "));
    }
    let started_s = now_s();
    while limit_s.is_none_or(|limit_s| now_s() - started_s < limit_s) {
        stand_in.take_due();
        for (index, device) in stand_in.devices.iter().enumerate() {
            service.server.publish(index, &device.state);
        }
        service.tick().iter().for_each(|notice| notice!("note: {notice}"));
        std::thread::sleep(Duration::from_secs_f64(STEP_S));
    }
    Ok(())
}

#[cfg(test)]
mod tests;
