//! Generated meshes and their surfaces against closed forms.

use crate::common::{euler_characteristic_of_closed, tet_volume};
use greenstage::mesh::quality::{components, quality_report};
use greenstage::mesh::{Block, GenerateError, Surface, TetMesh, Tube, block, tube};
use std::f64::consts::{PI, TAU};

pub fn demo_tube() -> Tube {
    Tube {
        inner_radius: 0.07,
        outer_radius: 0.1,
        length: 1.0,
        radial: 3,
        around: 40,
        along: 62,
        control_length: 0.1,
    }
}

#[test]
fn demo_tube_has_ten_thousand_nodes_of_good_quality() {
    let mesh = tube(&demo_tube()).unwrap();
    assert_eq!(mesh.nodes.len(), 4 * 40 * 63);
    assert_eq!(mesh.tets.len(), 5 * 3 * 40 * 62);
    let quality = quality_report(&mesh);
    assert!(quality.min > 0.5, "{quality:?}");
    assert_eq!(components(&mesh).nodes.len(), 1);
    // 0.1 m of layers 1/62 m apart: 0 to 6.
    assert_eq!(mesh.groups["left"].len(), 7 * 4 * 40);
    assert!(mesh.groups["left"].iter().all(|&node| mesh.nodes[node as usize].x <= -0.4 + 1e-12));
    assert_eq!(mesh.groups["right"].len(), 7 * 4 * 40);
    assert!(mesh.groups["right"].iter().all(|&node| mesh.nodes[node as usize].x >= 0.4 - 1e-12));
    for (name, radius) in [("inner", 0.07), ("outer", 0.1)] {
        assert_eq!(mesh.groups[name].len(), 40 * 63);
        for &node in &mesh.groups[name] {
            assert!((mesh.nodes[node as usize].yz().norm() - radius).abs() < 1e-15);
        }
    }
}

#[test]
fn tube_surface_is_a_closed_torus_of_the_polygons_volume() {
    let parameters = demo_tube();
    let mesh = tube(&parameters).unwrap();
    let surface = Surface::from_mesh(&mesh);
    assert_eq!(euler_characteristic_of_closed(&surface), 0);
    let n = f64::from(parameters.around);
    let exact = n / 2.0 * (TAU / n).sin() * (0.1f64.powi(2) - 0.07f64.powi(2));
    assert!((tet_volume(&mesh) / exact - 1.0).abs() < 1e-12);
    assert!((surface.volume(&mesh) / exact - 1.0).abs() < 1e-12);
    let walls = 2.0 * n * (PI / n).sin() * (0.1 + 0.07);
    assert!((surface.area(&mesh) / (walls + 2.0 * exact) - 1.0).abs() < 1e-12);
}

#[test]
fn tube_volume_converges_at_rate_2() {
    let exact = PI * (0.1f64.powi(2) - 0.07f64.powi(2));
    let errors: Vec<f64> = [8, 16, 32, 64]
        .map(|around| {
            let mesh = tube(&Tube { around, along: 4, radial: 1, ..demo_tube() }).unwrap();
            (tet_volume(&mesh) / exact - 1.0).abs()
        })
        .to_vec();
    // Least-squares slope of log₂ error over equidistant log₂ around.
    let logs: Vec<f64> = errors.iter().map(|error| error.log2()).collect();
    let rate = -(-1.5 * logs[0] - 0.5 * logs[1] + 0.5 * logs[2] + 1.5 * logs[3]) / 5.0;
    assert!((rate - 2.0).abs() < 0.05, "rate {rate}, errors {errors:?}");
}

#[test]
fn block_surface_is_a_closed_sphere() {
    let mesh = block(&Block { size: [3.0, 2.0, 1.0], cells: [5, 4, 3] }).unwrap();
    assert_eq!((mesh.nodes.len(), mesh.tets.len()), (6 * 5 * 4, 5 * 60));
    let surface = Surface::from_mesh(&mesh);
    assert_eq!(surface.triangles.len(), 4 * (20 + 15 + 12));
    assert_eq!(euler_characteristic_of_closed(&surface), 2);
    assert!((surface.volume(&mesh) - 6.0).abs() < 1e-13);
    assert!((tet_volume(&mesh) - 6.0).abs() < 1e-13);
    assert!((surface.area(&mesh) - 22.0).abs() < 1e-13);
    for (axis, name) in [(0, "xmin"), (1, "ymin"), (2, "zmin")] {
        let half = [1.5, 1.0, 0.5][axis];
        for &node in &mesh.groups[name] {
            assert_eq!(mesh.nodes[node as usize][axis], -half);
        }
    }
    assert_eq!(mesh.groups["xmin"].len(), 5 * 4);
    assert_eq!(mesh.groups["ymax"].len(), 6 * 4);
    assert_eq!(mesh.groups["zmax"].len(), 6 * 5);
}

#[test]
fn faces_between_regions_are_no_surface() {
    let mut mesh = block(&Block { size: [1.0; 3], cells: [4; 3] }).unwrap();
    let whole = Surface::from_mesh(&mesh);
    mesh.regions.iter_mut().enumerate().for_each(|(tet, region)| *region = tet as u32 % 3);
    assert_eq!(Surface::from_mesh(&mesh), whole);
    assert_eq!(whole.nodes.len(), 125 - 27);
}

#[test]
fn surface_of_one_tetrahedron_looks_outward() {
    let corners = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    let mesh =
        TetMesh { nodes: corners.map(Into::into).to_vec(), tets: vec![[0, 1, 2, 3]], ..TetMesh::default() };
    let surface = Surface::from_mesh(&mesh);
    for triangle in &surface.triangles {
        let [a, b, c] = triangle.map(|i| mesh.nodes[surface.nodes[i as usize] as usize]);
        let centre = nalgebra::Vector3::repeat(0.25);
        assert!((b - a).cross(&(c - a)).dot(&(a - centre)) > 0.0, "{triangle:?}");
    }
}

#[test]
fn impossible_sizes_are_refused_with_their_numbers() {
    let refused = |parameters: Tube| tube(&parameters).unwrap_err().to_string();
    let t = demo_tube();
    assert!(refused(Tube { length: f64::NAN, ..t.clone() }).starts_with("length is NaN"));
    assert!(refused(Tube { inner_radius: 0.0, ..t.clone() }).starts_with("inner_radius is 0 m"));
    assert!(refused(Tube { outer_radius: f64::INFINITY, ..t.clone() }).starts_with("outer_radius is inf"));
    assert!(refused(Tube { inner_radius: 0.2, ..t.clone() }).contains("(0.1 m) must be greater"));
    assert!(refused(Tube { around: 41, ..t.clone() }).contains("41 cells: an even number"));
    assert!(refused(Tube { around: 2, ..t.clone() }).contains("at least 4"));
    assert!(refused(Tube { along: 0, ..t.clone() }).contains("along is 0 cells"));
    assert!(refused(Tube { control_length: 0.5, ..t.clone() }).contains("control_length is 0.5 m"));
    assert!(refused(Tube { control_length: -0.1, ..t.clone() }).contains("control_length is -0.1 m"));
    assert!(refused(Tube { control_length: f64::NAN, ..t.clone() }).contains("control_length is NaN m"));
    let dense = Tube { around: 1 << 31, along: u32::MAX, radial: u32::MAX, ..t };
    assert!(refused(dense).contains("are more than 20000000"));
    let many = Block { size: [1.0; 3], cells: [4_000_001, 1, 1] };
    assert_eq!(block(&many), Err(GenerateError::TooMany { tetrahedra: 20_000_005 }));
    let tiny = block(&Block { size: [1e-120; 3], cells: [1; 3] }).unwrap_err();
    assert!(matches!(tiny, GenerateError::Volume { .. }), "{tiny}");
}

#[test]
fn parameters_are_strict_toml() {
    let parsed: Block =
        greenstage::config::parse("size = [1.0, 1.0, 1.0]\ncells = [1, 2, 3]", "a".as_ref()).unwrap();
    assert_eq!(parsed, Block { size: [1.0; 3], cells: [1, 2, 3] });
    let text = "size = [1.0, 1.0, 1.0]\ncell = [1, 2, 3]";
    let error = greenstage::config::parse::<Block>(text, "a.toml".as_ref()).unwrap_err().to_string();
    assert!(error.starts_with("a.toml:2:1") && error.contains("did you mean `cells`"), "{error}");
}
