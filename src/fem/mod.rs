//! The finite element method: tetrahedra and material constants in, the stiffness matrix K of K u = f out.
//!
//! The elements of [`ELEMENTS`] are linear tetrahedra (Zienkiewicz and Taylor, The Finite Element Method, vol. 1, 5th ed.,
//! section 6.2), the same with nodal pressures, and quadratic tetrahedra; K is kept in 3×3 blocks on the nodes and edges
//! of the mesh (the paper's figure 4). At large strain they have a law of [`LAWS`], and K is their tangent.

mod anp;
mod assembly;
mod corotational;
mod cubic;
pub mod dense_fields;
mod element;
mod elements;
mod energy;
mod free_face;
mod hyperelastic;
mod lame;
mod law;
mod laws;
mod loads;
mod mass;
mod neo_hookean;
mod polar;
mod products;
pub mod quadrature;
mod quartic;
mod rest_points;
mod series;
mod stiffness;
mod strain_points;
mod stvk;
pub mod tet10;
pub mod tet4;
mod volume_forms;

pub use anp::TET4_ANP;
pub use assembly::{AssemblyError, ElementSet, Elements, Partition, assemble_elements};
pub use corotational::COROTATIONAL;
pub use cubic::cubic_energy;
pub use element::{Dilatation, Element};
pub use elements::{ELEMENTS, find_element};
pub use energy::{Strains, mutual_energies};
pub use free_face::{FreeFace, hooke as hooke_at_free_face};
pub use hyperelastic::Hyperelastic;
pub use lame::Lame;
pub use law::{Law, Tangent};
pub use laws::LAWS;
pub use loads::{Area, FacePoint, body_force, expansion, free_expansion, traction};
pub use mass::consistent_mass;
pub use neo_hookean::NEO_HOOKEAN;
pub use polar::{Polar, nearest_turn};
pub use quartic::QuarticShape;
pub use rest_points::{RestPoint, RestPoints};
pub use stiffness::{NodeFields, StiffnessMatrix};
pub use strain_points::{Means, StrainPoints};
pub use stvk::STVK;
pub use tet4::TET4;
pub use tet10::TET10;
pub use volume_forms::CubicShape;
