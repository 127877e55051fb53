//! The finite element method: tetrahedra and material constants in, the stiffness matrix K of K u = f out.
//!
//! Elements are linear tetrahedra (Zienkiewicz and Taylor, The Finite Element Method, vol. 1, 5th ed.,
//! section 6.2), the same with nodal pressures, and quadratic tetrahedra; K is kept in 3×3 blocks on the nodes and edges of the mesh (the paper's figure 4).

pub mod anp;
mod assembly;
mod fields;
mod material;
mod partition;
mod stiffness;
pub mod tet10;
pub mod tet4;

pub use assembly::{AssemblyError, Elements, assemble, assemble_anp, assemble_elements};
pub use fields::NodeFields;
pub use material::Lame;
pub use partition::Partition;
pub use stiffness::StiffnessMatrix;
