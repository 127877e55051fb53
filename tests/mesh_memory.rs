//! Counts in a file are never trusted: reading one that promises 10¹⁵ entries costs no more than its bytes do.
#![allow(clippy::unwrap_used, reason = "a test fails by it")]

use greenstage::mesh::{Block, Encoding, block, encode, parse};
use std::alloc::{GlobalAlloc, Layout, System};
use std::path::Path;
use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};

/// The system's allocator, with a count of the bytes in use and their peak.
struct Counting;

static IN_USE: AtomicUsize = AtomicUsize::new(0);
static PEAK: AtomicUsize = AtomicUsize::new(0);

// SAFETY: both calls go to the system's allocator unchanged.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        PEAK.fetch_max(IN_USE.fetch_add(layout.size(), Relaxed) + layout.size(), Relaxed);
        // SAFETY: the caller's promise is handed on.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        IN_USE.fetch_sub(layout.size(), Relaxed);
        // SAFETY: the caller's promise is handed on.
        unsafe { System.dealloc(pointer, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

fn replaced(bytes: &[u8], from: &[u8], to: &[u8]) -> Vec<u8> {
    let at = bytes
        .windows(from.len())
        .position(|window| window == from)
        .expect("the file holds what is to be forged");
    [&bytes[..at], to, &bytes[at + from.len()..]].concat()
}

/// Peak bytes of reading `bytes`, over their number.
fn peak_ratio(name: &str, bytes: &[u8]) -> f64 {
    let before = IN_USE.load(Relaxed);
    PEAK.store(before, Relaxed);
    let result = greenstage::mesh::parse(Path::new(name), bytes);
    let peak = PEAK.load(Relaxed) - before;
    println!(
        "{name}: {peak} bytes for {} ({})",
        bytes.len(),
        if result.is_ok() { "read" } else { "refused" }
    );
    peak as f64 / bytes.len() as f64
}

/// Valid files of every written format cost less than 20 times their bytes; and so do files of forged counts.
fn formats_stay_below_20_times_the_file() {
    let mesh = block(&Block { size: [1.0; 3], cells: [16; 3] }).unwrap();
    for writer in greenstage::mesh::formats::writers().filter(|writer| writer.name != "tetgen") {
        let name = format!("m.{}", writer.files[0].0);
        let bytes = (writer.encode)(&mesh).unwrap().files.remove(0);
        let ratio = peak_ratio(&name, &bytes);
        assert!(ratio < 20.0, "{}: {ratio:.1}", writer.name);
    }
    let filler = "1 0 0 0\n".repeat(4000);
    let sets: String = (0..9000).map(|i| format!("*NSET,NSET=s{i},GENERATE\n0,9999999\n")).collect();
    let nodes: String = (0..9000).map(|i| format!("{i}\n")).collect();
    for (name, text) in [
        ("m.mesh", format!("MeshVersionFormatted 2\nVertices\n1000000000000000\n{filler}")),
        ("m.mesh", format!("MeshVersionFormatted 2\nTetrahedra\n18446744073709551615\n{filler}")),
        (
            "m.vtk",
            format!(
                "# vtk DataFile Version 3.0\n\nASCII\nDATASET UNSTRUCTURED_GRID\nPOINTS 1000000000000000 float\n\
                 {filler}"
            ),
        ),
        (
            "m.vtk",
            format!(
                "# vtk DataFile Version 3.0\n\nBINARY\nDATASET UNSTRUCTURED_GRID\nPOINTS 1000000000000000 float\n\
                 {filler}"
            ),
        ),
        ("m.inp", format!("*NODE\n{nodes}*ELEMENT,TYPE=C3D4\n1,1,2,3,4\n{sets}")),
        ("m.inp", format!("*NODE{}\n", ",a".repeat(9000))),
    ] {
        let ratio = peak_ratio(name, text.as_bytes());
        assert!(ratio < 20.0, "{name}: {ratio:.1}: {}", &text[..60]);
    }
}

/// The only test of this file, since the counter sees all threads.
#[test]
fn forged_counts_fail_at_once_and_allocate_nothing() {
    formats_stay_below_20_times_the_file();
    let mesh = block(&Block { size: [1.0; 3], cells: [2; 3] }).unwrap();
    let [text_2, binary_2, text_4, binary_4] = Encoding::ALL.map(|encoding| encode(&mesh, encoding).unwrap());
    let size = |n: u64| n.to_le_bytes();
    let sizes = |sizes: [u64; 4]| sizes.map(size).concat();
    const FORGED: u64 = 1_000_000_000_000_000;
    let tets = mesh.tets.len() as u64;
    let points = mesh.groups.values().map(|nodes| nodes.len() as u64).sum::<u64>();
    let elements = points + tets;
    let blocks = mesh.groups.len() as u64 + 1;
    let int = |n: i32| n.to_le_bytes();
    let tet_head = |n: i32| [int(4), int(n), int(2)].concat();
    let tets_after_counts = |n: u64| [&int(3)[..], &int(1), &int(4), &size(n)].concat();
    let files = [
        replaced(&text_2, b"$Nodes\n27", b"$Nodes\n1000000000000000"),
        replaced(&text_2, format!("$Elements\n{elements}").as_bytes(), b"$Elements\n1000000000000000"),
        replaced(&text_2, b" 15 2 1 1 ", b" 15 1000000000000000 1 1 "),
        replaced(&text_2, b"$PhysicalNames\n6", b"$PhysicalNames\n1000000000000000"),
        replaced(&binary_2, b"$Nodes\n27", b"$Nodes\n1000000000000000"),
        replaced(
            &replaced(&binary_2, format!("$Elements\n{elements}").as_bytes(), b"$Elements\n1000000000000000"),
            &tet_head(tets as i32),
            &tet_head(i32::MAX),
        ),
        replaced(&text_4, b"$Entities\n6", b"$Entities\n1000000000000000"),
        replaced(&text_4, b"$Nodes\n1 27", b"$Nodes\n1000000000000000 1000000000000000"),
        replaced(&text_4, b"3 1 0 27", b"3 1 0 1000000000000000"),
        replaced(&text_4, b"0 1 15 9", b"0 1 15 1000000000000000"),
        replaced(
            &binary_4,
            &[&b"$Entities\n"[..], &size(6)].concat(),
            &[&b"$Entities\n"[..], &size(FORGED)].concat(),
        ),
        replaced(&binary_4, &sizes([1, 27, 1, 27]), &sizes([FORGED, FORGED, 1, 27])),
        replaced(
            &binary_4,
            &[&int(3)[..], &int(1), &int(0), &size(27)].concat(),
            &[&int(3)[..], &int(1), &int(0), &size(FORGED)].concat(),
        ),
        replaced(&binary_4, &sizes([blocks, elements, 1, elements]), &sizes([FORGED, FORGED, 1, FORGED])),
        replaced(&binary_4, &tets_after_counts(tets), &tets_after_counts(u64::MAX)),
    ];
    for (i, file) in files.iter().enumerate() {
        // The least of three times: a busy machine may have stopped during one.
        let runs = [(); 3].map(|()| {
            let before = IN_USE.load(Relaxed);
            PEAK.store(before, Relaxed);
            let start = std::time::Instant::now();
            let error = parse(Path::new("m.msh"), file).unwrap_err().to_string();
            (start.elapsed(), PEAK.load(Relaxed) - before, error)
        });
        let (time, peak, error) = runs.into_iter().min().unwrap();
        println!("{i}: {peak} bytes in {time:.1?}: {error}");
        assert!(peak < 40 * file.len(), "file {i} of {} bytes: {peak} bytes", file.len());
        assert!(time.as_millis() < 500, "file {i}: {time:?}");
    }
}
