//! The state of a world as a number, and the styli that it knows.

use super::frame::World;

/// A tracker's state with more styli is followed in so many.
const MOST_STYLI: usize = 16;

impl World {
    /// blake3 over the bits of all that a frame makes: the head's pose, and per body its place, control poses,
    /// coefficients, and the blake3 of its deformed positions, which is made where they changed. The same for the same
    /// session, whatever the number of threads.
    pub fn state_hash(&mut self) -> String {
        let mut hasher = blake3::Hasher::new();
        let mut numbers = |numbers: &mut dyn Iterator<Item = &f64>| {
            for number in numbers {
                hasher.update(&number.to_bits().to_le_bytes());
            }
        };
        let head = &self.room_from_head;
        numbers(&mut head.translation.vector.iter().chain(head.rotation.coords.iter()));
        for body in &self.bodies {
            let place = &body.room_from_body;
            let rigid = &place.isometry;
            numbers(&mut rigid.translation.vector.iter().chain(rigid.rotation.coords.iter()));
            numbers(&mut std::iter::once(&place.scaling()));
            for pose in &body.deformer.poses {
                numbers(&mut pose.translation.iter().chain(pose.matrix.iter()));
            }
            let made = &body.deformer.state;
            numbers(&mut made.coefficients.iter());
            for rigid in &made.parts {
                numbers(&mut rigid.translation.vector.iter().chain(rigid.rotation.coords.iter()));
            }
        }
        for body in &mut self.bodies {
            let hash = match body.positions_hash {
                Some((deformations, hash)) if deformations == body.deformations => hash,
                _ => blake3::hash(bytemuck::cast_slice(body.deformer.positions().as_ref())),
            };
            body.positions_hash = Some((body.deformations, hash));
            hasher.update(hash.as_bytes());
        }
        hasher.finalize().to_hex().to_string()
    }

    pub fn styli_count(&self) -> usize {
        self.fields.styli.len()
    }

    /// Makes fields for so many styli.
    pub fn have_styli(&mut self, count: usize) {
        while self.fields.styli.len() < count.min(MOST_STYLI) {
            if let Err(error) = self.fields.add_stylus(&mut self.graph) {
                unreachable!("the names of styli are their own: {error}");
            }
        }
    }
}
