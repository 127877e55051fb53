//! Inputs of a function of the graph: one field, several of different types, or each of a list.

use super::value::{Field, Value, Values};

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
