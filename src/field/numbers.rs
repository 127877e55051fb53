//! Lists of numbers in a stream, exactly as they are; those that JSON lacks are the words `nan`, `inf` and `-inf`.
//!
//! `#[serde(with = "crate::field::numbers")]` on a vector, point, matrix (row by row) or pose (place, then quaternion
//! i, j, k, w); `numbers::option` where it may be absent, `numbers::list` where there are any number of them, `numbers::flat` on a list of
//! single numbers.

use nalgebra::{Isometry3, Point3, Quaternion, SMatrix, Similarity3, Translation3, UnitQuaternion, Vector3};
use serde::de::{Error, SeqAccess, Visitor};
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use std::fmt;
use std::marker::PhantomData;

/// A value that consists of a fixed count of numbers.
pub trait Numbers: Sized {
    const COUNT: usize;
    fn list(&self) -> Vec<f64>;
    /// The value made of `COUNT` numbers.
    fn made(numbers: &[f64]) -> Self;
}

#[derive(Serialize, Deserialize)]
#[serde(untagged)]
enum Number {
    Finite(f64),
    Other(Other),
}

#[derive(Serialize, Deserialize)]
enum Other {
    #[serde(rename = "nan")]
    Nan,
    #[serde(rename = "inf")]
    Infinite,
    #[serde(rename = "-inf")]
    MinusInfinite,
}

impl From<f64> for Number {
    fn from(value: f64) -> Number {
        match value {
            _ if value.is_finite() => Number::Finite(value),
            _ if value.is_nan() => Number::Other(Other::Nan),
            _ if value > 0.0 => Number::Other(Other::Infinite),
            _ => Number::Other(Other::MinusInfinite),
        }
    }
}

impl From<Number> for f64 {
    fn from(number: Number) -> f64 {
        match number {
            Number::Finite(value) => value,
            Number::Other(Other::Nan) => f64::NAN,
            Number::Other(Other::Infinite) => f64::INFINITY,
            Number::Other(Other::MinusInfinite) => f64::NEG_INFINITY,
        }
    }
}

pub fn serialize<T: Numbers, S: Serializer>(value: &T, serializer: S) -> Result<S::Ok, S::Error> {
    serializer.collect_seq(value.list().into_iter().map(Number::from))
}

pub fn deserialize<'de, T: Numbers, D: Deserializer<'de>>(deserializer: D) -> Result<T, D::Error> {
    deserializer.deserialize_seq(Exactly(PhantomData))
}

/// Reads `T::COUNT` numbers and no more, whatever the input says of its length.
struct Exactly<T>(PhantomData<T>);

impl<'de, T: Numbers> Visitor<'de> for Exactly<T> {
    type Value = T;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} numbers", T::COUNT)
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut list: A) -> Result<T, A::Error> {
        let mut numbers = Vec::with_capacity(T::COUNT);
        while let Some(number) = list.next_element::<Number>()? {
            if numbers.len() == T::COUNT {
                return Err(Error::invalid_length(T::COUNT + 1, &self));
            }
            numbers.push(f64::from(number));
        }
        if numbers.len() < T::COUNT {
            return Err(Error::invalid_length(numbers.len(), &self));
        }
        Ok(T::made(&numbers))
    }
}

/// One list of numbers among others.
mod listed {
    use super::{Deserialize, Numbers, Serialize};

    #[derive(Serialize, Deserialize)]
    #[serde(transparent)]
    #[serde(bound = "")]
    pub struct Listed<T: Numbers>(#[serde(with = "super")] pub T);
}

/// A list of numbers, or nothing.
pub mod option {
    use super::listed::Listed;
    use super::{Deserialize, Deserializer, Numbers, Serialize, Serializer};

    pub fn serialize<T: Numbers + Clone, S: Serializer>(
        value: &Option<T>,
        serializer: S,
    ) -> Result<S::Ok, S::Error> {
        value.clone().map(Listed).serialize(serializer)
    }

    pub fn deserialize<'de, T: Numbers, D: Deserializer<'de>>(
        deserializer: D,
    ) -> Result<Option<T>, D::Error> {
        Ok(Option::<Listed<T>>::deserialize(deserializer)?.map(|Listed(value)| value))
    }
}

/// Any count of lists of numbers.
pub mod list {
    use super::listed::Listed;
    use super::{Deserialize, Deserializer, Numbers, Serializer};

    pub fn serialize<T: Numbers + Clone, S: Serializer>(
        values: &[T],
        serializer: S,
    ) -> Result<S::Ok, S::Error> {
        serializer.collect_seq(values.iter().cloned().map(Listed))
    }

    pub fn deserialize<'de, T: Numbers, D: Deserializer<'de>>(deserializer: D) -> Result<Vec<T>, D::Error> {
        Ok(Vec::<Listed<T>>::deserialize(deserializer)?.into_iter().map(|Listed(value)| value).collect())
    }
}

/// Any count of single numbers.
pub mod flat {
    use super::{Deserialize, Deserializer, Number, Serializer};

    pub fn serialize<S: Serializer>(values: &[f64], serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_seq(values.iter().map(|value| Number::from(*value)))
    }

    pub fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Vec<f64>, D::Error> {
        Ok(Vec::<Number>::deserialize(deserializer)?.into_iter().map(f64::from).collect())
    }
}

impl Numbers for f64 {
    const COUNT: usize = 1;

    fn list(&self) -> Vec<f64> {
        vec![*self]
    }

    fn made(numbers: &[f64]) -> f64 {
        numbers[0]
    }
}

/// Vectors and points, of f32 or f64.
macro_rules! triple {
    ($($triple:ty: $number:ty),*) => {
        $(impl Numbers for $triple {
            const COUNT: usize = 3;

            fn list(&self) -> Vec<f64> {
                self.iter().map(|&x| f64::from(x)).collect()
            }

            fn made(numbers: &[f64]) -> $triple {
                <$triple>::new(numbers[0] as $number, numbers[1] as $number, numbers[2] as $number)
            }
        })*
    };
}

triple!(Vector3<f32>: f32, Vector3<f64>: f64, Point3<f32>: f32, Point3<f64>: f64);

impl<const N: usize> Numbers for SMatrix<f64, N, N> {
    const COUNT: usize = N * N;

    fn list(&self) -> Vec<f64> {
        self.transpose().iter().copied().collect()
    }

    fn made(numbers: &[f64]) -> Self {
        Self::from_row_slice(numbers)
    }
}

/// Poses, of f32 or f64; the quaternion is taken as it stands.
macro_rules! pose {
    ($($number:ty),*) => {
        $(impl Numbers for Isometry3<$number> {
            const COUNT: usize = 7;

            fn list(&self) -> Vec<f64> {
                self.translation.vector.iter().chain(self.rotation.coords.iter()).map(|&x| f64::from(x)).collect()
            }

            fn made(numbers: &[f64]) -> Isometry3<$number> {
                let at = |i: usize| numbers[i] as $number;
                let rotation = UnitQuaternion::new_unchecked(Quaternion::new(at(6), at(3), at(4), at(5)));
                Isometry3::from_parts(Translation3::new(at(0), at(1), at(2)), rotation)
            }
        })*
    };
}

pose!(f32, f64);

/// i, j, k, w, taken as they stand.
impl Numbers for UnitQuaternion<f64> {
    const COUNT: usize = 4;

    fn list(&self) -> Vec<f64> {
        self.coords.iter().copied().collect()
    }

    fn made(numbers: &[f64]) -> UnitQuaternion<f64> {
        UnitQuaternion::new_unchecked(Quaternion::new(numbers[3], numbers[0], numbers[1], numbers[2]))
    }
}

/// A pose, then its scale.
impl Numbers for Similarity3<f64> {
    const COUNT: usize = 8;

    fn list(&self) -> Vec<f64> {
        let mut list = self.isometry.list();
        list.push(self.scaling());
        list
    }

    fn made(numbers: &[f64]) -> Similarity3<f64> {
        // A similarity's scale is never 0; one that is none cannot be made.
        let scale = if numbers[7] == 0.0 { f64::MIN_POSITIVE } else { numbers[7] };
        Similarity3::from_isometry(Isometry3::made(&numbers[..7]), scale)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Matrix3;

    #[derive(Serialize, Deserialize)]
    struct Some {
        #[serde(with = "super")]
        pose: Isometry3<f32>,
        #[serde(with = "super::option")]
        point: Option<Point3<f64>>,
        #[serde(with = "super")]
        matrix: Matrix3<f64>,
    }

    fn some() -> Some {
        let rotation = UnitQuaternion::new_unchecked(Quaternion::new(0.1, f32::NAN, -0.0, 3e-40));
        Some {
            pose: Isometry3::from_parts(Translation3::new(f32::INFINITY, 0.1, f32::NEG_INFINITY), rotation),
            point: Option::Some(Point3::new(0.1, 1e300, -5e-324)),
            matrix: Matrix3::new(1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.1),
        }
    }

    #[test]
    fn numbers_come_back_with_every_bit() {
        let text = serde_json::to_string(&some()).unwrap();
        let back: Some = serde_json::from_str(&text).unwrap();
        assert_eq!(serde_json::to_string(&back).unwrap(), text);
        let bits = |some: &Some| some.pose.list().iter().map(|x| (*x as f32).to_bits()).collect::<Vec<_>>();
        assert_eq!(bits(&back), bits(&some()));
        assert_eq!((back.point, back.matrix), (some().point, some().matrix));
        assert!(text.contains("\"nan\"") && text.contains("-0.0"), "{text}");
        assert!(text.contains("[1.0,2.0,3.0,4.0"), "{text}");
    }

    #[test]
    fn another_count_or_kind_is_refused() {
        let text = serde_json::to_string(&some()).unwrap();
        for (from, to) in [
            ("[1.0,2.0,", "[2.0,"),
            ("[1.0,2.0,", "[1.0,1.0,2.0,"),
            ("[1.0,2.0,", "[\"one\",2.0,"),
            ("[1.0,2.0,", "[null,2.0,"),
            ("\"matrix\":[", "\"matrix\":[["),
            ("\"nan\"", "\"not\""),
        ] {
            let wrong = text.replace(from, to);
            assert_ne!(wrong, text);
            assert!(serde_json::from_str::<Some>(&wrong).is_err(), "{wrong}");
        }
        let absent = text
            .replace(&text[text.find("\"point\":").unwrap() + 8..text.find(",\"matrix").unwrap()], "null");
        assert_eq!(serde_json::from_str::<Some>(&absent).unwrap().point, None);
    }
}
