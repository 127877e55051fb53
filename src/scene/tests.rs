//! Scenes as they are read, and the errors for mistakes in them.

use super::*;
use crate::fem::TET4;

const BLOCK: &str = r#"
[body.block]
generate = { block = { size = [1.0, 1.0, 1.0], cells = [2, 2, 2] } }
material = { young = 1.0e6, poisson = 0.3 }
[body.block.control.low]
nodes = { group = "xmin" }
grab = "fixed"
"#;

fn error(from: &str, to: &str) -> String {
    let text = BLOCK.replace(from, to);
    assert_ne!(text, BLOCK, "{from} must stand in the scene");
    Scene::parse(&text, Path::new("scene.toml")).unwrap_err().to_string()
}

#[test]
fn defaults_are_the_papers() {
    let scene = Scene::parse(BLOCK, Path::new("scene.toml")).unwrap();
    let body = &scene.body["block"];
    assert_eq!((scene.stage.as_str(), body.model.as_str()), ("desktop", "linear"));
    assert_eq!((body.element, body.solver.method), (&TET4, Default::default()));
    assert!(body.effects.is_empty() && body.place.is_none());
}

#[test]
fn a_material_is_named_changed_or_given() {
    let material = |text: &str| {
        let text = BLOCK.replace("{ young = 1.0e6, poisson = 0.3 }", text);
        Scene::parse(&text, Path::new("scene.toml")).unwrap().body["block"].material
    };
    let steel = material("\"steel\"");
    assert_eq!((steel.young, steel.poisson, steel.density), (210e9, 0.3, Some(7850.0)));
    let soft = material("{ name = \"steel\", young = 1.0e9 }");
    assert_eq!(soft, Material { young: 1e9, ..steel });
    let given = material("{ young = 210e9, poisson = 0.3, density = 7850 }");
    assert_eq!(given, Material { known: None, limit: None, ..steel });
    assert_eq!(steel.limit, Some(Limit::Stress(235e6)));
    let limited = material("{ name = \"steel\", limit = { stress = 1e9 } }");
    assert_eq!(limited.limit, Some(Limit::Stress(1e9)));
}

/// A file in millimetres gives the numbers of one in metres.
#[test]
fn a_meshs_unit_is_one_of_two_keys() {
    let text = BLOCK.replace(
        "generate = { block = { size = [1.0, 1.0, 1.0], cells = [2, 2, 2] } }",
        "mesh = \"a.msh\"\nunit = \"mm\"",
    );
    let told = |text: &str| Scene::parse(text, Path::new("scene.toml"));
    assert_eq!(told(&text).unwrap().body["block"].mesh_scale(), Scale(0.001));
    let scaled = told(&text.replace("unit = \"mm\"", "scale = 0.0254")).unwrap();
    assert_eq!(scaled.body["block"].mesh_scale(), Scale(0.0254));
    for (line, expected) in [
        ("unit = \"mm\"\nscale = 0.001", "name either unit or scale"),
        ("unit = \"millimetres\"", "unknown unit of length"),
        ("scale = 0.0", "body.block.scale: 0 must lie between"),
    ] {
        let error = told(&text.replace("unit = \"mm\"", line)).unwrap_err().to_string();
        assert!(error.contains(expected), "{error}");
    }
}

#[test]
fn mistakes_name_the_entity_and_the_remedy() {
    for (from, to, expected) in [
        ("young = 1.0e6", "young = -1.0", "body.block.material: Young's modulus -1 Pa"),
        ("poisson = 0.3", "poisson = 0.5", "body.block.material: Poisson's ratio 0.5 is incompressible"),
        (
            "poisson = 0.3 }",
            "poisson = 0.3 }\nlines = 0.0",
            "body.block.lines: a spacing of 0 m: write a positive",
        ),
        ("poisson = 0.3 }", "poisson = 0.3 }\nlines = \"thin\"", "expected true, false, or the spacing"),
        ("poisson = 0.3 }", "poisson = 0.3 }\ncrease = 200.0", "body.block.crease: 200 is no angle from 0"),
        ("poisson = 0.3 }", "poisson = 0.3 }\ncolor = \"red\"", "write \"#c05030\" (red, green, blue)"),
        ("poisson = 0.3 }", "poisson = 0.3 }\ncolor = [0, 1]", "red, green and blue from 0 to 255"),
        ("poisson = 0.3 }", "poisson = 0.3 }\ntexture = { size = 1.0 }", "missing field `image`"),
        (
            "poisson = 0.3 }",
            "poisson = 0.3 }\ntexture = { image = \"a.png\", size = -1.0 }",
            "body.block.texture: size is -1 m: a positive length",
        ),
        ("poisson = 0.3", "poisson = 0.7", "must lie between -1 and 0.5"),
        ("poisson = 0.3", "poisson = nan", "must lie between -1 and 0.5"),
        ("{ young = 1.0e6, poisson = 0.3 }", "\"stel\"", "scene.toml:4:12: unknown material \"stel\""),
        ("{ young = 1.0e6, poisson = 0.3 }", "\"stel\"", "did you mean \"steel\"?"),
        ("young = 1.0e6, ", "", "scene.toml:4:12: missing field `young`; write"),
        ("young = 1.0e6, ", "name = \"wood\", ", "unknown material \"wood\""),
        ("{ young = 1.0e6, poisson = 0.3 }", "3.0", "expected a table, or a name of"),
        ("material", "unit = \"mm\"\nmaterial", "body.block.unit: only the coordinates of a mesh file"),
        ("poisson = 0.3", "poison = 0.3", "scene.toml:4:"),
        ("poisson = 0.3", "poison = 0.3", "did you mean `poisson`?"),
        ("generate = {", "generat = {", "did you mean `generate`?"),
        ("group = \"xmin\"", "gruop = \"xmin\"", "did you mean `group`?"),
        ("grab = \"fixed\"", "grab = \"fixt\"", "did you mean `fixed`?"),
        ("generate = { block = { size = [1.0, 1.0, 1.0], cells = [2, 2, 2] } }", "", "one of the two"),
        ("material", "tetrahedralise = { cell = 0.1 }\nmaterial", "only a surface file (.stl, .obj, .ply)"),
        (
            "generate = { block = { size = [1.0, 1.0, 1.0], cells = [2, 2, 2] } }",
            "mesh = \"a.stl\"\ntetrahedralise = { cell = -0.1 }",
            "body.block.tetrahedralise: cell is -0.1 m",
        ),
        (
            "material",
            "solver = { method = \"pcg\", tolerance = 0.5 }\nmaterial",
            "body.block.solver: tolerance 0.5 must lie between 1e-14 and 1e-3",
        ),
        ("material", "refine = 5\nmaterial", "body.block.refine: 5 refinements"),
        (
            "material",
            "storage = { error = 1e-6 }\nmaterial",
            "body.block.storage: error = 1e-6 must lie between 1.6e-5",
        ),
        ("material", "storage = { eror = 1e-3 }\nmaterial", "scene.toml:4:"),
        ("material", "refine = -1\nmaterial", "scene.toml:4:"),
        ("material", "solver = \"pcg\"\nmaterial", "expected a table like { method = \"pcg\" }"),
        (
            "material",
            "thermal = 20\nmaterial",
            "expected a table like { expansion = 1.2e-5, difference = 20.0 }",
        ),
        (
            "[body.block]",
            "refine = 1\n[body.block]",
            ":2:1: `refine` is a key of a body: it belongs below [body.NAME]",
        ),
        ("[body.block]", "refin = 1\n[body.block]", "unknown field `refin`, expected one of `stage`"),
    ] {
        let text = error(from, to);
        assert!(text.contains(expected), "{text}\nlacks {expected}");
    }
}

proptest::proptest! {
    #[test]
    fn no_text_makes_it_panic(text in ".*", at in 0..BLOCK.len(), cut in proptest::bool::ANY) {
        let rest = if cut { "" } else { &BLOCK[at..] };
        for text in [text.clone(), format!("{}{text}{rest}", &BLOCK[..at])] {
            if let Err(error) = Scene::parse(&text, Path::new("scene.toml")) {
                proptest::prop_assert!(error.to_string().starts_with("scene.toml"), "{error}");
            }
        }
    }
}
