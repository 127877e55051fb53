//! Time and forward error of every method of the list of solvers on twenty bodies, with the choice of `auto` and its time over
//! the shortest.
//!
//! `cargo bench --bench methods` measures all bodies, `cargo bench --bench methods -- needle` those with this in their names,
//! and `cargo bench --bench methods -- part.msh` a mesh of one's own, held at both ends of its longest side.

use greenstage::base::progress::Silent;
use greenstage::base::table::{Table, seconds};
use greenstage::fem::{Lame, NodeFields, Partition, StiffnessMatrix, find_element};
use greenstage::mesh::{self, Block, TetMesh, Tube};
use greenstage::solve::{AUTO, Job, Method, SOLVERS, Solver};
use std::path::Path;
use std::time::Instant;

/// Least number of rounds of each method; the methods take turns.
/// Time for which a method's rounds go on, s.
const ROUNDS: usize = 3;
const SECONDS: f64 = 6.0;
/// Factor over the best time from which a method is not measured again.
const HOPELESS: f64 = 4.0;

/// A body, held at both ends of its longest side by control elements of twelve columns each.
struct Body {
    name: String,
    mesh: TetMesh,
    element: &'static str,
    poisson: f64,
    /// Young's modulus of every second slice over that of the others.
    contrast: f64,
    controls: usize,
}

fn block(size: [f64; 3], cells: [u32; 3]) -> TetMesh {
    mesh::block(&Block { size, cells }).expect("sizes are positive")
}

fn tube([inner_radius, outer_radius, length]: [f64; 3], [radial, around, along]: [u32; 3]) -> TetMesh {
    let tube = Tube { inner_radius, outer_radius, length, radial, around, along, control_length: 0.0 };
    mesh::tube(&tube).expect("sizes are positive")
}

fn bodies() -> Vec<Body> {
    let body = |name: &str, mesh| Body {
        name: name.into(),
        mesh,
        element: "tet4",
        poisson: 0.3,
        contrast: 1.0,
        controls: 2,
    };
    let quadratic = |body: Body| Body {
        mesh: mesh::quadratic(body.mesh, &|a, b| (a + b) / 2.0),
        element: "tet10",
        ..body
    };
    let wire = [1.0, 0.002, 0.002];
    let slab = [0.3, 0.2, 0.02];
    vec![
        body("cube", block([1.0; 3], [6; 3])),
        body("cube", block([1.0; 3], [13; 3])),
        body("cube", block([1.0; 3], [22; 3])),
        body("cube", block([1.0; 3], [31; 3])),
        body("bar", block([6.0, 1.0, 1.0], [60, 10, 10])),
        body("bar", block([20.0, 1.0, 1.0], [200, 12, 12])),
        body("bracket", block(slab, [90, 60, 5])),
        body("needle", block(wire, [300, 2, 2])),
        body("needle", block([1.0, 0.01, 0.01], [1000, 2, 2])),
        body("needle", block(wire, [1500, 4, 4])),
        body("sheet", block([1.0, 1.0, 0.005], [60, 60, 2])),
        body("sheet", block([1.0, 1.0, 0.001], [120, 120, 1])),
        body("tube", tube([0.04, 0.05, 0.3], [2, 36, 60])),
        body("tube", tube([0.045, 0.05, 0.8], [3, 64, 120])),
        quadratic(body("cube, tet10", block([1.0; 3], [8; 3]))),
        quadratic(body("tube, tet10", tube([0.04, 0.05, 0.3], [1, 24, 40]))),
        Body { poisson: 0.4999, ..body("cube, ν = 0.4999", block([1.0; 3], [28; 3])) },
        Body { poisson: 0.499, ..body("bracket, ν = 0.499", block(slab, [60, 40, 4])) },
        Body { contrast: 1e6, ..body("bar, E 1 : 10⁶", block([6.0, 1.0, 1.0], [60, 10, 10])) },
        Body { controls: 10, ..body("cube, 120 columns", block([1.0; 3], [20; 3])) },
    ]
}

impl Body {
    fn of_file(path: &str) -> Body {
        let mesh = mesh::load(Path::new(path)).unwrap_or_else(|error| panic!("{error}")).mesh;
        let name = Path::new(path).file_stem().map_or(path.into(), |name| name.to_string_lossy().into());
        Body { name, mesh, element: "tet4", poisson: 0.3, contrast: 1.0, controls: 2 }
    }

    /// A, and the right-hand sides.
    fn system(&self) -> (StiffnessMatrix, NodeFields) {
        let nodes = &self.mesh.nodes;
        let ends = |axis: usize| {
            let of = |pick: fn(f64, f64) -> f64| nodes.iter().map(|x| x[axis]).reduce(pick).unwrap_or(0.0);
            [of(f64::min), of(f64::max)]
        };
        let length = |axis: &usize| ends(*axis)[1] - ends(*axis)[0];
        let long = (0..3).max_by(|a, b| length(a).total_cmp(&length(b))).unwrap_or(0);
        let [low, high] = ends(long);
        let margin = 0.01 * (high - low);
        let mut held: Vec<u32> = (0..nodes.len() as u32)
            .filter(|&i| (nodes[i as usize][long] - low).min(high - nodes[i as usize][long]) < margin)
            .collect();
        let key = |i: u32| {
            let x = nodes[i as usize];
            (x[long] > 0.5 * (low + high), x[(long + 1) % 3], x[(long + 2) % 3])
        };
        held.sort_by(|&a, &b| key(a).partial_cmp(&key(b)).unwrap_or(std::cmp::Ordering::Equal));
        let mut prescribed = NodeFields::zeros(nodes.len(), 12 * self.controls);
        for (place, &node) in held.iter().enumerate() {
            let first = 12 * (place * self.controls / held.len());
            let x = nodes[node as usize];
            for axis in 0..3 {
                for (k, value) in [1.0, x[0], x[1], x[2]].into_iter().enumerate() {
                    prescribed.row_mut(3 * node as usize + axis)[first + 4 * axis + k] = value;
                }
            }
        }
        let slice = |tet: &[u32; 4]| (8.0 * (nodes[tet[0] as usize][long] - low) / (high - low)) as u32;
        let young = |tet| if slice(tet) % 2 == 0 { 1e6 } else { 1e6 * self.contrast };
        let lame: Vec<Lame> =
            self.mesh.tets.iter().map(|tet| Lame::from_young_poisson(young(tet), self.poisson)).collect();
        let k = find_element(self.element)
            .expect("it is in the list")
            .assemble(&self.mesh, &lame)
            .unwrap_or_else(|error| panic!("{}: {error}", self.name));
        let partition = Partition::new(nodes.len(), held);
        (partition.a(&k), partition.minus_b_times(&k, &prescribed))
    }
}

/// The best times of a method, s and s of all processors together, and its result.
struct Taken {
    method: &'static Method,
    wall: f64,
    processor: f64,
    made: Result<(&'static str, f64), String>,
}

/// Time of all threads of this process, s.
fn processor_s() -> f64 {
    let mut time = libc::timespec { tv_sec: 0, tv_nsec: 0 };
    // SAFETY: the pointer is to a timespec of this frame.
    unsafe { libc::clock_gettime(libc::CLOCK_PROCESS_CPUTIME_ID, &mut time) };
    time.tv_sec as f64 + 1e-9 * time.tv_nsec as f64
}

fn solve(method: &'static Method, a: &StiffnessMatrix, b: &NodeFields) -> Taken {
    let (started, before) = (Instant::now(), processor_s());
    let settings = Solver { method, ..Solver::default() };
    let job = Job { columns: b.columns, needs_factor: false };
    let solved = settings.analyse_for(a, job, &Silent).and_then(|solver| {
        solver.fits(a, b.columns)?;
        let factor = solver.factor(a, &Silent)?;
        let (_, stats) = factor.solve_and_judge(b, &Silent)?;
        Ok((stats.method.name, stats.conditioning.map_or(f64::NAN, |judged| judged.forward_error)))
    });
    let (wall, processor) = (started.elapsed().as_secs_f64(), processor_s() - before);
    Taken { method, wall, processor, made: solved.map_err(|error| error.to_string()) }
}

/// Every method's best of all rounds.
fn measure(a: &StiffnessMatrix, b: &NodeFields) -> Vec<Taken> {
    let started = Instant::now();
    let mut all: Vec<Taken> = SOLVERS.iter().map(|method| solve(method, a, b)).collect();
    let mut rounds = 1;
    while rounds < ROUNDS || started.elapsed().as_secs_f64() < SECONDS {
        rounds += 1;
        let best = best(&all);
        for taken in all.iter_mut().filter(|taken| taken.made.is_ok() && taken.wall < HOPELESS * best) {
            let again = solve(taken.method, a, b);
            taken.wall = taken.wall.min(again.wall);
            taken.processor = taken.processor.min(again.processor);
        }
    }
    all
}

/// The shortest time of those that came to an end, but for the choice.
fn best(all: &[Taken]) -> f64 {
    let done = all.iter().filter(|taken| taken.made.is_ok() && *taken.method != AUTO);
    done.map(|taken| taken.wall).fold(f64::INFINITY, f64::min)
}

fn main() {
    let asked: Vec<String> = std::env::args().skip(1).filter(|word| !word.starts_with("--")).collect();
    let is_file = |word: &&String| Path::new(word.as_str()).is_file();
    let is_asked =
        |body: &Body| asked.is_empty() || asked.iter().any(|word| body.name.contains(word.as_str()));
    let files = asked.iter().filter(is_file).map(|path| Body::of_file(path));
    let mut heading = vec!["body".to_owned(), "unknowns".to_owned(), "columns".to_owned()];
    heading.extend(SOLVERS.iter().map(|method| format!("{}: wall, processors, error", method.name)));
    heading.extend(["choice".to_owned(), "auto / best".to_owned()]);
    let mut table = Table::new(&heading.iter().map(String::as_str).collect::<Vec<_>>());
    let mut worst: f64 = 0.0;
    for body in bodies().into_iter().filter(is_asked).chain(files) {
        let (a, b) = body.system();
        let all = measure(&a, &b);
        let mut row = vec![body.name.clone(), (3 * a.nodes()).to_string(), b.columns.to_string()];
        row.extend(all.iter().map(|taken| match &taken.made {
            Ok((_, error)) => format!("{}, {}, {error:.0e}", seconds(taken.wall), seconds(taken.processor)),
            Err(_) => format!("fails after {}", seconds(taken.wall)),
        }));
        let auto = all.iter().find(|taken| *taken.method == AUTO);
        let ratio = auto.map_or(f64::NAN, |auto| auto.wall / best(&all));
        worst = worst.max(ratio);
        row.push(auto.map_or(String::new(), |auto| match &auto.made {
            Ok((name, _)) => (*name).to_owned(),
            Err(why) => why.clone(),
        }));
        row.push(format!("{ratio:.2}"));
        eprintln!("{}", row.join("  "));
        table.row(&row.iter().map(String::as_str).collect::<Vec<_>>());
    }
    println!("{}\n{}", greenstage::base::machine::description(), table.text());
    println!("auto takes at most {worst:.2} of the time of the best method.");
}
