//! Compares how a struct lies in Rust and in WGSL, as naga lays it out.

use wgpu::naga;

/// Size of the struct `name` of `source`, and the name and offset of each field.
pub(super) fn in_wgsl(source: &str, name: &str) -> (usize, Vec<(String, usize)>) {
    let module = naga::front::wgsl::parse_str(source).unwrap();
    let found = module.types.iter().find(|(_, known)| known.name.as_deref() == Some(name));
    let naga::TypeInner::Struct { members, span } = &found.unwrap().1.inner else {
        panic!("{name} is no struct")
    };
    let field = |member: &naga::StructMember| (member.name.clone().unwrap(), member.offset as usize);
    (*span as usize, members.iter().map(field).collect())
}

/// Fails unless the struct `$name` of a shader has the size of `$rust` and these fields of it, at their offsets.
macro_rules! assert_layout {
    ($source:expr, $name:literal, $rust:ty: $($field:ident),+) => {
        let fields = vec![$((stringify!($field).to_owned(), std::mem::offset_of!($rust, $field))),+];
        assert_eq!($crate::render::layout::in_wgsl(&$source, $name), (size_of::<$rust>(), fields), $name);
    };
}
pub(super) use assert_layout;
