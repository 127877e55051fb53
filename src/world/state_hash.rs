//! The state of a world as a hash in hexadecimal digits, by which a replay is compared with its recording.

use super::running::World;

impl World {
    /// blake3 over the bits of all that a frame makes: the head's pose, and per body its place, control poses,
    /// coefficients, and the blake3 of its deformed positions, which is only computed anew where they changed. It is the
    /// same for the same session, whatever the number of threads.
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
            let version = body.deformer.version;
            let hash = match body.positions_hash {
                Some((of, hash)) if of == version => hash,
                _ => blake3::hash(bytemuck::cast_slice(body.deformer.positions().as_ref())),
            };
            body.positions_hash = Some((version, hash));
            hasher.update(hash.as_bytes());
        }
        hasher.finalize().to_hex().to_string()
    }
}
