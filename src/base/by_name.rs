//! Entries of the program's lists, such as elements and models, which are known by their names.

/// Makes entries with a `name` equal where their names are, and writes them as these; `find` reads them again.
macro_rules! by_name {
    ($entry:ty, $find:path) => {
        impl PartialEq for $entry {
            fn eq(&self, other: &$entry) -> bool {
                self.name == other.name
            }
        }

        impl Eq for $entry {}

        impl serde::Serialize for $entry {
            fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
                serializer.serialize_str(self.name)
            }
        }

        impl<'de> serde::Deserialize<'de> for &'static $entry {
            fn deserialize<D: serde::Deserializer<'de>>(
                deserializer: D,
            ) -> Result<&'static $entry, D::Error> {
                let name = <String as serde::Deserialize>::deserialize(deserializer)?;
                $find(&name).map_err(<D::Error as serde::de::Error>::custom)
            }
        }
    };
}

pub(crate) use by_name;
