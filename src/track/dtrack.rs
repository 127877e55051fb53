//! ART DTrack: frames of text lines, one frame per UDP datagram, usually to port 5000.
//!
//! In: `6d`, `6di` (bodies), `6df2`, `6df` (flysticks), `3d` (markers) with `fr`, `ts`, `ts2`; other lines are
//! ignored. Out: poses in metres (the protocol has millimetres) with their time of measurement: `ts2` gives the time of
//! day with its date, `ts` only the seconds since midnight (UTC). A frame that arrives after a newer one is dropped.
//!
//! | of DTrack | number of the sensor | buttons | valuators |
//! |---|---|---|---|
//! | body b | b | | |
//! | flystick f | 1000 + f | 32 f + bit | 16 f + axis |
//! | marker m, m < 100 | 2000 + m | | |

use super::device::DeviceState;
use super::listen::Listen;
use super::source_entry::{ANY, SourceEntry, SourceSettings, keys};
use super::udp::{Parser, settings};
use nalgebra::{Isometry3, Matrix3, Rotation3, Translation3, UnitQuaternion, Vector3};
use std::net::Ipv4Addr;
use std::time::{SystemTime, UNIX_EPOCH};

const FLYSTICK: i32 = 1000;
const MARKER: i32 = 2000;
/// DTrack numbers markers without end; higher numbers would fill all channels.
const MOST_MARKERS: f64 = 100.0;
const MOST_BUTTONS: usize = 32;
const MOST_AXES: usize = 16;
/// A frame whose number is below the last one's by at most this is late; by more, the controller has restarted.
const LATE: i64 = 16;
/// Number of late frames in order, or with the same number, after which the controller has restarted as well.
const IN_ORDER: u32 = 3;
/// The largest entry of RᵀR - I that rounding to six digits can cause.
const MOST_SKEW: f64 = 0.01;
const METRES: f64 = 1e-3;
const DAY_S: f64 = 86_400.0;
/// A date once found is kept as long as the time differs from our own by less than this, s: the controller's clock may
/// be in another time zone.
const OTHER_DAY_S: f64 = 0.75 * DAY_S;

pub const SOURCE: SourceEntry =
    SourceEntry { key: "dtrack", more_keys: &["interface"], sensors: ANY, has_buttons: true, read };

#[derive(serde::Deserialize)]
#[serde(deny_unknown_fields)]
struct Keys {
    dtrack: String,
    interface: Option<Ipv4Addr>,
}

fn read(tracker: &str, table: &toml::Table) -> Result<SourceSettings, String> {
    let Keys { dtrack, interface } = keys(tracker, table)?;
    let place = Listen::parse(tracker, "dtrack", &dtrack, interface)?;
    Ok(settings("dtrack", place, Dtrack::default()))
}

/// The state between frames.
#[derive(Clone, Copy, Debug, Default)]
pub struct Dtrack {
    last_frame: Option<i64>,
    /// The last late frame, and how many have come in order.
    late: Option<(i64, u32)>,
    /// The last time of measurement, s since 1970.
    last_s: Option<f64>,
}

impl Parser for Dtrack {
    fn parse(&mut self, datagram: &[u8], state: &mut DeviceState) -> bool {
        let Ok(text) = std::str::from_utf8(datagram) else { return false };
        let lines = || text.split(['\r', '\n', '\0']).filter_map(|line| line.trim().split_once(' '));
        let first = |name: &str| lines().find(|(key, _)| *key == name).map(|(_, rest)| rest);
        if let Some(frame) = first("fr").and_then(|rest| rest.trim().parse::<i64>().ok()) {
            if self.is_late(frame) {
                state.counters.dropped += 1;
                return true;
            }
            self.last_frame = Some(frame);
        }
        let measured_s = first("ts2").and_then(seconds_of_ts2).or_else(|| {
            let now = SystemTime::now().duration_since(UNIX_EPOCH).ok()?.as_secs_f64();
            Some(self.dated(first("ts").and_then(number)?, now))
        });
        let (mut read, mut bad) = (0_u64, 0_u64);
        for (key, rest) in lines() {
            let items = match key {
                "6d" => items(rest, 1, 3, |item| body(item, 6, state, measured_s)),
                "6di" => items(rest, 1, 3, |item| inertial(item, state, measured_s)),
                "6df2" => items(rest, 2, 4, |item| flystick2(item, state, measured_s)),
                "6df" => items(rest, 1, 3, |item| flystick(item, state, measured_s)),
                "3d" => items(rest, 1, 2, |item| marker(item, state, measured_s)),
                "fr" | "ts" | "ts2" | "6dcal" | "6dj" | "gl" | "glcal" | "6dmt" | "6dmt2" => Some(0),
                _ => continue,
            };
            match items {
                Some(count) => read += 1 + count,
                None => bad += 1,
            }
        }
        state.counters.messages += read;
        // The listener counts frames in which nothing could be read.
        state.counters.malformed += if read > 0 { bad } else { bad.saturating_sub(1) };
        read > 0
    }
}

impl Dtrack {
    /// Seconds since 1970 for a time given as seconds since midnight: on the day of the previous time, or on the next day
    /// if midnight has passed. For the first time it is the day that brings it nearest to `now_s`.
    fn dated(&mut self, since_midnight_s: f64, now_s: f64) -> f64 {
        let nearest_to =
            |time_s: f64| since_midnight_s + DAY_S * ((time_s - since_midnight_s) / DAY_S).round();
        let follows = self.last_s.map(nearest_to).filter(|time_s| (time_s - now_s).abs() < OTHER_DAY_S);
        let time_s = follows.unwrap_or_else(|| nearest_to(now_s));
        self.last_s = Some(time_s);
        time_s
    }

    fn is_late(&mut self, frame: i64) -> bool {
        let is_late = |last: i64| frame <= last && last.saturating_sub(frame) <= LATE;
        if !self.last_frame.is_some_and(is_late) {
            self.late = None;
            return false;
        }
        let count = match self.late {
            Some((before, count)) if before <= frame => count.saturating_add(1),
            _ => 1,
        };
        self.late = Some((frame, count));
        count < IN_ORDER
    }
}

/// Calls `take` for every item of a line. The line starts with `counts` numbers, of which the last is the number of items;
/// each item is a fixed number of groups in brackets. Returns the number of items, or `None` if the line is malformed.
fn items(
    rest: &str,
    counts: usize,
    groups_each: usize,
    mut take: impl FnMut(&[Vec<f64>]) -> Option<()>,
) -> Option<u64> {
    let (head, tail) = rest.split_at(rest.find('[').unwrap_or(rest.len()));
    let head: Vec<f64> = head.split_whitespace().map(number).collect::<Option<_>>()?;
    if head.len() != counts {
        return None;
    }
    let mut groups = Vec::new();
    let mut left = tail.trim();
    while let Some(inside) = left.strip_prefix('[') {
        let (group, after) = inside.split_once(']')?;
        groups.push(group.split_whitespace().map(number).collect::<Option<Vec<f64>>>()?);
        left = after.trim_start();
    }
    let is_whole = left.is_empty() && groups.len() as f64 == head[counts - 1] * groups_each as f64;
    if !is_whole {
        return None;
    }
    let mut count = 0;
    for item in groups.chunks_exact(groups_each) {
        take(item)?;
        count += 1;
    }
    Some(count)
}

/// `[id q][x y z (angles)][b0 … b8]`; with -1 ≤ q < 0 the body is not tracked, and its matrix is zero.
fn body(item: &[Vec<f64>], places: usize, state: &mut DeviceState, measured_s: Option<f64>) -> Option<()> {
    let [head, place, matrix] = item else { return None };
    let [id, quality] = head[..] else { return None };
    let id = whole(id, f64::from(FLYSTICK))?;
    take(state, id, quality, place.get(..3).filter(|_| place.len() == places)?, matrix, measured_s)
}

/// `[id state error][x y z][b0 … b8]`; state 0 is not tracked.
fn inertial(item: &[Vec<f64>], state: &mut DeviceState, measured_s: Option<f64>) -> Option<()> {
    let [head, place, matrix] = item else { return None };
    let [id, tracked, _error] = head[..] else { return None };
    let quality = if tracked > 0.0 { 1.0 } else { -1.0 };
    take(state, whole(id, f64::from(FLYSTICK))?, quality, place, matrix, measured_s)
}

/// `[id q buttons joysticks][x y z][b0 … b8][an int per 32 buttons … joysticks …]`.
fn flystick2(item: &[Vec<f64>], state: &mut DeviceState, measured_s: Option<f64>) -> Option<()> {
    let [head, place, matrix, inputs] = item else { return None };
    let [id, quality, buttons, axes] = head[..] else { return None };
    let id = whole(id, f64::from(FLYSTICK))?;
    let (buttons, axes) = (whole(buttons, 1024.0)? as usize, whole(axes, 1024.0)? as usize);
    let words = buttons.div_ceil(32);
    if inputs.len() != words + axes {
        return None;
    }
    take(state, FLYSTICK + id, quality, place, matrix, measured_s)?;
    if buttons > 0 {
        press(state, id, buttons, inputs[0], measured_s)?;
    }
    for (axis, value) in inputs[words..].iter().take(MOST_AXES).enumerate() {
        state.take_valuator(MOST_AXES as i32 * id + axis as i32, *value, measured_s);
    }
    Some(())
}

/// `[id q buttons][x y z η θ φ][b0 … b8]`, of older versions; eight buttons.
fn flystick(item: &[Vec<f64>], state: &mut DeviceState, measured_s: Option<f64>) -> Option<()> {
    let [head, place, matrix] = item else { return None };
    let [id, quality, buttons] = head[..] else { return None };
    let id = whole(id, f64::from(FLYSTICK))?;
    take(state, FLYSTICK + id, quality, place.get(..3).filter(|_| place.len() == 6)?, matrix, measured_s)?;
    press(state, id, 8, buttons, measured_s)
}

/// `[id q][x y z]`: a place without an orientation.
fn marker(item: &[Vec<f64>], state: &mut DeviceState, measured_s: Option<f64>) -> Option<()> {
    let [head, place] = item else { return None };
    let ([id, quality], [x, y, z]) = (&head[..], &place[..]) else { return None };
    let id = whole(*id, f64::from(i32::MAX))?;
    if f64::from(id) < MOST_MARKERS {
        let pose = Isometry3::translation(x * METRES, y * METRES, z * METRES);
        state.take_pose(MARKER + id, pose, measured_s, if *quality < 0.0 { 0.0 } else { 1.0 });
    } else {
        state.counters.dropped += 1;
    }
    Some(())
}

fn press(state: &mut DeviceState, id: i32, buttons: usize, bits: f64, measured_s: Option<f64>) -> Option<()> {
    // 32 bits, written as a signed or an unsigned number.
    if bits.fract() != 0.0 || !(f64::from(i32::MIN)..=f64::from(u32::MAX)).contains(&bits) {
        return None;
    }
    let bits = bits as i64;
    for bit in 0..buttons.min(MOST_BUTTONS) {
        let number = id * MOST_BUTTONS as i32 + bit as i32;
        state.take_button(number, bits >> bit & 1 == 1, measured_s);
    }
    Some(())
}

fn take(
    state: &mut DeviceState,
    sensor: i32,
    quality: f64,
    place: &[f64],
    columns: &[f64],
    measured_s: Option<f64>,
) -> Option<()> {
    let ([x, y, z], 9) = (place, columns.len()) else { return None };
    if quality < 0.0 {
        state.take_pose(sensor, Isometry3::identity(), measured_s, 0.0);
        return Some(());
    }
    let matrix = Matrix3::from_column_slice(columns);
    let skew = (matrix.transpose() * matrix - Matrix3::identity()).amax();
    if skew > MOST_SKEW || matrix.determinant() < 0.0 {
        return None;
    }
    let rotation = Rotation3::from_matrix_unchecked(matrix);
    let place = Translation3::from(Vector3::new(*x, *y, *z) * METRES);
    let pose = Isometry3::from_parts(place, UnitQuaternion::from_rotation_matrix(&rotation));
    state.take_pose(sensor, pose, measured_s, 1.0);
    Some(())
}

/// `sec usec latency`: the time of measurement, s.
fn seconds_of_ts2(rest: &str) -> Option<f64> {
    let mut numbers = rest.split_whitespace().map(number);
    let (seconds, microseconds) = (numbers.next()??, numbers.next()??);
    Some(seconds + 1e-6 * microseconds)
}

fn number(word: &str) -> Option<f64> {
    word.trim().parse().ok().filter(|value: &f64| value.is_finite())
}

/// A count below `end`.
fn whole(value: f64, end: f64) -> Option<i32> {
    (value.fract() == 0.0 && (0.0..end).contains(&value)).then_some(value as i32)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// 2026-03-14 00:00 UTC.
    const MIDNIGHT_S: f64 = 1_773_446_400.0;

    #[test]
    fn the_seconds_of_a_day_get_their_date_across_midnight() {
        let mut dtrack = Dtrack::default();
        for (told_s, now_s) in [(86_399.9, -0.05), (86_399.99, 0.01), (0.01, 0.03), (0.02, 0.04)] {
            let expected = if told_s > 1.0 { told_s - DAY_S } else { told_s };
            let dated = dtrack.dated(told_s, MIDNIGHT_S + now_s) - MIDNIGHT_S;
            assert!((dated - expected).abs() < 1e-6, "{told_s}: {dated}");
        }
        // As the first: a packet of before midnight that is read after it, and one of a clock that is ahead of ours.
        assert!((Dtrack::default().dated(1.0, MIDNIGHT_S + 0.5) - (MIDNIGHT_S + 1.0)).abs() < 1e-6);
        assert!((Dtrack::default().dated(86_399.9, MIDNIGHT_S + 0.2) - (MIDNIGHT_S - 0.1)).abs() < 1e-6);
    }

    /// A controller twelve hours off, whose nearest day would change with every packet's way.
    #[test]
    fn a_clock_of_another_time_zone_goes_on_evenly() {
        let mut dtrack = Dtrack::default();
        let times: Vec<f64> = (0..100)
            .map(|i| {
                let measured_s = 0.01 * f64::from(i);
                let late_s = 0.005 * f64::from(i % 3);
                dtrack.dated(43_200.0 + measured_s, MIDNIGHT_S + measured_s + late_s - 0.005)
            })
            .collect();
        assert!(times.windows(2).all(|pair| (pair[1] - pair[0] - 0.01).abs() < 1e-6), "{times:?}");
        // And one that was set to another time of the day is followed.
        let set_s = dtrack.dated(80_000.0, MIDNIGHT_S + 80_000.5);
        assert!((set_s - MIDNIGHT_S - 80_000.0).abs() < 1e-6, "{set_s}");
    }

    /// Frames of one flystick at rest with these counts and numbers in its last group; what was read of it.
    fn flystick(counts: &str, inputs: &str) -> (bool, DeviceState) {
        let mut state = DeviceState::default();
        let frame = format!("fr 1\n6df2 1 1 [0 1.0 {counts}][0 0 0][1 0 0 0 1 0 0 0 1][{inputs}]\n");
        let is_read = Dtrack::default().parse(frame.as_bytes(), &mut state);
        (is_read && state.counters.malformed == 0, state)
    }

    fn pressed(state: &DeviceState) -> Vec<i32> {
        state.buttons.iter().filter(|(_, reading)| reading.value).map(|(button, _)| *button).collect()
    }

    /// 32 buttons are one number, the first one its lowest bit and the last one its sign; 33 are two, of which the first counts.
    #[test]
    fn a_word_holds_32_buttons() {
        let (is_read, state) = flystick("32 1", "-2147483647 0.25");
        assert!(is_read);
        assert_eq!((pressed(&state), state.buttons.len()), (vec![0, 31], 32));
        assert_eq!(state.valuators[&0].value, 0.25);
        let (is_read, state) = flystick("33 1", "2 1 0.25");
        assert!(is_read);
        assert_eq!((pressed(&state), state.buttons.len()), (vec![1], 32));
        assert_eq!(state.valuators[&0].value, 0.25, "it stands behind two words");
        assert!(!flystick("33 1", "2 0.25").0, "a word is missing");
        assert!(!flystick("32 1", "2 1 0.25").0, "a word too many");
    }
}
