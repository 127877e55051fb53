//! Blades in a world: whole cuts, slits, the force of cutting, and cuts that go on from a state.

use super::blade::Sweep;
use super::operated::{BOTH, Operated, parsed, scene, text};
use crate::deform::ControlPose;
use crate::effect::{Resolved, file_of};
use crate::interact::Action;
use crate::render::Drawable;
use nalgebra::Vector3;
use std::path::Path;

type V3 = Vector3<f64>;

/// A block that is cut in two by a blade that comes from above: each half moves with its own end alone, and the ends pull no more.
#[test]
fn halves_go_each_with_its_own_end() {
    // Along x the frame of both halves does not turn.
    for (keys, pull) in [("", V3::new(0.02, 0.013, -0.01)), ("model = \"rotation\"", V3::new(0.02, 0.0, 0.0))]
    {
        let mut operated = Operated::of(BOTH, keys);
        let before = operated.nodes();
        operated.pass(V3::new(0.011, 0.08, -0.1), V3::new(0.011, -0.08, -0.1), 16);
        assert!(operated.nodes() > before && operated.is_quiet());
        let far = ControlPose { translation: pull, ..ControlPose::REST };
        let moved = operated.moved(far);
        let pulled: Vec<f64> = moved.iter().map(|(_, u)| u.norm()).collect();
        let of = |side: &dyn Fn(f64) -> bool| -> Vec<f64> {
            let own = moved.iter().zip(&pulled).filter(|((x, _), _)| side(x.x));
            own.map(|(_, u)| *u).collect()
        };
        let (left, right) = (of(&|x| x < 0.005), of(&|x| x > 0.017));
        let rest = left.iter().fold(0.0_f64, |most, u| most.max(*u));
        let off = right.iter().map(|u| (u - pull.norm()).abs()).fold(0.0, f64::max);
        println!("{keys}: left moves by {rest:e} m, right by {off:e} m too much");
        assert!(rest < 2e-8 && off < 2e-8, "{rest:e}, {off:e}");
        // E A δ²/(2 L) of the whole block is 0.4 J. `rotation` has no energy of the cut body.
        let energy = operated.world.bodies[0].deformer.wrenches().map(|(_, energy)| energy);
        assert!(energy.map_or(!keys.is_empty(), |energy| energy.abs() < 4e-14), "{energy:?} J");
    }
}

/// A cut beside a control element: nothing of it is left at the far side.
#[test]
fn a_cut_beside_what_is_held_separates() {
    let mut operated = Operated::of(BOTH, "");
    operated.pass(V3::new(-0.139, 0.08, -0.1), V3::new(-0.139, -0.08, -0.1), 16);
    assert!(operated.is_quiet(), "{:?}", operated.world.warnings);
    let pull = V3::new(0.02, 0.013, -0.01);
    let moved = operated.moved(ControlPose { translation: pull, ..ControlPose::REST });
    let off = |(x, u): &(V3, V3)| (u - if x.x < -0.139 { V3::zeros() } else { pull }).norm();
    // Points of the cut lie at -0.139 on both sides.
    let most = moved.iter().filter(|(x, _)| (x.x + 0.139).abs() > 1e-3).map(off).fold(0.0, f64::max);
    let energy = operated.world.bodies[0].deformer.wrenches().map_or(f64::NAN, |(_, energy)| energy);
    println!("off by {most:e} m, {energy:e} J");
    assert!(most < 2e-8 && energy.abs() < 1.5e-13, "{most:e} m, {energy:e} J");
}

/// The force of an end that is held still falls with the cut, and is gone with the last of the section.
#[test]
fn a_held_end_pulls_less_while_it_is_cut() {
    let mut operated = Operated::of(BOTH, "");
    operated.hold(V3::new(0.01, 0.0, 0.0));
    let mut last = f64::INFINITY;
    for k in 0..=20 {
        operated.put(V3::new(0.011, 0.08 - 0.008 * f64::from(k), -0.1));
        let (wrenches, _) = operated.world.bodies[0].deformer.wrenches().unwrap();
        let pull = wrenches[1].force.x;
        assert!(pull <= last + 1e-9, "step {k}: {pull} N after {last} N");
        last = pull;
        if k == 0 {
            // E A δ/L = 20 N, and more since the ends cannot narrow.
            assert!((19.9..22.0).contains(&pull), "{pull} N");
        }
    }
    operated.wait(V3::new(0.011, -0.08, -0.1));
    let last = operated.world.bodies[0].deformer.wrenches().unwrap().0[1].force.x;
    println!("{last:e} N are left");
    assert!(last.abs() < 8e-13, "{last} N");
}

/// Slits, cut twice along the same way: the second pass finds nothing more to cut. One through both ends of the block: they hold both sides.
#[test]
fn a_second_pass_cuts_nothing_more() {
    let mut operated = Operated::of(BOTH, "");
    let (above, inside) = (V3::new(0.011, 0.08, -0.1), V3::new(0.011, 0.004, -0.1));
    operated.pass(above, inside, 7);
    let once = operated.nodes();
    assert!(once > 0);
    operated.pass(inside, above, 5);
    operated.pass(above, inside, 9);
    assert_eq!(operated.nodes(), once);
    let held = |operated: &Operated| operated.world.bodies[0].deformer.control_nodes(1).len();
    let before = held(&operated);
    operated.pass(V3::new(-0.2, 0.013, -0.1), V3::new(0.2, 0.013, -0.1), 20);
    // Points of the cut between nodes of an element belong to it.
    assert!(held(&operated) > before);
    assert!(operated.nodes() > once && operated.is_quiet(), "{:?}", operated.world.warnings);
}

/// A state in the middle of a cut: another world that takes it goes on with the same bits.
#[test]
fn a_cut_goes_on_from_a_state() {
    let scene = scene(BOTH, "model = \"rotation\"").unwrap();
    let file = file_of(&scene).unwrap();
    let mut first = Operated::new(&scene, &file);
    let (above, below) = (V3::new(0.011, 0.08, -0.1), V3::new(0.011, 0.01, -0.1));
    let way = |k: usize| above.lerp(&below, k as f64 / 12.0);
    first.put(way(0));
    first.hold(V3::new(0.004, -0.003, 0.002));
    (1..8).for_each(|k| first.put(way(k)));
    let state = serde_json::to_string(&first.world.state().unwrap()).unwrap();
    let mut second = Operated::new(&scene, &file);
    second.world.set_state(&serde_json::from_str(&state).unwrap()).unwrap();
    second.frame = first.frame;
    assert_eq!(second.nodes(), first.nodes());
    for k in 8..=12 {
        [&mut first, &mut second].into_iter().for_each(|operated| operated.put(way(k)));
        assert_eq!(first.world.state_hash(), second.world.state_hash(), "frame {k}");
    }
    // Edges that this body does not have, and cuts off an edge's end.
    let edges = first.world.effects[0].memory().unwrap().get().to_owned();
    let at = edges.find("\"steps\":[{\"edges\":[[[").unwrap() + "\"steps\":[{\"edges\":[[[".len();
    let pair = &edges[at..at + edges[at..].find(']').unwrap()];
    let state = serde_json::to_string(&first.world.state().unwrap()).unwrap();
    let broken = state.replacen(&format!("[[{pair}]"), "[[0,0]", 1);
    assert_ne!(broken, state);
    let error = second.world.set_state(&serde_json::from_str(&broken).unwrap()).unwrap_err();
    assert!(error.contains("another body"), "{error}");
}

/// Two slits that are taken back one after the other, and cut again; a world that takes the state in between goes on with the same bits.
#[test]
fn strokes_are_undone_and_done_again() {
    let scene = scene(BOTH, "model = \"rotation\"").unwrap();
    let file = file_of(&scene).unwrap();
    let mut first = Operated::new(&scene, &file);
    let (low, away) = (V3::new(0.0, 0.01, -0.1), V3::new(0.3, 0.2, -0.1));
    let mut counts = vec![first.nodes()];
    for x in [0.011, -0.045] {
        let at = V3::x() * x;
        first.pass(at + V3::new(0.0, 0.08, -0.1), at + low, 9);
        first.put(at + V3::new(0.0, 0.2, -0.1));
        (0..30).for_each(|_| first.put(away));
        counts.push(first.nodes());
    }
    assert!(counts[0] < counts[1] && counts[1] < counts[2], "{counts:?}");
    assert_eq!(first.world.undo_depth(), [2, 0]);
    let rounded = |operated: &Operated| -> Vec<[i64; 3]> {
        operated.places().iter().map(|x| [x.x, x.y, x.z].map(|x| (x * 1e8).round() as i64)).collect()
    };
    first.hold(V3::new(0.004, -0.003, 0.002));
    first.put(away);
    let open = rounded(&first);
    let mut second: Option<Operated> = None;
    for (action, nodes) in [
        (Action::Undo, counts[1]),
        (Action::Undo, counts[0]),
        (Action::Redo, counts[1]),
        (Action::Redo, counts[2]),
        (Action::Undo, counts[1]),
        (Action::Redo, counts[2]),
    ] {
        for operated in [Some(&mut first), second.as_mut()].into_iter().flatten() {
            operated.act(action, away);
            operated.wait(away);
            assert_eq!(operated.nodes(), nodes, "{action:?}");
        }
        let other = second.get_or_insert_with(|| {
            let state = serde_json::to_string(&first.world.state().unwrap()).unwrap();
            let mut other = Operated::new(&scene, &file);
            other.world.set_state(&serde_json::from_str(&state).unwrap()).unwrap();
            other.frame = first.frame;
            other
        });
        assert_eq!(first.world.state_hash(), other.world.state_hash(), "{action:?}");
    }
    assert!(first.is_quiet(), "{:?}", first.world.warnings);
    // In two steps instead of many: the same but for rounding.
    let differ = rounded(&first).iter().zip(&open).filter(|(a, b)| a != b).count();
    println!("{differ} of {} nodes differ by 1e-8 m", open.len());
    assert!(differ < open.len() / 10, "{differ}");
    // A new stroke ends what could be done again.
    first.act(Action::Undo, away);
    first.pass(V3::new(0.08, 0.08, -0.1), V3::new(0.08, 0.01, -0.1), 9);
    assert_eq!(first.world.undo_depth(), [2, 0]);
}

/// A world that takes the place of another, as after a change in the panel, can take its cuts back; a reset body is whole.
#[test]
fn a_cut_is_undone_in_the_next_world_and_gone_after_a_reset() {
    let scene = scene(BOTH, "model = \"rotation\"").unwrap();
    let file = file_of(&scene).unwrap();
    let mut first = Operated::new(&scene, &file);
    let away = V3::new(0.3, 0.2, -0.1);
    let whole = first.nodes();
    first.pass(V3::new(0.011, 0.08, -0.1), V3::new(0.011, 0.01, -0.1), 9);
    (0..30).for_each(|_| first.put(away));
    let cut = first.nodes();
    assert!(whole < cut, "{whole} {cut}");

    let mut next = Operated::new(&scene, &file);
    next.world.carry_over(&mut first.world);
    next.frame = first.frame;
    next.put(away);
    assert_eq!((next.nodes(), next.world.undo_depth()), (cut, [1, 0]));
    next.act(Action::Undo, away);
    next.wait(away);
    assert_eq!((next.nodes(), next.world.undo_depth()), (whole, [0, 1]));

    // Effects of a live session join later.
    next.act(Action::Redo, away);
    next.wait(away);
    next.world.join(Vec::new()).unwrap();
    for reset in [&mut first, &mut next] {
        assert_eq!(reset.nodes(), cut);
        reset.act(Action::Reset, away);
        reset.wait(away);
        assert_eq!((reset.nodes(), reset.world.undo_depth()), (whole, [0, 0]));
    }
    let rest = Operated::new(&scene, &file);
    assert_eq!(first.places(), rest.places());
    assert!(first.is_quiet() && next.is_quiet(), "{:?} {:?}", first.world.warnings, next.world.warnings);
}

/// A blade that stands still cuts what is moved through it, and one that is carried along cuts nothing.
#[test]
fn what_counts_is_how_blade_and_body_move_against_each_other() {
    let [a, b] = [V3::new(-1.0, 0.0, 0.0), V3::new(1.0, 0.0, 0.0)];
    let still = [V3::new(0.2, 0.5, -1.0), V3::new(0.2, 0.5, 1.0)];
    let up = V3::new(0.0, 1.0, 0.0);
    let sweep = Sweep { from: still, to: still };
    let cut = |sweep: &Sweep, by: V3| sweep.crossed(&[[0, 1]], (&[a, b], &[a + by, b + by]));
    let found = cut(&sweep, up);
    assert!(found.len() == 1 && (found[0].1 - 0.6).abs() < 1e-12, "{found:?}");
    assert!(cut(&sweep, V3::zeros()).is_empty());
    assert!(cut(&sweep, up * 0.4).is_empty());
    let carried = Sweep { from: still, to: still.map(|end| end + up) };
    assert!(cut(&carried, up).is_empty());
    let towards = Sweep { from: still, to: still.map(|end| end - up * 0.3) };
    assert_eq!(cut(&towards, up * 0.3).len(), 1);
    assert!(cut(&towards, up * 0.1).is_empty());
}

#[test]
fn bodies_that_cannot_be_cut_are_refused() {
    for (keys, told) in [
        ("element = \"tet10\"", "write element = \"tet4\""),
        ("model = \"reduced\"", "write model = \"linear\" or \"rotation\""),
        ("load.squeeze = { nodes = { group = \"ymax\" }, kind = \"pressure\" }", "body.b.load.squeeze: "),
        ("accuracy = { force = 0.1 }", "measured of the whole body"),
        ("effects = [\"cut\", \"stress\"]", "\"stress\" keeps numbers"),
        ("effects = [\"cut\", \"force_curve\"]\nmodel = \"rotation\"", "write model = \"linear\""),
    ] {
        let error = scene(BOTH, keys).unwrap_err();
        assert!(error.contains(told), "{keys}: {error}");
    }
    let text = "[body.b]\ngenerate = { block = { size = [1.0, 1.0, 1.0], cells = [2, 2, 2] } }\n\
                material = { young = 1.0, poisson = 0.3 }\neffects = [\"cut\"]\n\
                control.low = { nodes = { group = \"xmin\" }, grab = \"fixed\" }\n";
    let scene = Resolved::parse(text, Path::new("cut.toml")).and_then(|scene| scene.requirements("b"));
    assert!(scene.unwrap_err().to_string().contains("nothing cuts the body"));
}

/// A block of 0.1 m × 0.06 m with a toughness of 100 J/m² that is cut in two: 0.6 J, with 6 N in the middle. A slit that is passed again takes
/// no force.
#[test]
fn cutting_takes_toughness_times_area() {
    let text = text(BOTH, "effect.cut = { toughness = 100.0 }", "").replace("[9, 4, 3]", "[17, 8, 6]");
    let scene = parsed(&text).unwrap();
    let mut operated = Operated::new(&scene, &file_of(&scene).unwrap());
    let resistance = |operated: &Operated| -> [f64; 3] {
        let memory = operated.world.effects[0].memory().unwrap();
        let memory: serde_json::Value = serde_json::from_str(memory.get()).unwrap();
        ["due", "done", "limit"].map(|name| memory["bodies"][0]["resistances"][0][name].as_f64().unwrap())
    };
    let shown = |operated: &Operated| {
        let plates =
            operated.world.frame.drawables.iter().filter(|drawable| matches!(drawable, Drawable::Plate(_)));
        plates.count()
    };
    let [above, middle, below] = [0.08, -0.03, -0.08].map(|y| V3::new(0.011, y, -0.1));
    let mut forces = Vec::new();
    for k in 0..110 {
        operated.put(above.lerp(&middle, f64::from(k) / 110.0));
        forces.push(resistance(&operated)[2]);
    }
    assert!(shown(&operated) > 0);
    let late = &forces[60..];
    let mean = late.iter().sum::<f64>() / late.len() as f64;
    let (least, most) =
        late.iter().fold((f64::MAX, 0.0_f64), |(least, most), f| (least.min(*f), most.max(*f)));
    println!("{mean} N of 6 N, {least} to {most} N");
    assert!((mean / 6.0 - 1.0).abs() < 0.2 && least > 3.0 && most < 12.0, "{mean}: {least} to {most}");
    operated.put(middle);
    let before = resistance(&operated);
    let lifted = middle.lerp(&above, 0.8);
    operated.pass(middle, lifted, 20);
    assert_eq!(shown(&operated), 0);
    operated.pass(lifted, middle, 20);
    assert!((resistance(&operated)[1] - before[1]).abs() < 1e-9);
    // What is due when the blade leaves the block is not asked for.
    let mut works = Vec::new();
    for k in 0..80 {
        operated.put(middle.lerp(&below, f64::from(k) / 80.0));
        let [due, done, _] = resistance(&operated);
        works.push(due + done);
    }
    let work = works.iter().copied().fold(0.0, f64::max);
    println!("{work} J of 0.6 J, {:e} off, {} J of them done", work - 0.6, resistance(&operated)[1]);
    assert!((work - 0.6).abs() < 3e-15 && resistance(&operated)[1] > 0.5, "{work} J");
    assert!(operated.world.effects[0].summary().contains("J of work"));
}

/// A ball that presses the lip of a cut, while the cut grows: the surface goes round it in every frame, and a world that takes the state in
/// between goes on with the same bits.
#[test]
fn a_ball_presses_the_lip_of_a_growing_cut() {
    let keys = "effects = [\"cut\", \"contact\"]\neffect.contact = { friction = 0.2 }\n";
    let ball = "[tool.probe]\nshape = { ball = { radius = 0.02 } }\nstylus = 2\n";
    let scene = parsed(&text(BOTH, keys, ball)).unwrap();
    let file = file_of(&scene).unwrap();
    let mut first = Operated::new(&scene, &file);
    // A slit from above to the middle, then the ball beside it.
    let (above, middle, low) =
        (V3::new(0.011, 0.08, -0.1), V3::new(0.011, 0.01, -0.1), V3::new(0.011, -0.04, -0.1));
    first.pass(above, middle, 7);
    let ball = |k: usize| V3::new(0.024, 0.075 - 0.001 * k as f64, 0.0);
    (0..15).for_each(|k| first.put_both(middle, ball(k)));
    let (before, lip) = (first.nodes(), first.lowest_beside(0.024));
    let mut second: Option<Operated> = None;
    let (mut deepest, mut growing) = (0.0_f64, 0);
    for k in 0..20 {
        let blade = middle.lerp(&low, k as f64 / 20.0);
        let had = first.nodes();
        for operated in [Some(&mut first), second.as_mut()].into_iter().flatten() {
            operated.put_both(blade, ball(14));
        }
        growing += usize::from(first.nodes() > had);
        if let Some(second) = &mut second {
            assert_eq!(first.world.state_hash(), second.world.state_hash(), "frame {k}");
        }
        deepest = deepest.max(first.within_ball(ball(14), 0.02));
        if k == 9 {
            let state = serde_json::to_string(&first.world.state().unwrap()).unwrap();
            let mut other = Operated::new(&scene, &file);
            other.world.set_state(&serde_json::from_str(&state).unwrap()).unwrap();
            other.frame = first.frame;
            second = Some(other);
        }
    }
    println!(
        "{growing} growing frames from {before} to {} nodes, {deepest:e} m within the ball",
        first.nodes()
    );
    println!("the lip went from {lip} to {} m", first.lowest_beside(0.024));
    assert!(first.is_quiet(), "{:?}", first.world.warnings);
    assert!(growing > 3 && deepest < 1e-7, "{growing}, {deepest}");
    // The deeper the slit, the softer its lip; the ball keeps it where it is.
    assert!(lip < -0.006 && (first.lowest_beside(0.024) - lip).abs() < 1e-3);
}
