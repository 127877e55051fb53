//! Open Inventor files, as far as `export` writes them, read and evaluated by their specification: nodes, fields, connections,
//! and the engines by what "The Inventor Mentor" says that they compute.

use nalgebra::{Matrix3, Rotation3, Unit, Vector3};
use std::collections::BTreeMap;

#[derive(Default)]
struct Field {
    words: Vec<String>,
    from: Option<(usize, String)>,
}

#[derive(Default)]
struct Node {
    kind: String,
    fields: BTreeMap<String, Field>,
}

#[derive(Default)]
pub struct Inventor {
    nodes: Vec<Node>,
    names: BTreeMap<String, usize>,
}

#[derive(Clone, Debug)]
pub enum Value {
    Numbers(Vec<f64>),
    Vectors(Vec<Vector3<f64>>),
    Matrix(Matrix3<f64>),
}

impl Value {
    pub fn vectors(self) -> Vec<Vector3<f64>> {
        let Value::Vectors(vectors) = self else { panic!("{self:?} are no vectors") };
        vectors
    }

    fn numbers(self) -> Vec<f64> {
        let Value::Numbers(numbers) = self else { panic!("{self:?} are no numbers") };
        numbers
    }
}

fn words(text: &str) -> Vec<String> {
    let lines =
        text.lines().map(|line| if line.contains('"') { line } else { line.split('#').next().unwrap() });
    let (mut words, mut quoted) = (Vec::new(), false);
    for part in lines.collect::<Vec<_>>().join("\n").split('"') {
        if quoted {
            words.push(format!("\"{part}"));
        } else {
            let marked = ["{", "}", "[", "]", "="]
                .iter()
                .fold(part.replace(',', " "), |part, mark| part.replace(mark, &format!(" {mark} ")));
            words.extend(marked.split_whitespace().map(str::to_owned));
        }
        quoted = !quoted;
    }
    words
}

impl Inventor {
    pub fn read(text: &str) -> Inventor {
        assert!(text.starts_with("#Inventor V2.1 ascii\n"));
        let mut all = Inventor::default();
        let words = words(text.split_once('\n').unwrap().1);
        let mut at = 0;
        all.node(&words, &mut at);
        assert_eq!(at, words.len(), "one root and nothing behind it");
        all
    }

    fn node(&mut self, words: &[String], at: &mut usize) -> usize {
        if words[*at] == "USE" {
            *at += 2;
            return *self
                .names
                .get(&words[*at - 1])
                .unwrap_or_else(|| panic!("{} before it is defined", words[*at - 1]));
        }
        let mut name = None;
        if words[*at] == "DEF" {
            name = Some(words[*at + 1].clone());
            *at += 2;
        }
        let number = self.nodes.len();
        self.nodes.push(Node { kind: words[*at].clone(), ..Node::default() });
        assert_eq!(words[*at + 1], "{", "{} opens", words[*at]);
        *at += 2;
        while words[*at] != "}" {
            let is_node = ["DEF", "USE"].contains(&words[*at].as_str()) || words[*at + 1] == "{";
            if is_node {
                self.node(words, at);
            } else {
                let field = words[*at].clone();
                *at += 1;
                let mut value = Field::default();
                let is_value = |word: &str| {
                    let first = word.chars().next().unwrap();
                    first.is_ascii_digit()
                        || first == '-'
                        || first == '"'
                        || ["COUNTERCLOCKWISE", "SOLID", "CENTER"].contains(&word)
                };
                if words[*at] == "[" {
                    let end = *at + words[*at..].iter().position(|word| word == "]").unwrap();
                    value.words = words[*at + 1..end].to_vec();
                    *at = end + 1;
                } else {
                    while is_value(&words[*at]) {
                        value.words.push(words[*at].clone());
                        *at += 1;
                    }
                }
                if words[*at] == "=" {
                    *at += 1;
                    let from = self.node(words, at);
                    assert_eq!(words[*at], ".");
                    value.from = Some((from, words[*at + 1].clone()));
                    *at += 2;
                }
                self.nodes[number].fields.insert(field, value);
            }
        }
        *at += 1;
        if let Some(name) = name {
            assert!(self.names.insert(name.clone(), number).is_none(), "{name} is defined twice");
        }
        number
    }

    /// Numbers of a field as they are written.
    pub fn written(&self, node: &str, field: &str) -> Vec<f64> {
        let words = &self.nodes[self.names[node]].fields[field].words;
        words.iter().map(|word| word.parse().unwrap()).collect()
    }

    pub fn kinds(&self, kind: &str) -> usize {
        self.nodes.iter().filter(|node| node.kind == kind).count()
    }

    /// A field of a named node with all engines before it.
    pub fn value(&self, node: &str, field: &str) -> Value {
        self.field(self.names[node], field)
    }

    /// An output of a named engine.
    pub fn engine(&self, node: &str, output: &str) -> Value {
        self.output(self.names[node], output)
    }

    fn field(&self, node: usize, field: &str) -> Value {
        let Node { kind, fields } = &self.nodes[node];
        let numbers = match fields.get(field) {
            Some(Field { from: Some((from, output)), .. }) => return self.output(*from, output),
            Some(Field { words, .. }) => words.iter().map(|word| word.parse().unwrap()).collect(),
            None => match field {
                "rotation" => vec![0.0, 0.0, 1.0, 0.0],
                "scaleFactor" => vec![1.0; 3],
                "translation" => vec![0.0; 3],
                "index" => vec![0.0],
                _ => panic!("{kind} has no {field}"),
            },
        };
        let is_number =
            field == "index" || (kind == "Calculator" && field.chars().all(|c| c.is_ascii_lowercase()));
        match is_number || field == "rotation" {
            true => Value::Numbers(numbers),
            false => Value::Vectors(numbers.chunks_exact(3).map(Vector3::from_column_slice).collect()),
        }
    }

    fn output(&self, node: usize, output: &str) -> Value {
        let Node { kind, fields } = &self.nodes[node];
        let of = |field: &str| self.field(node, field);
        let axis = |name: &str| ["x", "y", "z"].iter().position(|known| *known == name).unwrap();
        match (kind.as_str(), output) {
            ("Calculator", _) => {
                let text = fields["expression"].words[0].trim_start_matches('"');
                let (to, sum) = text.split_once(" = ").unwrap();
                assert_eq!(to, output);
                self.sum(node, sum)
            }
            ("DecomposeVec3f", _) => {
                Value::Numbers(of("vector").vectors().iter().map(|v| v[axis(output)]).collect())
            }
            ("TransformVec3f", "direction") => {
                let Value::Matrix(matrix) = of("matrix") else { panic!() };
                Value::Vectors(of("vector").vectors().iter().map(|v| matrix * v).collect())
            }
            ("ComposeMatrix", "matrix") => {
                let r = of("rotation").numbers();
                let axis = Unit::new_normalize(Vector3::new(r[0], r[1], r[2]));
                let scale = Matrix3::from_diagonal(&of("scaleFactor").vectors()[0]);
                Value::Matrix(Rotation3::from_axis_angle(&axis, r[3]).matrix() * scale)
            }
            ("SelectOne", "output") => {
                Value::Numbers(vec![of("input").numbers()[of("index").numbers()[0] as usize]])
            }
            // Fields are outputs too.
            ("Coordinate3" | "TransformerDragger", _) => of(output),
            _ => panic!("{kind} has no output {output}"),
        }
    }

    /// `A + a*B + b*C`, `A - B`: the last of fewer values counts for all further ones.
    fn sum(&self, node: usize, text: &str) -> Value {
        let mut sum: Option<Value> = None;
        let mut sign = 1.0;
        for word in text.split(' ') {
            match word {
                "+" => sign = 1.0,
                "-" => sign = -1.0,
                term => {
                    let (factor, name) = term
                        .split_once('*')
                        .map_or((1.0, term), |(factor, name)| (self.field(node, factor).numbers()[0], name));
                    let factor = sign * factor;
                    sum = Some(match (sum, self.field(node, name)) {
                        (None, Value::Numbers(x)) => Value::Numbers(x.iter().map(|x| factor * x).collect()),
                        (None, Value::Vectors(x)) => Value::Vectors(x.iter().map(|x| factor * x).collect()),
                        (Some(Value::Numbers(a)), Value::Numbers(b)) => {
                            Value::Numbers(a.iter().zip(&b).map(|(a, b)| a + factor * b).collect())
                        }
                        (Some(Value::Vectors(a)), Value::Vectors(b)) => {
                            assert_eq!(a.len(), b.len());
                            Value::Vectors(a.iter().zip(&b).map(|(a, b)| a + factor * b).collect())
                        }
                        _ => panic!("{text}"),
                    });
                }
            }
        }
        sum.unwrap()
    }
}
