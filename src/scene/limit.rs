//! Limits of a material, and the field that is shown in colours.

use serde::{Deserialize, Serialize};

/// `limit = { stress = 250e6 }` or `limit = { strain = 0.3 }`.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize, Serialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Limit {
    /// Limit of the von Mises stress, Pa: yield.
    Stress(f64),
    /// Limit of the largest principal strain: elongation at which it yields or tears.
    Strain(f64),
}

impl Limit {
    pub fn value(self) -> f64 {
        match self {
            Limit::Stress(value) | Limit::Strain(value) => value,
        }
    }

    /// Quantity that is limited.
    pub fn quantity(self) -> Quantity {
        match self {
            Limit::Stress(_) => Quantity::VonMises,
            Limit::Strain(_) => Quantity::Strain,
        }
    }

    /// Errors for what cannot be meant.
    pub fn check(self) -> Result<(), String> {
        match self {
            limit if !(limit.value() > 0.0 && limit.value().is_finite()) => {
                Err(format!("{} is no limit: a positive number is needed", limit.value()))
            }
            Limit::Stress(pascal) if pascal < 1.0 => Err(format!(
                "a limit of {pascal} Pa is implausibly low: stresses are in Pa; did you mean {}e6?",
                pascal
            )),
            Limit::Strain(strain) if strain > 10.0 => Err(format!(
                "a strain of {strain} is {} %: strains are ratios; did you mean {}?",
                100.0 * strain,
                strain / 100.0
            )),
            _ => Ok(()),
        }
    }
}

/// A field on the surface of a body.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Quantity {
    #[default]
    VonMises,
    /// The largest principal strain.
    Strain,
    Displacement,
}

impl Quantity {
    /// All quantities, in the order in which a key goes through them.
    pub const ALL: [Quantity; 3] = [Quantity::VonMises, Quantity::Strain, Quantity::Displacement];

    pub fn title(self) -> &'static str {
        match self {
            Quantity::VonMises => "von Mises stress",
            Quantity::Strain => "largest principal strain",
            Quantity::Displacement => "displacement",
        }
    }

    /// SI; nothing of a ratio.
    pub fn unit(self) -> &'static str {
        match self {
            Quantity::VonMises => "Pa",
            Quantity::Strain => "",
            Quantity::Displacement => "m",
        }
    }
}

/// `legend = { show = "strain", to = 0.3 }` of a scene.
#[derive(Clone, Copy, Debug, Default, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct LegendSettings {
    /// Quantity that is shown first; a key shows the others.
    #[serde(default)]
    pub show: Quantity,
    /// The value at the end of the colours, Pa, ratio or m. Without it the limit, else it grows with the session.
    pub to: Option<f64>,
}

impl LegendSettings {
    pub fn check(&self) -> Result<(), String> {
        match self.to {
            Some(to) if !(to > 0.0 && to.is_finite()) => {
                Err(format!("to = {to}: a positive number is needed"))
            }
            _ => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::Scene;
    use std::path::Path;

    fn scene(limit: &str, legend: &str) -> Result<Scene, String> {
        let text = format!(
            "{legend}\n[body.a]\ngenerate = {{ block = {{ size = [1, 1, 1], cells = [2, 2, 2] }} }}\n\
             material = {{ young = 1.0, poisson = 0.0{limit} }}\n\
             control.low = {{ nodes = {{ group = \"xmin\" }}, grab = \"fixed\" }}\n"
        );
        Scene::parse(&text, Path::new("any.toml")).map_err(|error| error.to_string())
    }

    #[test]
    fn limits_and_legends_are_read_and_mistakes_named() {
        let read = scene(", limit = { stress = 250e6 }", "legend = { show = \"strain\", to = 0.1 }").unwrap();
        assert_eq!(read.body["a"].material.limit, Some(Limit::Stress(250e6)));
        assert_eq!(read.legend, Some(LegendSettings { show: Quantity::Strain, to: Some(0.1) }));
        assert_eq!(scene("", "legend = {}").unwrap().legend.unwrap().show, Quantity::VonMises);
        for (limit, legend, expected) in [
            (", limit = { stress = 0.25 }", "", "body.a.material.limit: a limit of 0.25 Pa"),
            (", limit = { strain = 30 }", "", "strains are ratios; did you mean 0.3?"),
            (", limit = { strain = nan }", "", "is no limit"),
            (", limit = { stress = -1.0 }", "", "is no limit"),
            (", limit = { strian = 0.3 }", "", "any.toml:4:"),
            (", limit = { stress = 1.0, strain = 0.3 }", "", "this table takes exactly one of its keys"),
            ("", "legend = { show = \"stress\" }", "any.toml:1:"),
            ("", "legend = { to = 0.0 }", "any.toml: legend: to = 0"),
        ] {
            let error = scene(limit, legend).unwrap_err();
            assert!(error.contains(expected), "{error}\nlacks {expected}");
        }
    }
}
