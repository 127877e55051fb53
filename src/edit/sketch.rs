//! The control elements of a body while they are being made.
//!
//! In: touches of a ray, one after the other while a button is down. Out: [`Element`]s; no node belongs to two of them.

use super::canvas::{Canvas, Touch};
use crate::scene::{Body, Control, Grab, Nodes};
use indexmap::IndexMap;
use nalgebra::Vector3;
use std::collections::BTreeSet;

/// The tool that a button uses while it is down.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Tool {
    Paint,
    Erase,
    /// A ball, dragged from its centre to its radius.
    Ball,
    /// A box, dragged from corner to corner, with the brush's radius around them.
    Box,
    /// A ball by distance through the body's material.
    Grow,
}

impl Tool {
    /// Tool, verb, and what it does.
    pub const ALL: &[(Tool, &str, &str)] = &[
        (Tool::Paint, "Paint", "drag over the surface: what the brush touches is added"),
        (Tool::Erase, "Erase", "drag over the surface: what the brush touches is taken away"),
        (
            Tool::Ball,
            "Draw a ball",
            "press at its centre and drag: all nodes in the ball, inside the body too",
        ),
        (Tool::Box, "Draw a box", "drag from corner to corner: all nodes in the box, inside the body too"),
        (
            Tool::Grow,
            "Grow from a point",
            "press and drag: all nodes within that way through the body, across no gap",
        ),
    ];
}

impl Tool {
    /// Whether it acts at once, wherever the ray touches.
    fn is_brush(self) -> bool {
        matches!(self, Tool::Paint | Tool::Erase)
    }
}

/// Changes that can be taken back.
const KEPT: usize = 100;

/// A control element on its way.
#[derive(Clone, Debug, PartialEq)]
pub struct Element {
    pub name: String,
    pub grab: Grab,
    /// The nodes as they are written.
    pub nodes: Option<Nodes>,
    /// The nodes of the mesh that it holds.
    pub held: BTreeSet<u32>,
}

/// A drag that goes on.
struct Stroke {
    from: Touch,
    to: Touch,
}

/// All elements of a body.
pub struct Sketch {
    pub elements: Vec<Element>,
    /// The element that tools change.
    pub chosen: usize,
    pub tool: Tool,
    /// Radius of the brush, m.
    pub radius: f64,
    stroke: Option<Stroke>,
    /// The elements before each change, and which was chosen.
    history: Vec<(Vec<Element>, usize)>,
    /// The elements as they were in the scene, or were saved.
    first: Vec<Element>,
    /// Counts the changes of the held nodes.
    pub version: u64,
}

/// A brush's first radius as a part of the body's longest extent.
const BRUSH: f64 = 0.04;

impl Sketch {
    /// The elements that the body has; nodes that cannot be found in the mesh are left out.
    pub fn new(body: &Body, canvas: &Canvas) -> Sketch {
        let element = |(name, control): (&String, &Control)| Element {
            name: name.clone(),
            grab: control.grab,
            held: control.nodes.select(&canvas.mesh).unwrap_or_default().into_iter().collect(),
            nodes: Some(control.nodes.clone()),
        };
        let radius = rounded(BRUSH * canvas.extent(), canvas.extent());
        let elements: Vec<Element> = body.control.iter().map(element).collect();
        Sketch {
            first: elements.clone(),
            elements,
            chosen: 0,
            tool: Tool::Paint,
            radius,
            stroke: None,
            history: Vec::new(),
            version: 0,
        }
    }

    fn remember(&mut self) {
        if self.history.len() == KEPT {
            self.history.remove(0);
        }
        self.history.push((self.elements.clone(), self.chosen));
    }

    pub fn can_undo(&self) -> bool {
        !self.history.is_empty()
    }

    /// Whether it differs from the elements in the scene or a file.
    pub fn is_changed(&self) -> bool {
        fn made(elements: &[Element]) -> impl Iterator<Item = &Element> {
            elements.iter().filter(|element| !element.held.is_empty())
        }
        !made(&self.elements).eq(made(&self.first))
    }

    pub fn was_saved(&mut self) {
        self.first.clone_from(&self.elements);
    }

    /// Goes back to the elements in the scene or a file; this can be undone.
    pub fn throw_away(&mut self) {
        self.remember();
        self.elements.clone_from(&self.first);
        (self.chosen, self.stroke) = (0, None);
        self.version += 1;
    }

    /// Takes the last change back.
    pub fn undo(&mut self) {
        if let Some((elements, chosen)) = self.history.pop() {
            (self.elements, self.chosen, self.stroke) = (elements, chosen, None);
            self.version += 1;
        }
    }

    /// Adds an empty element and chooses it: the first is fixed, the others can be taken.
    pub fn add(&mut self) {
        let has_fixed = self.elements.iter().any(|element| element.grab == Grab::Fixed);
        let (grab, stem) = if has_fixed { (Grab::Dragger, "hand") } else { (Grab::Fixed, "base") };
        let is_free = |name: &String| self.elements.iter().all(|element| element.name != *name);
        let numbered = (2..).map(|number| format!("{stem}{number}"));
        let name = std::iter::once(stem.to_owned()).chain(numbered).find(is_free).unwrap_or_default();
        self.remember();
        self.elements.push(Element { name, grab, nodes: None, held: BTreeSet::new() });
        self.chosen = self.elements.len() - 1;
        self.version += 1;
    }

    pub fn delete(&mut self, number: usize) {
        if number < self.elements.len() {
            self.remember();
            self.elements.remove(number);
            self.chosen = self.chosen.min(self.elements.len().saturating_sub(1));
            self.version += 1;
        }
    }

    pub fn is_drawing(&self) -> bool {
        self.stroke.is_some()
    }

    /// A button is pressed over the surface.
    pub fn press(&mut self, canvas: &mut Canvas, touch: Touch) {
        if self.elements.is_empty() {
            self.add();
        }
        if self.tool.is_brush() {
            self.remember();
        }
        self.stroke = Some(Stroke { from: touch, to: touch });
        self.brush(canvas, touch);
    }

    /// The ray moves on over the surface while the button is down.
    pub fn drag(&mut self, canvas: &mut Canvas, touch: Touch) {
        let Some(stroke) = &mut self.stroke else { return };
        let before = std::mem::replace(&mut stroke.to, touch);
        // A quick hand leaves no gaps.
        let way = touch.point - before.point;
        let steps = (way.norm() / (0.5 * self.radius)).ceil().clamp(1.0, 50.0) as u32;
        if !self.tool.is_brush() || steps == 1 {
            return self.brush(canvas, touch);
        }
        for step in 1..=steps {
            let point = before.point + way * f64::from(step) / f64::from(steps);
            let distance = |vertex: &u32| (canvas.places[*vertex as usize] - point).norm_squared();
            let vertices = 0..canvas.places.len() as u32;
            if let Some(vertex) = vertices.min_by(|a, b| distance(a).total_cmp(&distance(b))) {
                self.brush(canvas, Touch { point, vertex });
            }
        }
    }

    /// The button is let go.
    pub fn release(&mut self, canvas: &Canvas) {
        let shape = self.shape(canvas);
        self.stroke = None;
        if let Some(shape) = shape {
            self.put(canvas, shape);
        }
    }

    /// Gives the chosen element these nodes instead of those it had.
    pub fn put(&mut self, canvas: &Canvas, nodes: Nodes) {
        let chosen = nodes.select(&canvas.mesh).unwrap_or_default();
        let held: BTreeSet<u32> = chosen.into_iter().filter(|node| !self.is_taken(*node)).collect();
        // Where a part of the shape belongs to another element, the shape does not say what is held.
        let is_whole = nodes.select(&canvas.mesh).is_ok_and(|all| all.len() == held.len());
        if held.is_empty() {
            return;
        }
        self.remember();
        if let Some(element) = self.elements.get_mut(self.chosen) {
            element.nodes = Some(if is_whole { nodes } else { list(canvas, &held) });
            element.held = held;
            self.version += 1;
        }
    }

    /// The chosen element grows along the surface by a distance, or shrinks where that is negative, m.
    pub fn spread(&mut self, canvas: &mut Canvas, distance: f64) {
        let Some(element) = self.elements.get(self.chosen) else { return };
        let own: BTreeSet<u32> =
            canvas.vertices(&element.held.iter().copied().collect::<Vec<_>>()).into_iter().collect();
        let is_growing = distance >= 0.0;
        let from = match is_growing {
            true => own,
            false => (0..canvas.places.len() as u32).filter(|vertex| !own.contains(vertex)).collect(),
        };
        let reached = canvas.roads.within(&from, distance.abs()).into_iter();
        let reached: BTreeSet<u32> = reached.map(|vertex| canvas.nodes[vertex as usize]).collect();
        // Nodes inside the body are on no way along the surface, and stay.
        let held = match is_growing {
            true => &element.held | &reached.into_iter().filter(|&node| !self.is_taken(node)).collect(),
            false => &element.held - &reached,
        };
        self.remember();
        self.hold(canvas, held);
    }

    /// The vertices that the tool would take or change at `touch`.
    pub fn preview(&self, canvas: &mut Canvas, touch: Option<Touch>) -> Vec<u32> {
        match (self.shape(canvas), touch) {
            (Some(shape), _) => canvas.vertices(&shape.select(&canvas.mesh).unwrap_or_default()),
            (None, Some(touch)) => canvas.roads.within(&BTreeSet::from([touch.vertex]), self.radius),
            (None, None) => Vec::new(),
        }
    }

    /// The body's control elements, in their order; elements that hold nothing are left out.
    pub fn controls(&self) -> IndexMap<String, Control> {
        let held = self.elements.iter().filter(|element| !element.held.is_empty());
        let control = |element: &Element| {
            let nodes = element.nodes.clone()?;
            Some((element.name.clone(), Control { nodes, grab: element.grab }))
        };
        held.filter_map(control).collect()
    }

    /// The reason why the elements cannot be precomputed, in words.
    pub fn lack(&self) -> Option<String> {
        let held = || self.elements.iter().filter(|element| !element.held.is_empty());
        let empty = self.elements.iter().find(|element| element.held.is_empty());
        let doubled = self.elements.iter().enumerate().find(|(i, element)| {
            element.name.trim().is_empty()
                || self.elements[..*i].iter().any(|other| other.name == element.name)
        });
        if self.elements.is_empty() {
            return Some("Draw on the body where it is to be held.".to_owned());
        }
        if let Some((_, element)) = doubled {
            return Some(match element.name.trim() {
                "" => "An element needs a name.".to_owned(),
                name => format!("Two elements are called {name}."),
            });
        }
        if let Some(element) = empty {
            return Some(format!("{} holds nothing yet: draw on the body.", element.name));
        }
        if !held().any(|element| element.grab == Grab::Fixed) {
            return Some("Nothing is fixed: the body would float. Make one element fixed.".to_owned());
        }
        if !held().any(|element| element.grab == Grab::Dragger) {
            return Some("Nothing can be grabbed: make one element that can.".to_owned());
        }
        None
    }

    /// Paints or erases at one place.
    fn brush(&mut self, canvas: &mut Canvas, touch: Touch) {
        let is_adding = match self.tool {
            Tool::Paint => true,
            Tool::Erase => false,
            _ => return,
        };
        let touched = canvas.roads.within(&BTreeSet::from([touch.vertex]), self.radius);
        let Some(element) = self.elements.get(self.chosen) else { return };
        let mut held = element.held.clone();
        for node in touched.into_iter().map(|vertex| canvas.nodes[vertex as usize]) {
            if !is_adding {
                held.remove(&node);
            } else if !self.is_taken(node) {
                held.insert(node);
            }
        }
        self.hold(canvas, held);
    }

    fn hold(&mut self, canvas: &Canvas, held: BTreeSet<u32>) {
        let Some(element) = self.elements.get_mut(self.chosen).filter(|element| element.held != held) else {
            return;
        };
        element.nodes = (!held.is_empty()).then(|| list(canvas, &held));
        element.held = held;
        self.version += 1;
    }

    /// Whether a node belongs to another element than the chosen one.
    fn is_taken(&self, node: u32) -> bool {
        let others = self.elements.iter().enumerate().filter(|(number, _)| *number != self.chosen);
        others.into_iter().any(|(_, element)| element.held.contains(&node))
    }

    /// The shape that is being drawn, for tools that draw one; a press without a drag makes one of the brush's size.
    fn shape(&self, canvas: &Canvas) -> Option<Nodes> {
        let Stroke { from, to } = self.stroke.as_ref()?;
        let extent = canvas.extent();
        let near = |v: Vector3<f64>| <[f64; 3]>::from(v.map(|x| rounded(x, extent)));
        let dragged = (to.point - from.point).norm();
        let radius = rounded(if dragged > 1e-3 * extent { dragged } else { self.radius }, extent);
        match self.tool {
            Tool::Paint | Tool::Erase => None,
            Tool::Ball => Some(Nodes::Sphere { centre: near(from.point), radius }),
            Tool::Grow => Some(Nodes::Geodesic { from: near(from.point), radius }),
            Tool::Box => {
                let around = Vector3::repeat(self.radius);
                let (low, high) = (from.point.inf(&to.point) - around, from.point.sup(&to.point) + around);
                Some(Nodes::Box { min: near(low), max: near(high) })
            }
        }
    }
}

fn list(canvas: &Canvas, held: &BTreeSet<u32>) -> Nodes {
    let mut tags: Vec<u64> = held.iter().map(|&node| canvas.mesh.tags[node as usize]).collect();
    tags.sort_unstable();
    Nodes::List(tags)
}

/// Rounds a value to a ten-thousandth of `extent` or better, by a power of ten, so that it can be read.
pub fn rounded(value: f64, extent: f64) -> f64 {
    let decimals = (4.0 - extent.max(f64::MIN_POSITIVE).log10().floor()).clamp(0.0, 15.0) as usize;
    format!("{value:.decimals$}").parse().unwrap_or(value)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::{Block, block};

    /// A bar along x from -0.5 to 0.5 m.
    fn canvas() -> Canvas {
        Canvas::new(block(&Block { size: [1.0, 0.2, 0.2], cells: [20, 4, 4] }).unwrap())
    }

    fn empty() -> Sketch {
        Sketch {
            first: Vec::new(),
            elements: Vec::new(),
            chosen: 0,
            tool: Tool::Paint,
            radius: 0.06,
            stroke: None,
            history: Vec::new(),
            version: 0,
        }
    }

    fn touch(canvas: &Canvas, point: [f64; 3]) -> Touch {
        let point = Vector3::from(point);
        let distance = |v: &u32| (canvas.places[*v as usize] - point).norm();
        let vertex =
            (0..canvas.places.len() as u32).min_by(|a, b| distance(a).total_cmp(&distance(b))).unwrap();
        Touch { point, vertex }
    }

    fn stroke(sketch: &mut Sketch, canvas: &mut Canvas, from: [f64; 3], to: [f64; 3]) {
        let [from, to] = [from, to].map(|point| touch(canvas, point));
        sketch.press(canvas, from);
        sketch.drag(canvas, to);
        sketch.release(canvas);
    }

    fn places<'a>(
        sketch: &'a Sketch,
        canvas: &'a Canvas,
        number: usize,
    ) -> impl Iterator<Item = Vector3<f64>> + 'a {
        sketch.elements[number].held.iter().map(|&node| canvas.mesh.nodes[node as usize])
    }

    #[test]
    fn a_quick_stroke_paints_all_that_lies_on_its_way_and_nothing_on_the_other_side() {
        let (mut canvas, mut sketch) = (canvas(), empty());
        stroke(&mut sketch, &mut canvas, [-0.4, 0.0, 0.1], [0.4, 0.0, 0.1]);
        for k in 0..=16 {
            let on_way = Vector3::new(-0.4 + 0.05 * f64::from(k), 0.0, 0.1);
            assert!(places(&sketch, &canvas, 0).any(|x| (x - on_way).norm() < 1e-9), "{on_way}");
        }
        assert!(places(&sketch, &canvas, 0).all(|x| x.z > 0.0 && x.y.abs() < 0.09));
        assert!(
            matches!(&sketch.elements[0].nodes, Some(Nodes::List(tags)) if tags.len() == sketch.elements[0].held.len())
        );
        assert_eq!(sketch.elements[0].grab, Grab::Fixed, "the first holds the body");

        sketch.tool = Tool::Erase;
        stroke(&mut sketch, &mut canvas, [0.0, 0.0, 0.1], [0.0, 0.0, 0.1]);
        let middle = Vector3::new(0.0, 0.0, 0.1);
        assert!(places(&sketch, &canvas, 0).all(|x| (x - middle).norm() > 0.051));
        sketch.undo();
        assert!(places(&sketch, &canvas, 0).any(|x| x.x.abs() < 0.01));
        sketch.undo();
        assert!(sketch.elements[0].held.is_empty());
    }

    #[test]
    fn shapes_stay_shapes_until_another_element_has_a_part_of_them() {
        let (mut canvas, mut sketch) = (canvas(), empty());
        sketch.tool = Tool::Ball;
        stroke(&mut sketch, &mut canvas, [-0.5, 0.0, 0.1], [-0.3, 0.0, 0.1]);
        assert_eq!(sketch.elements[0].nodes, Some(Nodes::Sphere { centre: [-0.5, 0.0, 0.1], radius: 0.2 }));
        let all = sketch.elements[0].nodes.as_ref().unwrap().select(&canvas.mesh).unwrap();
        assert_eq!(
            sketch.elements[0].held.iter().copied().collect::<Vec<_>>(),
            all,
            "inside the body as well"
        );

        sketch.add();
        assert_eq!((sketch.elements[1].name.as_str(), sketch.elements[1].grab), ("hand", Grab::Dragger));
        sketch.tool = Tool::Box;
        sketch.radius = 0.11;
        stroke(&mut sketch, &mut canvas, [0.3, 0.0, 0.1], [0.5, 0.0, 0.1]);
        assert!(matches!(sketch.elements[1].nodes, Some(Nodes::Box { .. })));
        stroke(&mut sketch, &mut canvas, [-0.35, 0.0, 0.1], [0.5, 0.0, 0.1]);
        assert!(matches!(sketch.elements[1].nodes, Some(Nodes::List(_))), "the ball keeps its nodes");
        assert!(sketch.elements[1].held.is_disjoint(&sketch.elements[0].held));
        assert_eq!(sketch.lack(), None);
        sketch.elements[1].grab = Grab::Fixed;
        assert!(sketch.lack().unwrap().contains("can be grabbed"));
        sketch.elements[1].name = "base".into();
        assert!(sketch.lack().unwrap().contains("called base"));
        assert_eq!(sketch.controls().len(), 1, "a table has one entry of a name");
    }

    #[test]
    fn an_element_grows_and_shrinks_by_a_length() {
        let (mut canvas, mut sketch) = (canvas(), empty());
        sketch.add();
        sketch.put(&canvas, Nodes::Group("xmin".into()));
        let count = |sketch: &Sketch| sketch.elements[0].held.len();
        let face = count(&sketch);
        sketch.spread(&mut canvas, 0.101);
        assert!(places(&sketch, &canvas, 0).all(|x| x.x < -0.39));
        assert_eq!(count(&sketch), face + 2 * 16, "two rings of 16 around the bar");
        sketch.spread(&mut canvas, -0.051);
        assert_eq!(count(&sketch), face + 16);

        // Five layers, whose inner nodes stay.
        sketch.put(&canvas, Nodes::Box { min: [-0.5, -0.1, -0.1], max: [-0.3, 0.1, 0.1] });
        assert_eq!(count(&sketch), 5 * 25);
        sketch.spread(&mut canvas, 0.051);
        assert_eq!(count(&sketch), 5 * 25 + 16);
        sketch.spread(&mut canvas, -0.101);
        assert_eq!(count(&sketch), 5 * 25 - 16);
    }

    #[test]
    fn numbers_are_rounded_so_that_they_can_be_read() {
        assert_eq!(rounded(0.123456789, 1.0), 0.1235);
        assert_eq!(rounded(123.456789, 250.0), 123.46);
        assert_eq!(rounded(0.000123456789, 0.002), 0.0001235);
        assert_eq!(rounded(f64::MAX, 0.0), f64::MAX);
    }
}
