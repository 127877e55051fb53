//! Real-time elastic bodies in virtual environments: finite elements and precomputed Green's functions.
//!
//! Two stages meet in one file:
//!
//! ```text
//! offline   Scene → TetMesh → StiffnessMatrix → A|B|C → Factor → GreenBasis → tube.green
//! online    tube.green → Deformer;  Tracker → PickRay → Hands → c → u → Surface → Stage (screen × eye) → Renderer
//! ```
//!
//! | module | what it holds |
//! |---|---|
//! | [`base`] | plain data and services that several rooms share |
//! | [`config`] | strict TOML: every error names file, line and the nearest known key |
//! | [`mesh`] | `TetMesh`, `Surface`, regions, quality, file formats, generators |
//! | [`stage`] | screens, viewer, off-axis projection |
//! | [`scene`] | what a scene asks for: bodies, materials, control elements, model, effects |
//! | [`fem`] | elements, materials, assembly → `StiffnessMatrix`, partition into A, B, C |
//! | [`solve`] | ordering, Cholesky, PCG → `SolveStats`; Newton's iteration |
//! | [`green`] | the precomputed bases and the .green file |
//! | [`deform`] | deformation models: coefficients → displacements |
//! | [`effect`] | opt-in effects: what no scene lists costs nothing |
//! | [`field`] | typed fields, connections, evaluated once per frame: the data-flow graph |
//! | [`track`] | where poses come from: VRPN, DTrack, OSC, FASTRAK, gamepad, mouse, script → `TrackerState` |
//! | [`interact`] | pick ray and reach, hands that hold, modes, history, navigation |
//! | [`report`] | what accuracy costs in time: measured rows, table, JSON, SVG, page |
//! | [`tuning`] | an asked accuracy or budget → element, refinement, storage, solver, model, chosen by measuring |
//! | [`render`] | wgpu: device, shaders, passes, windows, offscreen images |
//! | [`verify`] | problems with known answers, and how near the elements come to them |
//! | [`cli`] | one file per subcommand |
//! | [`manual`] | the manual's chapters in Markdown; `greenstage manual` prints them |
//!
//! Conventions: SI units, radians, right-handed, Y up in the room; transforms are named `a_from_b`;
//! offline arithmetic is f64, online f32.

pub mod base;
pub mod cli;
pub mod config;
pub mod deform;
pub mod effect;
pub mod fem;
pub mod field;
pub mod green;
pub mod interact;
pub mod manual;
pub mod mesh;
pub mod render;
pub mod report;
pub mod scene;
pub mod solve;
pub mod stage;
pub mod track;
pub mod tuning;
pub mod verify;
