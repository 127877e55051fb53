//! Inputs of a function of the graph (one field, several of different types, or each of a list), the values that a field can
//! hold, the handle of a field, and the values of all fields of a graph.

use serde::Serialize;
use serde::de::DeserializeOwned;
use std::any::Any;
use std::marker::PhantomData;

/// Fields that a function depends on, and how it sees their values.
pub trait Input: 'static {
    type Seen<'a>;

    /// Appends the numbers of the fields.
    fn list(&self, fields: &mut Vec<usize>);

    fn see<'a>(&'a self, values: &'a Values) -> Self::Seen<'a>;
}

impl<T: Value> Input for Field<T> {
    type Seen<'a> = &'a T;

    fn list(&self, fields: &mut Vec<usize>) {
        fields.push(self.number);
    }

    fn see<'a>(&'a self, values: &'a Values) -> &'a T {
        values.get(*self)
    }
}

/// The values of a list of fields; nothing is allocated to see them.
pub struct Each<'a, I> {
    inputs: &'a [I],
    values: &'a Values,
}

impl<'a, I: Input> Each<'a, I> {
    pub fn get(&self, i: usize) -> Option<I::Seen<'a>> {
        self.inputs.get(i).map(|input| input.see(self.values))
    }

    pub fn iter(&self) -> impl Iterator<Item = I::Seen<'a>> {
        let (inputs, values) = (self.inputs, self.values);
        inputs.iter().map(|input| input.see(values))
    }
}

impl<I: Input> Input for Vec<I> {
    type Seen<'a> = Each<'a, I>;

    fn list(&self, fields: &mut Vec<usize>) {
        self.iter().for_each(|input| input.list(fields));
    }

    fn see<'a>(&'a self, values: &'a Values) -> Each<'a, I> {
        Each { inputs: self, values }
    }
}

/// Two to five inputs of any kind.
macro_rules! tuple {
    ($($part:ident $at:tt),*) => {
        impl<$($part: Input),*> Input for ($($part,)*) {
            type Seen<'a> = ($($part::Seen<'a>,)*);

            fn list(&self, fields: &mut Vec<usize>) {
                $(self.$at.list(fields);)*
            }

            fn see<'a>(&'a self, values: &'a Values) -> Self::Seen<'a> {
                ($(self.$at.see(values),)*)
            }
        }
    };
}

tuple!(A 0, B 1);
tuple!(A 0, B 1, C 2);
tuple!(A 0, B 1, C 2, D 3);
tuple!(A 0, B 1, C 2, D 3, E 4);

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
