//! The loads of a body: all that its keys list.
//!
//! In: a [`Body`]. Out: its [`LoadEntry`]s in the order in which their columns stand, its selections of nodes, and what is wrong
//! with a key.

use super::loads::{
    CENTRIFUGAL, Centrifugal, GRAVITY, Gravity, KeptForm, LARGEST_NUMBER, LoadEntry, LoadKind, LoadSource,
    LoadValue, SurfaceCompliance, SurfaceNodes, THERMAL, Take, Thermal, Whole,
};
use super::{Body, Method, Nodes};
use std::path::{Path, PathBuf};

impl Body {
    /// Gives its whole surface a compliance where the scene says nothing of one: by the factor, where the solver has one that can be
    /// kept.
    pub fn be_pressed(&mut self) {
        if self.surface_compliance.is_some() || self.method == Method::Bem {
            return;
        }
        let usual = KeptForm::default();
        let kept = if self.solver.method.keeps_factor { KeptForm::Factor } else { usual };
        let nodes = SurfaceNodes::All(Whole::Surface);
        self.surface_compliance =
            Some(SurfaceCompliance { nodes, take: Take::default(), spring: None, kept, is_added: true });
    }

    /// Takes back what [`Body::be_pressed`] added, so that another choice of effects does not keep it.
    pub fn forget_added(&mut self) {
        self.surface_compliance.take_if(|compliance| compliance.is_added);
    }

    /// The coefficients of a load's columns for numbers as pose files and scripts write them: rad/s of a centrifugal load, kelvins of
    /// warmth. The error says what to write.
    pub fn load_coefficients(&self, load: &LoadEntry<'_>, numbers: &[f64]) -> Result<Vec<f64>, String> {
        let columns = load.source.columns();
        if numbers.len() != columns || numbers.iter().any(|x| x.is_nan() || x.abs() > LARGEST_NUMBER) {
            let what = if columns == 3 { "three finite numbers, [x, y, z]," } else { "one finite number" };
            return Err(format!("write {what} of at most {LARGEST_NUMBER:e}"));
        }
        Ok(match load.source {
            LoadSource::Centrifugal(_) => vec![numbers[0].powi(2)],
            LoadSource::Thermal => vec![self.thermal.map_or(0.0, |thermal| thermal.expansion) * numbers[0]],
            LoadSource::Gravity | LoadSource::Pattern(_) => numbers.to_vec(),
        })
    }

    /// All its loads, in the order of their columns.
    pub fn loads(&self) -> Vec<LoadEntry<'_>> {
        let mut all = Vec::new();
        if let Some(acceleration) = self.gravity.and_then(Gravity::in_room) {
            all.push(LoadEntry { name: GRAVITY, source: LoadSource::Gravity, start: acceleration.to_vec() });
        }
        if let Some(centrifugal) = &self.centrifugal {
            let source = LoadSource::Centrifugal(centrifugal);
            all.push(LoadEntry { name: CENTRIFUGAL, source, start: vec![centrifugal.speed.powi(2)] });
        }
        if let Some(thermal) = &self.thermal {
            let start = vec![thermal.expansion * thermal.difference];
            all.push(LoadEntry { name: THERMAL, source: LoadSource::Thermal, start });
        }
        for (name, load) in &self.load {
            let source = LoadSource::Pattern(load);
            let start = load.value.map_or(vec![0.0; source.columns()], |value| value.numbers().to_vec());
            all.push(LoadEntry { name, source, start });
        }
        all
    }

    /// This body without loads, for measurements that compare models.
    pub fn unloaded(&self) -> Body {
        Body {
            gravity: None,
            centrifugal: None,
            thermal: None,
            load: Default::default(),
            surface_compliance: None,
            ..self.clone()
        }
    }

    /// Every selection of nodes in the body's keys, with its key below the body.
    pub fn selections(&self) -> Vec<(String, &Nodes)> {
        let controls = self.control.iter().map(|(name, c)| (format!("control.{name}.nodes"), &c.nodes));
        let loads = self.load.iter().map(|(name, load)| (format!("load.{name}.nodes"), &load.nodes));
        let compliance = self.surface_compliance.iter().filter_map(|of| of.nodes.selection());
        let compliance = compliance.map(|nodes| ("surface_compliance.nodes".to_owned(), nodes));
        controls.chain(loads).chain(compliance).collect()
    }

    /// Every file that its selections and loads name, with its key below the body; relative to the scene.
    pub fn files(&self) -> Vec<(String, &Path)> {
        let lists = self.selections().into_iter().filter_map(|(key, nodes)| match nodes {
            Nodes::File(path) => Some((key, path.as_path())),
            _ => None,
        });
        let fields = self.load.iter().filter_map(|(name, load)| {
            Some((format!("load.{name}.direction"), load.direction.as_ref()?.file.as_path()))
        });
        lists.chain(fields).collect()
    }

    /// Every path of the body, relative to the scene, those of released control elements too.
    pub(super) fn paths_mut(&mut self) -> Vec<&mut PathBuf> {
        let controls = self.control.values_mut().map(|control| &mut control.nodes);
        let loose = self.updates.iter_mut().flat_map(|updates| &mut updates.loose);
        let compliance = self.surface_compliance.iter_mut().filter_map(|of| match &mut of.nodes {
            SurfaceNodes::All(Whole::Surface) => None,
            SurfaceNodes::Some(nodes) => Some(nodes),
        });
        let mut selections: Vec<&mut Nodes> =
            controls.chain(loose.map(|(.., control)| &mut control.nodes)).collect();
        selections.extend(compliance);
        let image = self.texture.iter_mut().map(|texture| &mut texture.image);
        let mut paths: Vec<&mut PathBuf> = self.mesh.iter_mut().chain(image).collect();
        for load in self.load.values_mut() {
            selections.push(&mut load.nodes);
            paths.extend(load.direction.iter_mut().map(|direction| &mut direction.file));
        }
        paths.extend(selections.into_iter().filter_map(|nodes| match nodes {
            Nodes::File(path) => Some(path),
            _ => None,
        }));
        paths
    }

    /// Errors name the key below the body and what is wrong with it.
    pub(super) fn check_loads(&self) -> Result<(), (String, String)> {
        check(self)
    }
}

fn check(body: &Body) -> Result<(), (String, String)> {
    let wrong = |key: &str, message: String| Err((key.to_owned(), message));
    let finite = |values: &[f64]| values.iter().all(|value| value.is_finite() && value.abs() <= 1e12);
    let is_axis = |axis: &[f64; 3]| finite(axis) && axis.iter().any(|x| x.abs() > 1e-12);
    let acceleration = body.gravity.and_then(Gravity::in_room);
    if let Some(acceleration) = acceleration.filter(|acceleration| !finite(acceleration)) {
        return wrong(GRAVITY, format!("{acceleration:?} is no acceleration: three finite numbers, m/s²"));
    }
    if let Some(Centrifugal { axis, point, speed }) = &body.centrifugal
        && !(is_axis(axis) && finite(point) && finite(&[*speed]))
    {
        let message =
            "axis must be a direction that is not zero, point three numbers (m), speed a number (rad/s)";
        return wrong(CENTRIFUGAL, message.to_owned());
    }
    if (acceleration.is_some() || body.centrifugal.is_some())
        && body.materials().any(|material| material.density.is_none())
    {
        let key = if acceleration.is_some() { GRAVITY } else { CENTRIFUGAL };
        let message = "needs the density of every material of the body: write density = 1000 (kg/m³) into it, or name a \
                       material of `greenstage manual materials`";
        return wrong(key, message.to_owned());
    }
    if let Some(Thermal { expansion, difference }) = &body.thermal
        && !(finite(&[*expansion, *difference]) && (expansion * difference).abs() <= 1.0)
    {
        let message = format!(
            "expansion {expansion} (1/K) times difference {difference} (K) must be a strain between -1 and 1; steel expands by \
             1.2e-5 a kelvin"
        );
        return wrong(THERMAL, message);
    }
    for (name, load) in &body.load {
        let key = format!("load.{name}");
        // A column `left.tx` is that of a control element.
        if name.contains(['/', '.']) || [GRAVITY, CENTRIFUGAL, THERMAL].contains(&name.as_str()) {
            return wrong(
                &key,
                "the name must contain neither '/' nor '.', and not be that of a body load".to_owned(),
            );
        }
        load.nodes.check().map_err(|message| (key.clone(), message))?;
        if load.axis.as_ref().is_some_and(|axis| !is_axis(axis)) {
            return wrong(&key, "axis must be a direction that is not zero".to_owned());
        }
        if let Some(direction) = &load.direction {
            if load.kind != LoadKind::Direction || load.axis.is_some() {
                let message =
                    "direction = { file = … } belongs to kind = \"direction\", in place of its axis";
                return wrong(&key, message.to_owned());
            }
            if direction.array.is_some() && !direction.is_vtu() {
                return wrong(
                    &key,
                    "direction: only a .vtu file has arrays by name: leave array out".to_owned(),
                );
            }
        }
        match (load.kind, load.axis) {
            (LoadKind::Direction, None) if load.direction.is_none() => {
                let message = "kind = \"direction\" needs its direction: axis = [0, 0, 1], or direction = { file = \"wind.csv\" }";
                return wrong(&key, message.to_owned());
            }
            (LoadKind::Shift | LoadKind::Pressure, Some(_)) => {
                let message = format!("kind = \"{}\" has no axis: leave it out", load.kind.name());
                return wrong(&key, message);
            }
            _ => {}
        }
        let columns = LoadSource::Pattern(load).columns();
        let is_fit = |value: &LoadValue| value.numbers().len() == columns && finite(value.numbers());
        if load.value.as_ref().is_some_and(|value| !is_fit(value)) {
            let what = if columns == 3 { "three finite numbers, [x, y, z]" } else { "one finite number" };
            return wrong(&key, format!("the value of a {} is {what}", load.kind.name()));
        }
    }
    let spring = body.surface_compliance.as_ref().and_then(|of| of.spring);
    if let Some(spring) = spring.filter(|spring| !(*spring > 0.0 && spring.is_finite())) {
        return wrong("surface_compliance", format!("spring is {spring} N/m: a positive number is needed"));
    }
    if let Some(asked) = &body.surface_compliance {
        asked.kept.check().map_err(|message| ("surface_compliance".to_owned(), message))?;
        let method = body.solver.method;
        if asked.kept == KeptForm::Factor && !method.keeps_factor {
            let message = format!(
                "kept = \"factor\" needs a factor in f64, not that of method = \"{}\": write solver = {{ method \
                 = \"cholesky\" }}, or kept = \"inverse\"",
                method.name
            );
            return wrong("surface_compliance", message);
        }
    }
    if let Some(nodes) = body.surface_compliance.as_ref().and_then(|of| of.nodes.selection()) {
        nodes.check().map_err(|message| ("surface_compliance".to_owned(), message))?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use crate::scene::Scene;
    use crate::scene::loads::STANDARD_GRAVITY;
    use std::path::Path;

    const BLOCK: &str = "[body.a]\ngenerate = { block = { size = [1, 1, 1], cells = [2, 2, 2] } }\n\
                         material = { young = 1.0, poisson = 0.0, density = 1000 }\nKEYS\n\
                         [body.a.control.low]\nnodes = { group = \"xmin\" }\ngrab = \"fixed\"\n";

    fn scene(keys: &str) -> Result<Scene, String> {
        Scene::parse(&BLOCK.replace("KEYS", keys), Path::new("any.toml")).map_err(|error| error.to_string())
    }

    #[test]
    fn loads_come_in_the_order_of_their_columns_with_what_they_start_from() {
        let scene = scene(
            "load.b = { nodes = { group = \"xmax\" }, kind = \"shift\", value = [1, 2, 3] }\n\
             load.a = { nodes = { group = \"xmax\" }, kind = \"pressure\" }\n\
             gravity = true\ncentrifugal = { axis = [0, 0, 1], speed = 3 }\n\
             thermal = { expansion = 1e-5, difference = 20 }\nsurface_compliance = { nodes = \"surface\" }",
        )
        .unwrap();
        let loads = scene.body["a"].loads();
        let found: Vec<(&str, usize, Vec<f64>)> =
            loads.iter().map(|load| (load.name, load.source.columns(), load.start.clone())).collect();
        assert_eq!(
            found,
            [
                ("gravity", 3, vec![0.0, -STANDARD_GRAVITY, 0.0]),
                ("centrifugal", 1, vec![9.0]),
                ("thermal", 1, vec![1e-5 * 20.0]),
                ("b", 3, vec![1.0, 2.0, 3.0]),
                ("a", 1, vec![0.0]),
            ]
        );
        assert_eq!(scene.body["a"].selections().len(), 3);
        assert!(self::scene("gravity = false").unwrap().body["a"].loads().is_empty());
    }

    #[test]
    fn mistakes_name_the_key_and_the_remedy() {
        let pattern = |rest: &str| format!("load.p = {{ nodes = {{ group = \"xmax\" }}, {rest} }}");
        for (keys, expected) in [
            ("gravity = [0, nan, 0]".to_owned(), "body.a.gravity: "),
            ("gravity = \"down\"".to_owned(), "expected true, false, or an acceleration"),
            ("centrifugal = { axis = [0, 0, 0], speed = 1 }".to_owned(), "body.a.centrifugal: axis must be"),
            ("thermal = { expansion = 1, difference = 20 }".to_owned(), "must be a strain between -1 and 1"),
            (pattern("kind = \"push\""), "unknown variant `push`"),
            (pattern("kind = \"direction\""), "body.a.load.p: kind = \"direction\" needs"),
            (pattern("kind = \"pressure\", axis = [1, 0, 0]"), "has no axis"),
            (pattern("kind = \"shift\", value = 1.0"), "the value of a shift is three finite numbers"),
            (pattern("kind = \"twist\", value = [1, 2, 3]"), "the value of a twist is one finite number"),
            (pattern("kind = \"twist\", axis = [0, 0, 0]"), "axis must be a direction"),
            (
                "load.gravity = { nodes = { group = \"xmax\" }, kind = \"twist\" }".to_owned(),
                "body.a.load.gravity",
            ),
            (
                "surface_compliance = { nodes = \"inside\" }".to_owned(),
                "expected \"surface\", or a selection",
            ),
            (
                "surface_compliance = { nodes = \"surface\", kept = { error = 1.0 } }".to_owned(),
                "body.a.surface_compliance: kept = { error = 1e0 } must lie between 1e-6 and 1e-2",
            ),
            (
                "surface_compliance = { nodes = \"surface\", kept = \"factor\" }\nsolver = { method = \"pcg\" }".to_owned(),
                "body.a.surface_compliance: kept = \"factor\" needs a factor in f64, not that of method = \"pcg\"",
            ),
            (
                "surface_compliance = { nodes = \"surface\", kept = \"half\" }".to_owned(),
                "unknown variant `half`",
            ),
        ] {
            let error = scene(&keys).unwrap_err();
            assert!(error.starts_with("any.toml") && error.contains(expected), "{keys}: {error}");
        }
        let text = BLOCK.replace(", density = 1000", "").replace("KEYS", "gravity = true");
        let error = Scene::parse(&text, Path::new("any.toml")).unwrap_err().to_string();
        assert!(error.contains("body.a.gravity: needs the density"), "{error}");
    }
}
