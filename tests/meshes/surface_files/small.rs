//! The surface of one tetrahedron in every format and form; made here, byte by byte.

/// A tetrahedron of volume 1/6, outward.
pub const VERTICES: [[f32; 3]; 4] = [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
pub const TRIANGLES: [[u32; 3]; 4] = [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]];

pub fn stl_text() -> Vec<u8> {
    let mut text = "solid a body of \"no\" name\n".to_owned();
    for triangle in TRIANGLES {
        text += " facet normal 0 0 0\n  outer loop\n";
        for [x, y, z] in triangle.map(|v| VERTICES[v as usize]) {
            text += &format!("   vertex {x:e} {y} {z}\n");
        }
        text += "  endloop\n endfacet\n";
    }
    (text + "endsolid\n").into_bytes()
}

pub fn stl_binary(header: &[u8]) -> Vec<u8> {
    let mut bytes = header.to_vec();
    bytes.resize(80, b' ');
    bytes.extend(4u32.to_le_bytes());
    for triangle in TRIANGLES {
        bytes.extend([0; 12]);
        bytes.extend(triangle.iter().flat_map(|v| VERTICES[*v as usize]).flat_map(f32::to_le_bytes));
        bytes.extend([0; 2]);
    }
    bytes
}

pub const OBJ: &str = "# a comment\nmtllib none.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0 1.0\nv 0 0 1\nvt 0 0\nvn 0 0 1\no body\ns off\n\
                   f 1 3 2\nf 1/1 2/1 4/1\r\nf 1//1 4//1 3//1\nf -3/1/1 \\\n -2/1/1 -1/1/1\n";

pub fn ply(form: &str) -> Vec<u8> {
    let mut bytes = format!(
        "ply\nformat {form} 1.0\ncomment made by hand\nelement vertex 4\nproperty float x\nproperty float y\nproperty \
         float z\nproperty uchar red\nelement face 4\nproperty list uchar int vertex_indices\nelement edge \
         0\nproperty int vertex1\nend_header\n"
    )
    .into_bytes();
    for [x, y, z] in VERTICES {
        match form {
            "ascii" => bytes.extend(format!("{x} {y} {z} 255\n").into_bytes()),
            "binary_big_endian" => {
                bytes.extend([x, y, z].into_iter().flat_map(f32::to_be_bytes).chain([255]))
            }
            _ => bytes.extend([x, y, z].into_iter().flat_map(f32::to_le_bytes).chain([255])),
        }
    }
    for triangle in TRIANGLES {
        match form {
            "ascii" => {
                bytes.extend(format!("3 {} {} {}\n", triangle[0], triangle[1], triangle[2]).into_bytes())
            }
            "binary_big_endian" => {
                bytes.extend([3].into_iter().chain(triangle.into_iter().flat_map(u32::to_be_bytes)))
            }
            _ => bytes.extend([3].into_iter().chain(triangle.into_iter().flat_map(u32::to_le_bytes))),
        }
    }
    bytes
}

/// One file of every format and form.
pub fn samples() -> Vec<(&'static str, Vec<u8>)> {
    vec![
        ("text.stl", stl_text()),
        ("binary.stl", stl_binary(b"made by hand")),
        ("solid.STL", stl_binary(b"solid, says the header of this binary file")),
        ("a.obj", OBJ.as_bytes().to_vec()),
        ("text.ply", ply("ascii")),
        ("little.ply", ply("binary_little_endian")),
        ("big.ply", ply("binary_big_endian")),
    ]
}
