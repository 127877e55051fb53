//! The list of all exporters.

use super::exporter::{Exporter, Spread};
use super::{csv, found, glb, obj, ply, pose_picture, stl, vtu};

/// All exporters, in the order in which their files are written and named.
pub const EXPORTERS: &[Exporter] = &[
    csv::DISPLACEMENTS,
    csv::FORCES,
    csv::STRESSES,
    found::POSES,
    vtu::BODIES,
    stl::SURFACE,
    ply::SURFACE,
    obj::SURFACE,
    glb::SURFACE,
    pose_picture::PICTURE,
];

/// The exporters of one file a pose, which are written if they are asked for.
pub fn surfaces() -> impl Iterator<Item = &'static Exporter> {
    EXPORTERS.iter().filter(|exporter| exporter.spread == Spread::EachPose)
}

/// The one of [`surfaces`] called `name`, or what there is instead.
pub fn find_surface(name: &str) -> Result<&'static Exporter, String> {
    let known: Vec<&str> = surfaces().map(Exporter::name).collect();
    surfaces()
        .find(|exporter| exporter.name() == name)
        .ok_or_else(|| crate::config::unknown_name("surface format", name, known.into_iter()))
}
