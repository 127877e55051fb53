//! Checks which settings of a body go with boundary elements, and which do not.

use super::Body;
use super::method::Method;
use crate::fem::Element;
use crate::mesh::surface_files::is_surface_file;
use crate::solve::Solver;

const LOAD: &str = "is a load, which is computed in tetrahedra";

impl Body {
    /// Whether its mesh file is taken as the surface that it is.
    pub(super) fn is_surface(&self) -> bool {
        self.method == Method::Bem && self.mesh.as_deref().is_some_and(is_surface_file)
    }

    /// Name of the element in the body's .green file.
    pub fn element_name(&self) -> &'static str {
        match self.method {
            Method::Fem => self.element.name,
            Method::Bem => self.method.name(),
        }
    }

    /// Errors name the key below the body and what is wrong with it.
    pub(super) fn check_method(&self) -> Result<(), (&'static str, String)> {
        if self.method == Method::Fem {
            return match self.longest_edge {
                None => Ok(()),
                Some(_) => Err((
                    "longest_edge",
                    "cuts the triangles of boundary elements: write method = \"bem\", or leave it out and take refine for \
                     tetrahedra"
                        .to_owned(),
                )),
            };
        }
        if let Some(edge) = self.longest_edge
            && !(edge > 0.0 && edge.is_finite())
        {
            return Err(("longest_edge", format!("{edge} m: a positive length is needed")));
        }
        let needs_inside = [
            (
                "tetrahedralise",
                self.tetrahedralise.is_some(),
                "fills the body with tetrahedra, and boundary elements need none",
            ),
            (
                "element",
                self.element != <&Element>::default(),
                "is one of tetrahedra, and boundary elements have none",
            ),
            (
                "region",
                !self.region.is_empty(),
                "is a part of the inside, and boundary elements know one material throughout",
            ),
            (
                "solver",
                self.solver != Solver::default(),
                "is for sparse matrices, and those of boundary elements are full",
            ),
            ("parts", self.parts.is_some(), "cuts the inside, and boundary elements have none"),
            (
                "surface_compliance",
                self.surface_compliance.is_some(),
                "needs the matrix of the inside, and boundary elements have none",
            ),
            ("gravity", self.gravity.is_some(), LOAD),
            ("centrifugal", self.centrifugal.is_some(), LOAD),
            ("thermal", self.thermal.is_some(), LOAD),
            ("load", !self.load.is_empty(), LOAD),
            ("accuracy", self.accuracy.is_some(), "chooses among elements of tetrahedra"),
            ("budget", self.budget.is_some(), "chooses among elements of tetrahedra"),
        ];
        match needs_inside.into_iter().find(|(_, is_there, _)| *is_there) {
            None => Ok(()),
            Some((key, _, why)) => Err((key, format!("{why}: leave it out, or leave out method = \"bem\""))),
        }
    }
}

#[cfg(test)]
mod tests {
    use crate::scene::{Method, Scene};
    use std::path::Path;

    fn scene(lines: &str) -> Result<Scene, String> {
        let text = format!(
            "[body.a]\nmesh = \"a.stl\"\nmaterial = {{ young = 1.0, poisson = 0.0 }}\n{lines}\n\
             control.low = {{ nodes = {{ box = {{ min = [0, 0, 0], max = [1, 1, 1] }} }}, grab = \"fixed\" }}\n"
        );
        Scene::parse(&text, Path::new("any.toml")).map_err(|error| error.to_string())
    }

    #[test]
    fn what_boundary_elements_do_not_have_is_named() {
        let read = scene("method = \"bem\"\nlongest_edge = 0.1\nrefine = 1").unwrap();
        assert_eq!((read.body["a"].method, read.body["a"].element_name()), (Method::Bem, "bem"));
        assert_eq!(scene("").unwrap().body["a"].method, Method::Fem);
        for (lines, expected) in [
            ("longest_edge = 0.1", "body.a.longest_edge: cuts the triangles of boundary elements"),
            ("method = \"bem\"\nlongest_edge = -0.1", "body.a.longest_edge: -0.1 m: a positive length"),
            ("method = \"bem\"\ntetrahedralise = { cell = 0.1 }", "body.a.tetrahedralise: fills the body"),
            ("method = \"bem\"\nelement = \"tet10\"", "body.a.element: is one of tetrahedra"),
            ("method = \"bem\"\nregion.1 = \"steel\"", "body.a.region: is a part of the inside"),
            ("method = \"bem\"\nsolver = { method = \"pcg\" }", "body.a.solver: is for sparse matrices"),
            ("method = \"bem\"\ngravity = true", "body.a.gravity: is a load"),
            (
                "method = \"bem\"\nsurface_compliance = { nodes = \"surface\" }",
                "body.a.surface_compliance: needs",
            ),
            ("method = \"bm\"", "unknown variant `bm`, expected `fem` or `bem`"),
        ] {
            let error = scene(lines).unwrap_err();
            assert!(error.contains(expected), "{lines}: {error}");
        }
    }
}
