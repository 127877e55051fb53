//! Errors of making, setting or connecting fields.

/// Every name in it is a field's.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum FieldError {
    #[error("there is a field {name} already")]
    Name { name: String },
    #[error("field {name} is connected: set the fields that it is made from ({}), or disconnect it", from.join(", "))]
    Connected { name: String, from: Vec<String> },
    /// The first and the last are the same.
    #[error("fields would depend on themselves: {}; take one of them from the previous frame", circle.join(" ← "))]
    Circle { circle: Vec<String> },
}
