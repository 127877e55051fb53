//! Real-time elastic bodies in virtual environments: finite elements and precomputed Green's functions.
//!
//! "The paper" is I. Nikitin, L. Nikitina, P. Frolov, G. Goebbels, M. Göbel, S. Klimenko and G. M. Nielson, "Real-time
//! simulation of elastic objects in Virtual Environments using finite element method and precomputed Green's functions".
//!
//! Two stages meet in one file:
//!
//! ```text
//! offline   Scene → Resolved → TetMesh → StiffnessMatrix → A|B|C → Factor → columns → tube.green
//! online    tube.green → Assets, and a Deformer for each body of a World
//!           trackers, keys, script → Input → World::step moves the world by one frame (State is its snapshot) → Frame
//!           Frame → ViewSource (screen × eye) → Presenter
//! ```
//!
//! | question | answer |
//! |---|---|
//! | What is the state of a session between two frames? | [`world::State`], plain data; [`world::World::state`] takes it, [`world::World::set_state`] continues from it |
//! | What comes from outside in a frame? | [`world::Input`] and nothing else; a recording is a `State`, followed by one `Input` per frame |
//! | What can a script write? | head, styli and loads: [`session::InputSource::state`] and [`session::InputSource::loads`] put them into the `Input` |
//! | Where would another effect go? | a folder of [`effect`], a line in [`effect::EFFECTS`]; its [`acts`](world::RunningEffect::acts) returns true and its [`solve`](world::RunningEffect::solve) adds coefficients, forces at points, or energy and slopes; its `memory` is part of the `State`. `tests/pictures/breath.rs` is a complete example |
//! | Where would a headset plug in? | one [`display::view_source::ViewSource`] and one [`display::presenter::Presenter`], which [`display::view_source::show`] joins; head and controllers come from a [`track::Source`]. `tests/pictures/headset.rs` shows the views |
//! | How is a new model, element, file format or device added? | a file, and a line in [`deform::MODELS`], [`fem::ELEMENTS`], [`mesh::formats::FORMATS`] or [`track::SOURCES`] respectively |
//!
//! Each module (called a room here) imports only from rooms that stand below it in this table, and there are no import cycles,
//! not even between two files.
//!
//! | room | what it holds |
//! |---|---|
//! | [`cli`] | one file per subcommand (its arguments, one call, the printed result), and the helpers that they share |
//! | [`demo`] | the demo's chapters, in one captioned window, or as pictures and a film |
//! | [`display`] | a session on screens or in images: views and presenters, bodies on the GPU, overlays, the stage from outside |
//! | [`edit`] | control elements made with a ray: brush, ball, box, growing; a scene written as a file |
//! | [`tuning`] | chooses element, refinement, storage, solver and model from measurements, for a required accuracy or a given budget |
//! | [`session`] | moves a world frame by frame ([`session::Session::advance`]): input sources, recordings |
//! | [`report`] | the cost of accuracy in time, as table, CSV, JSON, plots and page |
//! | [`verify`] | problems with known answers, and how near the elements come to them; hard cases; studies behind the manual's tables |
//! | [`measure`] | one machinery of comparison: references, variants, poses, norms, times, resumption |
//! | [`export`] | displacements and forces of many poses, as CSV and VTU files |
//! | [`prepare`] | resolves the names in a scene ([`prepare::Resolved`]), and finds its .green file, or makes it where it is missing or stale |
//! | [`effect`] | opt-in effects, each with all its parts: precomputation, phases of a frame, drawing, threads; an effect that no scene lists costs nothing |
//! | [`world`] | everything that moves in one frame: bodies at their places, hands, the graph of fields; [`world::State`] is all that changes, [`world::Frame`] all that is shown |
//! | [`deform`] | deformation models: control poses → coefficients → displacements; pose files |
//! | [`interact`] | pick ray and reach, hands that hold, modes, history, navigation |
//! | [`green`] | the precomputed columns and the .green file |
//! | [`scene`] | the contents of a scene: bodies, materials, control elements, model, effects |
//! | [`bem`] | boundary elements: the columns of a homogeneous body from its surface alone |
//! | [`solve`] | ordering, Cholesky, PCG, one minimiser for all equilibria ([`solve::minimise`](solve::minimise())) |
//! | [`fem`] | elements, material laws, assembly → `StiffnessMatrix`, partition into A, B, C |
//! | [`track`] | where poses come from: VRPN, DTrack, OSC, FASTRAK, gamepad, mouse, script |
//! | [`render`] | wgpu: device, shaders, passes, windows, offscreen images |
//! | [`audio`] | sound in the room: amplitude panning over loudspeakers, binaural for headphones, mixer, audio device, WAV files |
//! | [`stage`] | screens, loudspeakers, viewer, off-axis projection, stereo, windows of a stage |
//! | [`field`] | typed fields, connections, evaluated once per frame: the data-flow graph |
//! | [`mesh`] | `TetMesh`, `Surface`, regions, quality, file formats, generators |
//! | [`config`] | strict TOML: every error names file, line and the nearest known key |
//! | [`manual`] | the manual's chapters in Markdown |
//! | [`base`] | plain data and services that several rooms share |
//!
//! The way of a tracker's packet to a pixel; arrows are calls:
//!
//! ```text
//! track     udp::run → Parser::parse → DeviceState::take_pose → StatePublisher::publish_changed   (a thread per tracker)
//! display   Application::frame                                                                    (once a frame)
//! session     Session::advance → InputSource::state → TrackerSet::state (Follower), trackers::merge
//! effect        RunningEffect::input; the Input is whole now, and Recorder::frame writes it after the step
//! world         World::step: commands, then the graph of fields:
//!                 pick, Hands::step, PlacedBody::admit
//! effect          RunningEffect::solve, if an effect acts on bodies
//! deform          Deformer::take → DeformationModel::state, Deformer::respond (energy and forces: the model's and the effects')
//!                 Deformer::deform → Superposition::update, move_parts, SurfaceNormals::write
//! effect          RunningEffect::surface: colours, scales of forces
//! world           World::show_hands → force::held_force → Deformer::wrenches: the force on the hand, and its arrow
//! effect          RunningEffect::show: what is drawn beside the bodies; the Frame is whole now
//! display     ScreenWindows::draw → ViewSource::tiles → window_layout::tiles → World::view → Screen::view
//!               GpuBodies::upload
//!               Overlays::draw → Presenter::present
//! render          TilePainter::draw → Renderer::draw, each of PASSES → TilePainter::join → present
//! ```
//!
//! Conventions: SI units, radians, right-handed, Y up in the stage; transforms are named `a_from_b`;
//! offline arithmetic is f64, online f32.

pub mod audio;
pub mod base;
pub mod bem;
pub mod cli;
pub mod config;
pub mod deform;
pub mod demo;
pub mod display;
pub mod edit;
pub mod effect;
pub mod export;
pub mod fem;
pub mod field;
pub mod green;
pub mod interact;
pub mod manual;
pub mod measure;
pub mod mesh;
pub mod prepare;
pub mod render;
pub mod report;
pub mod scene;
pub mod session;
pub mod solve;
pub mod stage;
pub mod track;
pub mod tuning;
pub mod verify;
pub mod world;
