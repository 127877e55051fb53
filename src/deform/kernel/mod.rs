//! The kernel of a frame: x_i = Σ_p w_ip (R_p (X_i + Σ_k c_k u_i⁽ᵏ⁾) + t_p).
//!
//! In: columns of the .green file, coefficients c of a model, motions R, t of the parts. Out: positions of the surface, its normals,
//! and the stress in it. Each loop has a twin on the graphics device.

pub mod parts;
pub mod superposition;
pub mod surface;
pub mod surface_stress;
