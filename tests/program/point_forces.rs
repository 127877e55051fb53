//! Forces at points of the surface and on ends, as `deform` reports them.

use crate::common::{csv_rows, greenstage, project, text};

const SCENE: &str = "[body.bar]\n\
    generate = { block = { size = [1.0, 0.2, 0.2], cells = [10, 2, 2] } }\n\
    material = { young = 1.0e6, poisson = 0.3 }\n\
    MODEL\n\
    control.left = { nodes = { group = \"xmin\" }, grab = \"fixed\" }\n";
const FORCE: [f64; 3] = [0.0, -3.0, 4.0];

/// The printed displacement of the point is that of the table at this node, whether it is summed or solved.
#[test]
fn where_the_points_of_forces_went_is_printed() {
    for (name, model) in
        [("summed", "surface_compliance = { nodes = \"surface\" }"), ("solved", "model = \"stvk\"")]
    {
        let poses =
            |at: &str| format!("[[pose]]\nname = \"poke\"\nforce = [{{ {at}, force = {FORCE:?} }}]\n");
        let folder = project(
            &format!("point_forces_{name}"),
            None,
            &SCENE.replace("MODEL", model),
            &poses("at = [0.5, 0.1, 0.0]"),
        );
        let arguments = ["deform", "scene.toml", "--poses", "poses.toml", "-o", "out"];
        let told = text(&greenstage(&folder, &arguments).stdout);
        let line = told.lines().find(|line| line.contains("where 5.00 N act")).unwrap_or_default();
        let rows = csv_rows(&folder.join("out.csv"), 2);
        let along = |u: &[f64]| u.iter().zip(FORCE).map(|(u, f)| 1e3 * u * f / 5.0).sum::<f64>();
        let is_told = |tag: &str, u: &[f64]| {
            let vector: Vec<String> = u.iter().map(|u| format!("{:.2}", 1e3 * u)).collect();
            let told = format!("({}) mm, {:.2} mm of it along the force", vector.join(", "), along(u));
            line.ends_with(&told).then(|| tag.rsplit(',').next().unwrap_or_default().to_owned())
        };
        let nodes: Vec<String> = rows.iter().filter_map(|(tag, u)| is_told(tag, u)).collect();
        assert_eq!(nodes.len(), 1, "{name}: {line}");
        // Named by its tag, the node is the same.
        std::fs::write(folder.join("poses.toml"), poses(&format!("node = {}", nodes[0]))).unwrap();
        let again = text(&greenstage(&folder, &arguments).stdout);
        assert!(again.contains(line), "{name}: {line}\n{again}");
    }
}

/// An end that a moment turns by 33° is where static equilibrium has it. `reduced` lost its state on the way, and its poses were refused.
#[test]
fn a_pushed_end_is_found_where_equilibrium_has_it() {
    let scene = "[body.bar]\n\
        generate = { block = { size = [0.4, 0.03, 0.02], cells = [20, 2, 2] } }\n\
        material = { young = 1.0e7, poisson = 0.3 }\n\
        MODEL\neffects = [\"haptics\"]\n\
        control.left = { nodes = { group = \"xmin\" }, grab = \"fixed\" }\n\
        control.right = { nodes = { group = \"xmax\" }, grab = \"dragger\" }\n";
    let poses = "[[pose]]\nname = \"push\"\ncontrol.right = { moment = [0.0, -0.6, 0.0] }\n";
    let [reduced, full] = ["reduced", "stvk"].map(|model| {
        let scene = scene.replace("MODEL", &format!("model = \"{model}\""));
        let folder = project(&format!("pushed_{model}"), None, &scene, poses);
        let output = greenstage(&folder, &["deform", "scene.toml", "--poses", "poses.toml", "-o", "out"]);
        assert!(output.status.success(), "{model}: {}", text(&output.stderr));
        csv_rows(&folder.join("out.csv"), 2)
    });
    let largest = |u: &[f64]| u.iter().fold(0.0, |most: f64, u| most.max(u.abs()));
    let off = |(tag, own): &(String, Vec<f64>)| {
        let (_, u) = full.iter().find(|(full, _)| full == tag).unwrap();
        largest(&own.iter().zip(u).map(|(own, u)| own - u).collect::<Vec<f64>>())
    };
    let size = largest(&full.iter().flat_map(|(_, u)| u.clone()).collect::<Vec<f64>>());
    let apart = largest(&reduced.iter().map(off).collect::<Vec<f64>>());
    println!("{apart:e} m apart of {size} m");
    assert!(size > 0.1 && apart < 9e-5 * size, "{apart} of {size}");
}
