//! The parameters of a setting, one entry each: its name in tables, its value, and the part of the error that it makes.

use super::data::{Errors, Setting, Spread};

/// A choice that can be made for a body.
pub struct Parameter {
    /// Heads its column in tables.
    pub name: &'static str,
    pub value: fn(&Setting) -> String,
    /// The part of the error that it makes.
    pub part: &'static str,
    /// `None` where it was not measured.
    pub error: fn(&Errors) -> Option<Spread>,
}

pub const MESH: Parameter = Parameter {
    name: "mesh and element",
    value: Setting::mesh,
    part: "discretisation",
    error: |error| Some(error.discretisation),
};
pub const SOLVER: Parameter = Parameter {
    name: "solver",
    value: |setting| setting.solver.to_string(),
    part: "solver",
    error: |error| Some(error.solver),
};
pub const STORAGE: Parameter = Parameter {
    name: "storage",
    value: |setting| setting.storage.clone(),
    part: "storage",
    error: |error| error.storage,
};
pub const MODEL: Parameter = Parameter {
    name: "model",
    value: |setting| setting.model.name.to_owned(),
    part: "model",
    error: |error| Some(error.model),
};

/// The parts of the error are independent: each entry can be changed alone.
pub const PARAMETERS: [Parameter; 4] = [MESH, SOLVER, STORAGE, MODEL];

impl Setting {
    /// The value of each of [`PARAMETERS`].
    pub fn values(&self) -> [String; PARAMETERS.len()] {
        PARAMETERS.map(|parameter| (parameter.value)(self))
    }
}

impl std::fmt::Display for Setting {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(&self.values().join(" · "))
    }
}

impl Errors {
    /// The part that each of [`PARAMETERS`] makes.
    pub fn parts(&self) -> [Option<Spread>; PARAMETERS.len()] {
        PARAMETERS.map(|parameter| (parameter.error)(self))
    }

    /// Index into [`PARAMETERS`] of the one whose part has the largest median. `None` where all are zero.
    pub fn dominating(&self) -> Option<usize> {
        let medians = self.parts().map(|part| part.map_or(0.0, |part| part.median));
        (0..medians.len()).filter(|&i| medians[i] > 0.0).max_by(|&a, &b| medians[a].total_cmp(&medians[b]))
    }

    /// Name of the largest part.
    pub fn largest_part(&self) -> &'static str {
        self.dominating().map_or("none", |i| PARAMETERS[i].part)
    }
}
