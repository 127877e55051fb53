//! Contact forces: a complementarity problem with Coulomb's cone.
//!
//! In: for n contacts, each with a normal and two tangents, the compliance W, 3n × 3n, m/N, the displacements d₀ without forces, m (normal: the
//! gap; tangential: the slip), and a coefficient of friction μ of each. Out: forces f, N, with
//!
//! ```text
//! d = W f + d₀      0 ≤ d_n ⊥ f_n ≥ 0      |f_t| ≤ μ f_n,  f_t = -μ f_n d_t/|d_t| where d_t ≠ 0
//! ```
//!
//! Block Gauss–Seidel sweeps, each contact solved by itself (M. Jean, The non-smooth contact dynamics method, Computer Methods in
//! Applied Mechanics and Engineering 177, 1999, 235-257), find out which contacts are open, stick or slip. They converge slowly where a
//! soft body moves as a whole, and where contacts depend on one another. Where fewer sweeps than a Newton step costs would not do, such
//! steps for the equations of these states are taken (P. Alart and A. Curnier, the same journal 92, 1991, 353-375). Each is followed by
//! a few sweeps, which mend what it does to single contacts, and shortened until the conditions are missed by less than before.
//!
//! Of W only the columns of contacts that were pressed once are computed, and a sweep costs nothing for contacts that stay open: of a flat
//! body that falls onto a floor hundreds of nodes reach it, and few of them carry it.

mod compliance;
mod newton;
mod problem;
mod single;
#[cfg(test)]
mod tests;

pub use compliance::Compliance;
pub use problem::{Cone, Reached};
pub use single::{single, within};
