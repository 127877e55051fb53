//! A cut that goes on from new bases in a world.

use super::operated::{BOTH, Operated, parsed, text};
use crate::effect::file_of;
use crate::interact::Action;
use nalgebra::Vector3;

type V3 = Vector3<f64>;

/// Number of steps, steps in the base of the last one, and those in a base that is being worked out.
fn steps(operated: &Operated) -> (usize, u64, Option<u64>) {
    let memory = operated.world.effects[0].memory().unwrap();
    let memory: serde_json::Value = serde_json::from_str(memory.get()).unwrap();
    let body = &memory["bodies"][0];
    let steps = body["steps"].as_array().unwrap();
    (
        steps.len(),
        steps.last().map_or(0, |step| step["base"].as_u64().unwrap()),
        body["renewal"]["at"].as_u64(),
    )
}

/// A slit with more copies than a base is good for. A world that takes the state before, during and after the change goes on with the same bits;
/// undo gives the whole body back, bit by bit, and what is cut again is the same but for rounding.
#[test]
fn a_long_cut_goes_on_from_a_new_base() {
    let scene = parsed(&text(BOTH, "", "").replace("[9, 4, 3]", "[5, 13, 13]")).unwrap();
    let file = file_of(&scene).unwrap();
    let mut first = Operated::new(&scene, &file);
    let (above, below) = (V3::new(0.011, 0.06, -0.1), V3::new(0.011, -0.03, -0.1));
    let way = |k: usize| above.lerp(&below, k.min(24) as f64 / 24.0);
    first.put(way(0));
    first.hold(V3::new(0.004, -0.003, 0.002));
    first.put(way(0));
    let whole = first.places();
    let mut taken = vec![None; 3];
    let mut hashes = Vec::new();
    for k in 1..=40 {
        first.put(way(k));
        hashes.push(first.world.state_hash());
        let stage = match steps(&first) {
            (3, 0, None) => 0,
            (_, 0, Some(_)) => 1,
            (_, base, None) if base > 0 => 2,
            _ => continue,
        };
        taken[stage]
            .get_or_insert_with(|| (k, serde_json::to_string(&first.world.state().unwrap()).unwrap()));
    }
    let (count, base, _) = steps(&first);
    println!("{count} steps, {base} of them in the last base, {} nodes", first.nodes());
    for (stage, at) in taken.into_iter().enumerate() {
        let (k, state) = at.unwrap();
        println!("stage {stage} from frame {k}");
        let mut second = Operated::new(&scene, &file);
        second.world.set_state(&serde_json::from_str(&state).unwrap()).unwrap();
        second.frame = first.frame - 40 + k;
        for k in k + 1..=40.min(k + 14) {
            second.put(way(k));
            assert_eq!(hashes[k - 1], second.world.state_hash(), "stage {stage}, frame {k}");
        }
    }
    assert!(first.is_quiet(), "{:?}", first.world.warnings);
    // The blade goes out through the slit.
    (0..12).for_each(|_| first.put(above));
    let cut = first.places();
    first.act(Action::Undo, above);
    first.wait(above);
    assert!(first.places() == whole);
    first.act(Action::Redo, above);
    (0..30).for_each(|_| first.put(above));
    let again = first.places();
    let lengths = [again.len(), cut.len()];
    let off = again.iter().zip(&cut).map(|(x, y)| (x - y).amax()).fold(0.0, f64::max);
    println!("cut again: {off:e} m off");
    assert!(lengths[0] == lengths[1] && off < 1e-8, "{lengths:?}, {off:e}");
}
