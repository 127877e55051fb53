//! A forecast of the size of a body's factor and of the time that it takes, from the counts of its mesh alone.
//!
//! In: a mesh and the number of its control elements. Out: a [`Forecast`], which is an estimate and is shown as one. Nested
//! dissection of a body in three dimensions fills c n^{4/3} numbers of n unknowns, less terms of lower order (George, SIAM J.
//! Numer. Anal. 10, 1973; Lipton, Rose and Tarjan, SIAM J. Numer. Anal. 16, 1979). Of cubes of 9,261 to 1,000,000 nodes, c was
//! measured as 11 to 20, near 23 - 340/n^{1/3}. A body with more surface has smaller separators: with s times the surface nodes
//! of a cube, c was 0.77 of the cube's of a bar 250 × 60 × 60 (s = 1.2), 0.54 of a slab (1.6), 0.36 and 0.15 of rods (1.9 and
//! 3.6), 0.24 of a plate (4.6), and never below s^{-1.7}. Beside its numbers the factor takes those of the fronts at work and
//! the solves: 1.45 to 2.0 times its numbers in all. The time of a factor is that of L^{1.5} multiplications, and was measured
//! with a tube and with a box of 28,000 nodes: 0.10 s for 5.0·10⁶ numbers and 3.0 s for some 4.4·10⁷, on one thread.

use super::control::ControlElement;
use crate::base::machine;
use crate::base::table::{bytes, duration};
use crate::bem;
use crate::mesh::{Surface, TetMesh};
use crate::solve::{NUMBER, Solver, without_factor};

/// Numbers of the factor of a compact body: (a - b/n^{1/3}) n^{4/3}.
const COMPACT: [f64; 2] = [23.5, 340.0];
/// Least part of it, for a surface of a cube; the power of the surface's size with which it falls; and least numbers over n^{4/3}.
const LEAST: f64 = 0.75;
const SURFACE_POWER: f64 = -1.7;
const THIN: f64 = 2.3;
/// Memory of the factor with all that is held beside it over that of its numbers, at least and at most.
const BESIDE: [f64; 2] = [1.4, 1.9];
/// Bytes of the program itself.
const PROGRAM: f64 = 20e6;
/// Seconds of the factorization on one thread over L^{1.5}, and how far wrong it may be either way.
const SECONDS: f64 = 1.0e-11;
const SPREAD: f64 = 2.0;
/// Seconds on one thread over L of a solve of one column of many, of the estimates in such columns, and of a column of the
/// inverse at the surface, whose solves stop early.
const COLUMN: f64 = 7e-10;
const JUDGEMENT: f64 = 30.0;
const SURFACE_COLUMN: f64 = 1.5e-10;
/// Numbers of a kept factor over those of the whole, at least and at most: 0.69 of a cube, 0.80 of a tube, 0.85 of a thin plate.
const KEPT: [f64; 2] = [0.6, 0.85];
/// Bytes of a node of a compressed compliance at an error of 1e-3, and what each further decade adds: of a tube of 3,240 nodes.
const COMPRESSED_NODE: [f64; 2] = [1900.0, 1200.0];
/// Factorizations of the tangent for the equilibria of a basis, and seconds on one thread of a tangent and of the quartic over the
/// points of integration: of a tube of 10,080 nodes.
const TANGENTS: f64 = 410.0;
const TANGENT_POINT: f64 = 7e-7;
const QUARTIC_POINT: f64 = 4e-4;
/// Bytes of a node for the fields of all equilibria.
const EQUILIBRIA_NODE: f64 = 4.0 * 24.0 * 193.0;
/// Memory of the compliance while it is made over its bytes.
const WHILE_MADE: f64 = 3.0;
/// Bytes of a tetrahedron and of an unknown's row of K while the body is prepared.
const TETRAHEDRON: f64 = 200.0;
const ROW: f64 = 40.0 * 12.0;
/// Number of unknowns and seconds below which no forecast is shown.
const SMALL: f64 = 30_000.0;
const SHORT: f64 = 20.0;

/// The cost of a body's Cholesky factor, at least and at most.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Forecast {
    pub unknowns: f64,
    /// Numbers in the factor.
    pub factor_entries: [f64; 2],
    /// Memory of the whole offline stage, bytes.
    pub memory: [f64; 2],
    /// Time of the factor and of all columns, s.
    pub seconds: [f64; 2],
    /// Memory with a method that makes no factor, bytes.
    pub iterative_memory: f64,
}

impl Forecast {
    /// A forecast for a mesh with so many control elements. All of its nodes count as unknown: those of control elements are few.
    pub fn new(mesh: &TetMesh, controls: usize) -> Forecast {
        let unknowns = 3.0 * mesh.nodes.len() as f64;
        let columns = 12.0 * controls as f64;
        let base = PROGRAM + TETRAHEDRON * mesh.tets.len() as f64 + (ROW + 16.0 * columns) * unknowns;
        let factor_entries =
            fill(mesh).map(|fill| (fill * unknowns.powf(4.0 / 3.0)).min(unknowns * unknowns / 2.0));
        let threads = rayon::current_num_threads() as f64;
        let time =
            |entries: f64| (SECONDS * entries.powf(1.5) + COLUMN * entries * (columns + JUDGEMENT)) / threads;
        let [thin, compact] = factor_entries.map(time);
        Forecast {
            unknowns,
            factor_entries,
            memory: [0, 1].map(|i| base + 8.0 * BESIDE[i] * factor_entries[i]),
            seconds: [thin / SPREAD, compact * SPREAD],
            iterative_memory: base,
        }
    }

    /// The forecast with the equilibria from which a basis is made, of an element with so many points of integration.
    pub fn with_equilibria(mut self, nodes: usize, points: usize) -> Forecast {
        let (points, threads) = (points as f64, rayon::current_num_threads() as f64);
        let [thin, compact] = self.factor_entries.map(|entries| {
            let tangent = SECONDS * entries.powf(1.5) + TANGENT_POINT * points;
            (TANGENTS * tangent + QUARTIC_POINT * points) / threads
        });
        self.seconds = [self.seconds[0] + thin / SPREAD, self.seconds[1] + compact * SPREAD];
        // Two tangents with their factors for each of the paths that are walked at a time: between one and the number of threads.
        let fields = EQUILIBRIA_NODE * nodes as f64;
        for (i, paths) in [1.0, threads].into_iter().enumerate() {
            let tangents = 2.0 * (ROW * self.unknowns + 8.0 * BESIDE[i] * self.factor_entries[i]);
            self.memory[i] += fields + paths * tangents;
        }
        self
    }

    /// Refused where the body's method surely needs more memory than this machine has, with what would fit.
    pub fn fits(&self, solver: &Solver) -> Result<(), String> {
        let direct = self.memory[0] - self.iterative_memory;
        let need =
            self.iterative_memory + direct * solver.method.factor_number as f64 / size_of::<f64>() as f64;
        let refused = match machine::fits("precomputing", need, 0.0) {
            Ok(()) => return Ok(()),
            Err(refused) => refused,
        };
        let iterative = match machine::fits("", self.iterative_memory, 0.0) {
            Ok(()) => {
                let (name, memory) = (without_factor().name, bytes(self.iterative_memory));
                format!("solver = {{ method = \"{name}\" }}, which takes about {memory}, or ")
            }
            Err(_) => String::new(),
        };
        Err(format!("estimated from its nodes, {refused}: write {iterative}a coarser mesh"))
    }

    /// The cost of `surface_compliance`, from [`super::compliance_size`]: its columns are solved as others are.
    pub fn compliance_told(&self, [nodes, all, size]: [usize; 3]) -> String {
        let columns = 3.0 * nodes as f64;
        let threads = rayon::current_num_threads() as f64;
        let seconds = self.factor_entries.map(|entries| SURFACE_COLUMN * entries * columns / threads);
        let [soon, late] = [seconds[0] / SPREAD, seconds[1] * SPREAD].map(duration);
        let [size, peak] = [1.0, WHILE_MADE].map(|times| bytes(times * size as f64));
        format!(
            "{nodes} of {all} free nodes of the surface take forces: {size} in the file, {peak} of memory, \
             and {} longer while precomputed",
            if soon == late { soon } else { format!("{soon} to {late}") }
        )
    }

    /// The cost with kept = "factor": the numbers on the ways from the surface to the root of the elimination tree.
    pub fn kept_factor_told(&self, [nodes, all, size]: [usize; 3]) -> String {
        let [least, most] = [0, 1].map(|i| KEPT[i] * self.factor_entries[i]);
        let [file, memory] = [NUMBER as f64, 8.0].map(|number| {
            let [least, most] = [least, most].map(|entries| bytes(number * entries));
            format!("{least} to {most}")
        });
        format!(
            "{nodes} of {all} free nodes of the surface take forces: about {file} in the file and {memory} \
             of memory (kept = \"inverse\": {} in the file)",
            bytes(size as f64)
        )
    }

    /// The cost of a compliance that is compressed within an error.
    pub fn compressed_told(&self, [nodes, all, full]: [usize; 3], error: f64) -> String {
        let own = COMPRESSED_NODE[0] - COMPRESSED_NODE[1] * (error.log10() + 3.0);
        let [least, most] = [0.5, 2.0].map(|times| bytes((times * own * all as f64).min(full as f64)));
        format!(
            "{nodes} of {all} free nodes of the surface take forces: compressed within {error:e}, {least} to \
             {most} in the file (uncompressed: {})",
            bytes(full as f64)
        )
    }

    /// The forecast as a sentence; `None` for a small body, which takes seconds.
    pub fn told(&self) -> Option<String> {
        let [least, most] = self.memory.map(bytes);
        let [soon, late] = self.seconds.map(duration);
        (self.unknowns > SMALL || self.seconds[1] > SHORT).then(|| {
            format!(
                "{:.3e} unknowns: precomputing takes about {} and {least} to {most} of memory ({} threads)",
                self.unknowns,
                if soon == late { soon } else { format!("{soon} to {late}") },
                rayon::current_num_threads()
            )
        })
    }
}

/// Numbers of the factor over n^{4/3}, at least and at most.
fn fill(mesh: &TetMesh) -> [f64; 2] {
    let nodes = mesh.nodes.len().max(1) as f64;
    let compact = (COMPACT[0] - COMPACT[1] / (3.0 * nodes).cbrt()).max(THIN);
    let of_cube = 6.0 * nodes.powf(2.0 / 3.0);
    let surface = Surface::from_mesh(mesh).nodes.len() as f64 / of_cube;
    [(LEAST * compact * surface.max(1.0).powf(SURFACE_POWER)).max(THIN), compact]
}

/// The bytes of the compliance at the surface, as [`super::compliance_size`] tells them, refused where what makes them does not
/// fit into this machine.
pub fn compliance_fits(size: usize) -> Result<(), String> {
    let fits = machine::fits("the compliance of the surface", WHILE_MADE * size as f64, 0.0);
    fits.map_err(|refused| format!("{refused}: take fewer nodes, or kept = {{ error = 1e-3 }} or \"factor\""))
}

/// Memory and time of the boundary elements of a prepared body, or the reason why they do not fit.
pub fn boundary_told(mesh: &TetMesh, controls: &[ControlElement]) -> Result<String, String> {
    let mut is_held = vec![false; mesh.nodes.len()];
    controls.iter().flat_map(|control| &control.nodes).for_each(|&node| is_held[node as usize] = true);
    let loaded =
        bem::loaded_triangles(bem::Surface { nodes: &mesh.nodes, triangles: &mesh.triangles }, &is_held)
            .len();
    let need = bem::fits(mesh.nodes.len(), loaded).map_err(|error| error.to_string())?;
    Ok(format!(
        "boundary elements on {} triangles, tractions on {loaded}: full matrices of {} while it is precomputed",
        mesh.triangles.len(),
        bytes(need)
    ))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::{Block, block};
    use crate::solve::SOLVERS;

    /// Unknowns and numbers in the factor as `greenstage precompute` printed them.
    #[test]
    fn factors_that_were_measured_lie_in_the_forecast() {
        for (cells, unknowns, entries) in [
            ([16, 16, 16], 13_005.0, 3.273e6),
            ([24, 24, 24], 43_125.0, 1.892e7),
            ([100, 10, 10], 35_937.0, 7.824e6),
        ] {
            let mesh = block(&Block { size: cells.map(f64::from), cells }).unwrap();
            let forecast = Forecast::new(&mesh, 2);
            // Those of the control elements are counted too.
            assert!((1.0..1.2).contains(&(forecast.unknowns / unknowns)), "{}", forecast.unknowns);
            let [thin, compact] = forecast.factor_entries;
            assert!(thin <= entries && entries <= compact, "{cells:?}: {entries} in {thin}..{compact}");
            assert_eq!(forecast.told().is_some(), forecast.unknowns > SMALL);
        }
    }

    /// Seconds of `greenstage precompute` with `reduced` on two threads: a tube of 10,080 nodes and 48,000 tetrahedra, and a hook of
    /// 22,700 nodes and 14,000 quadratic tetrahedra of four points; 37 and 150 s with 12 random paths, and 1.17 times as long with 24, as a
    /// tube took, with one path at a time. A bracket of 12,277 nodes and 57,000 tetrahedra took 131 s and 0.90 GB with two.
    #[test]
    fn equilibria_that_were_measured_lie_in_the_forecast() {
        let threads = rayon::current_num_threads() as f64;
        let measured =
            [([140, 23, 2], 48_000, 43.0), ([58, 25, 14], 56_000, 176.0), ([40, 27, 10], 57_000, 131.0)];
        let bracket = block(&Block { size: [40.0, 27.0, 10.0], cells: [40, 27, 10] }).unwrap();
        let [least, most] = Forecast::new(&bracket, 2).with_equilibria(bracket.nodes.len(), 57_000).memory;
        let most = most * (2.0 / threads).max(1.0);
        assert!(least <= 0.9e9 && 0.9e9 <= most, "{least:e} {most:e}");
        for (cells, points, seconds) in measured {
            let mesh = block(&Block { size: cells.map(f64::from), cells }).unwrap();
            let forecast = Forecast::new(&mesh, 2).with_equilibria(mesh.nodes.len(), points);
            let [soon, late] = forecast.seconds.map(|seconds| seconds * threads / 2.0);
            assert!(soon <= seconds && seconds <= late, "{cells:?}: {seconds} in {soon}..{late}");
            assert!(forecast.told().is_some());
        }
    }

    /// Peak memory of `greenstage precompute` with cholesky on two threads; where it refused, what it would have needed.
    #[test]
    fn memory_that_was_measured_lies_in_the_forecast() {
        for (cells, peak) in [
            ([20, 20, 20], 0.203e9),
            ([30, 30, 30], 0.894e9),
            ([45, 45, 45], 4.20e9),
            ([66, 66, 66], 23.6e9),
            ([150, 150, 2], 0.792e9),
            ([150, 150, 1], 0.457e9),
            ([1500, 4, 4], 0.323e9),
            ([300, 10, 10], 0.477e9),
            ([60, 60, 6], 0.421e9),
        ] {
            let mesh = block(&Block { size: cells.map(f64::from), cells }).unwrap();
            let [least, most] = Forecast::new(&mesh, 2).memory;
            assert!(least <= peak && peak <= most, "{cells:?}: {peak:e} in {least:e}..{most:e}");
        }
    }

    #[test]
    fn what_surely_does_not_fit_is_refused_with_what_does() {
        let mut forecast = Forecast::new(&block(&Block { size: [1.0; 3], cells: [8; 3] }).unwrap(), 2);
        let of = |method: &str| Solver {
            method: SOLVERS.iter().find(|m| m.name == method).unwrap(),
            ..Solver::default()
        };
        assert_eq!(forecast.fits(&of("cholesky")), Ok(()));
        forecast.memory[0] = 1e16;
        let told = forecast.fits(&of("cholesky")).unwrap_err();
        assert!(told.contains("leaves") && told.contains("\"pcg\""), "{told}");
        assert!(["mixed", "faer"].iter().all(|method| forecast.fits(&of(method)).is_err()));
        assert_eq!(forecast.fits(&of("auto")), Ok(()), "it takes what fits");
        assert!(compliance_fits(1 << 20).is_ok() && compliance_fits(1 << 50).unwrap_err().contains("kept"));
    }

    /// Sizes that `greenstage precompute` printed for these bodies.
    #[test]
    fn kept_factors_that_were_measured_lie_in_the_forecast() {
        for (size, cells, kept) in
            [([1.0, 1.0, 0.005], [60, 60, 2], 23.2e6), ([1.0; 3], [21, 21, 20], 39.1e6)]
        {
            let forecast = Forecast::new(&block(&Block { size, cells }).unwrap(), 2);
            let [thin, compact] = [0, 1].map(|i| NUMBER as f64 * KEPT[i] * forecast.factor_entries[i]);
            assert!(thin <= kept && kept <= compact, "{cells:?}: {kept} in {thin}..{compact}");
            let told = forecast.kept_factor_told([10, 20, 5_000_000]);
            assert!(told.starts_with("10 of 20 free") && told.contains("\"inverse\": 5.00 MB"), "{told}");
        }
    }

    #[test]
    fn millions_of_tetrahedra_are_told_in_gigabytes_and_hours() {
        let mut mesh = TetMesh::default();
        mesh.nodes.resize(1_400_000, Default::default());
        mesh.tets.resize(8_000_000, [0; 4]);
        let forecast = Forecast::new(&mesh, 2);
        assert!(forecast.memory[0] > 3e10 && forecast.memory[1] < 3e11, "{forecast:?}");
        let told = forecast.told().unwrap();
        assert!(
            told.starts_with("4.200e6 unknowns: precomputing takes about") && told.contains(" GB of memory"),
            "{told}"
        );
    }
}
