//! The manual: a guide with a chapter for each job, and a reference. Each chapter is a module, and `greenstage manual CHAPTER`
//! prints the same text.
//!
//! In: Markdown files. Out: [`GUIDE`] and [`REFERENCE`]. Tests parse every whole example in them and every command.

/// A chapter as the contents list it and as it is printed.
pub struct Chapter {
    pub name: &'static str,
    /// Its line of the contents.
    pub summary: &'static str,
    /// Markdown, which begins with the title `# NAME: …`.
    pub text: &'static str,
}

/// Each chapter once: its file in a folder, its module for rustdoc, its line of the contents.
macro_rules! part {
    ($list:ident in $folder:literal, $doc:literal; $($name:ident: $summary:literal,)*) => {
        $(
            #[doc = include_str!(concat!($folder, stringify!($name), ".md"))]
            pub mod $name {}
        )*

        #[doc = $doc]
        pub const $list: &[Chapter] = &[$(Chapter {
            name: stringify!($name),
            summary: $summary,
            text: include_str!(concat!($folder, stringify!($name), ".md")),
        }),*];
    };
}

part! {
    GUIDE in "", "The guide's chapters, in the order of reading.";
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
    export: "columns and poses for other programs: Open Inventor, glTF, VTK, STL, PLY, OBJ",
    check: "what can go wrong in silence, what is done about it, and how well: hard cases with their figures",
    accuracy: "what accuracy costs in time: the report, its parts and files; letting `precompute` choose",
    bench: "what each figure of `greenstage bench` means, and how to measure honestly",
}

part! {
    REFERENCE in "reference/", "The reference's chapters.";
    method: "the mathematics, the accuracy that was measured, and the limits",
    green: "the .green file: tensors, metadata, how to open it in Python, when it is stale",
    verify: "the elements against published and analytic answers: tables, rates, locking, what is required",
}

/// All chapters: the guide's, then the reference's.
pub fn chapters() -> impl Iterator<Item = &'static Chapter> + Clone {
    GUIDE.iter().chain(REFERENCE)
}

/// The chapter called `name`.
pub fn find(name: &str) -> Option<&'static Chapter> {
    chapters().find(|chapter| chapter.name == name)
}
