//! The graph of fields: its order, once a frame, only where something changed, circles refused, feedback of the
//! last frame; random graphs against a naive evaluator.

use crate::common::{program, text};
use greenstage::field::{Each, Field, FieldError, Graph};
use proptest::prelude::*;
use std::collections::BTreeMap;
use std::path::Path;

/// Names of the functions that ran, in their order.
type Ran = Vec<&'static str>;

/// left and right from outside; sum = left + right; double = 2 sum; all = sum + double + right.
struct Small {
    graph: Graph<Ran>,
    left: Field<f64>,
    right: Field<f64>,
    sum: Field<f64>,
    double: Field<f64>,
    all: Field<f64>,
}

fn small() -> Small {
    let mut graph = Graph::default();
    // Made in an order that is not that of their dependencies.
    let [all, double, sum, right, left] =
        ["all", "double", "sum", "right", "left"].map(|name| graph.field(name, 0.0).unwrap());
    graph
        .compute(
            all,
            "add",
            (vec![sum, double], right),
            |ran: &mut Ran, (some, right): (Each<'_, _>, &f64)| {
                ran.push("all");
                some.iter().sum::<f64>() + right
            },
        )
        .unwrap();
    graph
        .compute(double, "double", sum, |ran: &mut Ran, sum: &f64| {
            ran.push("double");
            2.0 * sum
        })
        .unwrap();
    graph
        .compute(sum, "add", (left, right), |ran: &mut Ran, (left, right): (&f64, &f64)| {
            ran.push("sum");
            left + right
        })
        .unwrap();
    Small { graph, left, right, sum, double, all }
}

#[test]
fn functions_run_once_a_frame_in_the_order_of_dependencies_and_only_where_an_input_changed() {
    let Small { mut graph, left, right, sum, double, all } = small();
    let mut ran = Ran::new();
    let mut frame = |graph: &mut Graph<Ran>| {
        graph.evaluate(&mut ran);
        std::mem::take(&mut ran)
    };
    assert_eq!(frame(&mut graph), ["sum", "double", "all"], "all once at first");
    assert_eq!(frame(&mut graph), [""; 0], "nothing changed");
    graph.set(left, 1.0).unwrap();
    graph.set(right, 2.0).unwrap();
    graph.set(right, 3.0).unwrap();
    assert_eq!(frame(&mut graph), ["sum", "double", "all"], "once, however many inputs changed");
    assert_eq!([sum, double, all].map(|field| *graph.get(field)), [4.0, 8.0, 15.0]);
    graph.set(left, 1.0).unwrap();
    assert_eq!(frame(&mut graph), [""; 0], "the same value is no change");
    graph.set(left, 2.0).unwrap();
    graph.set(right, 2.0).unwrap();
    assert_eq!(frame(&mut graph), ["sum", "all"], "a sum that stays leaves what is made of it alone");
    assert_eq!(*graph.get(all), 14.0);
    assert_eq!([sum, double, all, left].map(|field| graph.evaluations(field)), [3, 2, 3, 0]);
}

#[test]
fn what_is_connected_cannot_be_set_or_connected_again_until_it_is_disconnected() {
    let Small { mut graph, left, sum, double, .. } = small();
    let refused = graph.set(sum, 1.0).unwrap_err();
    assert_eq!(
        refused,
        FieldError::Connected { name: "sum".into(), from: vec!["left".into(), "right".into()] }
    );
    assert!(graph.connect(sum, left).is_err());
    graph.disconnect(sum);
    graph.set(sum, 5.0).unwrap();
    graph.evaluate(&mut Ran::new());
    assert_eq!(*graph.get(double), 10.0);
    graph.disconnect(sum);
    graph.connect(sum, left).unwrap();
    graph.set(left, -1.0).unwrap();
    graph.evaluate(&mut Ran::new());
    assert_eq!((*graph.get(sum), *graph.get(double)), (-1.0, -2.0));
    let twice = graph.field("sum", 0u64).err();
    assert_eq!(twice, Some(FieldError::Name { name: "sum".into() }));
}

#[test]
fn a_circle_is_refused_with_the_names_in_it() {
    let Small { mut graph, left, all, .. } = small();
    let error = graph.connect(left, all).unwrap_err();
    assert_eq!(
        error.to_string(),
        "fields would depend on themselves: left ← all ← sum ← left; take one of them from the previous frame"
    );
    let own = graph.field("own", 0.0).unwrap();
    assert_eq!(
        graph.connect(own, own).unwrap_err(),
        FieldError::Circle { circle: vec!["own".into(), "own".into()] }
    );
    // Nothing was connected by the refusals.
    graph.set(left, 1.0).unwrap();
    graph.set(own, 1.0).unwrap();
}

#[test]
fn the_previous_frame_closes_a_circle() {
    let mut graph = Graph::<()>::default();
    let step = graph.field("step", 1.0).unwrap();
    let place = graph.field("place", 0.0).unwrap();
    let last = graph.previous(place).unwrap();
    let before = graph.previous(last).unwrap();
    assert_eq!(graph.name(last), "place.previous");
    let again = graph.previous(place).unwrap();
    assert_eq!(graph.name(again), "place.previous", "one field, however often asked for");
    graph
        .compute(place, "go", (last, step), |(), (last, step): (&f64, &f64)| f64::min(last + step, 3.0))
        .unwrap();
    let mut seen = Vec::new();
    for _ in 0..5 {
        graph.evaluate(&mut ());
        seen.push((*graph.get(place), *graph.get(before)));
    }
    assert_eq!(seen, [(1.0, 0.0), (2.0, 1.0), (3.0, 2.0), (3.0, 3.0), (3.0, 3.0)]);
    assert_eq!(graph.evaluations(place), 4, "it rests where the last frame brought nothing new");
    // A value set between frames is not yet the last frame's.
    let shown = graph.field("shown", 0.0).unwrap();
    let shown_last = graph.previous(shown).unwrap();
    let both = graph.field("both", 0.0).unwrap();
    graph.compute(both, "", (shown, shown_last), |(), (now, last): (&f64, &f64)| 10.0 * now + last).unwrap();
    graph.set(shown, 1.0).unwrap();
    graph.evaluate(&mut ());
    assert_eq!(*graph.get(both), 10.0);
    graph.evaluate(&mut ());
    assert_eq!(*graph.get(both), 11.0);
    // A new start is the last frame's as well.
    graph.restore(place, 0.5);
    graph.evaluate(&mut ());
    assert_eq!(*graph.get(place), 1.5);
}

#[test]
fn the_listing_names_types_and_connections() {
    let Small { mut graph, all, .. } = small();
    graph.previous(all).unwrap();
    assert_eq!(
        graph.text(),
        "\
left          number  set from outside
right         number  set from outside
  sum         number  = add(left, right)
    double    number  = double(sum)
      all     number  = add(sum, double, right)
all.previous  number  all of the last frame
"
    );
    let dot = graph.dot();
    for line in [
        "digraph fields {",
        "  \"left\" [label=\"left\\nnumber\", style=filled, fillcolor=\"#dfe9f5\"];",
        "  \"sum\" [label=\"sum\\nnumber\\nadd\"];",
        "  \"left\" -> \"sum\";",
        "  \"all\" -> \"all.previous\" [style=dashed, constraint=false];",
    ] {
        assert!(dot.lines().any(|found| found == line), "{line}\n{dot}");
    }
}

/// A random graph: field i is made from some of those before it in a shuffled order, or set from outside.
#[derive(Clone, Debug)]
struct Plan {
    /// Per field: numbers that choose its inputs; none: it is set from outside.
    inputs: Vec<Vec<prop::sample::Index>>,
    /// The order in which fields are connected.
    shuffle: Vec<usize>,
    /// Per frame: what is set.
    frames: Vec<Vec<(prop::sample::Index, i8)>>,
}

fn plan() -> impl Strategy<Value = Plan> {
    let any_index = any::<prop::sample::Index>;
    (2..20usize).prop_flat_map(move |n| {
        let inputs = prop::collection::vec(prop::collection::vec(any_index(), 0..4), n);
        let frames = prop::collection::vec(prop::collection::vec((any_index(), -2..3i8), 0..4), 1..8);
        (inputs, Just((0..n).collect::<Vec<_>>()).prop_shuffle(), frames)
            .prop_map(|(inputs, shuffle, frames)| Plan { inputs, shuffle, frames })
    })
}

/// Saturates, so that many a sum does not change when its parts do.
fn mix(values: impl Iterator<Item = f64>) -> f64 {
    values.enumerate().map(|(i, x)| x * (i as f64 + 1.0)).sum::<f64>().clamp(-5.0, 5.0)
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 300, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn a_random_graph_agrees_with_a_naive_evaluator(plan in plan()) {
        let n = plan.inputs.len();
        let mut graph = Graph::<Vec<usize>>::default();
        let fields: Vec<Field<f64>> = (0..n).map(|i| graph.field(format!("f{i}"), 0.0).unwrap()).collect();
        // Inputs by number, each once, in ascending order.
        let inputs: Vec<Vec<usize>> = plan
            .inputs
            .iter()
            .enumerate()
            .map(|(i, chosen)| {
                let mut inputs: Vec<usize> =
                    chosen.iter().filter(|_| i > 0).map(|index| index.index(i.max(1))).collect();
                inputs.sort_unstable();
                inputs.dedup();
                inputs
            })
            .collect();
        for &i in plan.shuffle.iter().filter(|&&i| !inputs[i].is_empty()) {
            let from: Vec<Field<f64>> = inputs[i].iter().map(|&input| fields[input]).collect();
            graph
                .compute(fields[i], "mix", from, move |ran: &mut Vec<usize>, values: Each<'_, Field<f64>>| {
                    ran.push(i);
                    mix(values.iter().copied())
                })
                .unwrap();
        }
        let mut naive = vec![0.0; n];
        let mut before: Option<Vec<f64>> = None;
        for frame in &plan.frames {
            // Each field is set at most once a frame: one that is set to and fro counts as changed.
            let set: BTreeMap<usize, i8> = frame.iter().map(|(index, value)| (index.index(n), *value)).collect();
            for (i, value) in set {
                let refused = graph.set(fields[i], f64::from(value)).is_err();
                prop_assert_eq!(refused, !inputs[i].is_empty());
                if !refused {
                    naive[i] = f64::from(value);
                }
            }
            for i in (0..n).filter(|&i| !inputs[i].is_empty()) {
                naive[i] = mix(inputs[i].iter().map(|&input| naive[input]));
            }
            let mut ran = Vec::new();
            graph.evaluate(&mut ran);
            let values: Vec<f64> = fields.iter().map(|field| *graph.get(*field)).collect();
            prop_assert_eq!(&values, &naive);
            for (at, i) in ran.iter().enumerate() {
                prop_assert!(!ran[..at].contains(i), "f{} ran twice", i);
                prop_assert!(!ran[..at].iter().any(|earlier| inputs[*earlier].contains(i)), "f{} ran too late", i);
            }
            for i in (0..n).filter(|&i| !inputs[i].is_empty()) {
                let changed = |before: &Vec<f64>| inputs[i].iter().any(|&input| before[input] != naive[input]);
                prop_assert_eq!(ran.contains(&i), before.as_ref().is_none_or(changed), "f{}", i);
            }
            before = Some(naive.clone());
        }
        // Any connection from a field to one that it is made from closes a circle.
        for (i, inputs) in inputs.iter().enumerate() {
            for &input in inputs {
                let from = fields[i];
                graph.disconnect(fields[input]);
                let is_circle = matches!(graph.connect(fields[input], from), Err(FieldError::Circle { .. }));
                prop_assert!(is_circle);
            }
        }
    }
}

/// Numbers, text, lists and a field of the last frame.
fn streamed() -> (Graph<()>, Field<f64>, Field<String>, Field<f64>) {
    let mut graph = Graph::default();
    let number = graph.field("number", 0.1).unwrap();
    let text = graph.field("text", "a \"quoted\"\nline".to_owned()).unwrap();
    graph.field("count", u64::MAX).unwrap();
    let double = graph.field("double", 0.0).unwrap();
    let last = graph.previous(double).unwrap();
    graph
        .compute(double, "double", (number, last), |(), (x, last): (&f64, &f64)| 2.0 * x + 0.5 * last)
        .unwrap();
    (graph, number, text, double)
}

fn written(graph: &Graph<()>) -> String {
    let mut bytes = Vec::new();
    graph.write(&mut bytes).unwrap();
    String::from_utf8(bytes).unwrap()
}

#[test]
fn a_graph_read_from_a_stream_goes_on_as_the_one_that_was_written() {
    let (mut first, number, text, double) = streamed();
    for step in 0..5 {
        first.set(number, f64::from(step) / 3.0).unwrap();
        first.evaluate(&mut ());
    }
    first.set(text, "other".into()).unwrap();
    let (mut second, ..) = streamed();
    let stream = written(&first);
    assert!(stream.starts_with("{\"greenstage\":\"fields\",\"version\":2,\"fields\":5}\n"), "{stream}");
    let mut line = 0;
    second.read(&mut stream.as_bytes(), &mut line).unwrap();
    assert_eq!((line, written(&second)), (6, stream));
    for step in 0..5 {
        for graph in [&mut first, &mut second] {
            graph.set(number, f64::from(step * step)).unwrap();
            graph.evaluate(&mut ());
        }
        assert_eq!(first.get(double).to_bits(), second.get(double).to_bits());
    }
}

#[test]
fn a_faulty_stream_changes_nothing_and_says_where_it_is_wrong() {
    let (mut graph, ..) = streamed();
    graph.evaluate(&mut ());
    let good = written(&graph);
    let whole = good.replace("0.1", "0.7");
    for (from, to, said) in [
        ("\"fields\":5", "\"fields\":4", "line 1: it says 4 fields, this graph has 5"),
        ("\"fields\":5", "\"fields\":18446744073709551615", "line 1: it says 18446744073709551615 fields"),
        (
            "\"version\":2",
            "\"version\":3",
            "line 1: not a stream of fields of version 2, but fields of version 3",
        ),
        ("\"greenstage\":", "\"other\":", "line 1: unknown field `other`"),
        (
            "\"field\":\"number\"",
            "\"field\":\"numer\"",
            "line 2: this graph has no field numer; did you mean \"number\"?",
        ),
        ("\"field\":\"double\"", "\"field\":\"number\"", "line 5: field number is there twice"),
        (
            "\"type\":\"text\"",
            "\"type\":\"number\"",
            "line 3: field text is a number here, a text in this graph",
        ),
        ("\"value\":0.7", "\"value\":\"0.7\"", "line 2: field number: not a number: invalid type: string"),
        ("\"value\":0.7}", "\"value\":0.7,\"more\":1}", "line 2: unknown field `more`"),
        ("\"value\":0.7}\n", "\"value\":0.7", "line 2: expected"),
    ] {
        assert!(whole.contains(from), "{from}\n{whole}");
        let error = graph.read(&mut whole.replacen(from, to, 1).as_bytes(), &mut 0).unwrap_err().to_string();
        assert!(error.starts_with(said), "{error} does not start with {said}");
        assert_eq!(written(&graph), good, "{said}");
    }
    for cut in 0..whole.len() {
        assert!(graph.read(&mut &whole.as_bytes()[..cut], &mut 0).is_err(), "cut at {cut}");
    }
    assert_eq!(written(&graph), good);
    let endless = std::io::Read::take(std::io::repeat(b' '), 3 << 20);
    let error = graph.read(&mut std::io::BufReader::new(endless), &mut 0).unwrap_err();
    assert!(error.to_string().starts_with("line 1 is longer than 1048576 bytes"), "{error}");
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 2000, failure_persistence: None, ..ProptestConfig::default() })]

    /// Either the stream still says the same, or another valid state, or it is refused and nothing changes.
    #[test]
    fn no_mutated_stream_panics_or_half_changes_a_graph(
        mutations in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>(), 0..3u8), 1..6),
    ) {
        let (mut graph, ..) = streamed();
        graph.evaluate(&mut ());
        let good = written(&graph);
        let mut bytes = good.replace("0.1", "0.3").into_bytes();
        for (index, byte, how) in mutations {
            let at = index.index(bytes.len());
            match how {
                0 => bytes[at] = byte,
                1 => bytes[at] ^= 1 << (byte % 8),
                _ => drop(bytes.drain(at..(at + 1 + usize::from(byte) / 16).min(bytes.len()))),
            }
            if bytes.is_empty() {
                break;
            }
        }
        match graph.read(&mut bytes.as_slice(), &mut 0) {
            Ok(()) => graph.evaluate(&mut ()),
            Err(error) => {
                prop_assert!(!error.to_string().is_empty());
                prop_assert_eq!(written(&graph), good);
            }
        }
    }
}

#[test]
fn inspect_prints_the_graph_of_a_scene_without_solving_it() {
    let inspect = |arguments: &[&str]| {
        let arguments = [&["inspect"], arguments].concat();
        let output = program(Path::new(env!("CARGO_MANIFEST_DIR")), &arguments).output().unwrap();
        (output.status.code(), text(&output.stdout), text(&output.stderr))
    };
    let (status, text, _) = inspect(&["configs/scenes/tube.toml", "--graph"]);
    assert_eq!(status, Some(0));
    // name, type, and what it is made from
    let cells = text.lines().map(|line| line.split("  ").map(str::trim).filter(|cell| !cell.is_empty()));
    let rows: Vec<Vec<&str>> = cells.map(Iterator::collect).collect();
    let row = |name: &str| rows.iter().find(|row| row[0] == name).unwrap().as_slice();
    assert_eq!(row("stylus.right"), ["stylus.right", "stylus", "set from outside"]);
    assert_eq!(row("body.tube.surface"), ["body.tube.surface", "surface", "= sum(body.tube.coefficients)"]);
    let from = ["control.left.pose", "control.right.pose", "arrived"].map(|own| format!("body.tube.{own}"));
    assert_eq!(row("body.tube.coefficients")[2], format!("= coefficients({})", from.join(", ")));
    let (status, dot, _) = inspect(&["configs/scenes/tube.toml", "--graph", "dot"]);
    assert_eq!(status, Some(0));
    assert!(dot.starts_with("digraph fields {\n") && dot.ends_with("}\n"));
    assert_eq!(dot.matches("[label=").count(), text.lines().count(), "a box per field");
    let (status, _, said) = inspect(&["configs/stages/desktop.toml", "--graph"]);
    assert!(status == Some(2) && said.contains("only a scene has a data flow to show"), "{said}");
}
