//! The manual, a chapter a module: `greenstage manual CHAPTER` prints the same text.
//!
//! In: Markdown files. Out: [`CHAPTERS`]. Every whole example in them is parsed by a test, and so is every command.

/// Each chapter once: its file, its module for rustdoc, its line of the contents.
macro_rules! chapters {
    ($($name:ident: $summary:literal,)*) => {
        $(
            #[doc = include_str!(concat!(stringify!($name), ".md"))]
            pub mod $name {}
        )*

        /// Name, summary and text of every chapter, in the order of reading.
        pub const CHAPTERS: &[(&str, &str, &str)] =
            &[$((stringify!($name), $summary, include_str!(concat!(stringify!($name), ".md")))),*];
    };
}

chapters! {
    start: "the demo, and a mesh of your own bent in five minutes",
    scene: "every key of the scene file: bodies, materials, control elements, models, effects, solver, place",
    materials: "steel, rubber, liver, …: a small library of materials, with sources",
    meshes: "mesh files: groups, regions, what is repaired and what is refused; the two generators",
    stages: "describe your own bench, CAVE or powerwall; off-axis projection, stereo, black screens",
    tracking: "trackers: what a stage file says of them, how to calibrate them, and how to see that they work",
    install: "on your own workbench or CAVE: from a tape measure to a bent tube, and troubleshooting",
    scripts: "key frames that move head and stylus where nobody does",
    graph: "the data flow from tracker to surface, and recording a session and replaying it",
    view: "windows, mouse and keyboard, colours, and what happens without a display",
    haptics: "forces in the hand: devices, what keeps them stable, how well that works",
    deform: "poses in, displacements and forces out: files, columns, units, signs",
    green: "the .green file: tensors, metadata, how to open it in Python, when it is stale",
    export: "columns and poses for other programs: Open Inventor, glTF, VTK, STL, PLY, OBJ",
    check: "what can go wrong in silence, what is done about it, and how well: hard cases with their figures",
    method: "the mathematics, the accuracy that was measured, and the limits",
    accuracy: "what accuracy costs in time: the report, its parts and files; letting `precompute` choose",
    verify: "the elements against published and analytic answers: tables, rates, locking, what is required",
    bench: "what each figure of `greenstage bench` means, and how to measure honestly",
}
