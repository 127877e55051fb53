//! A compressed compliance beside the whole one of the same body, its size, and its damages.

use super::*;
use crate::green::{self, AFFINE, COMPLIANCE, Requirements};
use crate::scene::Scene;
use crate::solve::Silent;
use nalgebra::Matrix3;
use proptest::prelude::*;
use std::path::Path;
use std::sync::LazyLock;

type M3 = Matrix3<f64>;

fn text(size: &str, cells: &str, compliance: &str) -> String {
    format!(
        "[body.a]\ngenerate = {{ block = {{ size = {size}, cells = {cells} }} }}\n\
         material = {{ young = 2e5, poisson = 0.3 }}\nsurface_compliance = {{ {compliance} }}\n\
         [body.a.control.low]\nnodes = {{ group = \"xmin\" }}\ngrab = \"fixed\"\n\
         [body.a.control.high]\nnodes = {{ group = \"xmax\" }}\ngrab = \"dragger\"\n"
    )
}

/// The file of a body, in memory alone.
fn made(size: &str, cells: &str, compliance: &str, family: Family) -> Arc<GreenFile> {
    let scene = Scene::parse(&text(size, cells, compliance), Path::new("any.toml")).unwrap();
    let required = Requirements::new(&[AFFINE, family]);
    let made = green::precompute(&scene, "a", &required, &Silent).unwrap();
    green::opened(&[made]).unwrap()
}

fn bytes_of(file: &GreenFile) -> usize {
    let tensors = file.tensors().filter(|(name, ..)| name.starts_with("a/compressed/"));
    tensors.map(|(.., size)| size).sum()
}

/// All columns by the node of the surface that the force is at.
fn columns(file: &GreenFile) -> BTreeMap<u32, Yield> {
    let compliance = file.compliance("a").unwrap();
    compliance.places().into_iter().map(|(node, place)| (node, compliance.column(place).unwrap())).collect()
}

fn matrix(of: &[[f32; 3]; 3]) -> M3 {
    M3::from_fn(|axis, force| f64::from(of[axis][force]))
}

/// The largest displacement that is wrong where a force moves the node under it by 1.
fn error(found: &BTreeMap<u32, Yield>, exact: &BTreeMap<u32, Yield>) -> f64 {
    let larger = |largest: f64, (node, found): (&u32, &Yield)| {
        let exact = &exact[node];
        let inverse = matrix(&exact[*node as usize]).try_inverse().unwrap();
        let off = found.iter().zip(exact).map(|(a, b)| (matrix(a) - matrix(b)) * inverse);
        // ‖·‖₂ is at most Frobenius' norm, which takes less.
        off.fold(largest, |largest, off| match off.norm() > largest {
            true => largest.max(off.singular_values().max()),
            false => largest,
        })
    };
    found.iter().fold(0.0, larger)
}

const LONG: [&str; 2] = ["[4, 1, 1]", "[24, 6, 6]"];

/// The compressed compliance against the whole inverse, at every node and not only at those that were measured; for forces on a
/// part of the surface too.
#[test]
fn a_compressed_compliance_is_the_inverse_within_its_error() {
    let [size, cells] = LONG;
    let some = "{ box = { min = [-9, -9, -9], max = [0.3, 9, 9] } }";
    let whole = made(size, cells, "nodes = \"surface\"", COMPLIANCE);
    let exact = columns(&whole);
    for (nodes, errors) in [("\"surface\"", &[1e-2, 1e-3, 1e-5][..]), (some, &[1e-4])] {
        for asked in errors {
            let file =
                made(size, cells, &format!("nodes = {nodes}, kept = {{ error = {asked:e} }}"), COMPRESSED);
            let meta = file.meta.bodies["a"].compressed.unwrap();
            let found = columns(&file);
            let off = error(&found, &exact);
            let (count, all) = (found.len(), file.count("a/compressed/order"));
            // 23 rings of 24 nodes are free, and the box holds 13 of them.
            assert_eq!([exact.len(), all, count], [552, 552, if nodes == some { 312 } else { 552 }]);
            let ratio = TileLayout { n: count, m: all }.bytes() as f64 / bytes_of(&file) as f64;
            println!(
                "{nodes} {asked:e}: {count} of {all} nodes, off by {off:.2e}, measured {:.2e} at {}, 1/{ratio:.1}",
                meta.measured, meta.nodes
            );
            assert!(off <= *asked && off > 0.05 * asked, "{off:e} of {asked:e}");
            assert!(
                meta.measured <= 1.01 * off + 1e-6 && meta.measured > 0.2 * off,
                "{:e} {off:e}",
                meta.measured
            );
            assert!(ratio > 2.0, "{ratio}");
            // Betti: what a force here does there is what one there does here.
            let pairs = found.iter().zip(found.iter().skip(7));
            for ((a, of_a), (b, of_b)) in pairs {
                let off = matrix(&of_a[*b as usize]) - matrix(&of_b[*a as usize]).transpose();
                assert!(off.amax() <= 1e-6 * matrix(&of_a[*a as usize]).amax(), "{a} {b}: {off}");
            }
        }
    }
}

/// A body twice as long, with twice as many nodes, has about twice as many bytes, where the whole inverse has four times.
#[test]
fn bytes_grow_little_faster_than_nodes() {
    let sizes = [("[6, 1, 1]", "[24, 4, 4]"), ("[12, 1, 1]", "[48, 4, 4]")].map(|(size, cells)| {
        let file = made(size, cells, "nodes = \"surface\", kept = { error = 1e-3 }", COMPRESSED);
        bytes_of(&file) as f64 / file.count("a/compressed/order") as f64
    });
    println!("{sizes:?} bytes a node");
    assert!(sizes[1] / sizes[0] < 1.3, "{sizes:?}");
}

#[test]
fn the_same_scene_gives_the_same_bytes_on_any_number_of_threads() {
    // Clusters large enough for products that would be shared among threads.
    let ([size, cells], asked) = (LONG, "nodes = \"surface\", kept = { error = 1e-3 }");
    let one = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    let [a, b] = [one.install(|| made(size, cells, asked, COMPRESSED)), made(size, cells, asked, COMPRESSED)];
    assert_eq!(a.meta, b.meta);
}

static SOUND: LazyLock<Arc<GreenFile>> = LazyLock::new(|| {
    made("[3, 1, 1]", "[9, 3, 3]", "nodes = \"surface\", kept = { error = 1e-2 }", COMPRESSED)
});

/// The file with other bytes in one of its tensors, and the hashes of these.
fn forged(tensor: &str, change: impl Fn(&mut Vec<u8>)) -> Result<GreenFile, GreenError> {
    let mut meta = SOUND.meta.bodies["a"].clone();
    meta.plan = None;
    let names: Vec<String> = SOUND.tensors().map(|(name, ..)| name.to_owned()).collect();
    let mut tensors = BTreeMap::new();
    for name in names {
        let name = name.strip_prefix("a/").unwrap();
        let mut of = SOUND.tensor("a", name).unwrap();
        if name == VALUES {
            of.bytes = SOUND.bytes_of(&format!("a/{VALUES}"), 0..of.shape[0]).unwrap().into_owned();
        }
        if name == tensor {
            change(&mut of.bytes);
        }
        tensors.insert(name.to_owned(), of);
    }
    SOUND.clone().with_bodies([("a".to_owned(), (meta, tensors))].into())
}

#[test]
fn a_damaged_block_is_told_where_it_is_read() {
    let file = forged(VALUES, |bytes| bytes[20] ^= 4).unwrap();
    let told = file.verify().unwrap_err().to_string();
    assert!(told.contains("block 0 of tensor a/compressed/values is damaged (the hash differs)"), "{told}");
    let compliance = file.compliance("a").unwrap();
    let failed = (0..compliance.places().len()).filter(|&place| compliance.column(place).is_err()).count();
    assert!(failed > 0 && failed < compliance.places().len(), "{failed}");
    assert!(forged(VALUES, |_| {}).unwrap().verify().is_ok());
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(150))]
    /// Whatever numbers a file claims with right hashes, it is refused or its columns are finite.
    #[test]
    fn no_numbers_make_it_panic(
        tensor in prop::sample::select(vec![ORDER, FRAMES, RANKS, BASES, BASIS_ENDS, BLOCKS, ENDS, HASHES, VALUES]),
        at in any::<prop::sample::Index>(), byte in any::<u8>(),
    ) {
        let file = forged(tensor, |bytes| {
            let at = at.index(bytes.len());
            bytes[at] = byte;
        });
        if let Ok(file) = file {
            let compliance = file.compliance("a").unwrap();
            for place in [0, compliance.places().len() - 1] {
                if let Ok(column) = compliance.column(place) {
                    assert!(column.iter().flatten().flatten().all(|x| x.is_finite()));
                }
            }
        }
    }
}
