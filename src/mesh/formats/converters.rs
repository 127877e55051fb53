//! Advice for files of formats that are not read: geometry without a mesh, and meshes of other programs.
//!
//! In: a path with its first bytes. Out: a sentence with the command that converts the file.

use super::format::extension;
use std::path::Path;

/// Advice for a file that no reader knows; `None` if it is not known here either.
pub fn advice(path: &Path, bytes: &[u8]) -> Option<String> {
    let name = path.file_name().unwrap_or_default().display();
    let mesh = path.with_extension("msh");
    let mesh = mesh.file_name().unwrap_or_default().display();
    let is_step = bytes.starts_with(b"ISO-10303-21");
    Some(match extension(path).as_str() {
        "step" | "stp" | "p21" | "iges" | "igs" | "brep" => geometry(&name, &mesh),
        _ if is_step => geometry(&name, &mesh),
        "geo" => format!("is a Gmsh script; mesh it: `gmsh -3 -clmax 0.008 -format msh41 {name} -o {mesh}`"),
        "fcstd" | "sldprt" | "ipt" | "prt" | "catpart" | "x_t" | "3mf" | "off" | "dae" | "fbx" | "glb"
        | "gltf" => {
            format!(
                "is not read: save it as STL, OBJ or PLY (a closed surface), or as STEP, which Gmsh can mesh: {name}"
            )
        }
        "bdf" | "nas" | "unv" | "med" | "cgns" => {
            format!("is not read; Gmsh converts it: `gmsh {name} -save -format msh41 -o {mesh}`")
        }
        "e" | "exo" | "xdmf" | "h5m" | "ugrid" | "su2" => {
            format!("is not read; meshio converts it: `meshio convert {name} part.vtu`")
        }
        _ => return None,
    })
}

fn geometry(name: &dyn std::fmt::Display, mesh: &dyn std::fmt::Display) -> String {
    format!(
        "is CAD geometry without a mesh; Gmsh meshes it: `gmsh -3 -clmax 5 -format msh41 {name} -o {mesh}` (5: the greatest \
         edge in the file's unit, mostly mm), then `greenstage new {mesh} --unit mm`; or save it in FreeCAD as STL (File, \
         Export), which a scene can fill"
    )
}
