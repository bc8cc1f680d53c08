//! TOML as people write it: a section for each table of the schema, and everything in it on the line of its key.

use crate::math::{DVec3, Rgb};
use crate::scene::value::decimal;
use std::fmt::{self, Write as _};

/// A value.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Item {
    Text(String),
    Number(f64),
    Count(u32),
    Flag(bool),
    List(Vec<Item>),
    Table(Keys),
}

/// The keys of a table, in the order in which they are written.
pub(super) type Keys = Vec<(&'static str, Item)>;

impl From<&str> for Item {
    fn from(text: &str) -> Item {
        Item::Text(text.to_owned())
    }
}

impl From<f64> for Item {
    fn from(number: f64) -> Item {
        Item::Number(number)
    }
}

impl From<f32> for Item {
    fn from(number: f32) -> Item {
        Item::Number(decimal(number))
    }
}

impl From<bool> for Item {
    fn from(flag: bool) -> Item {
        Item::Flag(flag)
    }
}

impl<T: Into<Item>, const N: usize> From<[T; N]> for Item {
    fn from(list: [T; N]) -> Item {
        Item::List(list.into_iter().map(Into::into).collect())
    }
}

impl From<Rgb> for Item {
    fn from(rgb: Rgb) -> Item {
        rgb.to_array().into()
    }
}

impl From<DVec3> for Item {
    fn from(vector: DVec3) -> Item {
        vector.to_array().into()
    }
}

impl fmt::Display for Item {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Item::Text(text) => quoted(text, f),
            // The fewest digits that are read as the same number.
            Item::Number(number) => write!(f, "{number:?}"),
            Item::Count(count) => write!(f, "{count}"),
            Item::Flag(flag) => write!(f, "{flag}"),
            Item::List(items) => {
                f.write_char('[')?;
                for (i, item) in items.iter().enumerate() {
                    write!(f, "{}{item}", if i == 0 { "" } else { ", " })?;
                }
                f.write_char(']')
            }
            Item::Table(keys) => {
                f.write_char('{')?;
                for (i, (key, item)) in keys.iter().enumerate() {
                    write!(f, "{} {key} = {item}", if i == 0 { "" } else { "," })?;
                }
                f.write_str(" }")
            }
        }
    }
}

fn quoted(text: &str, f: &mut fmt::Formatter<'_>) -> fmt::Result {
    f.write_char('"')?;
    for c in text.chars() {
        match c {
            '"' | '\\' => write!(f, "\\{c}")?,
            c if c.is_control() => write!(f, "\\u{:04X}", u32::from(c))?,
            c => f.write_char(c)?,
        }
    }
    f.write_char('"')
}

/// A name as a part of a header.
pub(super) fn key(name: &str) -> String {
    let is_bare = !name.is_empty()
        && name
            .bytes()
            .all(|b| b.is_ascii_alphanumeric() || b == b'_' || b == b'-');
    if is_bare {
        name.to_owned()
    } else {
        Item::from(name).to_string()
    }
}

/// Adds a header, unless it is empty, and keys.
pub(super) fn section(text: &mut String, header: &str, keys: &Keys) {
    if !text.is_empty() {
        text.push('\n');
    }
    if !header.is_empty() {
        text.push_str(header);
        text.push('\n');
    }
    for (key, item) in keys {
        // Writing to a string cannot fail.
        let _ = writeln!(text, "{key} = {item}");
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_written_is_read_as_the_same() {
        let numbers = [0.1f64, -0.0, 1e300, 5e-324, 1.0 / 3.0, 1e16, 123_456_789.0];
        let floats = [0.1f32, f32::MAX, f32::MIN_POSITIVE, 1e-45, 16_777_217.0, 0.33333334];
        let texts = [
            "plain",
            "",
            "a \"b\" \\ c",
            "tab\tline\nnull\0bell\u{7}del\u{7f}",
            "ä [x] #",
            "\u{85}\u{2028}",
        ];
        let mut text = String::new();
        let keys = vec![
            ("numbers", Item::from(numbers)),
            ("floats", Item::from(floats)),
            (
                "table",
                Item::Table(vec![("empty", Item::List(Vec::new())), ("yes", true.into())]),
            ),
        ];
        section(&mut text, "", &keys);
        for name in texts {
            section(
                &mut text,
                &format!("[names.{}]", key(name)),
                &vec![("name", name.into())],
            );
        }
        let value: serde_json::Value = toml::from_str(&text).unwrap();
        for (i, number) in numbers.iter().enumerate() {
            assert_eq!(value["numbers"][i].as_f64().unwrap().to_bits(), number.to_bits());
        }
        for (i, number) in floats.iter().enumerate() {
            assert_eq!(
                (value["floats"][i].as_f64().unwrap() as f32).to_bits(),
                number.to_bits()
            );
        }
        assert_eq!(value["table"]["yes"], true);
        for name in texts {
            assert_eq!(value["names"][name]["name"], name);
        }
        assert!(text.contains("floats = [0.1, "), "{text}");
    }
}
