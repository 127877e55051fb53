//! A mesh without a scene: `new` writes one, other commands propose one in a folder of their own.

use super::{project, refuse, succeed};
use crate::common::{program, text};
use std::fs::read_to_string;

#[test]
fn new_writes_a_scene_and_never_over_another_file_unasked() {
    let folder = project("new");
    let told = text(&succeed(&folder, &["new", "block.msh", "-o", "own.toml", "--material", "steel"]).stdout);
    for said in [
        "own.toml: written",
        "material: steel (E = 210 GPa, ν = 0.3), as you asked",
        "greenstage view own.toml",
    ] {
        assert!(told.contains(said), "{said} is missing in: {told}");
    }
    let written = read_to_string(folder.join("own.toml")).unwrap();
    assert!(
        written.contains("mesh = \"block.msh\"") && written.contains("material = \"steel\""),
        "{written}"
    );
    let checked = text(&succeed(&folder, &["check", "own.toml"]).stdout);
    assert!(checked.contains("0 errors"), "{checked}");
    refuse(&folder, &["new", "block.msh", "-o", "own.toml"], &["own.toml: already exists", "--force"]);
    succeed(&folder, &["new", "block.msh", "-o", "own.toml", "--fixed", "xmin", "--grab", "xmax", "--force"]);
    let written = read_to_string(folder.join("own.toml")).unwrap();
    assert!(written.contains("[body.block.control.xmin]"), "{written}");
    std::fs::write(folder.join("other.toml"), "title = 1\n").unwrap();
    refuse(&folder, &["new", "block.msh", "-o", "other.toml", "--force"], &["not a scene file"]);
    refuse(&folder, &["new", "block.msh", "-o", "x.toml", "--fixed", "xmn"], &["did you mean \"xmin\"?"]);
    assert!(!folder.join("x.toml").exists());
}

/// The stage's file was named from the working folder, and commands fell apart at the space.
#[test]
fn a_proposed_scene_in_another_folder_opens_with_its_stage() {
    let folder = project("new-stage");
    let desktop = include_str!("../../../configs/stages/desktop.toml");
    std::fs::write(folder.join("mine.toml"), desktop).unwrap();
    let onto = |stage| ["new", "block.msh", "--stage", stage, "-o", "sub/a b.toml", "--pull", "5mm"];
    refuse(&folder, &onto("nost"), &["nost"]);
    refuse(&folder, &onto("nix.toml"), &["nix.toml"]);
    let told = text(&succeed(&folder, &onto("mine.toml")).stdout);
    let command = "greenstage deform 'sub/a b.toml' --poses 'sub/a b.poses.toml' -o 'out/a b'";
    assert!(told.contains(command) && told.contains("greenstage view 'sub/a b.toml'"), "{told}");
    assert!(read_to_string(folder.join("sub/a b.poses.toml")).unwrap().contains(command));
    let written = read_to_string(folder.join("sub/a b.toml")).unwrap();
    assert!(written.contains("stage = \"../mine.toml\"") && !written.contains("one window"), "{written}");
    succeed(&folder, &["check", "sub/a b.toml"]);
}

/// The note was of a reading of the file by its corners alone.
#[test]
fn the_nodes_on_the_edges_of_a_quadratic_mesh_are_not_said_to_be_dropped() {
    let folder = project("new-quadratic");
    let quadratic = super::SCENE.replace("effects = [\"haptics\"]", "element = \"tet10\"");
    std::fs::write(folder.join("ten.toml"), quadratic).unwrap();
    succeed(&folder, &["deform", "ten.toml", "--poses", "poses.toml", "--all-nodes", "-o", "ten"]);
    let told = |material: &str| {
        let new = ["new", "ten.vtu", "-o", "a.toml", "--force", "--material", material];
        text(&succeed(&folder, &new).stdout)
    };
    let (soft, stiff) = (told("rubber"), told("steel"));
    assert!(soft.contains("tet10") && !soft.contains("only their 4 corners are used"), "{soft}");
    assert!(!stiff.contains("tet10") && stiff.contains("only their 4 corners are used"), "{stiff}");
}

#[test]
fn what_is_given_in_place_of_a_mesh_is_judged_first() {
    let folder = project("new-no-mesh");
    refuse(&folder, &["new", "."], &[".: is no mesh or surface file"]);
    refuse(&folder, &["new", "scene.toml"], &["scene.toml: is no mesh or surface file"]);
    refuse(&folder, &["new", "block.msh", "--cell", "0.1"], &["--cell fills a surface"]);
    let dotted = "body.block.mesh = \"block.msh\"\n";
    std::fs::write(folder.join("dotted.toml"), dotted).unwrap();
    succeed(&folder, &["new", "block.msh", "-o", "dotted.toml", "--force"]);
}

#[test]
fn a_body_of_implausible_size_is_asked_about() {
    let folder = project("units");
    succeed(&folder, &["convert", "block.msh", "large.msh", "--metres-per-unit", "195"]);
    let inspected = text(&succeed(&folder, &["inspect", "large.msh"]).stdout);
    assert!(inspected.contains("unit = \"mm\" beside mesh makes it 0.1950 m"), "{inspected}");
    let with = |unit: &str| format!("\n  greenstage new large.msh --unit {unit}    for ");
    refuse(&folder, &["new", "large.msh"], &["195.0 m long", &with("mm"), &with("m")]);
    succeed(&folder, &["new", "large.msh", "--unit", "mm"]);
    let written = read_to_string(folder.join("large.toml")).unwrap();
    assert!(written.contains("unit = \"mm\""), "{written}");
}

#[test]
fn a_mesh_is_checked_without_a_scene_and_nothing_appears_beside_it() {
    let folder = project("no-scene");
    let before = std::fs::read_dir(&folder).unwrap().count();
    let cache = tempfile::tempdir().unwrap();
    let checked =
        program(&folder, &["check", "block.msh"]).env("XDG_CACHE_HOME", cache.path()).output().unwrap();
    assert!(checked.status.success(), "{}", text(&checked.stderr));
    assert!(text(&checked.stderr).contains("greenstage new block.msh"), "{}", text(&checked.stderr));
    assert_eq!(std::fs::read_dir(&folder).unwrap().count(), before);
    assert_eq!(std::fs::read_dir(cache.path().join("greenstage")).unwrap().count(), 1);
    refuse(
        &folder,
        &["deform", "block.msh", "--poses", "poses.toml", "-o", "out"],
        &["greenstage new block.msh"],
    );
    refuse(&folder, &["check", "scene.toml", "--unit", "mm"], &["--unit and --material are for a mesh"]);
    std::fs::write(folder.join("part.step"), "ISO-10303-21;\n").unwrap();
    refuse(&folder, &["view", "part.step"], &["gmsh -3 -clmax 5 -format msh41 part.step -o part.msh"]);
}

/// An open surface had a volume, and of a closed one a cell was suggested that its walls might not bear.
#[test]
fn inspect_tells_the_volume_of_a_closed_surface_alone_and_leaves_the_cell_to_new() {
    let folder = project("inspect-surface");
    let vertices = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\n";
    for (faces, expected, other) in [
        ("f 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n", "closed: `greenstage new a.obj` fills it", "open"),
        ("f 1 3 2\nf 1 2 4\nf 1 4 3\n", "not closed: it has no inside to be filled", "volume 1"),
    ] {
        std::fs::write(folder.join("a.obj"), format!("{vertices}{faces}")).unwrap();
        let told = text(&succeed(&folder, &["inspect", "a.obj"]).stdout);
        assert!(told.contains(expected) && !told.contains(other), "{told}");
    }
}
