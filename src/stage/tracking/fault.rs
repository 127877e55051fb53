//! Why the tracking part of a stage is refused, and what to do about it.

/// What is wrong with a tracker, a sensor, a stylus or the viewer's head.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum TrackingFault {
    #[error("tracker `{tracker}` has {found}: give exactly one of vrpn, dtrack, osc, fastrak, gamepad")]
    Kind { tracker: String, found: String },
    #[error("`{key}` of tracker `{tracker}` goes with `{with}` alone: remove it")]
    LoneKey { tracker: String, key: &'static str, with: &'static str },
    #[error(
        "`{key}` of tracker `{tracker}` is \"{address}\": give the address to listen on, as \"127.0.0.1:5000\" (packets \
         from this machine), \"0.0.0.0:5000\" (from any network), or a port alone (this machine)"
    )]
    Listen { tracker: String, key: &'static str, address: String },
    #[error(
        "`vrpn` of tracker `{tracker}` is \"{address}\": {why}; write \"Tracker0@host\", \"Tracker0@host:3883\" or \
         \"tcp://host:3883/Tracker0\""
    )]
    Vrpn { tracker: String, address: String, why: &'static str },
    #[error("`{key}` of tracker `{tracker}` is empty: give the device's path, as {example}")]
    Device { tracker: String, key: &'static str, example: &'static str },
    #[error(
        "trackers `{first}` and `{second}` both use {what}: one of them would hear nothing; keep one, several sensors may \
         name it"
    )]
    SamePlace { first: String, second: String, what: String },
    #[error("{what} is {value}: it must be a number{unit} between {min} and {max}")]
    Range { what: String, value: f64, unit: &'static str, min: f64, max: f64 },
    #[error("{what} has `rotation` and `axes`: keep one")]
    TwoRotations { what: String },
    #[error(
        "{what}: the axes {first} and {second} meet at {degrees:.1}° instead of 90°, so they are no rotation: measure \
         them again (up to 5° is straightened)"
    )]
    Skewed { what: String, first: char, second: char, degrees: f64 },
    #[error(
        "{what}: the axes are left-handed. If the tracker's system really is, as Unity's, reverse the last one and add \
         mirror = \"z\"; if not, one axis points the other way"
    )]
    LeftHanded { what: String },
    #[error("{what}: the {axis} axis has no length: say where in the room it points")]
    NoAxis { what: String, axis: char },
    #[error("{who}: {message}")]
    UnknownName { who: String, message: String },
    #[error(
        "sensors `{first}` and `{second}` are both number {id} of tracker `{tracker}`: one of them has another number \
         (`greenstage track` lists those that speak)"
    )]
    SameSensor { first: String, second: String, tracker: String, id: i32 },
    #[error(
        "`grab` and `second` of stylus `{stylus}` are the same button: give `second` another, or remove it"
    )]
    SameButton { stylus: String },
    #[error("styli `{first}` and `{second}` both follow sensor `{sensor}`: give each its own, or remove one")]
    SharedSensor { first: String, second: String, sensor: String },
    #[error(
        "`lost` of sensor `{sensor}`: it warns after {warn_s} s, before it holds at {after_s} s: swap them"
    )]
    LostOrder { sensor: String, after_s: f64, warn_s: f64 },
}
