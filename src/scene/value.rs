//! Reading keys out of a parsed scene file, with errors that name the key and the nearest known one.

use crate::math::DVec3;
use serde::de::{self, Deserialize, Deserializer, MapAccess, SeqAccess, Visitor};
use serde_json::{Map, Value};
use std::cell::RefCell;
use std::fmt;

/// A problem at a key of a scene file.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct KeyError {
    /// Dotted path, for example `materials.gold.eta`.
    pub(super) key: String,
    /// What is wrong and what to write instead.
    pub(super) problem: String,
}

type Result<T> = std::result::Result<T, KeyError>;

/// A table of a scene file. Every key asked for counts as known; [`Table::finish`] rejects the others.
pub(super) struct Table<'a> {
    path: String,
    map: &'a Map<String, Value>,
    known: RefCell<Vec<&'static str>>,
}

/// A value and where it stands.
pub(super) struct Field<'a> {
    path: String,
    value: &'a Value,
}

/// A document in which no table has a key twice. TOML forbids that; of JSON's, `serde_json` would silently keep the last.
pub(super) struct Document(pub(super) Value);

impl<'de> Deserialize<'de> for Document {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> std::result::Result<Document, D::Error> {
        deserializer.deserialize_any(DocumentVisitor).map(Document)
    }
}

struct DocumentVisitor;

impl<'de> Visitor<'de> for DocumentVisitor {
    type Value = Value;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a value")
    }

    fn visit_unit<E>(self) -> std::result::Result<Value, E> {
        Ok(Value::Null)
    }

    fn visit_bool<E>(self, value: bool) -> std::result::Result<Value, E> {
        Ok(value.into())
    }

    fn visit_i64<E>(self, value: i64) -> std::result::Result<Value, E> {
        Ok(value.into())
    }

    fn visit_u64<E>(self, value: u64) -> std::result::Result<Value, E> {
        Ok(value.into())
    }

    fn visit_f64<E>(self, value: f64) -> std::result::Result<Value, E> {
        Ok(value.into())
    }

    fn visit_str<E>(self, value: &str) -> std::result::Result<Value, E> {
        Ok(value.into())
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut values: A) -> std::result::Result<Value, A::Error> {
        let mut array = Vec::new();
        while let Some(Document(value)) = values.next_element()? {
            array.push(value);
        }
        Ok(Value::Array(array))
    }

    fn visit_map<A: MapAccess<'de>>(self, mut entries: A) -> std::result::Result<Value, A::Error> {
        let mut map = Map::new();
        while let Some((key, Document(value))) = entries.next_entry::<String, Document>()? {
            if map.contains_key(&key) {
                return Err(de::Error::custom(format_args!(
                    "the key \"{key}\" stands twice in a table"
                )));
            }
            map.insert(key, value);
        }
        Ok(Value::Object(map))
    }
}

fn kind(value: &Value) -> &'static str {
    match value {
        Value::Null => "a number that is not finite, or null",
        Value::Bool(_) => "a boolean",
        Value::Number(_) => "a number",
        Value::String(_) => "a string",
        Value::Array(_) => "an array",
        Value::Object(_) => "a table",
    }
}

impl<'a> Table<'a> {
    /// The top of a file.
    pub(super) fn root(value: &'a Value) -> Result<Table<'a>> {
        Field {
            path: String::new(),
            value,
        }
        .table()
    }

    /// The field under `key`, if it is there.
    pub(super) fn get(&self, key: &'static str) -> Option<Field<'a>> {
        self.known.borrow_mut().push(key);
        self.map.get(key).map(|value| Field {
            path: self.path_of(key),
            value,
        })
    }

    /// The field under `key`.
    pub(super) fn require(&self, key: &'static str) -> Result<Field<'a>> {
        self.get(key).ok_or_else(|| self.missing(key))
    }

    /// The error of a key that is not there.
    pub(super) fn missing(&self, key: &str) -> KeyError {
        KeyError {
            key: self.path_of(key),
            problem: "is missing".into(),
        }
    }

    /// All entries by name, for tables whose keys are the user's choice.
    pub(super) fn entries(&self) -> impl Iterator<Item = (&'a str, Field<'a>)> + '_ {
        self.map.iter().map(|(key, value)| {
            (
                key.as_str(),
                Field {
                    path: self.path_of(key),
                    value,
                },
            )
        })
    }

    /// Rejects keys that nobody asked for.
    pub(super) fn finish(&self) -> Result<()> {
        let known = self.known.borrow();
        let Some(unknown) = self.map.keys().find(|key| !known.contains(&key.as_str())) else {
            return Ok(());
        };
        let problem = match nearest(unknown, known.iter().copied()) {
            Some(near) => format!("is not a known key; did you mean `{near}`?"),
            None => format!("is not a known key; known here: {}", known.join(", ")),
        };
        Err(KeyError {
            key: self.path_of(unknown),
            problem,
        })
    }

    fn path_of(&self, key: &str) -> String {
        if self.path.is_empty() {
            key.to_owned()
        } else {
            format!("{}.{key}", self.path)
        }
    }
}

impl<'a> Field<'a> {
    /// An error at this field.
    pub(super) fn error(&self, problem: impl Into<String>) -> KeyError {
        KeyError {
            key: self.path.clone(),
            problem: problem.into(),
        }
    }

    /// An error about the type.
    pub(super) fn expected(&self, what: &str) -> KeyError {
        self.error(format!("expected {what}, found {}", kind(self.value)))
    }

    pub(super) fn is_number(&self) -> bool {
        self.value.is_number()
    }

    pub(super) fn is_array(&self) -> bool {
        self.value.is_array()
    }

    /// Yes or no.
    pub(super) fn flag(&self) -> Result<bool> {
        self.value.as_bool().ok_or_else(|| self.expected("true or false"))
    }

    pub(super) fn table(&self) -> Result<Table<'a>> {
        match self.value {
            Value::Object(map) => Ok(Table {
                path: self.path.clone(),
                map,
                known: RefCell::default(),
            }),
            _ => Err(self.expected("a table")),
        }
    }

    pub(super) fn array(&self) -> Result<Vec<Field<'a>>> {
        match self.value {
            Value::Array(values) => Ok(values
                .iter()
                .enumerate()
                .map(|(i, value)| Field {
                    path: format!("{}[{i}]", self.path),
                    value,
                })
                .collect()),
            _ => Err(self.expected("an array")),
        }
    }

    pub(super) fn string(&self) -> Result<&'a str> {
        self.value.as_str().ok_or_else(|| self.expected("a string"))
    }

    /// One of a few words.
    pub(super) fn word<T: Copy>(&self, words: &[(&'static str, T)]) -> Result<T> {
        let given = self.string()?;
        if let Some((_, value)) = words.iter().find(|(word, _)| *word == given) {
            return Ok(*value);
        }
        let hint = match nearest(given, words.iter().map(|(word, _)| *word)) {
            Some(near) => format!("; did you mean \"{near}\"?"),
            None => String::new(),
        };
        let all: Vec<String> = words.iter().map(|(word, _)| format!("\"{word}\"")).collect();
        Err(self.error(format!("\"{given}\" is not one of {}{hint}", all.join(", "))))
    }

    /// A finite number.
    pub(super) fn number(&self) -> Result<f64> {
        self.value
            .as_f64()
            .filter(|v| v.is_finite())
            .ok_or_else(|| self.expected("a number"))
    }

    /// A number within a closed range.
    pub(super) fn number_in(&self, low: f64, high: f64) -> Result<f64> {
        let number = self.number()?;
        if (low..=high).contains(&number) {
            return Ok(number);
        }
        Err(self.error(format!(
            "{} is not within {} to {}",
            short(number),
            short(low),
            short(high)
        )))
    }

    /// A whole number, 0 or more.
    pub(super) fn count(&self) -> Result<u32> {
        let count = self
            .value
            .as_u64()
            .ok_or_else(|| self.expected("a whole number of 0 or more"))?;
        u32::try_from(count).map_err(|_| self.error(format!("{count} is above {}", u32::MAX)))
    }

    /// `N` numbers.
    pub(super) fn numbers<const N: usize>(&self) -> Result<[f64; N]> {
        let fields = self
            .array()
            .map_err(|_| self.expected(&format!("an array of {N} numbers")))?;
        let count = fields.len();
        let fields: [Field<'a>; N] = fields.try_into().map_err(|_| {
            self.error(format!(
                "expected an array of {N} numbers, found one of {count} elements"
            ))
        })?;
        let mut numbers = [0.0; N];
        for (number, field) in numbers.iter_mut().zip(&fields) {
            *number = field.number()?;
        }
        Ok(numbers)
    }

    /// A point or direction, no coordinate of which exceeds `limit` in size.
    pub(super) fn vector(&self, limit: f64) -> Result<DVec3> {
        for coordinate in self.array().unwrap_or_default() {
            coordinate.number_in(-limit, limit)?;
        }
        self.numbers::<3>().map(DVec3::from)
    }

    /// Three numbers within a closed range.
    pub(super) fn rgb_in(&self, low: f64, high: f64) -> Result<crate::math::Rgb> {
        for channel in self.array().unwrap_or_default() {
            channel.number_in(low, high)?;
        }
        self.numbers::<3>().map(crate::math::Rgb::from)
    }
}

/// The f64 that is written with the fewest digits among those that become `value` when they are rounded to f32.
pub(super) fn decimal(value: f32) -> f64 {
    // The shortest digits of an f32 are read as an f64 first, and rounding twice may end at another f32.
    let short = value.to_string().parse().unwrap_or(f64::from(value));
    if short as f32 == value { short } else { value.into() }
}

/// A number for people, who do not count zeros.
fn short(number: f64) -> String {
    if number == 0.0 || (1e-6..1e16).contains(&number.abs()) {
        number.to_string()
    } else {
        format!("{number:e}")
    }
}

/// The candidate that a typing error most likely meant, if one is near.
pub(crate) fn nearest<'a>(given: &str, candidates: impl Iterator<Item = &'a str>) -> Option<&'a str> {
    candidates
        .map(|candidate| (strsim::jaro_winkler(given, candidate), candidate))
        .filter(|(similarity, _)| *similarity > 0.75)
        .max_by(|a, b| a.0.total_cmp(&b.0))
        .map(|(_, candidate)| candidate)
}
