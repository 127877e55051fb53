//! Arrays of the length that is asked for, and tables where tables are asked for.
//!
//! In: any serde deserializer. Out: the same, but that an array with more elements than its type takes is an error, and
//! so is an array in the place of a table. A type takes what it knows of a sequence, and it is the format's duty to
//! refuse what is left (serde's own for buffered values does); toml's leaves it unread.

use serde::Deserializer;
use serde::de::{
    DeserializeSeed, EnumAccess, Error, IgnoredAny, MapAccess, SeqAccess, Unexpected, VariantAccess, Visitor,
};
use std::fmt;

/// A deserializer, or what it hands out to its visitors, watched.
pub struct Strict<T>(pub T);

/// A visitor, and the length of a sequence that it may be given.
struct LimitedVisitor<V> {
    visitor: V,
    takes: Takes,
}

#[derive(Clone, Copy)]
enum Takes {
    Anything,
    /// A sequence of this many elements.
    Length(usize),
    /// No sequence.
    Table,
}

macro_rules! forward {
    ($($method:ident($($argument:ident: $kind:ty),*) $takes:expr;)*) => {
        $(fn $method<V: Visitor<'de>>(self, $($argument: $kind,)* visitor: V) -> Result<V::Value, D::Error> {
            self.0.$method($($argument,)* LimitedVisitor { visitor, takes: $takes })
        })*
    };
    ($($method:ident)*) => {
        forward! { $($method() Takes::Anything;)* }
    };
}

impl<'de, D: Deserializer<'de>> Deserializer<'de> for Strict<D> {
    type Error = D::Error;

    forward! {
        deserialize_any deserialize_bool deserialize_i8 deserialize_i16 deserialize_i32 deserialize_i64
        deserialize_i128 deserialize_u8 deserialize_u16 deserialize_u32 deserialize_u64 deserialize_u128
        deserialize_f32 deserialize_f64 deserialize_char deserialize_str deserialize_string deserialize_bytes
        deserialize_byte_buf deserialize_option deserialize_unit deserialize_seq deserialize_map
        deserialize_identifier deserialize_ignored_any
    }
    forward! {
        deserialize_unit_struct(name: &'static str) Takes::Anything;
        deserialize_newtype_struct(name: &'static str) Takes::Anything;
        deserialize_tuple(length: usize) Takes::Length(length);
        deserialize_tuple_struct(name: &'static str, length: usize) Takes::Length(length);
        deserialize_struct(name: &'static str, fields: &'static [&'static str]) Takes::Table;
        deserialize_enum(name: &'static str, variants: &'static [&'static str]) Takes::Anything;
    }

    fn is_human_readable(&self) -> bool {
        self.0.is_human_readable()
    }
}

macro_rules! hand_on {
    ($($method:ident($($value:ident: $kind:ty)?))*) => {
        $(fn $method<E: Error>(self $(, $value: $kind)?) -> Result<V::Value, E> {
            self.visitor.$method($($value)?)
        })*
    };
}

impl<'de, V: Visitor<'de>> Visitor<'de> for LimitedVisitor<V> {
    type Value = V::Value;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.visitor.expecting(f)
    }

    hand_on! {
        visit_none() visit_unit() visit_bool(x: bool) visit_i8(x: i8) visit_i16(x: i16) visit_i32(x: i32)
        visit_i64(x: i64) visit_i128(x: i128) visit_u8(x: u8) visit_u16(x: u16) visit_u32(x: u32)
        visit_u64(x: u64) visit_u128(x: u128) visit_f32(x: f32) visit_f64(x: f64) visit_char(x: char)
        visit_str(x: &str) visit_borrowed_str(x: &'de str) visit_string(x: String) visit_bytes(x: &[u8])
        visit_borrowed_bytes(x: &'de [u8]) visit_byte_buf(x: Vec<u8>)
    }

    fn visit_some<D: Deserializer<'de>>(self, value: D) -> Result<V::Value, D::Error> {
        self.visitor.visit_some(Strict(value))
    }

    fn visit_newtype_struct<D: Deserializer<'de>>(self, value: D) -> Result<V::Value, D::Error> {
        self.visitor.visit_newtype_struct(Strict(value))
    }

    fn visit_seq<A: SeqAccess<'de>>(self, elements: A) -> Result<V::Value, A::Error> {
        let mut elements = Strict(elements);
        match self.takes {
            Takes::Anything => self.visitor.visit_seq(elements),
            Takes::Table => Err(A::Error::invalid_type(Unexpected::Seq, &self.visitor)),
            Takes::Length(length) => {
                let value = self.visitor.visit_seq(&mut elements)?;
                let mut found = length;
                while elements.0.next_element::<IgnoredAny>()?.is_some() {
                    found += 1;
                }
                let asked = format!("an array of length {length}");
                if found > length { Err(A::Error::invalid_length(found, &asked.as_str())) } else { Ok(value) }
            }
        }
    }

    fn visit_map<A: MapAccess<'de>>(self, entries: A) -> Result<V::Value, A::Error> {
        self.visitor.visit_map(Strict(entries))
    }

    fn visit_enum<A: EnumAccess<'de>>(self, variant: A) -> Result<V::Value, A::Error> {
        self.visitor.visit_enum(Strict(variant))
    }
}

impl<'de, S: DeserializeSeed<'de>> DeserializeSeed<'de> for Strict<S> {
    type Value = S::Value;

    fn deserialize<D: Deserializer<'de>>(self, value: D) -> Result<S::Value, D::Error> {
        self.0.deserialize(Strict(value))
    }
}

impl<'de, A: SeqAccess<'de>> SeqAccess<'de> for Strict<A> {
    type Error = A::Error;

    fn next_element_seed<S: DeserializeSeed<'de>>(&mut self, seed: S) -> Result<Option<S::Value>, A::Error> {
        self.0.next_element_seed(Strict(seed))
    }

    fn size_hint(&self) -> Option<usize> {
        self.0.size_hint()
    }
}

impl<'de, A: MapAccess<'de>> MapAccess<'de> for Strict<A> {
    type Error = A::Error;

    fn next_key_seed<S: DeserializeSeed<'de>>(&mut self, seed: S) -> Result<Option<S::Value>, A::Error> {
        self.0.next_key_seed(Strict(seed))
    }

    fn next_value_seed<S: DeserializeSeed<'de>>(&mut self, seed: S) -> Result<S::Value, A::Error> {
        self.0.next_value_seed(Strict(seed))
    }

    fn size_hint(&self) -> Option<usize> {
        self.0.size_hint()
    }
}

impl<'de, A: EnumAccess<'de>> EnumAccess<'de> for Strict<A> {
    type Error = A::Error;
    type Variant = Strict<A::Variant>;

    fn variant_seed<S: DeserializeSeed<'de>>(self, seed: S) -> Result<(S::Value, Self::Variant), A::Error> {
        let (value, variant) = self.0.variant_seed(Strict(seed))?;
        Ok((value, Strict(variant)))
    }
}

impl<'de, A: VariantAccess<'de>> VariantAccess<'de> for Strict<A> {
    type Error = A::Error;

    fn unit_variant(self) -> Result<(), A::Error> {
        self.0.unit_variant()
    }

    fn newtype_variant_seed<S: DeserializeSeed<'de>>(self, seed: S) -> Result<S::Value, A::Error> {
        self.0.newtype_variant_seed(Strict(seed))
    }

    fn tuple_variant<V: Visitor<'de>>(self, length: usize, visitor: V) -> Result<V::Value, A::Error> {
        self.0.tuple_variant(length, LimitedVisitor { visitor, takes: Takes::Length(length) })
    }

    fn struct_variant<V: Visitor<'de>>(
        self,
        fields: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value, A::Error> {
        self.0.struct_variant(fields, LimitedVisitor { visitor, takes: Takes::Table })
    }
}

#[cfg(test)]
mod tests {
    use crate::config::parse;
    use serde::Deserialize;
    use std::path::Path;
    use toml::Spanned;

    #[derive(Debug, PartialEq, Deserialize)]
    struct Pair(f64, f64);

    #[derive(Debug, PartialEq, Deserialize)]
    #[serde(rename_all = "snake_case", deny_unknown_fields)]
    enum Shape {
        Box { min: [f64; 3] },
        Line([f64; 2]),
        Both(f64, f64),
    }

    #[derive(Debug, PartialEq, Deserialize)]
    #[serde(deny_unknown_fields)]
    struct Inner {
        size: [u32; 2],
    }

    #[derive(Debug, PartialEq, Deserialize)]
    #[serde(deny_unknown_fields)]
    struct All {
        plain: Option<[f64; 3]>,
        spanned: Option<Spanned<[f64; 3]>>,
        rows: Option<[[f64; 2]; 2]>,
        tuple: Option<(u32, String)>,
        pair: Option<Pair>,
        shape: Option<Shape>,
        inner: Option<Inner>,
        list: Option<Vec<[f64; 2]>>,
        #[serde(default)]
        table: std::collections::BTreeMap<String, Inner>,
        any: Option<toml::Value>,
    }

    fn told(text: &str) -> Result<All, String> {
        parse::<All>(&format!("\n{text}\n"), Path::new("a.toml")).map_err(|error| error.to_string())
    }

    /// An element too many, wherever an array may stand; the place is that of the array.
    #[test]
    fn arrays_with_an_element_too_many_are_refused_with_their_place() {
        for (good, bad, place, length) in [
            ("plain = [1, 2, 3]", "plain = [1, 2, 3, 4]", "2:9", [4, 3]),
            ("spanned = [1, 2, 3]", "spanned = [1, 2, 3, 4, 5]", "2:11", [5, 3]),
            ("rows = [[1, 2], [3, 4]]", "rows = [[1, 2], [3, 4, 5]]", "2:17", [3, 2]),
            ("rows = [[1, 2], [3, 4]]", "rows = [[1, 2], [3, 4], [5, 6]]", "2:8", [3, 2]),
            ("tuple = [1, \"a\"]", "tuple = [1, \"a\", 2]", "2:9", [3, 2]),
            ("pair = [1, 2]", "pair = [1, 2, 3]", "2:8", [3, 2]),
            (
                "shape = { box = { min = [1, 2, 3] } }",
                "shape = { box = { min = [1, 2, 3, 4] } }",
                "2:25",
                [4, 3],
            ),
            ("shape = { line = [1, 2] }", "shape = { line = [1, 2, 3] }", "2:18", [3, 2]),
            ("list = [[1, 2], [1, 2], [1, 2]]", "list = [[1, 2], [1, 2, 3]]", "2:17", [3, 2]),
            ("inner.size = [1, 2]", "inner.size = [1, 2, 3]", "2:14", [3, 2]),
            ("table.a.size = [1, 2]", "table.a.size = [1, 2, 3]", "2:16", [3, 2]),
        ] {
            assert!(told(good).is_ok(), "{good}: {:?}", told(good));
            let [found, asked] = length;
            let expected =
                format!("a.toml:{place}: invalid length {found}, expected an array of length {asked}");
            assert_eq!(told(bad).unwrap_err(), expected, "{bad}");
        }
        assert!(told("shape = { both = [1, 2] }").is_ok());
        assert!(told("shape = { both = [1, 2, 3] }").is_err());
        assert!(told("any = [1, [2, 3, 4], { a = 1979-05-27 }]").is_ok());
    }

    #[test]
    fn an_array_is_no_table() {
        for bad in ["inner = [[1, 2]]", "shape = { box = [[1, 2, 3]] }"] {
            let text = told(bad).unwrap_err();
            assert!(text.starts_with("a.toml:2:"), "{bad}: {text}");
        }
        assert_eq!(
            told("inner = [[1, 2]]").unwrap_err(),
            "a.toml:2:9: invalid type: sequence, expected a table"
        );
    }
}
