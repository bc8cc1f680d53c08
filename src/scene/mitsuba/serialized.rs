//! Mitsuba's own mesh files: one or more meshes, each compressed by zlib, and a table of where they begin.

use super::super::input::read_file;
use super::super::load::LoadError;
use crate::math::{DVec3, Vec2, Vec3};
use crate::mesh::TriangleMesh;
use flate2::read::ZlibDecoder;
use std::io::{self, Read};
use std::path::Path;

const MAGIC: u16 = 0x041c;

/// DEFLATE makes at most so many bytes of one.
const MAX_RATIO: u64 = 1032;

/// Longest name of a mesh or attribute.
const MAX_NAME: usize = 1 << 12;

/// Bits of the flags: of versions 3 and 4, then of version 5.
const NORMALS: u32 = 0x1;
const OLD_UVS: u32 = 0x2;
const OLD_COLORS: u32 = 0x8;
const OLD_DOUBLE: u32 = 0x2000;
const FACE_NORMALS: u32 = 0x10;
const TANGENTS: u32 = 0x2;
const UVS: u32 = 0x4;

/// A mesh of a file.
#[derive(Debug)]
pub(super) struct Loaded {
    pub(super) mesh: TriangleMesh<DVec3>,
    /// Whether the file says that it has no smooth normals.
    pub(super) has_face_normals: bool,
}

/// Reads one mesh of a file, counted from 0; with the hash over the file.
pub(super) fn read(path: &Path, index: u32) -> Result<(Loaded, blake3::Hash), LoadError> {
    let bytes = read_file(path)?;
    let loaded = parse(&bytes, index).map_err(|problem| LoadError::Key {
        path: path.to_owned(),
        key: format!("mesh {index}"),
        problem: format!("{problem}; export it again"),
    })?;
    Ok((loaded, blake3::hash(&bytes)))
}

fn parse(bytes: &[u8], index: u32) -> Result<Loaded, String> {
    let header = |at: usize| -> Option<(u16, u16)> {
        let field = |at: usize| Some(u16::from_le_bytes(bytes.get(at..at + 2)?.try_into().ok()?));
        Some((field(at)?, field(at + 2)?))
    };
    let version = match header(0) {
        Some((MAGIC, version @ 3..=5)) => version,
        Some((MAGIC, version)) => return Err(format!("the file has version {version}; expected 3, 4 or 5")),
        _ => return Err("the file does not begin as a serialized mesh".into()),
    };
    let offset = if index == 0 { 0 } else { offset(bytes, version, index)? };
    match header(offset) {
        Some((MAGIC, found)) if found == version => {}
        _ => return Err(format!("there is no mesh at byte {offset}")),
    }
    let compressed = &bytes[offset + 4..];
    let mut stream = Stream {
        decoder: ZlibDecoder::new(compressed),
        left: compressed.len() as u64 * MAX_RATIO,
    };
    let loaded = if version == 5 {
        version_5(&mut stream)?
    } else {
        versions_3_and_4(&mut stream, version)?
    };
    loaded.mesh.validate().map_err(|e| e.to_string())?;
    Ok(loaded)
}

/// Where a mesh begins, by the table at the end.
fn offset(bytes: &[u8], version: u16, index: u32) -> Result<usize, String> {
    let damaged = || "the table at the end of the file is damaged".to_owned();
    let count_at = bytes.len().checked_sub(4).ok_or_else(damaged)?;
    let count = u32::from_le_bytes(bytes[count_at..].try_into().map_err(|_| damaged())?);
    if index >= count {
        return Err(format!("the file has {count} meshes"));
    }
    let width = if version == 3 { 4 } else { 8 };
    let back = (count - index) as usize * width;
    let at = count_at.checked_sub(back).ok_or_else(damaged)?;
    let mut field = [0; 8];
    field[..width].copy_from_slice(&bytes[at..at + width]);
    let offset = usize::try_from(u64::from_le_bytes(field)).map_err(|_| damaged())?;
    if offset < count_at { Ok(offset) } else { Err(damaged()) }
}

fn versions_3_and_4(stream: &mut Stream, version: u16) -> Result<Loaded, String> {
    let flags = stream.u32()?;
    if version == 4 {
        stream.skip_text()?;
    }
    let [vertices, triangles] = [stream.u64()?, stream.u64()?];
    let has = |flag: u32| flags & flag != 0;
    let is_double = has(OLD_DOUBLE);
    let numbers = 3 + 3 * u64::from(has(NORMALS)) + 2 * u64::from(has(OLD_UVS)) + 3 * u64::from(has(OLD_COLORS));
    stream.check(&[(vertices, numbers * if is_double { 8 } else { 4 }), (triangles, 12)])?;
    let [vertices, triangles] = [vertices as usize, triangles as usize];
    let positions = stream.numbers(3 * vertices, is_double)?;
    let mut mesh = TriangleMesh {
        positions: positions
            .chunks_exact(3)
            .map(|c| DVec3::new(c[0], c[1], c[2]))
            .collect(),
        ..TriangleMesh::default()
    };
    let single = |c: &f64| *c as f32;
    if has(NORMALS) {
        let normals: Vec<f32> = stream.numbers(3 * vertices, is_double)?.iter().map(single).collect();
        mesh.normals = vectors(&normals);
    }
    if has(OLD_UVS) {
        let uvs: Vec<f32> = stream.numbers(2 * vertices, is_double)?.iter().map(single).collect();
        mesh.uvs = uvs.chunks_exact(2).map(|c| finite(Vec2::new(c[0], c[1]))).collect();
    }
    if has(OLD_COLORS) {
        stream.numbers(3 * vertices, is_double)?;
    }
    mesh.indices = stream
        .indices(3 * triangles)?
        .chunks_exact(3)
        .map(|c| [c[0], c[1], c[2]])
        .collect();
    Ok(finished(mesh, has(FACE_NORMALS)))
}

fn version_5(stream: &mut Stream) -> Result<Loaded, String> {
    let flags = stream.u32()?;
    let has = |flag: u32| flags & flag != 0;
    stream.text()?;
    let [vertices, triangles] = [stream.u64()?, stream.u64()?];
    // How many vertices are one place, and how many have one normal; what follows the faces is not needed.
    stream.bytes::<16>()?;
    if has(TANGENTS) {
        return Err("the mesh stores tangents, which is not supported".into());
    }
    stream.check(&[(vertices, 32), (triangles, 16)])?;
    let [vertices, triangles] = [vertices as usize, triangles as usize];
    let records = stream.singles(8 * vertices)?;
    let faces = stream.indices(4 * triangles)?;
    let mut mesh = TriangleMesh {
        positions: records
            .chunks_exact(8)
            .map(|r| Vec3::new(r[0], r[1], r[2]).as_dvec3())
            .collect(),
        indices: faces.chunks_exact(4).map(|c| [c[0], c[1], c[2]]).collect(),
        ..TriangleMesh::default()
    };
    if has(NORMALS) {
        let normals: Vec<f32> = records.chunks_exact(8).flat_map(|r| [r[3], r[4], r[5]]).collect();
        mesh.normals = vectors(&normals);
    }
    if has(UVS) {
        mesh.uvs = records.chunks_exact(8).map(|r| finite(Vec2::new(r[6], r[7]))).collect();
    }
    Ok(finished(mesh, has(FACE_NORMALS)))
}

fn finished(mut mesh: TriangleMesh<DVec3>, has_face_normals: bool) -> Loaded {
    mesh.repair_normals();
    Loaded { mesh, has_face_normals }
}

fn vectors(numbers: &[f32]) -> Vec<Vec3> {
    numbers.chunks_exact(3).map(|c| Vec3::new(c[0], c[1], c[2])).collect()
}

fn finite(uv: Vec2) -> Vec2 {
    if uv.is_finite() { uv } else { Vec2::ZERO }
}

/// The content of a mesh.
struct Stream<'a> {
    decoder: ZlibDecoder<&'a [u8]>,
    /// Bytes that it can have at most from here on.
    left: u64,
}

impl Stream<'_> {
    fn bytes<const N: usize>(&mut self) -> Result<[u8; N], String> {
        let mut bytes = [0; N];
        self.decoder.read_exact(&mut bytes).map_err(damaged)?;
        self.left = self.left.saturating_sub(N as u64);
        Ok(bytes)
    }

    fn u32(&mut self) -> Result<u32, String> {
        self.bytes().map(u32::from_le_bytes)
    }

    fn u64(&mut self) -> Result<u64, String> {
        self.bytes().map(u64::from_le_bytes)
    }

    /// A text that a zero byte ends.
    fn skip_text(&mut self) -> Result<(), String> {
        for _ in 0..MAX_NAME {
            if self.bytes::<1>()? == [0] {
                return Ok(());
            }
        }
        Err(format!("the name of the mesh has more than {MAX_NAME} bytes"))
    }

    /// A text after its length.
    fn text(&mut self) -> Result<String, String> {
        let length = self.u32()? as usize;
        if length > MAX_NAME {
            return Err(format!("a name has more than {MAX_NAME} bytes"));
        }
        let bytes = self.many(length)?;
        Ok(String::from_utf8_lossy(&bytes).into_owned())
    }

    /// Refuses counts of items, each of so many bytes, that the file cannot hold.
    fn check(&self, counts: &[(u64, u64)]) -> Result<(), String> {
        let bytes = counts
            .iter()
            .map(|&(count, size)| u128::from(count) * u128::from(size))
            .sum::<u128>();
        let largest = counts.iter().map(|(count, _)| *count).max().unwrap_or(0);
        if bytes > u128::from(self.left) || largest > u64::from(u32::MAX) {
            let counts: Vec<u64> = counts.iter().map(|(count, _)| *count).collect();
            return Err(format!(
                "the counts {counts:?} of vertices and triangles are more than the file can hold"
            ));
        }
        Ok(())
    }

    fn many(&mut self, count: usize) -> Result<Vec<u8>, String> {
        let mut bytes = Vec::new();
        let limit = count as u64;
        (&mut self.decoder)
            .take(limit)
            .read_to_end(&mut bytes)
            .map_err(damaged)?;
        if bytes.len() != count {
            return Err("the file ends before its mesh does".into());
        }
        self.left = self.left.saturating_sub(limit);
        Ok(bytes)
    }

    fn singles(&mut self, count: usize) -> Result<Vec<f32>, String> {
        let bytes = self.many(4 * count)?;
        Ok(bytes
            .chunks_exact(4)
            .map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]]))
            .collect())
    }

    fn indices(&mut self, count: usize) -> Result<Vec<u32>, String> {
        let bytes = self.many(4 * count)?;
        Ok(bytes
            .chunks_exact(4)
            .map(|b| u32::from_le_bytes([b[0], b[1], b[2], b[3]]))
            .collect())
    }

    fn numbers(&mut self, count: usize, is_double: bool) -> Result<Vec<f64>, String> {
        if !is_double {
            return Ok(self.singles(count)?.into_iter().map(f64::from).collect());
        }
        let bytes = self.many(8 * count)?;
        let number = |b: &[u8]| f64::from_le_bytes(std::array::from_fn(|k| b[k]));
        Ok(bytes.chunks_exact(8).map(number).collect())
    }
}

fn damaged(error: io::Error) -> String {
    format!("the compressed data is damaged ({error})")
}
