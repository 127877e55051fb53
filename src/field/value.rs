//! The values that a field can hold, the handle of a field, and the values of all fields of a graph.

use serde::Serialize;
use serde::de::DeserializeOwned;
use std::any::Any;
use std::marker::PhantomData;

/// A value that a field can hold. Two values that are equal count as no change.
pub trait Value: Clone + PartialEq + Serialize + DeserializeOwned + 'static {
    /// The type's name in listings and streams.
    const TYPE: &'static str;
}

/// Types that fields can hold, with what listings and streams call them; [`Value`] must be in scope.
macro_rules! value_types {
    ($($type:ty => $name:literal),* $(,)?) => {
        $(impl Value for $type {
            const TYPE: &'static str = $name;
        })*
    };
}
pub(crate) use value_types;

value_types!(f64 => "number", u64 => "count", bool => "switch", String => "text");

/// A field of one graph: its number in it. Only that graph may be asked for it; a different one panics or answers with the wrong
/// field.
pub struct Field<T> {
    pub(super) number: usize,
    value: PhantomData<fn() -> T>,
}

impl<T> Field<T> {
    pub(super) fn new(number: usize) -> Self {
        Self { number, value: PhantomData }
    }
}

impl<T> Clone for Field<T> {
    fn clone(&self) -> Self {
        *self
    }
}

impl<T> Copy for Field<T> {}

/// The values of all fields, by number.
pub struct Values(pub(super) Vec<Box<dyn Any>>);

impl Values {
    /// Panics where `field` is of another graph.
    pub(super) fn get<T: Value>(&self, field: Field<T>) -> &T {
        match self.0[field.number].downcast_ref() {
            Some(value) => value,
            None => unreachable!("a field knows the type of its value within its own graph"),
        }
    }

    /// True if the new value differs.
    pub(super) fn put<T: Value>(&mut self, field: Field<T>, new: T) -> bool {
        let differs = *self.get(field) != new;
        if let Some(old) = self.0[field.number].downcast_mut().filter(|_| differs) {
            *old = new;
        }
        differs
    }
}
