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

/// Fails unless the struct `name` of `source` has this size and these fields at these offsets.
pub(super) fn assert(source: &str, name: &str, size: usize, fields: &[(&str, usize)]) {
    let fields = fields.iter().map(|(field, offset)| ((*field).to_owned(), *offset)).collect();
    assert_eq!(in_wgsl(source, name), (size, fields), "{name}");
}
