//! Vertices and faces as they are read.

use super::PlyError;
use super::attributes::{self, PlyAttribute};
use super::header::{Element, Header, Kind, Type};
use super::rows::{Fault, Rows};
use crate::math::{DVec3, Vec2};
use crate::mesh::{Polygon, TriangleMesh};
use std::path::Path;

/// Names of the two texture coordinates.
const UVS: [[&str; 2]; 3] = [["u", "v"], ["s", "t"], ["texture_u", "texture_v"]];

/// Names of the list of a face's corners.
const CORNERS: [&str; 2] = ["vertex_indices", "vertex_index"];

/// What has been read of a file.
#[derive(Default)]
pub(super) struct Content {
    pub(super) mesh: TriangleMesh<DVec3>,
    /// The faces of more than three corners.
    pub(super) polygons: Vec<Polygon>,
    pub(super) attributes: Vec<PlyAttribute>,
    /// Points and lines.
    pub(super) small_faces: u64,
    /// Names of elements and lists that are not read, and how often they occur.
    pub(super) unread: Vec<(String, u64)>,
    /// Bytes after the last row that say something.
    pub(super) trailing: u64,
}

/// Reads all elements. `rows` is at the first row.
pub(super) fn read(path: &Path, header: &Header, mut rows: impl Rows) -> Result<Content, PlyError> {
    let mut content = Content::default();
    for element in &header.elements {
        let available = rows.rest().len();
        // The last number of a text needs nothing behind it.
        if element.least_bytes(header.format) > available as u128 + 1 {
            return Err(PlyError::Count {
                path: path.to_owned(),
                element: element.name.clone(),
                count: element.count,
                available,
            });
        }
        let result = match element.name.as_str() {
            "vertex" if content.mesh.positions.is_empty() => content.vertices(element, &mut rows),
            "face" if content.mesh.indices.is_empty() => content.faces(element, &mut rows),
            _ => content.skip(element, &mut rows),
        };
        result.map_err(|(row, problem)| PlyError::Row {
            path: path.to_owned(),
            place: rows.place(),
            element: element.name.clone(),
            row,
            problem,
        })?;
    }
    content.trailing = rows.rest().trim_ascii().len() as u64;
    Ok(content)
}

/// Rows of an element: one after the other, their numbers, and those of one list.
fn for_each_row<R: Rows>(
    element: &Element,
    rows: &mut R,
    list: Option<usize>,
    mut row: impl FnMut(&[f64], &[u32]) -> Result<(), Fault>,
) -> Result<(), (u64, Fault)> {
    let mut numbers = vec![0.0; element.properties.len()];
    let mut items = Vec::new();
    for index in 0..element.count {
        let mut read = || {
            rows.begin()?;
            for (column, property) in element.properties.iter().enumerate() {
                match property.kind {
                    Kind::Number(kind) => numbers[column] = rows.number(kind)?,
                    Kind::List { count, item } => {
                        let length = list_length(rows, count, item)?;
                        if list == Some(column) {
                            items.clear();
                            for _ in 0..length {
                                items.push(corner(rows.number(item)?)?);
                            }
                        } else {
                            rows.skip(item, length)?;
                        }
                    }
                }
            }
            rows.end()?;
            row(&numbers, &items)
        };
        read().map_err(|fault| (index, fault))?;
    }
    Ok(())
}

#[inline(always)]
fn list_length<R: Rows>(rows: &mut R, count: Type, item: Type) -> Result<usize, Fault> {
    let length = rows.number(count)?;
    let most = rows.most(item);
    if length >= 0.0 && length <= most as f64 && length.fract() == 0.0 {
        Ok(length as usize)
    } else {
        Err(format!("a list of {length} numbers, where {most} would fit at most"))
    }
}

#[inline(always)]
fn corner(index: f64) -> Result<u32, Fault> {
    // Also false for NaN.
    if index >= 0.0 && index <= f64::from(u32::MAX) && index.fract() == 0.0 {
        Ok(index as u32)
    } else {
        Err(format!("the face uses vertex {index}"))
    }
}

impl Content {
    fn vertices<R: Rows>(&mut self, element: &Element, rows: &mut R) -> Result<(), (u64, Fault)> {
        let columns =
            |names: &[&str]| -> Option<Vec<usize>> { names.iter().map(|name| element.number(name)).collect() };
        let Some(&[x, y, z]) = columns(&["x", "y", "z"]).as_deref() else {
            return Err((0, "vertices without the numbers `x`, `y` and `z`".into()));
        };
        if element.count > u64::from(u32::MAX) {
            return Err((0, "more than 2^32 - 1 vertices; split the file".into()));
        }
        let count = element.count as usize;
        let mesh = &mut self.mesh;
        mesh.positions.reserve_exact(count);
        let normal = columns(&["nx", "ny", "nz"]);
        if normal.is_some() {
            mesh.normals.reserve_exact(count);
        }
        let uv = UVS.iter().find_map(|names| columns(names));
        if uv.is_some() {
            mesh.uvs.reserve_exact(count);
        }
        let mut groups = attributes::of(element, "vertex");
        // Texture coordinates are no attribute, although their names may look like it.
        groups.retain(|group| uv.as_ref().is_none_or(|uv| !group.has_column(uv[0])));
        for group in &mut groups {
            group.reserve(count);
        }
        for_each_row(element, rows, None, |row, _| {
            let position = DVec3::new(row[x], row[y], row[z]);
            if !position.as_vec3().is_finite() {
                return Err("expected a position of finite 32-bit numbers".into());
            }
            mesh.positions.push(position);
            if let Some(&[x, y, z]) = normal.as_deref() {
                mesh.normals.push(DVec3::new(row[x], row[y], row[z]).as_vec3());
            }
            if let Some(&[u, v]) = uv.as_deref() {
                mesh.uvs.push(Vec2::new(row[u] as f32, row[v] as f32));
            }
            groups.iter_mut().for_each(|group| group.push(row));
            Ok(())
        })?;
        self.attributes.extend(groups.into_iter().map(|group| group.attribute));
        Ok(())
    }

    fn faces<R: Rows>(&mut self, element: &Element, rows: &mut R) -> Result<(), (u64, Fault)> {
        let is_list = |column: &usize| matches!(element.properties[*column].kind, Kind::List { .. });
        let column = |name: &&str| element.column(name).filter(is_list);
        let Some(list) = CORNERS.iter().find_map(column) else {
            return Err((0, "faces without the list `vertex_indices`".into()));
        };
        for (column, property) in element.properties.iter().enumerate() {
            if is_list(&column) && column != list {
                self.unread
                    .push((format!("list `{}` of faces", property.name), element.count));
            }
        }
        let indices = &mut self.mesh.indices;
        indices.reserve(element.count as usize);
        let mut groups = attributes::of(element, "face");
        for group in &mut groups {
            group.reserve(element.count as usize);
        }
        for_each_row(element, rows, Some(list), |row, corners| {
            let [first, rest @ ..] = corners else {
                self.small_faces += 1;
                return Ok(());
            };
            let triangles = rest.len().saturating_sub(1);
            match triangles {
                0 => {
                    self.small_faces += 1;
                    return Ok(());
                }
                1 => {}
                _ => self.polygons.push(Polygon {
                    start: indices.len() as u32,
                    corners: corners.len() as u32,
                }),
            }
            indices.extend(rest.windows(2).map(|pair| [*first, pair[0], pair[1]]));
            if indices.len() > u32::MAX as usize {
                return Err("more than 2^32 - 1 triangles; split the file".into());
            }
            groups.iter_mut().for_each(|group| group.push(row));
            Ok(())
        })?;
        self.attributes.extend(groups.into_iter().map(|group| group.attribute));
        Ok(())
    }

    fn skip<R: Rows>(&mut self, element: &Element, rows: &mut R) -> Result<(), (u64, Fault)> {
        if element.count > 0 {
            self.unread.push((format!("element `{}`", element.name), element.count));
        }
        // Nothing stands for them, however many there are.
        if element.properties.is_empty() {
            return Ok(());
        }
        for_each_row(element, rows, None, |_, _| Ok(()))
    }
}
