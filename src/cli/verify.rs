//! `greenstage verify`: compares the elements with published and analytic answers, and fits their rates of convergence.

use super::print::print;
use super::{marks, parsers};
use crate::base::diagnostic::{is_verbose, notice};
use crate::base::failure::Failure;
use crate::base::machine;
use crate::base::table::{Table, duration, seconds};
use crate::config::unknown_name;
use crate::tuning;
use crate::verify::studies::{STUDIES, Study, forces_of_scenes};
use crate::verify::truth::{self, JudgedBody, KeptBodies, Planner, Run, Source, Standing, held, offenders};
use crate::verify::{self, Bound, ConvergenceRow, Effort, PROBLEMS, Problem, together};
use indexmap::IndexMap;
use serde_json::{Value, json};
use std::path::PathBuf;
use std::time::Duration;

/// Compare every element with published and analytic answers, with fitted rates of convergence
///
/// Each problem is solved on a sequence of refined meshes. The exit status is 1 if an element is less accurate than theory
/// promises.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Problems to solve (default: all), or one of: `hard-cases` (bodies for which a solver can silently be wrong), `haptics`
    /// (stability of the force in the hand), `forces` (the models' forces and shapes at large rotations, of the bodies of scenes that follow, or of three of its own), `bent` (whether the
    /// force in the hand generates energy on bent bodies; takes minutes), `together` (all pairs of effects, with every model or those that follow; minutes),
    /// `truth` (how often printed errors hold, on random bodies; minutes for each on one core)
    pub problems: Vec<String>,
    /// Frames of each scene of `together`
    #[arg(long, default_value_t = 1000, value_name = "N")]
    pub frames: usize,
    /// Number of random bodies of `truth` [default: 12]
    #[arg(long, value_name = "N")]
    pub bodies: Option<u64>,
    /// Seed of the first random body of `truth`; the others have the next ones [default: 1]
    #[arg(long)]
    pub seed: Option<u64>,
    /// The random body of this seed alone, with all of its statements
    #[arg(long, conflicts_with_all = ["bodies", "seed", "keep"])]
    pub only: Option<u64>,
    /// Threads of `truth`, each with a body of its own; default: all processors
    #[arg(long, value_name = "T")]
    pub threads: Option<usize>,
    /// Time of `truth`: no body is begun that would probably end later
    #[arg(long, value_name = "M", value_parser = parsers::positive)]
    pub minutes: Option<f64>,
    /// Keep each body of `truth` in this file as it ends, and go on from those that this program kept there; the table is of all
    /// of them
    #[arg(long, value_name = "FILE")]
    pub keep: Option<PathBuf>,
    /// Judge the ± beside forces of `truth` alone, which takes a minute for each body
    #[arg(long)]
    pub expected: bool,
    /// Solve each problem on one more, finer mesh; this takes some minutes
    #[arg(long, conflicts_with = "coarse")]
    pub fine: bool,
    /// Solve each problem on one mesh fewer; this takes seconds
    #[arg(long)]
    pub coarse: bool,
    /// Print the results as JSON
    #[arg(long)]
    pub json: bool,
    /// Write the tables between the marks of this Markdown file
    #[arg(long)]
    pub readme: Option<PathBuf>,
}

pub fn run(args: &Args) -> Result<(), Failure> {
    if args.problems == [TRUTH] {
        return judge_truth(args);
    }
    let of_truth = [
        ("--bodies", args.bodies.is_some()),
        ("--seed", args.seed.is_some()),
        ("--only", args.only.is_some()),
        ("--threads", args.threads.is_some()),
        ("--minutes", args.minutes.is_some()),
        ("--keep", args.keep.is_some()),
        ("--expected", args.expected),
    ];
    if let Some((option, _)) = of_truth.into_iter().find(|(_, is_given)| *is_given) {
        return Err(Failure::wrong(format!("{option}: is an option of `greenstage verify {TRUTH}` alone")));
    }
    if let [name, scenes @ ..] = &args.problems[..]
        && name == "forces"
        && !scenes.is_empty()
    {
        return print_study(args, name, |told| forces_of_scenes(scenes, told));
    }
    if let [name, models @ ..] = &args.problems[..]
        && name == TOGETHER
    {
        return print_study(args, name, |told| together::tables::study(models, args.frames, told));
    }
    let study = match &args.problems[..] {
        [name] => STUDIES.iter().find(|(known, _)| known == name),
        _ => None,
    };
    if let Some(path) = &args.readme {
        marks::try_between(path, study.map_or("verify", |(name, _)| name))?;
    }
    if let Some((name, make)) = study {
        return print_study(args, name, *make);
    }
    let effort = match (args.fine, args.coarse) {
        (true, _) => Effort::Fine,
        (_, true) => Effort::Coarse,
        _ => Effort::Usual,
    };
    let (mut rows, mut text) = (Vec::new(), String::new());
    for problem in chosen(&args.problems)? {
        let solved = verify::run(problem, effort).map_err(Failure::work)?;
        let section = section(problem, &solved);
        if !args.json && is_verbose() {
            print(&section)?;
        }
        text.push_str(&section);
        rows.extend(solved);
    }
    if args.json {
        let rows: Vec<Value> = rows.iter().map(as_json).collect();
        print(&format!("{:#}\n", json!(rows)))?;
    } else if !is_verbose() {
        let fits = text.lines().count() <= SCREEN;
        print(&if fits { text.clone() } else { format!("{}\n", summary(&rows).text()) })?;
    }
    if let Some(path) = &args.readme {
        let machine = format!(
            "greenstage {}, {} threads, {}:",
            env!("CARGO_PKG_VERSION"),
            rayon::current_num_threads(),
            machine::processor()
        );
        marks::write_between(path, "verify", &format!("{machine}\n\n```text\n{}\n```\n", text.trim_end()))?;
    }
    judge(&rows)?;
    verdict(args.json, &format!("all {} rows within their bounds (column required)", rows.len()))
}

const TRUTH: &str = "truth";
const TOGETHER: &str = "together";
/// Statements that do not hold, which are listed.
const OFFENDERS: usize = 12;
/// Part of the statements of each kind that must hold.
const HOLD: f64 = 0.95;

/// Judges printed errors on random bodies: a line for each body as it ends, then the table, and the statements that do not hold.
fn judge_truth(args: &Args) -> Result<(), Failure> {
    if let Some(path) = &args.readme {
        marks::try_between(path, TRUTH)?;
    }
    let processors = std::thread::available_parallelism().map_or(1, usize::from);
    let kept = args
        .keep
        .as_deref()
        .map(|path| KeptBodies::open(path, !args.expected))
        .transpose()
        .map_err(Failure::Request)?;
    if let (Some(path), Some(KeptBodies { bodies, others, .. })) = (&args.keep, &kept) {
        let others = if *others == 0 {
            String::new()
        } else {
            format!(", {others} of another build or with other statements are not used")
        };
        notice!("{}: {} bodies{others}", path.display(), bodies.len());
    }
    let is_new = |seed: &u64| kept.as_ref().is_none_or(|kept| !kept.has(*seed));
    let run = Run {
        seeds: match args.only {
            Some(only) => vec![only],
            None => {
                let first = args.seed.unwrap_or(1);
                (first..first.saturating_add(args.bodies.unwrap_or(12))).filter(is_new).collect()
            }
        },
        threads: args.threads.unwrap_or(processors),
        limit: args.minutes.map(|minutes| Duration::from_secs_f64(60.0 * minutes)),
    };
    let planner = |scene: &_, body: &str, rows, demand: &_| tuning::answered(scene, body, rows, demand);
    let planner: Option<Planner<'_>> = (!args.expected).then_some(&planner);
    let judged = run.judge(planner, &|standing| {
        notice!("{}", body_line(&standing, run.seeds.len()));
        if let (Some(kept), Ok(body)) = (&kept, standing.body)
            && let Err(error) = kept.keep(body)
        {
            notice!("seed {}: not kept: {error}", body.seed);
        }
    });
    let (bodies, failed): (Vec<_>, Vec<_>) = judged.iter().partition(|found| found.is_ok());
    let mut bodies: Vec<&JudgedBody> = bodies.into_iter().flatten().collect();
    bodies.extend(kept.iter().flat_map(|kept| &kept.bodies));
    bodies.sort_by_key(|body| body.seed);
    let failed: Vec<&String> = failed.into_iter().filter_map(|found| found.as_ref().err()).collect();
    if args.json {
        return print(&format!("{:#}\n", json!({ "bodies": bodies, "failed": failed })));
    }
    let mut text = String::new();
    if let (Some(_), [body]) = (args.only, &bodies[..]) {
        text += &format!("{}\n", statements(body).text());
        text.extend(body.left_out.iter().map(|why| format!("not judged: {why}\n")));
        text += "\n";
    }
    let table = truth::summary(&bodies);
    text += &format!("{}, greenstage {}\n\n", head(&bodies), env!("CARGO_PKG_VERSION"));
    text += &format!("{}\n", table.text());
    text.extend(offenders(&bodies, OFFENDERS).iter().map(|line| format!("{line}\n")));
    text.extend(failed.iter().map(|why| format!("failed: {why}\n")));
    print(&text)?;
    if let Some(path) = &args.readme {
        marks::write_between(path, TRUTH, &format!("{}:\n\n{}\n", head(&bodies), table.markdown()))?;
    }
    if !failed.is_empty() {
        return Err(Failure::Work(anyhow::anyhow!("{} bodies could not be judged", failed.len())));
    }
    let known: Vec<bool> =
        bodies.iter().flat_map(|body| &body.statements).filter_map(|statement| statement.holds()).collect();
    let part = known.iter().filter(|holds| **holds).count() as f64 / known.len().max(1) as f64;
    match part >= HOLD {
        true => verdict(args.json, &format!("{:.1} % of {} printed errors hold", 100.0 * part, known.len())),
        false => Err(Failure::Work(anyhow::anyhow!(
            "{:.1} % of {} printed errors hold, and {:.0} % must",
            100.0 * part,
            known.len(),
            100.0 * HOLD
        ))),
    }
}

/// "22 bodies of the seeds 1 to 26".
fn head(bodies: &[&JudgedBody]) -> String {
    let [first, last] = [bodies.first(), bodies.last()].map(|body| body.map_or(0, |body| body.seed));
    format!("{} bodies of the seeds {first} to {last}", bodies.len())
}

/// "3 of 12: seed 3, thin, 352 nodes, rotation: report 34/34, planner 2/2, ± 7/8 hold; 42 s; some 6 min left".
fn body_line(standing: &Standing<'_>, all: usize) -> String {
    let left = duration(standing.left);
    let of = format!("{} of {all}", standing.done);
    match standing.body {
        Err(why) => format!("{of}: {why}; {left} left"),
        Ok(body) => format!(
            "{of}: seed {}, {}, {} nodes, {}: report {}, planner {}, ± {} hold; {:.0} s; {left} left",
            body.seed,
            body.kind.name(),
            body.nodes,
            body.model,
            held(body, Source::Report),
            held(body, Source::Planner),
            held(body, Source::Expected),
            body.seconds
        ),
    }
}

/// A row for each statement about a body.
fn statements(body: &JudgedBody) -> Table {
    let mut table = Table::new(&["source", "of", "quantity", "shown", "doubt", "true", "holds"]);
    for statement in &body.statements {
        let word = |value: Value| value.as_str().unwrap_or_default().to_owned();
        let number = |x: f64| format!("{x:.3e}");
        let holds = statement.holds().map_or("not measured", |holds| if holds { "yes" } else { "NO" });
        table.row(&[
            &word(json!(statement.source)),
            &statement.of,
            &word(json!(statement.quantity)),
            &statement.shown.map_or(String::new(), number),
            &number(statement.doubt),
            &number(statement.truth),
            holds,
        ]);
    }
    table
}

/// The last line where nothing missed its bound; the error is the last line where something did.
fn verdict(json: bool, said: &str) -> Result<(), Failure> {
    if json { Ok(()) } else { print(&format!("{said}\n")) }
}

fn print_study(
    args: &Args,
    name: &str,
    make: impl FnOnce(&mut dyn FnMut(String)) -> Result<Study, Failure>,
) -> Result<(), Failure> {
    let Study { tables, json, verdict: judged } = make(&mut |left_out| notice!("note: {left_out}"))?;
    let headed = |heading: &str, table: String| {
        if heading.is_empty() { table } else { format!("{heading}\n\n{table}\n") }
    };
    if args.json {
        print(&format!("{json:#}\n"))?;
    } else {
        print(&on_a_screen(tables.iter().map(|([heading, _], table)| headed(heading, table.text()))))?;
    }
    if let Some(path) = &args.readme {
        let markdown = |([_, heading], table): &([String; 2], Table)| headed(heading, table.markdown());
        marks::write_between(path, name, &tables.iter().map(markdown).collect::<String>())?;
    }
    match judged {
        Ok(said) => said.map_or(Ok(()), |said| verdict(args.json, &said)),
        Err(why) => Err(Failure::Work(anyhow::anyhow!(why))),
    }
}

/// Lines of tables that are printed without `--verbose`, so that all fits a screen with the verdict.
const SCREEN: usize = 36;

/// The first texts that fit a screen, and how many are left out; all with `--verbose`.
fn on_a_screen(texts: impl Iterator<Item = String>) -> String {
    let (mut shown, mut left_out) = (String::new(), 0);
    for text in texts {
        if is_verbose() || left_out == 0 && shown.lines().count() + text.lines().count() <= SCREEN {
            shown += &text;
        } else {
            left_out += text.lines().count();
        }
    }
    if left_out > 0 {
        shown += &format!("{left_out} more lines of tables: --verbose\n");
    }
    shown
}

/// A row for each problem and element: the errors on the finest mesh, the rates, and how many bounds hold.
fn summary(rows: &[ConvergenceRow]) -> Table {
    let mut table = Table::new(&["problem", "element", "nodes", "errors", "rates", "bounds that hold"]);
    let mut groups: IndexMap<[&str; 2], Vec<&ConvergenceRow>> = IndexMap::new();
    rows.iter().for_each(|row| groups.entry([&row.problem, &row.element]).or_default().push(row));
    for ([problem, element], rows) in groups {
        let finest = || rows.iter().filter_map(|row| row.levels.last());
        let nodes = finest().map(|level| level.nodes).max().unwrap_or(0);
        let errors = range(finest().map(|level| level.error), percent);
        let rates = range(rows.iter().filter_map(|row| row.rate), |rate| format!("{rate:.2}"));
        let bounded: Vec<bool> =
            rows.iter().filter(|row| row.bound != Bound::NONE).map(|row| row.holds()).collect();
        let holds = format!("{} of {}", bounded.iter().filter(|holds| **holds).count(), bounded.len());
        table.row(&[problem, element, &nodes.to_string(), &errors, &rates, &holds]);
    }
    table
}

/// "0.3 % to 2 %": the least and the largest of some numbers.
fn range(numbers: impl Iterator<Item = f64>, text: impl Fn(f64) -> String) -> String {
    let widest = |(least, most): (f64, f64), x: f64| (least.min(x), most.max(x));
    match numbers.fold((f64::INFINITY, f64::NEG_INFINITY), widest) {
        (least, most) if least > most => String::new(),
        (least, most) if least == most => text(least),
        (least, most) => format!("{} to {}", text(least), text(most)),
    }
}

fn chosen(names: &[String]) -> Result<Vec<&'static Problem>, Failure> {
    let studies = STUDIES.iter().map(|(name, _)| *name).chain([TRUTH, TOGETHER]);
    let known = || PROBLEMS.iter().map(|problem| problem.name).chain(studies.clone());
    if names.is_empty() {
        return Ok(PROBLEMS.iter().collect());
    }
    let find = |name: &String| {
        let problem = PROBLEMS.iter().find(|problem| problem.name == *name);
        problem.ok_or_else(|| Failure::wrong(unknown_name("problem", name, known())))
    };
    names.iter().map(find).collect()
}

fn judge(rows: &[ConvergenceRow]) -> Result<(), Failure> {
    let missed: Vec<String> = rows
        .iter()
        .filter(|row| !row.holds())
        .map(|row| format!("{} {} {}", row.problem, row.quantity, row.element))
        .collect();
    if missed.is_empty() {
        return Ok(());
    }
    let (count, all) = (missed.len(), rows.len());
    Err(Failure::Work(anyhow::anyhow!("{count} of {all} rows miss their bound: {}", missed.join(", "))))
}

fn section(problem: &Problem, rows: &[ConvergenceRow]) -> String {
    let mut table = Table::new(&[
        "quantity",
        "element",
        "nodes",
        "value",
        "reference",
        "errors, coarse to fine",
        "rate",
        "required",
        "time",
    ]);
    for row in rows {
        let Some(finest) = row.levels.last() else { continue };
        let errors: Vec<String> =
            row.levels.iter().map(|level| format!("{:>9}", percent(level.error))).collect();
        let is_norm = row.reference == 0.0;
        let number = |value: f64| if is_norm { String::new() } else { significant(value, 6) };
        table.row(&[
            &row.quantity,
            &row.element,
            &finest.nodes.to_string(),
            &number(finest.value),
            &number(row.reference),
            &errors.join(" "),
            &row.rate.map_or(String::new(), |rate| format!("{rate:.2}")),
            &required(row),
            &seconds(finest.seconds),
        ]);
    }
    format!("{}: {}\n{}\n\n{}\n", problem.name, problem.about, problem.source, table.text())
}

fn percent(error: f64) -> String {
    format!("{} %", significant(100.0 * error, 3))
}

/// `digits` significant digits; a power of ten where more than three zeros would follow the point.
fn significant(value: f64, digits: i32) -> String {
    let leading = value.abs().log10().floor();
    if value != 0.0 && !(-4.0..8.0).contains(&leading) {
        return format!("{value:.1e}");
    }
    let decimals = (digits - 1 - leading.clamp(-4.0, 8.0) as i32).max(0) as usize;
    format!("{value:.decimals$}")
}

fn as_json(row: &ConvergenceRow) -> Value {
    let mut value = json!(row);
    value["holds"] = json!(row.holds());
    value
}

fn required(row: &ConvergenceRow) -> String {
    let error = row.bound.error.map(|most| format!("error ≤ {}", percent(most)));
    let rate = row.bound.rate.map(|least| format!("rate ≥ {least:.1}"));
    let missed = (!row.holds()).then(|| "MISSED".to_owned());
    [error, rate, missed].into_iter().flatten().collect::<Vec<_>>().join(", ")
}
