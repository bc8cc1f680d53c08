//! Which properties belong together, and what they are.

use super::header::{Element, Kind, Type};
use crate::math::srgb_decode;

/// Numbers of each vertex or face beside those that a mesh has, as other renderers name them.
#[derive(Clone, Debug, PartialEq)]
pub struct PlyAttribute {
    /// `vertex_NAME` or `face_NAME`, NAME being what is before the last `_` of the properties `NAME_0`, `NAME_x` or `NAME_r`
    /// and so on. Properties `r` or `red` and so on are named `color`, those of alpha left out.
    pub name: String,
    /// Numbers of a vertex or face, 1 to 4.
    pub channels: usize,
    /// The numbers of the first one, those of the second one, and so on; faces of less than three corners do not count. Whole numbers of colours are decoded as sRGB; all
    /// others are as they are in the file.
    pub values: Vec<f32>,
}

/// An attribute that is being read.
pub(super) struct Group {
    /// Columns of its numbers.
    columns: Vec<usize>,
    /// What white is, if the numbers are not linear.
    encoded: Option<f32>,
    pub(super) attribute: PlyAttribute,
}

impl Group {
    pub(super) fn has_column(&self, column: usize) -> bool {
        self.columns.contains(&column)
    }

    /// Makes room for so many rows.
    pub(super) fn reserve(&mut self, rows: usize) {
        self.attribute.values.reserve_exact(rows * self.attribute.channels);
    }

    /// Adds the numbers of a row.
    #[inline]
    pub(super) fn push(&mut self, row: &[f64]) {
        let Group {
            columns,
            encoded,
            attribute,
        } = self;
        attribute.values.extend(columns.iter().map(|&column| {
            let value = row[column] as f32;
            match encoded {
                Some(white) => srgb_decode((value / *white).clamp(0.0, 1.0)),
                None => value,
            }
        }));
    }
}

/// Names of the three numbers of a colour.
const COLORS: [[&str; 3]; 3] = [
    ["r", "g", "b"],
    ["red", "green", "blue"],
    ["diffuse_red", "diffuse_green", "diffuse_blue"],
];

/// What the numbers of an attribute end with.
const ENDINGS: [[&str; 4]; 4] = [
    ["0", "1", "2", "3"],
    ["1", "2", "3", "4"],
    ["x", "y", "z", "w"],
    ["r", "g", "b", "a"],
];

/// The attributes of an element, whose kind is "vertex" or "face".
pub(super) fn of(element: &Element, kind: &str) -> Vec<Group> {
    let mut groups: Vec<Group> = Vec::new();
    let color = COLORS.iter().find_map(|names| {
        let [r, g, b] = names.map(|name| element.number(name));
        Some((vec![r?, g?, b?], names))
    });
    let mut taken = Vec::new();
    if let Some((columns, names)) = color {
        taken.extend(names.map(str::to_owned));
        groups.push(group(element, kind, "color", columns));
    }
    let mut at = 0;
    while let Some(property) = element.properties.get(at) {
        let is_taken = taken.contains(&property.name);
        match property.name.rsplit_once('_').filter(|_| !is_taken) {
            Some((prefix, _)) => {
                let columns = columns_of(element, at, prefix);
                at += columns.len().max(1);
                if !columns.is_empty() {
                    groups.push(group(element, kind, prefix, columns));
                }
            }
            None => at += 1,
        }
    }
    groups
}

/// Columns from `at` on whose names are `prefix` and consecutive endings.
fn columns_of(element: &Element, at: usize, prefix: &str) -> Vec<usize> {
    let is_next = |column: usize, ending: &str| {
        let name = element.properties[column].name.strip_prefix(prefix);
        name.and_then(|rest| rest.strip_prefix('_')) == Some(ending)
            && matches!(element.properties[column].kind, Kind::Number(_))
    };
    let columns_with = |endings: &[&str; 4]| -> Vec<usize> {
        let columns = (at..element.properties.len()).zip(endings);
        columns
            .take_while(|(c, ending)| is_next(*c, ending))
            .map(|(c, _)| c)
            .collect()
    };
    let all = ENDINGS.iter().map(columns_with);
    all.max_by_key(Vec::len).unwrap_or_default()
}

fn group(element: &Element, kind: &str, name: &str, columns: Vec<usize>) -> Group {
    let white = match element.properties[columns[0]].kind {
        Kind::Number(kind) if name == "color" && kind.is_whole() => Some(match kind {
            Type::U16 => 65535.0,
            // Nobody means more than eight bits by the wider types.
            _ => 255.0,
        }),
        _ => None,
    };
    Group {
        attribute: PlyAttribute {
            name: format!("{kind}_{name}"),
            channels: columns.len(),
            values: Vec::new(),
        },
        columns,
        encoded: white,
    }
}
