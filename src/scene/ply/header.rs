//! The header of a PLY file: what follows it, in which order and form.

use super::PlyError;
use std::path::Path;

/// How numbers are written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Format {
    Ascii,
    LittleEndian,
    BigEndian,
}

/// The type of a number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Type {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    I64,
    U64,
    F32,
    F64,
}

impl Type {
    /// By any of its names; those of 64-bit whole numbers are not in the format's description, but in use.
    fn named(name: &str) -> Option<Type> {
        Some(match name {
            "char" | "int8" => Type::I8,
            "uchar" | "uint8" => Type::U8,
            "short" | "int16" => Type::I16,
            "ushort" | "uint16" => Type::U16,
            "int" | "int32" => Type::I32,
            "uint" | "uint32" => Type::U32,
            "long" | "int64" => Type::I64,
            "ulong" | "uint64" => Type::U64,
            "float" | "float32" => Type::F32,
            "double" | "float64" => Type::F64,
            _ => return None,
        })
    }

    /// Bytes of a binary number.
    pub(super) fn size(self) -> usize {
        match self {
            Type::I8 | Type::U8 => 1,
            Type::I16 | Type::U16 => 2,
            Type::I32 | Type::U32 | Type::F32 => 4,
            Type::I64 | Type::U64 | Type::F64 => 8,
        }
    }

    pub(super) fn is_whole(self) -> bool {
        !matches!(self, Type::F32 | Type::F64)
    }
}

/// What a property holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    Number(Type),
    List { count: Type, item: Type },
}

#[derive(Clone, Debug, PartialEq)]
pub(super) struct Property {
    pub(super) name: String,
    pub(super) kind: Kind,
}

#[derive(Clone, Debug, PartialEq)]
pub(super) struct Element {
    pub(super) name: String,
    /// How many rows follow.
    pub(super) count: u64,
    pub(super) properties: Vec<Property>,
}

impl Element {
    /// The column of a property.
    pub(super) fn column(&self, name: &str) -> Option<usize> {
        self.properties.iter().position(|property| property.name == name)
    }

    /// The column of a number.
    pub(super) fn number(&self, name: &str) -> Option<usize> {
        self.column(name)
            .filter(|&column| matches!(self.properties[column].kind, Kind::Number(_)))
    }

    /// The least number of bytes that its rows have.
    pub(super) fn least_bytes(&self, format: Format) -> u128 {
        let of_property = |property: &Property| match (format, property.kind) {
            // A digit and what parts it from the next.
            (Format::Ascii, _) => 2,
            (_, Kind::Number(kind)) => kind.size(),
            (_, Kind::List { count, .. }) => count.size(),
        };
        let row: usize = self.properties.iter().map(of_property).sum();
        u128::from(self.count) * row as u128
    }
}

#[derive(Clone, Debug, PartialEq)]
pub(super) struct Header {
    pub(super) format: Format,
    pub(super) elements: Vec<Element>,
    /// Where the data begins.
    pub(super) bytes: usize,
    /// The line that it begins on, from 1.
    pub(super) line: u64,
    /// The last byte of a line.
    pub(super) line_end: u8,
}

/// Reads the header.
pub(super) fn read(path: &Path, bytes: &[u8]) -> Result<Header, PlyError> {
    let mut lines = Lines::new(bytes);
    let mut format = None;
    let mut elements: Vec<Element> = Vec::new();
    loop {
        let line = lines.next();
        let number = lines.number;
        let fail = |expected: &'static str| PlyError::Header {
            path: path.to_owned(),
            line: number,
            text: excerpt(line.unwrap_or_default()),
            expected,
        };
        let Some(line) = line else {
            return Err(fail("`end_header` before the end of the file"));
        };
        let text = std::str::from_utf8(line).unwrap_or("\u{fffd}").trim();
        if number == 1 {
            if text != "ply" {
                return Err(fail("`ply`, with which PLY files begin"));
            }
            continue;
        }
        let words: Vec<&str> = text.split_ascii_whitespace().collect();
        let kind = |name: &str| Type::named(name).ok_or_else(|| fail("a type such as `float`, `uchar` or `int`"));
        match *words.as_slice() {
            [] | ["comment" | "obj_info", ..] => {}
            ["format", name, _] if format.is_none() => {
                format = Some(match name {
                    "ascii" => Format::Ascii,
                    "binary_little_endian" => Format::LittleEndian,
                    "binary_big_endian" => Format::BigEndian,
                    _ => return Err(fail("`ascii`, `binary_little_endian` or `binary_big_endian`")),
                });
            }
            ["element", name, count] => elements.push(Element {
                name: name.to_owned(),
                count: count
                    .parse()
                    .map_err(|_| fail("`element NAME COUNT` with a whole number"))?,
                properties: Vec::new(),
            }),
            ["property", "list", count, item, name] => {
                let kind = Kind::List {
                    count: kind(count)?,
                    item: kind(item)?,
                };
                let element = elements.last_mut();
                element
                    .ok_or_else(|| fail("`element` before its properties"))?
                    .push(name, kind);
            }
            ["property", number, name] => {
                let kind = Kind::Number(kind(number)?);
                let element = elements.last_mut();
                element
                    .ok_or_else(|| fail("`element` before its properties"))?
                    .push(name, kind);
            }
            ["end_header"] => {
                return Ok(Header {
                    format: format.ok_or_else(|| fail("`format` before the end of the header"))?,
                    elements,
                    bytes: lines.at,
                    line: lines.number + 1,
                    line_end: if lines.end == b"\r" { b'\r' } else { b'\n' },
                });
            }
            _ => return Err(fail("`format`, `comment`, `element`, `property` or `end_header`")),
        }
    }
}

impl Element {
    fn push(&mut self, name: &str, kind: Kind) {
        let name = name.to_owned();
        self.properties.push(Property { name, kind });
    }
}

/// The beginning of a line, fit for a message.
pub(super) fn excerpt(line: &[u8]) -> String {
    let text = String::from_utf8_lossy(&line[..line.len().min(240)]);
    let mut shown: String = text.trim().chars().filter(|c| !c.is_control()).take(60).collect();
    if text.trim().chars().nth(60).is_some() {
        shown.push('…');
    }
    shown
}

/// Lines that all end as the first one does: what follows the header may be binary and begin with any byte.
struct Lines<'a> {
    bytes: &'a [u8],
    at: usize,
    number: u64,
    end: &'static [u8],
}

impl<'a> Lines<'a> {
    fn new(bytes: &'a [u8]) -> Lines<'a> {
        let first = bytes.iter().position(|b| matches!(b, b'\n' | b'\r'));
        let end: &[u8] = match first.map(|at| &bytes[at..]) {
            Some([b'\r', b'\n', ..]) => b"\r\n",
            Some([b'\r', ..]) => b"\r",
            _ => b"\n",
        };
        Lines {
            bytes,
            at: 0,
            number: 0,
            end,
        }
    }

    fn next(&mut self) -> Option<&'a [u8]> {
        self.number += 1;
        let rest = &self.bytes[self.at..];
        if rest.is_empty() {
            return None;
        }
        let length = memchr::memmem::find(rest, self.end).unwrap_or(rest.len());
        self.at = self.bytes.len().min(self.at + length + self.end.len());
        Some(&rest[..length])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn error_of(text: &str) -> String {
        read(Path::new("a.ply"), text.as_bytes()).unwrap_err().to_string()
    }

    #[test]
    fn any_line_end_is_one_and_data_begins_after_the_last() {
        for end in ["\n", "\r\n", "\r"] {
            let lines = [
                "ply",
                "format binary_big_endian 1.0",
                "comment made by hand",
                "obj_info num_cols 512",
                "element vertex 7",
                "property double x",
                "element face 2",
                "property list uint8 int32 vertex_indices",
                "end_header",
            ];
            let text = lines.map(|line| format!("{line}{end}")).concat() + "\n\r";
            let header = read(Path::new("a.ply"), text.as_bytes()).unwrap();
            assert_eq!(header.format, Format::BigEndian);
            assert_eq!((header.bytes, header.line), (text.len() - 2, 10));
            assert_eq!((header.elements[0].count, header.elements[1].count), (7, 2));
            assert_eq!(header.elements[0].properties[0].kind, Kind::Number(Type::F64));
            let list = Kind::List {
                count: Type::U8,
                item: Type::I32,
            };
            assert_eq!(header.elements[1].properties[0].kind, list);
        }
    }

    #[test]
    fn faults_are_told_by_line() {
        for (text, line, expected) in [
            ("", 1, "`end_header` before"),
            ("solid cube\n", 1, "PLY files begin"),
            ("ply\nformat ascii 1.0\n", 3, "`end_header` before"),
            ("ply\nformat utf8 1.0\n", 2, "binary_little_endian"),
            ("ply\nend_header\n", 2, "`format` before"),
            ("ply\nformat ascii 1.0\nproperty float x\n", 3, "`element` before"),
            ("ply\nformat ascii 1.0\nelement vertex -1\n", 3, "whole number"),
            (
                "ply\nformat ascii 1.0\nelement vertex 99999999999999999999\n",
                3,
                "whole number",
            ),
            (
                "ply\nformat ascii 1.0\nelement vertex 1\nproperty real x\n",
                4,
                "a type such as",
            ),
            (
                "ply\nformat ascii 1.0\nelement vertex 1\nproperty list uchar x\n",
                4,
                "`property`",
            ),
            ("ply\nformat ascii 1.0\nformat ascii 1.0\n", 3, "`property`"),
            ("ply\nv 0 0 0\n", 2, "`property`"),
        ] {
            let message = error_of(text);
            let place = format!("a.ply:{line}: ");
            assert!(
                message.starts_with(&place) && message.contains(expected),
                "{text}: {message}"
            );
        }
    }
}
