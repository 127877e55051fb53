//! The manual: a guide with a chapter for each job, and a reference. Each chapter is a module, and `greenstage manual CHAPTER`
//! prints the same text.
//!
//! In: Markdown files. Out: [`GUIDE`] and [`REFERENCE`]. Tests parse every whole example in them and every command.

/// A chapter as the contents list it and as it is printed.
pub struct Chapter {
    pub name: &'static str,
    /// Line of the contents.
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
    scene: "write a scene: bodies, materials, control elements; which model, element and effects",
    materials: "steel, rubber, liver, …: a small library of materials, with sources",
    meshes: "mesh and surface files: units, groups, regions, what is repaired and refused; generators",
    stages: "describe your own bench, CAVE or powerwall: screens, windows, stereo, test pattern",
    tracking: "set up trackers, calibrate them with a tape measure, and see that they work",
    install: "from a tape measure to a bent tube on your own display, and troubleshooting",
    scripts: "key frames that move head and stylus where nobody does",
    recording: "record a session, and replay it bit by bit",
    view: "mouse and keyboard, colours, overlay, panel, pictures and videos",
    haptics: "forces in the hand: set up a device, and what keeps it stable",
    deform: "poses in, displacements and forces out: files, columns, units, signs",
    export: "columns and poses for other programs: Open Inventor, glTF, VTK, STL, PLY, OBJ",
    check: "what is checked, and how far to trust a number: the errors to expect",
    accuracy: "what accuracy costs in time; let `precompute` choose the setting",
    bench: "what each figure of `greenstage bench` means, and how to measure honestly",
}

part! {
    REFERENCE in "reference/", "The reference's chapters.";
    keys: "every key of a scene file, with ranges, defaults and what it costs",
    method: "the equations behind the columns: elements, boundary elements, loads, compression, graph",
    models: "how each deformation model computes, and where it ends",
    forces: "measured errors of force, torque, energy and shape of each model, and its time",
    verify: "the elements against published and analytic answers; which element near ν = 1/2",
    errors: "how expected errors and the accuracy report are defined, and its files",
    cases: "hard cases with their figures, what is judged after solving, damaged input",
    stability: "the force loop: keys, bounds, how the force ends, measured tables of stability",
    protocols: "trackers that fail, VRPN, and passing trackers on",
    drawing: "projection, ranges and checks of stages, stress at the surface, devices, shadows",
    green: "the .green file: tensors, metadata, how to open it in Python, when it is stale",
}

/// All chapters: the guide's, then the reference's.
pub fn chapters() -> impl Iterator<Item = &'static Chapter> + Clone {
    GUIDE.iter().chain(REFERENCE)
}

/// The chapter called `name`.
pub fn find(name: &str) -> Option<&'static Chapter> {
    chapters().find(|chapter| chapter.name == name)
}
