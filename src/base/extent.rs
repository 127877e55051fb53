//! The box about places, along the axes.

use nalgebra::{RealField, Vector3};

type Corners<T> = (Vector3<T>, Vector3<T>);

/// Least and greatest coordinates of places; `None` without places.
pub fn extent<T: RealField + Copy>(places: impl IntoIterator<Item = Vector3<T>>) -> Option<Corners<T>> {
    places.into_iter().map(|x| (x, x)).reduce(|a, b| (a.0.inf(&b.0), a.1.sup(&b.1)))
}

/// Least and greatest coordinates of places in a list; zero without places.
pub fn bounding_box(places: &[Vector3<f64>]) -> (Vector3<f64>, Vector3<f64>) {
    extent(places.iter().copied()).unwrap_or_default()
}
