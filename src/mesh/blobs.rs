//! Rounded bodies from a few numbers: balls and round cones that melt into one another.
//!
//! In: [`Blobs`], sizes in metres. Out: a [`TetMesh`] by isosurface stuffing ([`fill`]). The depth of a point is that below
//! the surface of a round cone, the hull of two balls; of several cones it is their smooth maximum, by the quadratic
//! polynomial of I. Quilez, "Smooth minimum", which rounds the seam where two depths differ by less than `blend`.

use super::generate::{GenerateError, check_length};
use super::isosurface_stuffing::lattice::Lattice;
use super::isosurface_stuffing::{MAX_TETRAHEDRA, MAX_VERTICES, drop_crumbs, fill};
use super::tet_mesh::{LoadedMesh, TetMesh};
use crate::base::machine;
use nalgebra::Vector3;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::collections::BTreeSet;

/// Bodies of more parts are refused: every part is asked at every lattice vertex.
const MOST_PARTS: usize = 1000;

/// Round parts that melt into one another, filled with tetrahedra of `cell` metres. It has no groups: control elements
/// take their nodes by place.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Blobs {
    /// Edge of a lattice cube, m; the tetrahedra's edges have about this length.
    pub cell: f64,
    /// Radius by which a seam between two parts is rounded, m; 0 leaves it sharp.
    #[serde(default)]
    pub blend: f64,
    /// Parts in the order in which one after another melts into those before it.
    pub parts: Vec<Blob>,
}

/// A ball, or with `to` a round cone: the hull of two balls.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Blob {
    pub from: [f64; 3],
    pub to: Option<[f64; 3]>,
    pub radius: f64,
    /// Radius at `to`, m; the same as at `from` where it is left out.
    pub end_radius: Option<f64>,
    /// Region of the tetrahedra in this part that lie in no later one, for a material of its own; those of other parts are region 0.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub region: Option<String>,
}

impl Blob {
    fn ends(&self) -> [(Vector3<f64>, f64); 2] {
        let from = (Vector3::from(self.from), self.radius);
        [from, (self.to.map_or(from.0, Vector3::from), self.end_radius.unwrap_or(self.radius))]
    }

    /// Depth of a point below the surface, m, negative outside. In the plane through the axis, x is the distance from it and y
    /// the place along it from 0 at one middle to the length l; the cone touches both balls where the line from the point to it
    /// leans by (r₁ - r₂)/l.
    fn depth(&self, point: &Vector3<f64>) -> f64 {
        let [(a, ra), (b, rb)] = self.ends();
        let (axis, slope) = (b - a, ra - rb);
        let length = axis.norm();
        if length <= slope.abs() {
            let (middle, radius) = if ra >= rb { (a, ra) } else { (b, rb) };
            return radius - (point - middle).norm();
        }
        let along = (point - a).dot(&axis) / length;
        let across = ((point - a).norm_squared() - along * along).max(0.0).sqrt();
        let sin = slope / length;
        let cos = (1.0 - sin * sin).sqrt();
        // Where the shortest line to the cone meets the axis.
        let foot = along - across * sin / cos;
        if foot <= 0.0 {
            ra - (point - a).norm()
        } else if foot >= length {
            rb - (point - b).norm()
        } else {
            ra - (across * cos + along * sin)
        }
    }
}

impl Blobs {
    /// Depth of a point in the body, m, negative outside; 0 on its surface.
    pub fn depth(&self, point: &Vector3<f64>) -> f64 {
        let depths = self.parts.iter().map(|part| part.depth(point));
        depths.reduce(|a, b| smooth_max(a, b, self.blend)).unwrap_or(f64::NEG_INFINITY)
    }

    /// A box about the body. Each part that melts in raises the depth by at most a quarter of `blend`, and never above what
    /// all of them together would.
    fn bounds(&self) -> (Vector3<f64>, Vector3<f64>) {
        let margin = self.blend * (self.parts.len().saturating_sub(1) as f64 / 4.0).min(1.0);
        let (mut low, mut high) = (Vector3::repeat(f64::INFINITY), Vector3::repeat(f64::NEG_INFINITY));
        for (middle, radius) in self.parts.iter().flat_map(Blob::ends) {
            low = low.inf(&middle.add_scalar(-radius - margin));
            high = high.sup(&middle.add_scalar(radius + margin));
        }
        (low, high)
    }

    fn check(&self) -> Result<(), GenerateError> {
        let refused = |message: String| Err(GenerateError::Blobs(message));
        check_length("cell", self.cell)?;
        if !(self.blend >= 0.0 && self.blend.is_finite()) {
            return refused(format!("blend is {} m: write 0 or a positive length", self.blend));
        }
        if self.parts.is_empty() || self.parts.len() > MOST_PARTS {
            return refused(format!("{} parts: give 1 to {MOST_PARTS}", self.parts.len()));
        }
        for (number, part) in (1..).zip(&self.parts) {
            for (middle, radius) in part.ends() {
                if !middle.iter().all(|x| x.abs() <= 1e6) {
                    return refused(format!("part {number}: a place is not within ±1e6 m"));
                }
                if !(radius > 0.0 && radius <= 1e6) {
                    return refused(format!("part {number}: radius {radius} m: a positive length is needed"));
                }
            }
            if part.to.is_none() && part.end_radius.is_some() {
                return refused(format!("part {number}: end_radius without `to`: a ball has one radius"));
            }
        }
        Ok(())
    }
}

/// The larger of two, rounded where they differ by less than `blend`: at most a quarter of it more.
fn smooth_max(a: f64, b: f64, blend: f64) -> f64 {
    let near = (blend - (a - b).abs()).max(0.0);
    a.max(b) + if near > 0.0 { near * near / (4.0 * blend) } else { 0.0 }
}

/// The body as tetrahedra, with notices of parts that were left out.
pub fn blobs(blobs: &Blobs) -> Result<LoadedMesh, GenerateError> {
    blobs.check()?;
    let (low, high) = blobs.bounds();
    let tetrahedra = 12.0 * (high - low).product() / blobs.cell.powi(3);
    let refused = |message: String| GenerateError::Blobs(message);
    if tetrahedra > 4.0 * MAX_TETRAHEDRA {
        let coarser = 1.1 * blobs.cell * (tetrahedra / (4.0 * MAX_TETRAHEDRA)).cbrt();
        return Err(refused(format!(
            "a cell of {} m makes too many tetrahedra: take {coarser:.1e}",
            blobs.cell
        )));
    }
    machine::expect(format!("a lattice of about {:.1e} cells", tetrahedra / 12.0), 40.0 * tetrahedra)?;
    let lattice = Lattice::around(&low, &high, blobs.cell, MAX_VERTICES)
        .ok_or_else(|| refused(format!("a cell of {} m makes too many lattice vertices", blobs.cell)))?;
    let values: Vec<f64> = (0..lattice.vertices())
        .into_par_iter()
        .with_min_len(256)
        .map(|vertex| blobs.depth(&lattice.position(lattice.coordinates(vertex))))
        .collect();
    let mut mesh: TetMesh = fill(&lattice, &values, |point| blobs.depth(point));
    if mesh.tets.is_empty() {
        return Err(refused(format!(
            "no tetrahedron of cell {} m fits inside: take a smaller one",
            blobs.cell
        )));
    }
    let mut notices = Vec::new();
    drop_crumbs(&mut mesh, &mut notices);
    name_regions(blobs, &mut mesh);
    Ok(LoadedMesh { mesh, notices })
}

/// Gives each tetrahedron the region of the last part in which its middle lies; named regions are node groups, too.
fn name_regions(blobs: &Blobs, mesh: &mut TetMesh) {
    let mut names: Vec<&str> = Vec::new();
    let numbers = blobs.parts.iter().map(|part| {
        let Some(name) = &part.region else { return 0 };
        let known = names.iter().position(|other| other == name);
        known.unwrap_or_else(|| {
            names.push(name);
            names.len() - 1
        }) as u32
            + 1
    });
    let numbers: Vec<u32> = numbers.collect();
    if names.is_empty() {
        return;
    }
    let mut nodes = vec![BTreeSet::new(); names.len()];
    for tet in 0..mesh.tets.len() {
        let middle = mesh.corners(tet).iter().sum::<Vector3<f64>>() / 4.0;
        let depths = blobs.parts.iter().map(|part| part.depth(&middle)).zip(&numbers);
        // In the seam between parts lies what is in none of them.
        let last = depths.reduce(|a, b| if b.0 >= 0.0 || b.0 > a.0 { b } else { a });
        mesh.regions[tet] = last.map_or(0, |(_, region)| *region);
        if let Some(own) = (mesh.regions[tet] as usize).checked_sub(1) {
            nodes[own].extend(mesh.tets[tet]);
        }
    }
    for ((number, name), nodes) in (1..).zip(names).zip(nodes) {
        mesh.region_names.insert(number, name.to_owned());
        mesh.groups.insert(name.to_owned(), nodes.into_iter().collect());
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::{Surface, quality};
    use proptest::prelude::*;
    use std::f64::consts::PI;

    fn ball(from: [f64; 3], radius: f64) -> Blob {
        Blob { from, to: None, radius, end_radius: None, region: None }
    }

    fn volume(body: &Blobs) -> f64 {
        let mesh = blobs(body).unwrap().mesh;
        Surface::from_mesh(&mesh).volume(&mesh)
    }

    /// The hull of two balls: two caps and the frustum between their circles of contact.
    fn round_cone_volume(ra: f64, rb: f64, length: f64) -> f64 {
        let sin = (ra - rb) / length;
        let cap = |r: f64, height: f64| PI * height * height * (r - height / 3.0);
        let (ca, cb) = ((1.0 - sin * sin) * ra * ra, (1.0 - sin * sin) * rb * rb);
        let height = length + (rb - ra) * sin;
        cap(ra, ra * (1.0 + sin))
            + cap(rb, rb * (1.0 - sin))
            + PI * height / 3.0 * (ca + cb + (ca * cb).sqrt())
    }

    #[test]
    fn volumes_come_nearer_to_the_closed_forms_by_the_square_of_the_cell() {
        let cone = Blob { to: Some([1.0, 0.5, 0.0]), end_radius: Some(0.2), ..ball([0.0; 3], 0.4) };
        for (parts, exact) in [
            (vec![ball([0.1, 0.2, 0.3], 0.5)], 4.0 / 3.0 * PI * 0.125),
            (vec![cone], round_cone_volume(0.4, 0.2, 1.25f64.sqrt())),
            (vec![ball([-1.0, 0.0, 0.0], 0.5), ball([1.0, 0.0, 0.0], 0.4)], 4.0 / 3.0 * PI * 0.189),
        ] {
            let error = |cell: f64| 1.0 - volume(&Blobs { cell, blend: 0.0, parts: parts.clone() }) / exact;
            let [coarse, fine] = [0.12, 0.06].map(error);
            assert!(fine.abs() < 0.01 && fine.abs() < 0.4 * coarse.abs(), "{coarse} {fine}");
        }
    }

    #[test]
    fn a_blend_fills_the_seam_and_leaves_the_rest() {
        let parts = vec![ball([-0.3, 0.0, 0.0], 0.4), ball([0.3, 0.0, 0.0], 0.4)];
        let of = |blend: f64| Blobs { cell: 0.06, blend, parts: parts.clone() };
        let lens = 2.0 * PI * 0.01 * (0.4 - 0.1 / 3.0);
        let sharp = 2.0 * 4.0 / 3.0 * PI * 0.064 - lens;
        assert!((volume(&of(0.0)) / sharp - 1.0).abs() < 0.01);
        assert!(volume(&of(0.2)) > 1.01 * sharp);
        let far = Vector3::new(-0.7, 0.0, 0.0);
        assert_eq!(of(0.2).depth(&far), of(0.0).depth(&far));
        let seam = Vector3::new(0.0, (0.16f64 - 0.09).sqrt(), 0.0);
        assert!((of(0.2).depth(&seam) - 0.05).abs() < 1e-12, "a quarter of the blend");
    }

    #[test]
    fn its_tetrahedra_are_good_and_its_surface_is_closed() {
        let cone = Blob { to: Some([0.0, 0.9, 0.1]), end_radius: Some(0.15), ..ball([0.0; 3], 0.4) };
        let body = Blobs { cell: 0.1, blend: 0.1, parts: vec![cone, ball([0.4, 0.1, 0.0], 0.25)] };
        let mesh = blobs(&body).unwrap().mesh;
        let least = (0..mesh.tets.len()).map(|tet| quality::quality(&mesh.corners(tet))).fold(1.0, f64::min);
        assert!(least > 0.1, "{least}");
        assert_eq!(quality::components(&mesh).nodes.len(), 1);
        let surface = Surface::from_mesh(&mesh);
        for &node in &surface.nodes {
            assert!(body.depth(&mesh.nodes[node as usize]).abs() < 1e-6);
        }
        let (vertices, triangles) = (surface.nodes.len(), surface.triangles.len());
        assert_eq!(2 * vertices, triangles + 4, "Euler: a sphere");
    }

    /// A large ball with a small one of another material at its side: each region has the volume of its own part up to the seam.
    #[test]
    fn a_part_with_a_region_has_a_material_of_its_own() {
        let small = Blob { region: Some("bladder".into()), ..ball([0.6, 0.0, 0.0], 0.25) };
        let body = Blobs { cell: 0.05, blend: 0.0, parts: vec![ball([0.0; 3], 0.5), small] };
        let mesh = blobs(&body).unwrap().mesh;
        assert_eq!(mesh.region_names.iter().collect::<Vec<_>>(), [(&1, &"bladder".to_owned())]);
        let of = |tet: &usize| mesh.regions[*tet] == 1;
        for tet in (0..mesh.tets.len()).filter(of) {
            assert!(mesh.tets[tet].iter().all(|node| mesh.groups["bladder"].contains(node)));
        }
        let own: f64 =
            (0..mesh.tets.len()).filter(of).map(|tet| quality::signed_volume(&mesh.corners(tet))).sum();
        // By counting the points of a grid.
        let (h, steps) = (0.01, -30..30);
        let inside = |x: &Vector3<f64>| body.parts[1].depth(x) > 0.0;
        let at = |i: i32, j: i32, k: i32| Vector3::new(0.6, 0.0, 0.0) + Vector3::new(i, j, k).cast() * h;
        let all = steps.clone().flat_map(|i| {
            let steps = steps.clone();
            steps.clone().flat_map(move |j| steps.clone().map(move |k| at(i, j, k)))
        });
        let exact = all.filter(inside).count() as f64 * h.powi(3);
        println!("{own} m³ of {exact}");
        assert!((own / exact - 1.0).abs() < 0.05, "{own} of {exact}");
    }

    #[test]
    fn what_cannot_be_made_is_refused_with_the_number() {
        let refused = |cell: f64, blend: f64, parts: Vec<Blob>| {
            blobs(&Blobs { cell, blend, parts }).unwrap_err().to_string()
        };
        let one = || vec![ball([0.0; 3], 1.0)];
        assert!(refused(0.0, 0.0, one()).contains("cell is 0 m"));
        assert!(refused(1.0, -1.0, one()).contains("blend is -1 m"));
        assert!(refused(1.0, 0.0, vec![]).contains("0 parts"));
        assert!(refused(1.0, 0.0, vec![ball([f64::NAN; 3], 1.0)]).contains("part 1: a place"));
        assert!(refused(1.0, 0.0, vec![ball([0.0; 3], -1.0)]).contains("part 1: radius -1 m"));
        assert!(refused(1e-4, 0.0, one()).contains("too many"));
        assert!(refused(50.0, 0.0, one()).contains("fits inside"));
        let half = Blob { end_radius: Some(1.0), ..ball([0.0; 3], 1.0) };
        assert!(refused(1.0, 0.0, vec![half]).contains("end_radius without `to`"));
    }

    proptest! {
        /// Against the definition: the largest depth below any ball of the hull.
        #[test]
        fn a_round_cone_is_the_union_of_its_balls(
            to in proptest::array::uniform3(-1.0..1.0f64),
            radii in (0.1..0.8f64, 0.1..0.8f64),
            at in proptest::array::uniform3(-2.0..2.0f64),
        ) {
            let cone = Blob { to: Some(to), end_radius: Some(radii.1), ..ball([0.0; 3], radii.0) };
            let at = Vector3::from(at);
            let of = |share: f64| {
                let middle = Vector3::from(to) * share;
                radii.0 + share * (radii.1 - radii.0) - (at - middle).norm()
            };
            let deepest = (0..=4000).map(|k| of(f64::from(k) / 4000.0)).fold(f64::NEG_INFINITY, f64::max);
            prop_assert!((cone.depth(&at) - deepest).abs() < 1e-3, "{} {deepest}", cone.depth(&at));
        }

        #[test]
        fn no_numbers_make_it_panic(
            cell in prop_oneof![0.05..2.0f64, any::<f64>()],
            blend in prop_oneof![0.0..1.0f64, any::<f64>()],
            numbers in proptest::collection::vec(prop_oneof![-1.0..1.0f64, any::<f64>()], 8),
        ) {
            let [a, b, c, r, d, e, f, s] = numbers[..] else { unreachable!() };
            let (from, to) = ([a, b, c], Some([d, e, f]));
            let part = Blob { from, to, radius: r, end_radius: Some(s), region: Some("r".into()) };
            let _ = blobs(&Blobs { cell, blend, parts: vec![part] });
        }
    }
}
