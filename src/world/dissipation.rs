//! Work that friction and cutting take in a frame, for an effect that makes a part of it heard.

use nalgebra::{Point3, Vector3};

/// Work done at one or more places of a body in a frame.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Dissipation {
    /// J.
    pub work: f64,
    /// Sums of the places in the room and of the ways, each times its work, J m.
    places: Vector3<f64>,
    ways: f64,
}

impl Dissipation {
    /// Work at a place in the room, where one thing has gone this way along another in the frame, m.
    pub fn of(work: f64, place: &Vector3<f64>, way: f64) -> Dissipation {
        Dissipation { work, places: place * work, ways: way * work }
    }

    pub fn add(&mut self, other: &Dissipation) {
        self.work += other.work;
        self.places += other.places;
        self.ways += other.ways;
    }

    /// Mean place and way in the frame, weighted by work; `None` where no work was done.
    pub fn mean(&self) -> Option<(Point3<f64>, f64)> {
        let place = self.places / self.work;
        let way = self.ways / self.work;
        let is_known = self.work > 0.0 && way.is_finite() && place.iter().all(|x| x.is_finite());
        is_known.then(|| (place.into(), way))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_and_ways_count_by_their_work() {
        let mut all = Dissipation::default();
        assert_eq!(all.mean(), None);
        all.add(&Dissipation::of(1.0, &Vector3::new(0.0, 0.0, 4.0), 2.0));
        all.add(&Dissipation::of(3.0, &Vector3::zeros(), 6.0));
        assert_eq!((all.work, all.mean()), (4.0, Some((Point3::new(0.0, 0.0, 1.0), 5.0))));
        all.add(&Dissipation::of(f64::NAN, &Vector3::zeros(), 1.0));
        assert_eq!(all.mean(), None);
    }
}
