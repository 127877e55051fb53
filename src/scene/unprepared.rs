//! The advice for a change for which a body was not prepared: the lines to write into its scene.

use super::Body;
use super::updates::Updates;
use crate::config::unknown_name;

impl Body {
    /// Why the body, of this name, cannot let go of a control element that its `updates` do not list.
    pub fn cannot_release(&self, name: &str, control: &str) -> String {
        let loose = self.updates.iter().flat_map(Updates::loose);
        let all: Vec<&str> = self.control.keys().map(String::as_str).chain(loose).collect();
        if !all.contains(&control) {
            return format!("body.{name}: {}", unknown_name("control element", control, all.into_iter()));
        }
        if all.len() == 1 {
            return format!(
                "{name}.{control} is the body's only control element: nothing would hold the body"
            );
        }
        let mut updates = self.updates.clone().unwrap_or_default();
        updates.release.push(control.to_owned());
        format!(
            "{name}.{control} was not prepared to be released: write {} into [body.{name}]",
            updates.written()
        )
    }

    /// Why a modulus cannot be changed that the `updates` of the body, of this name, do not list. That the mesh has the region
    /// is not looked at.
    pub fn cannot_change(&self, name: &str, region: &str) -> String {
        let mut updates = self.updates.clone().unwrap_or_default();
        updates.modulus.push(region.to_owned());
        let table = match self.region.contains_key(region) {
            true => String::new(),
            false => format!(
                ", and give the region a table of its own: [body.{name}.region.{}] with young = {:?}, poisson = {:?}, \
                 as it has now",
                written_key(region),
                self.material.young,
                self.material.poisson
            ),
        };
        format!(
            "the modulus of {name}.{region} was not prepared to be changed: write {} into [body.{name}]{table}",
            updates.written()
        )
    }
}

impl Updates {
    /// The table as a scene file has it.
    fn written(&self) -> String {
        let lists = [("release", &self.release), ("modulus", &self.modulus), ("released", &self.released)];
        let of_list = |(key, names): (&str, &Vec<String>)| {
            let names: Vec<String> =
                names.iter().map(|name| toml::Value::from(name.as_str()).to_string()).collect();
            (!names.is_empty()).then(|| format!("{key} = [{}]", names.join(", ")))
        };
        let lists: Vec<String> = lists.into_iter().filter_map(of_list).collect();
        format!("updates = {{ {} }}", lists.join(", "))
    }
}

/// A key of TOML, in quotes where it needs them.
fn written_key(key: &str) -> String {
    let is_bare = |c: char| c.is_ascii_alphanumeric() || c == '_' || c == '-';
    match !key.is_empty() && key.chars().all(is_bare) {
        true => key.to_owned(),
        false => toml::Value::from(key).to_string(),
    }
}

#[cfg(test)]
mod tests {
    use crate::scene::Scene;
    use std::path::Path;

    const HEAD: &str = "[body.cube]\ngenerate = { block = { size = [1, 1, 1], cells = [2, 2, 2] } }\n\
                        material = { young = 1.0e5, poisson = 0.3 }\nregion.2 = { young = 2.0, poisson = 0.0 }\n";
    const CONTROLS: &str = "control.base = { nodes = { group = \"xmin\" }, grab = \"fixed\" }\n\
                            control.top = { nodes = { group = \"xmax\" }, grab = \"dragger\" }\n";

    fn scene(updates: &str, controls: &str) -> Scene {
        Scene::parse(&format!("{HEAD}{updates}\n{controls}"), Path::new("any.toml")).unwrap()
    }

    /// The `updates = { … }` of an answer.
    fn advice(answer: &str) -> &str {
        let from = answer.find("updates = {").unwrap();
        &answer[from..=from + answer[from..].find('}').unwrap()]
    }

    #[test]
    fn the_remedy_keeps_what_is_listed_and_the_scene_takes_it() {
        let updates = "updates = { release = [\"top\"], modulus = [\"2\"] }";
        let body = &scene(updates, CONTROLS).body["cube"];
        let told = body.cannot_release("cube", "base");
        let whole = "updates = { release = [\"top\", \"base\"], modulus = [\"2\"] }";
        assert_eq!(advice(&told), whole, "{told}");
        scene(whole, CONTROLS);
        let told = body.cannot_change("cube", "1");
        let whole = "updates = { release = [\"top\"], modulus = [\"2\", \"1\"] }";
        assert_eq!(advice(&told), whole, "{told}");
        assert!(told.contains("[body.cube.region.1] with young = 100000.0, poisson = 0.3"), "{told}");
        scene(&format!("{whole}\nregion.1 = {{ young = 100000.0, poisson = 0.3 }}"), CONTROLS);
        let told = scene("", CONTROLS).body["cube"].cannot_change("cube", "2");
        assert!(told.ends_with("updates = { modulus = [\"2\"] } into [body.cube]"), "{told}");
    }

    #[test]
    fn a_slip_is_answered_with_the_nearest_name_and_the_only_element_with_what_would_follow() {
        let told = scene("", CONTROLS).body["cube"].cannot_release("cube", "tp");
        assert_eq!(
            told,
            "body.cube: unknown control element \"tp\" (known: base, top); did you mean \"top\"?"
        );
        let one = "control.base = { nodes = { group = \"xmin\" }, grab = \"fixed\" }\n";
        let told = scene("", one).body["cube"].cannot_release("cube", "base");
        assert!(told.ends_with("nothing would hold the body"), "{told}");
    }

    #[test]
    fn where_all_are_released_it_is_said_that_nothing_holds_the_body() {
        let mut scene = scene("updates = { release = [\"base\", \"top\"] }", CONTROLS);
        let body = &mut scene.body["cube"];
        assert!(body.release("base") && body.release("top"));
        let told = scene.checked().unwrap_err().to_string();
        assert!(told.contains("base, top") && told.contains("nothing would hold the body"), "{told}");
    }
}
