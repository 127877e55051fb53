//! The data-flow graph: fields, connections between them, and one evaluation of all that changed; the errors of making,
//! setting or connecting fields; and the graph as text, as an indented list or in Graphviz' language.

use super::input::{Field, Input, Value, Values};
use std::any::Any;

/// Fields of any types, whose functions may act on a context `C` as well.
pub struct Graph<C> {
    pub(super) values: Values,
    pub(super) nodes: Vec<Node<C>>,
    /// Connected fields, each behind all that it is made from; empty: to be sorted anew.
    order: Vec<usize>,
    /// Fields that hold another's value of the last frame, in the order in which they were made.
    delays: Vec<usize>,
}

impl<C> Default for Graph<C> {
    fn default() -> Graph<C> {
        Graph { values: Values(Vec::new()), nodes: Vec::new(), order: Vec::new(), delays: Vec::new() }
    }
}

/// The properties of a field beside its value.
pub(super) struct Node<C> {
    pub name: String,
    pub type_name: &'static str,
    pub from: Option<Connection<C>>,
    /// Fields that are made from this one.
    dependents: Vec<usize>,
    /// An input has changed since the last evaluation.
    pub(super) is_dirty: bool,
    pub evaluations: u64,
    pub write: fn(&dyn Any) -> serde_json::Result<String>,
    pub read: fn(&str) -> serde_json::Result<Box<dyn Any>>,
}

/// The source of a field's value.
pub(super) struct Connection<C> {
    /// Name of the function; empty for a value taken as it is.
    pub function: &'static str,
    pub inputs: Vec<usize>,
    /// Whether the input is that of the last frame.
    pub is_delay: bool,
    run: Box<Function<C>>,
}

/// Makes the new value from the others; true if it differs from the old one.
type Function<C> = dyn FnMut(&mut Values, &mut C) -> bool;

impl<C: 'static> Graph<C> {
    /// A new field; `name` must be nobody else's.
    pub fn field<T: Value>(&mut self, name: impl Into<String>, first: T) -> Result<Field<T>, FieldError> {
        let name = name.into();
        if self.nodes.iter().any(|node| node.name == name) {
            return Err(FieldError::Name { name });
        }
        self.values.0.push(Box::new(first));
        self.nodes.push(Node {
            name,
            type_name: T::TYPE,
            from: None,
            dependents: Vec::new(),
            is_dirty: false,
            evaluations: 0,
            write: |value| match value.downcast_ref::<T>() {
                Some(value) => serde_json::to_string(value),
                None => unreachable!("a node knows the type of its value"),
            },
            read: |text| Ok(Box::new(serde_json::from_str::<T>(text)?)),
        });
        Ok(Field::new(self.nodes.len() - 1))
    }

    pub fn get<T: Value>(&self, field: Field<T>) -> &T {
        self.values.get(field)
    }

    pub fn name<T>(&self, field: Field<T>) -> &str {
        &self.nodes[field.number].name
    }

    /// Number of times that the field's function ran.
    pub fn evaluations<T>(&self, field: Field<T>) -> u64 {
        self.nodes[field.number].evaluations
    }

    /// Gives a field a value; refused where one is connected to it.
    pub fn set<T: Value>(&mut self, field: Field<T>, value: T) -> Result<(), FieldError> {
        self.is_free(field.number)?;
        if self.values.put(field, value) {
            self.mark_dependents(field.number);
        }
        Ok(())
    }

    /// Gives any field a value as if it had always had it, in the previous frame too; a function that makes it runs
    /// anew in the next evaluation. Undo, reset and reading a stream do so, between frames.
    pub fn restore<T: Value>(&mut self, field: Field<T>, value: T) {
        self.values.put(field, value.clone());
        self.restored(field.number);
        for number in self.delays_of(field.number) {
            self.restore(Field::<T>::new(number), value.clone());
        }
    }

    /// The fields that hold `number`'s value of the last frame.
    fn delays_of(&self, number: usize) -> Vec<usize> {
        let is_of = |delay: &usize| {
            self.nodes[*delay].from.as_ref().is_some_and(|from| from.inputs.contains(&number))
        };
        self.delays.iter().copied().filter(is_of).collect()
    }

    /// The value of a field was replaced: those that depend on it, and its own function, run anew.
    pub(super) fn restored(&mut self, number: usize) {
        self.nodes[number].is_dirty = self.nodes[number].from.is_some();
        self.mark_dependents(number);
    }

    /// `to` always has the value of `from`.
    pub fn connect<T: Value>(&mut self, to: Field<T>, from: Field<T>) -> Result<(), FieldError> {
        self.compute(to, "", from, |_, value: &T| value.clone())
    }

    /// `to` is made from `from` by a function, called by `name` in listings, which may act on the context.
    pub fn compute<T: Value, I: Input>(
        &mut self,
        to: Field<T>,
        name: &'static str,
        from: I,
        mut function: impl for<'a> FnMut(&mut C, I::Seen<'a>) -> T + 'static,
    ) -> Result<(), FieldError> {
        self.is_free(to.number)?;
        let mut inputs = Vec::new();
        from.list(&mut inputs);
        let mut seen = vec![false; self.nodes.len()];
        inputs.retain(|&input| !std::mem::replace(&mut seen[input], true));
        if let Some(circle) = self.path(to.number, &inputs) {
            return Err(FieldError::Circle { circle });
        }
        let run = Box::new(move |values: &mut Values, context: &mut C| {
            let new = function(context, from.see(values));
            values.put(to, new)
        });
        self.attach(to.number, Connection { function: name, inputs, is_delay: false, run });
        self.order.clear();
        Ok(())
    }

    /// A field that holds what `of` was at the end of the last frame; the same one whenever it is asked for.
    pub fn previous<T: Value>(&mut self, of: Field<T>) -> Result<Field<T>, FieldError> {
        if let Some(&number) = self.delays_of(of.number).first() {
            return Ok(Field::new(number));
        }
        let name = format!("{}.previous", self.name(of));
        let delay = self.field(name, self.get(of).clone())?;
        let run = Box::new(move |values: &mut Values, _: &mut C| {
            let new = values.get(of).clone();
            values.put(delay, new)
        });
        self.attach(delay.number, Connection { function: "", inputs: vec![of.number], is_delay: true, run });
        self.delays.push(delay.number);
        Ok(delay)
    }

    /// `field` keeps the value that it has and can be set.
    pub fn disconnect<T>(&mut self, field: Field<T>) {
        let number = field.number;
        if let Some(from) = self.nodes[number].from.take() {
            for input in from.inputs {
                self.nodes[input].dependents.retain(|&dependent| dependent != number);
            }
        }
        self.nodes[number].is_dirty = false;
        self.delays.retain(|&delay| delay != number);
        self.order.clear();
    }

    /// Brings every field up to date: one frame. Each function runs at most once, and only where an input changed.
    pub fn evaluate(&mut self, context: &mut C) {
        if self.order.is_empty() {
            self.order = self.sorted();
        }
        for at in 0..self.order.len() {
            self.run(self.order[at], context);
        }
        // The frame is over: what was made later holds what is older, as the previous value of a previous value.
        for at in (0..self.delays.len()).rev() {
            self.run(self.delays[at], context);
        }
    }

    /// Brings these fields, and all that they are made from in this frame, up to date; the frame goes on with
    /// [`Graph::evaluate`].
    pub fn evaluate_first(&mut self, fields: &impl Input, context: &mut C) {
        if self.order.is_empty() {
            self.order = self.sorted();
        }
        let mut open = Vec::new();
        fields.list(&mut open);
        let mut needed = vec![false; self.nodes.len()];
        while let Some(number) = open.pop() {
            if !std::mem::replace(&mut needed[number], true) {
                open.extend(self.inputs(number));
            }
        }
        for at in 0..self.order.len() {
            if needed[self.order[at]] {
                self.run(self.order[at], context);
            }
        }
    }

    fn run(&mut self, number: usize, context: &mut C) {
        let node = &mut self.nodes[number];
        let Some(from) = node.from.as_mut().filter(|_| node.is_dirty) else { return };
        (node.is_dirty, node.evaluations) = (false, node.evaluations + 1);
        if (from.run)(&mut self.values, context) {
            self.mark_dependents(number);
        }
    }

    fn mark_dependents(&mut self, number: usize) {
        for at in 0..self.nodes[number].dependents.len() {
            let dependent = self.nodes[number].dependents[at];
            self.nodes[dependent].is_dirty = true;
        }
    }

    fn attach(&mut self, to: usize, connection: Connection<C>) {
        for &input in &connection.inputs {
            self.nodes[input].dependents.push(to);
        }
        self.nodes[to].from = Some(connection);
        self.nodes[to].is_dirty = true;
    }

    fn is_free(&self, number: usize) -> Result<(), FieldError> {
        let node = &self.nodes[number];
        match &node.from {
            None => Ok(()),
            Some(from) => Err(FieldError::Connected {
                name: node.name.clone(),
                from: from.inputs.iter().map(|&input| self.nodes[input].name.clone()).collect(),
            }),
        }
    }

    /// The fields from which `number` is made in this frame.
    pub(super) fn inputs(&self, number: usize) -> &[usize] {
        match &self.nodes[number].from {
            Some(from) if !from.is_delay => &from.inputs,
            _ => &[],
        }
    }

    /// The names from `to` back to itself, were it made from `inputs`; `None` where that is no circle.
    fn path(&self, to: usize, inputs: &[usize]) -> Option<Vec<String>> {
        let mut seen = vec![false; self.nodes.len()];
        // Fields to look at, and at what depth of `way` each of them is.
        let mut open: Vec<(usize, usize)> = inputs.iter().rev().map(|&input| (input, 0)).collect();
        let mut way: Vec<usize> = Vec::new();
        while let Some((number, depth)) = open.pop() {
            way.truncate(depth);
            way.push(number);
            if number == to {
                let circle = std::iter::once(&to).chain(&way);
                return Some(circle.map(|&number| self.nodes[number].name.clone()).collect());
            }
            if !std::mem::replace(&mut seen[number], true) {
                open.extend(self.inputs(number).iter().rev().map(|&input| (input, depth + 1)));
            }
        }
        None
    }

    /// All fields in the order of their dependencies, those made first before others where either would do.
    fn sorted(&self) -> Vec<usize> {
        let mut missing: Vec<usize> = (0..self.nodes.len()).map(|number| self.inputs(number).len()).collect();
        let mut ready: std::collections::BTreeSet<usize> =
            (0..missing.len()).filter(|&number| missing[number] == 0).collect();
        let mut order = Vec::new();
        while let Some(number) = ready.pop_first() {
            order.push(number);
            for &dependent in &self.nodes[number].dependents {
                if !self.inputs(dependent).contains(&number) {
                    continue;
                }
                missing[dependent] -= 1;
                if missing[dependent] == 0 {
                    ready.insert(dependent);
                }
            }
        }
        let is_made = |number: usize| self.nodes[number].from.as_ref().is_some_and(|from| !from.is_delay);
        order.retain(|&number| is_made(number));
        order
    }
}

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

/// One field and where its value comes from.
pub struct Entry<'a> {
    pub name: &'a str,
    pub type_name: &'a str,
    /// Number of functions between it and what is set from outside.
    pub depth: usize,
    /// The function that makes it; `None`: it is set from outside. Empty: the value is taken as it is.
    pub function: Option<&'a str>,
    /// Whether the input is that of the last frame.
    pub is_delay: bool,
    pub inputs: Vec<&'a str>,
    pub evaluations: u64,
}

impl<C: 'static> Graph<C> {
    /// All fields, each behind those that it is made from in a frame.
    pub fn entries(&self) -> Vec<Entry<'_>> {
        let mut depth: Vec<Option<usize>> = vec![None; self.nodes.len()];
        let mut entries = Vec::new();
        for last in self.ends() {
            self.enter(last, &mut depth, &mut entries);
        }
        entries
    }

    /// Fields of which nothing is made within a frame: delays of nobody's too.
    fn ends(&self) -> Vec<usize> {
        let mut is_input = vec![false; self.nodes.len()];
        for number in 0..self.nodes.len() {
            self.inputs(number).iter().for_each(|&input| is_input[input] = true);
        }
        (0..is_input.len()).filter(|&number| !is_input[number]).collect()
    }

    fn enter<'a>(&'a self, last: usize, depth: &mut [Option<usize>], entries: &mut Vec<Entry<'a>>) {
        let mut open = vec![last];
        while let Some(&number) = open.last() {
            let waiting = self.inputs(number).iter().rev().filter(|input| depth[**input].is_none());
            let before = open.len();
            open.extend(waiting.copied().collect::<Vec<_>>());
            if open.len() > before {
                continue;
            }
            open.pop();
            if depth[number].is_some() {
                continue;
            }
            let inputs = self.inputs(number);
            let at =
                inputs.iter().filter_map(|&input| depth[input]).map(|depth| depth + 1).max().unwrap_or(0);
            depth[number] = Some(at);
            let node = &self.nodes[number];
            let named = |input: &usize| self.nodes[*input].name.as_str();
            entries.push(Entry {
                name: &node.name,
                type_name: node.type_name,
                depth: at,
                function: node.from.as_ref().map(|from| from.function),
                is_delay: node.from.as_ref().is_some_and(|from| from.is_delay),
                inputs: node.from.iter().flat_map(|from| from.inputs.iter().map(named)).collect(),
                evaluations: node.evaluations,
            });
        }
    }

    /// A line per field: its name, indented by its depth, its type, and what it is made from.
    pub fn text(&self) -> String {
        let entries = self.entries();
        let indented = |entry: &Entry<'_>| format!("{}{}", "  ".repeat(entry.depth), entry.name);
        let width = |length: &dyn Fn(&Entry<'_>) -> usize| entries.iter().map(length).max().unwrap_or(0);
        let names = width(&|entry| indented(entry).chars().count());
        let types = width(&|entry| entry.type_name.chars().count());
        let line = |entry: &Entry<'_>| {
            let from = match entry.function {
                None => "set from outside".to_owned(),
                Some(_) if entry.is_delay => format!("{} of the last frame", entry.inputs.join(", ")),
                Some("") => format!("= {}", entry.inputs.join(", ")),
                Some(function) => format!("= {function}({})", entry.inputs.join(", ")),
            };
            format!("{:names$}  {:types$}  {from}\n", indented(entry), entry.type_name)
        };
        entries.iter().map(line).collect()
    }

    /// Text for `dot -Tsvg`: a box per field, an arrow per connection, dashed from one frame to the next.
    pub fn dot(&self) -> String {
        let quoted = |text: &str| format!("\"{}\"", text.replace('\\', "\\\\").replace('"', "\\\""));
        let mut text =
            "digraph fields {\n  rankdir=LR;\n  node [shape=box, fontname=\"sans-serif\"];\n".to_owned();
        for entry in self.entries() {
            let function = entry.function.filter(|function| !function.is_empty());
            let made = function.map_or(String::new(), |function| format!("\n{function}"));
            // A literal \n within the quotes is Graphviz' line break.
            let label = quoted(&format!("{}\n{}{made}", entry.name, entry.type_name)).replace('\n', "\\n");
            let style = if entry.function.is_none() { ", style=filled, fillcolor=\"#dfe9f5\"" } else { "" };
            text += &format!("  {} [label={label}{style}];\n", quoted(entry.name));
            let dashed = if entry.is_delay { " [style=dashed, constraint=false]" } else { "" };
            for input in entry.inputs {
                text += &format!("  {} -> {}{dashed};\n", quoted(input), quoted(entry.name));
            }
        }
        text + "}\n"
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_restored_value_is_that_of_the_previous_frame_too() {
        let mut graph: Graph<()> = Graph::default();
        let now = graph.field("now", 1.0).unwrap();
        let before = graph.previous(now).unwrap();
        graph.set(now, 2.0).unwrap();
        graph.evaluate(&mut ());
        graph.set(now, 3.0).unwrap();
        assert_eq!(*graph.get(before), 2.0);
        graph.restore(now, 5.0);
        assert_eq!([*graph.get(now), *graph.get(before)], [5.0, 5.0]);
    }
}
