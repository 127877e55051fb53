//! A tensor on its way into a .green file: a type, a shape and little-endian bytes.

use safetensors::tensor::Dtype;

#[derive(Clone, Debug, PartialEq)]
pub struct Tensor {
    pub dtype: Dtype,
    pub shape: Vec<usize>,
    pub bytes: Vec<u8>,
}

/// A number that tensors are made of.
pub trait Number: Copy {
    const DTYPE: Dtype;
    fn to_bytes(self) -> impl IntoIterator<Item = u8>;
}

macro_rules! number {
    ($($number:ty: $dtype:ident),*) => {
        $(impl Number for $number {
            const DTYPE: Dtype = Dtype::$dtype;

            fn to_bytes(self) -> impl IntoIterator<Item = u8> {
                self.to_le_bytes()
            }
        })*
    };
}

number!(u8: U8, f32: F32, f64: F64, u32: U32, u64: U64);

impl Tensor {
    /// `numbers` row by row; as many as the shape has places.
    pub fn new<T: Number>(shape: &[usize], numbers: impl IntoIterator<Item = T>) -> Tensor {
        let bytes = numbers.into_iter().flat_map(T::to_bytes).collect();
        Tensor { dtype: T::DTYPE, shape: shape.to_vec(), bytes }
    }
}
