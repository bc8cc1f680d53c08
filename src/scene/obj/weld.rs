//! From the pieces of a file to meshes, in which one index serves position, normal and texture coordinate alike.

use super::piece::{Ignored, NO_COLOR, Piece};
use crate::math::{DVec3, Rgb, Vec2, Vec3};
use crate::mesh::TriangleMesh;
use rayon::prelude::*;
use std::collections::HashMap;
use std::mem::take;
use std::sync::atomic::{AtomicBool, Ordering};

/// What distinguishes the parts of a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
struct PartKey {
    /// Index into [`Content::names`].
    material: Option<usize>,
    /// Every corner has texture coordinates.
    uvs: bool,
    /// Every corner has a normal.
    normals: bool,
}

/// Some triangles of a part: those of a run in a piece.
struct PartRun {
    piece: usize,
    /// Where the run begins in [`Piece::corners`].
    start: [usize; 3],
    triangles: usize,
}

struct Part {
    key: PartKey,
    runs: Vec<PartRun>,
}

/// What has been read of a file.
#[derive(Default)]
pub(super) struct Content {
    positions: Vec<DVec3>,
    /// Of the first positions; [`NO_COLOR`] where there is none.
    colors: Vec<Rgb>,
    uvs: Vec<Vec2>,
    normals: Vec<Vec3>,
    /// Of each piece.
    corners: Vec<[Vec<[u32; 3]>; 3]>,
    /// In order of first use.
    parts: Vec<Part>,
    part_index: HashMap<PartKey, usize>,
    /// The materials in use, in order of appearance.
    pub(super) names: Vec<String>,
    name_index: HashMap<String, usize>,
    /// The material at the end of the text so far.
    material: Option<usize>,
    pub(super) ignored: Ignored,
}

/// No vertex.
const NONE: u32 = u32::MAX;

/// A vertex of a mesh being made.
struct Vertex {
    /// Indices of position, texture coordinate and normal.
    corner: [u32; 3],
    /// Another vertex at the same position.
    next: u32,
}

/// So many vertices at one position are looked through for one that has the same attributes; then there is one more.
const MAX_SEARCH: usize = 32;

impl Content {
    /// Appends the next pieces of the file.
    pub(super) fn extend(&mut self, mut pieces: Vec<Piece>) {
        for piece in &mut pieces {
            if !piece.colors.is_empty() {
                self.colors.resize(self.positions.len(), NO_COLOR);
                self.colors.append(&mut piece.colors);
            }
            self.positions.append(&mut piece.positions);
            self.uvs.append(&mut piece.uvs);
            self.normals.append(&mut piece.normals);
        }
        pieces
            .par_iter_mut()
            .for_each(|piece| piece.cut_polygons(&self.positions));
        pieces.into_iter().for_each(|piece| self.add(piece));
    }

    /// Appends the faces of a piece.
    fn add(&mut self, piece: Piece) {
        self.ignored.add(piece.ignored);
        let names: Vec<usize> = piece.names.into_iter().map(|name| self.index_of_name(name)).collect();
        let mut start = [0; 3];
        for run in &piece.runs {
            let key = PartKey {
                material: run.name.map_or(self.material, |name| Some(names[name])),
                uvs: run.uvs,
                normals: run.normals,
            };
            let part = *self.part_index.entry(key).or_insert_with(|| {
                self.parts.push(Part { key, runs: Vec::new() });
                self.parts.len() - 1
            });
            self.parts[part].runs.push(PartRun {
                piece: self.corners.len(),
                start,
                triangles: run.triangles,
            });
            for (start, has) in start.iter_mut().zip([true, run.uvs, run.normals]) {
                *start += if has { run.triangles } else { 0 };
            }
        }
        self.corners.push(piece.corners);
        self.material = names.last().copied().or(self.material);
    }

    fn index_of_name(&mut self, name: String) -> usize {
        if let Some(&index) = self.name_index.get(&name) {
            return index;
        }
        self.names.push(name.clone());
        self.name_index.insert(name, self.names.len() - 1);
        self.names.len() - 1
    }

    /// Material and mesh of each part; no mesh where its triangles or vertices cannot be numbered with 32 bits.
    pub(super) fn weld(mut self) -> Vec<(Option<usize>, Option<TriangleMesh<DVec3>>)> {
        if !self.colors.is_empty() {
            self.colors.resize(self.positions.len(), NO_COLOR);
        }
        if let Some(mesh) = self.take_if_welded() {
            return vec![(self.parts[0].key.material, Some(mesh))];
        }
        // The last vertex made at each position. Each part leaves it as it finds it.
        let mut at_position = vec![NONE; self.positions.len()];
        self.parts
            .iter()
            .map(|part| (part.key.material, self.weld_part(part, &mut at_position)))
            .collect()
    }

    /// The whole file as it is, if it has one part and one index serves position, normal and texture coordinate already:
    /// scans are like that, and the largest meshes are scans.
    fn take_if_welded(&mut self) -> Option<TriangleMesh<DVec3>> {
        let [Part { key, runs }] = &*self.parts else {
            return None;
        };
        let triangles = runs.iter().map(|run| run.triangles).sum();
        let is_parallel = |has: bool, count: usize, kind: usize| {
            let is_same = |corners: &[Vec<[u32; 3]>; 3]| corners[kind] == corners[0];
            !has || (count == self.positions.len() && self.corners.par_iter().all(is_same))
        };
        if triangles > u32::MAX as usize
            || !is_parallel(key.uvs, self.uvs.len(), 1)
            || !is_parallel(key.normals, self.normals.len(), 2)
        {
            return None;
        }
        // Positions that no triangle has are no vertices.
        let is_used: Vec<AtomicBool> = self.positions.iter().map(|_| AtomicBool::new(false)).collect();
        let mut indices = vec![[0; 3]; triangles];
        let mut rest = &mut *indices;
        let mut jobs = Vec::with_capacity(self.corners.len());
        for [corners, ..] in &self.corners {
            let (to, behind) = rest.split_at_mut(corners.len());
            jobs.push((to, corners));
            rest = behind;
        }
        jobs.into_par_iter().for_each(|(to, corners)| {
            to.copy_from_slice(corners);
            for &i in corners.as_flattened() {
                is_used[i as usize].store(true, Ordering::Relaxed);
            }
        });
        if !is_used.into_iter().all(AtomicBool::into_inner) {
            return None;
        }
        Some(TriangleMesh {
            colors: usable(take(&mut self.colors)),
            positions: take(&mut self.positions),
            uvs: if key.uvs { take(&mut self.uvs) } else { Vec::new() },
            normals: if key.normals {
                take(&mut self.normals)
            } else {
                Vec::new()
            },
            indices,
        })
    }

    fn weld_part(&self, part: &Part, at_position: &mut [u32]) -> Option<TriangleMesh<DVec3>> {
        let triangles = part.runs.iter().map(|run| run.triangles).sum();
        let mut vertices: Vec<Vertex> = Vec::new();
        let mut indices = Vec::with_capacity(triangles);
        for run in &part.runs {
            let [positions, uvs, normals] = &self.corners[run.piece];
            let corners_of = |corners: &[[u32; 3]], has: bool, kind: usize, triangle: usize| {
                if has {
                    corners[run.start[kind] + triangle]
                } else {
                    [NONE; 3]
                }
            };
            for triangle in 0..run.triangles {
                let p = corners_of(positions, true, 0, triangle);
                let uv = corners_of(uvs, part.key.uvs, 1, triangle);
                let n = corners_of(normals, part.key.normals, 2, triangle);
                indices.push([0, 1, 2].map(|c| index_of_vertex([p[c], uv[c], n[c]], &mut vertices, at_position)));
            }
        }
        for vertex in &vertices {
            at_position[vertex.corner[0] as usize] = NONE;
        }
        if vertices.len().max(triangles) > u32::MAX as usize {
            return None;
        }
        let corners = || vertices.par_iter().map(|vertex| vertex.corner.map(|i| i as usize));
        let colored = corners().map(|[p, ..]| p).filter(|_| !self.colors.is_empty());
        Some(TriangleMesh {
            colors: usable(colored.map(|p| self.colors[p]).collect()),
            positions: corners().map(|[p, ..]| self.positions[p]).collect(),
            uvs: if part.key.uvs {
                corners().map(|[_, uv, _]| self.uvs[uv]).collect()
            } else {
                Vec::new()
            },
            normals: if part.key.normals {
                corners().map(|[.., n]| self.normals[n]).collect()
            } else {
                Vec::new()
            },
            indices,
        })
    }
}

/// The colours of a mesh: none if no vertex has one, else white for those without.
fn usable(mut colors: Vec<Rgb>) -> Vec<Rgb> {
    if colors.iter().all(|color| *color == NO_COLOR) {
        return Vec::new();
    }
    for color in colors.iter_mut().filter(|color| **color == NO_COLOR) {
        *color = Rgb::WHITE;
    }
    colors
}

/// The vertex of a corner, which is made if there is none.
#[inline]
fn index_of_vertex(corner: [u32; 3], vertices: &mut Vec<Vertex>, at_position: &mut [u32]) -> u32 {
    let first = &mut at_position[corner[0] as usize];
    let mut index = *first;
    for _ in 0..MAX_SEARCH {
        let Some(vertex) = vertices.get(index as usize) else {
            break;
        };
        if vertex.corner == corner {
            return index;
        }
        index = vertex.next;
    }
    let index = vertices.len() as u32;
    vertices.push(Vertex { corner, next: *first });
    *first = index;
    index
}
