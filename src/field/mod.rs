//! The paper's fields: typed values, connected into a data-flow graph that is evaluated once a frame.
//!
//! In: values set from outside (such as the state of trackers). Out: values that functions make of them, each at most once a
//! frame, in the order of their dependencies, and only where an input differs from what it was. The graph plays the part of
//! Avango's marks of changed fields and of its evaluation loop (the paper, "Avango" and "Implementation in Avango").
//!
//! | part | rule |
//! |---|---|
//! | [`Graph::field`] | a name that is nobody else's, and a first value |
//! | [`Graph::connect`], [`Graph::compute`] | from a field of the same type, or from several through a function; a circle is refused, with the names in it |
//! | [`Graph::set`] | only where nothing is connected |
//! | [`Graph::previous`] | a field that holds what another was at the end of the last frame: the only way to feed back |
//! | [`Graph::write`], [`Graph::read`] | the state of all fields to a stream and back: the paper's streaming interface |
//! | [`Graph::restore`] | a new start of any field, from outside a frame |
//! | context `C` | what functions act on beside fields (deformers), handed to [`Graph::evaluate`] and named in its type |
mod graph;
mod input;
pub mod numbers;
mod stream;

pub use graph::{Entry, FieldError, Graph};
pub(crate) use input::value_types;
pub use input::{Each, Field, Input, Value};
pub use stream::{FieldState, LONGEST_LINE, StreamError, VERSION, read_line};

#[cfg(test)]
mod tests {
    use super::{FieldError, Graph};

    /// A field that is set, and one that a function makes of it.
    #[test]
    fn a_body_turns_by_half_the_turn_of_the_stylus() -> Result<(), FieldError> {
        let mut graph = Graph::<()>::default();
        let turn = graph.field("stylus.turn", 0.0)?;
        let half = graph.field("body.turn", 0.0)?;
        graph.compute(half, "half", turn, |(), turn: &f64| 0.5 * turn)?;
        graph.set(turn, 1.0)?;
        graph.evaluate(&mut ());
        assert_eq!(*graph.get(half), 0.5);
        Ok(())
    }
}
