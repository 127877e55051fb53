//! A graph to be read: as an indented list, and in Graphviz' language.

use super::graph::Graph;

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
