//! Finds the first number of any serialisable value that is not finite.
//!
//! JSON has no NaN: `serde_json` writes `null` for it, which would read as "missing". This serialiser
//! writes nothing; it walks the value and stops at the first NaN or infinity with its path.

use std::fmt::{self, Display};

use serde::ser::{self, Serialize};

use crate::error::ReportError;

/// Refuses a value that holds a NaN or an infinity, naming `section` and the path.
///
/// # Errors
/// [`ReportError::NotFinite`] for the first such number, [`ReportError::Serialise`] if the value's own
/// `Serialize` fails.
pub fn check_finite<T: Serialize + ?Sized>(section: &str, value: &T) -> Result<(), ReportError> {
    value.serialize(&mut Walk::default()).map_err(|stop| match stop {
        Stop::NotFinite { path, value } => ReportError::NotFinite { section: section.to_owned(), path, value },
        Stop::Other(what) => ReportError::Serialise { section: section.to_owned(), what },
    })
}

/// Where the walk stands: one step for each level of nesting.
#[derive(Default)]
struct Walk {
    path: Vec<Step>,
}

/// One step of the path.
enum Step {
    Name(String),
    Index(usize),
}

/// Why the walk ended early.
#[derive(Debug)]
enum Stop {
    NotFinite { path: String, value: String },
    Other(String),
}

impl Display for Stop {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NotFinite { path, value } => write!(f, "{path} is {value}"),
            Self::Other(what) => f.write_str(what),
        }
    }
}

impl std::error::Error for Stop {}

impl ser::Error for Stop {
    fn custom<T: Display>(message: T) -> Self {
        Self::Other(message.to_string())
    }
}

impl Walk {
    fn path_text(&self) -> String {
        let mut text = String::new();
        for step in &self.path {
            match step {
                Step::Name(name) if text.is_empty() => text.push_str(name),
                Step::Name(name) => {
                    text.push('.');
                    text.push_str(name);
                }
                Step::Index(index) => text.push_str(&format!("[{index}]")),
            }
        }
        if text.is_empty() { "the value".to_owned() } else { text }
    }

    fn step<T: Serialize + ?Sized>(&mut self, step: Step, value: &T) -> Result<(), Stop> {
        self.path.push(step);
        value.serialize(&mut *self)?;
        self.path.pop();
        Ok(())
    }

    fn named<T: Serialize + ?Sized>(&mut self, name: &str, value: &T) -> Result<(), Stop> {
        self.step(Step::Name(name.to_owned()), value)
    }
}

/// The open compound: counts elements of sequences, remembers the key of maps.
struct Compound<'a> {
    walk: &'a mut Walk,
    index: usize,
    key: String,
}

impl<'a> Compound<'a> {
    fn open(walk: &'a mut Walk) -> Result<Self, Stop> {
        Ok(Self { walk, index: 0, key: String::new() })
    }

    fn element<T: Serialize + ?Sized>(&mut self, value: &T) -> Result<(), Stop> {
        let index = self.index;
        self.index += 1;
        self.walk.step(Step::Index(index), value)
    }
}

macro_rules! no_float {
    ($($method:ident: $kind:ty),* $(,)?) => {
        $(fn $method(self, _: $kind) -> Result<(), Stop> { Ok(()) })*
    };
}

impl<'a> ser::Serializer for &'a mut Walk {
    type Ok = ();
    type Error = Stop;
    type SerializeSeq = Compound<'a>;
    type SerializeTuple = Compound<'a>;
    type SerializeTupleStruct = Compound<'a>;
    type SerializeTupleVariant = Compound<'a>;
    type SerializeMap = Compound<'a>;
    type SerializeStruct = Compound<'a>;
    type SerializeStructVariant = Compound<'a>;

    no_float!(
        serialize_bool: bool, serialize_i8: i8, serialize_i16: i16, serialize_i32: i32, serialize_i64: i64,
        serialize_i128: i128, serialize_u8: u8, serialize_u16: u16, serialize_u32: u32, serialize_u64: u64,
        serialize_u128: u128, serialize_char: char, serialize_str: &str, serialize_bytes: &[u8],
        serialize_unit_struct: &'static str,
    );

    fn serialize_f32(self, value: f32) -> Result<(), Stop> {
        self.serialize_f64(f64::from(value))
    }

    fn serialize_f64(self, value: f64) -> Result<(), Stop> {
        if value.is_finite() {
            return Ok(());
        }
        Err(Stop::NotFinite { path: self.path_text(), value: value.to_string() })
    }

    fn serialize_none(self) -> Result<(), Stop> {
        Ok(())
    }

    fn serialize_some<T: Serialize + ?Sized>(self, value: &T) -> Result<(), Stop> {
        value.serialize(self)
    }

    fn serialize_unit(self) -> Result<(), Stop> {
        Ok(())
    }

    fn serialize_unit_variant(self, _: &'static str, _: u32, _: &'static str) -> Result<(), Stop> {
        Ok(())
    }

    fn serialize_newtype_struct<T: Serialize + ?Sized>(self, _: &'static str, value: &T) -> Result<(), Stop> {
        value.serialize(self)
    }

    fn serialize_newtype_variant<T: Serialize + ?Sized>(
        self,
        _: &'static str,
        _: u32,
        _: &'static str,
        value: &T,
    ) -> Result<(), Stop> {
        value.serialize(self)
    }

    fn serialize_seq(self, _: Option<usize>) -> Result<Compound<'a>, Stop> {
        Compound::open(self)
    }

    fn serialize_tuple(self, _: usize) -> Result<Compound<'a>, Stop> {
        Compound::open(self)
    }

    fn serialize_tuple_struct(self, _: &'static str, _: usize) -> Result<Compound<'a>, Stop> {
        Compound::open(self)
    }

    fn serialize_tuple_variant(self, _: &'static str, _: u32, _: &'static str, _: usize) -> Result<Compound<'a>, Stop> {
        Compound::open(self)
    }

    fn serialize_map(self, _: Option<usize>) -> Result<Compound<'a>, Stop> {
        Compound::open(self)
    }

    fn serialize_struct(self, _: &'static str, _: usize) -> Result<Compound<'a>, Stop> {
        Compound::open(self)
    }

    fn serialize_struct_variant(
        self,
        _: &'static str,
        _: u32,
        _: &'static str,
        _: usize,
    ) -> Result<Compound<'a>, Stop> {
        Compound::open(self)
    }
}

macro_rules! sequence {
    ($($kind:ident :: $method:ident),* $(,)?) => {$(
        impl ser::$kind for Compound<'_> {
            type Ok = ();
            type Error = Stop;
            fn $method<T: Serialize + ?Sized>(&mut self, value: &T) -> Result<(), Stop> {
                self.element(value)
            }
            fn end(self) -> Result<(), Stop> {
                Ok(())
            }
        }
    )*};
}

sequence!(
    SerializeSeq::serialize_element,
    SerializeTuple::serialize_element,
    SerializeTupleStruct::serialize_field,
    SerializeTupleVariant::serialize_field,
);

macro_rules! record {
    ($($kind:ident),*) => {$(
        impl ser::$kind for Compound<'_> {
            type Ok = ();
            type Error = Stop;
            fn serialize_field<T: Serialize + ?Sized>(&mut self, name: &'static str, value: &T) -> Result<(), Stop> {
                self.walk.named(name, value)
            }
            fn end(self) -> Result<(), Stop> {
                Ok(())
            }
        }
    )*};
}

record!(SerializeStruct, SerializeStructVariant);

impl ser::SerializeMap for Compound<'_> {
    type Ok = ();
    type Error = Stop;

    fn serialize_key<T: Serialize + ?Sized>(&mut self, key: &T) -> Result<(), Stop> {
        // JSON keys are text, numbers or unit variants: their JSON text is the name in the path.
        let text = serde_json::to_string(key).map_err(ser::Error::custom)?;
        self.key = text.trim_matches('"').to_owned();
        Ok(())
    }

    fn serialize_value<T: Serialize + ?Sized>(&mut self, value: &T) -> Result<(), Stop> {
        let key = std::mem::take(&mut self.key);
        self.walk.named(&key, value)
    }

    fn end(self) -> Result<(), Stop> {
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use super::*;

    #[test]
    fn path_of_a_nested_nan_is_named() {
        let value = BTreeMap::from([("curve", vec![(1.0, Some(2.0)), (3.0, Some(f64::NAN))])]);
        let message = check_finite("S", &value).unwrap_err().to_string();
        assert!(message.contains("section 'S': curve[1][1] is NaN"), "{message}");
    }

    #[test]
    fn missing_and_finite_pass() {
        check_finite("S", &(1.0, None::<f64>, "text", f64::MAX)).unwrap();
        assert!(check_finite("S", &f32::NEG_INFINITY).is_err());
    }
}
