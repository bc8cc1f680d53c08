//! Writing PLY files.

use crate::math::DVec3;
use crate::mesh::TriangleMesh;
use std::io::{self, Write};

/// Bytes that are put together before they are written.
const BUFFER: usize = 1 << 16;

/// Writes a mesh as a PLY file, such that [`super::read`] gives the same mesh to the bit: binary, little endian, positions
/// as `double`, everything else as `float`, linear colours as `red`, `green` and `blue`.
///
/// The mesh must be one that can be read ([`TriangleMesh::validate`]; normals of unit length or zero; texture coordinates and
/// colours finite).
///
/// # Errors
/// What `out` says.
pub fn write_ply(mesh: &TriangleMesh<DVec3>, mut out: impl Write) -> io::Result<()> {
    let (has_normals, has_uvs, has_colors) = (!mesh.normals.is_empty(), !mesh.uvs.is_empty(), !mesh.colors.is_empty());
    let mut header = format!(
        "ply\nformat binary_little_endian 1.0\nelement vertex {}\n",
        mesh.positions.len()
    );
    for (is_there, kind, names) in [
        (true, "double", ["x", "y", "z"].as_slice()),
        (has_normals, "float", &["nx", "ny", "nz"]),
        (has_uvs, "float", &["u", "v"]),
        (has_colors, "float", &["red", "green", "blue"]),
    ] {
        for name in names.iter().filter(|_| is_there) {
            header += &format!("property {kind} {name}\n");
        }
    }
    header += &format!(
        "element face {}\nproperty list uchar uint vertex_indices\nend_header\n",
        mesh.indices.len()
    );
    let mut buffer = header.into_bytes();
    for (i, position) in mesh.positions.iter().enumerate() {
        for c in position.to_array() {
            buffer.extend_from_slice(&c.to_le_bytes());
        }
        let normal = has_normals.then(|| mesh.normals[i].to_array());
        let uv = has_uvs.then(|| mesh.uvs[i].to_array());
        let color = has_colors.then(|| mesh.colors[i].to_array());
        for c in normal
            .iter()
            .flatten()
            .chain(uv.iter().flatten())
            .chain(color.iter().flatten())
        {
            buffer.extend_from_slice(&c.to_le_bytes());
        }
        flush_if_full(&mut buffer, &mut out)?;
    }
    for corners in &mesh.indices {
        buffer.push(3);
        for index in corners {
            buffer.extend_from_slice(&index.to_le_bytes());
        }
        flush_if_full(&mut buffer, &mut out)?;
    }
    out.write_all(&buffer)?;
    out.flush()
}

fn flush_if_full(buffer: &mut Vec<u8>, out: &mut impl Write) -> io::Result<()> {
    if buffer.len() >= BUFFER {
        out.write_all(buffer)?;
        buffer.clear();
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::{Rgb, Vec2, Vec3};

    #[test]
    fn a_file_has_a_header_and_as_many_bytes_as_that_says() {
        let mut mesh = TriangleMesh {
            positions: vec![DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::new(0.1, 1e-30, -7e20)],
            indices: vec![[0, 1, 2], [3, 2, 1]],
            ..TriangleMesh::default()
        };
        let size = |mesh: &TriangleMesh<DVec3>| {
            let mut bytes = Vec::new();
            write_ply(mesh, &mut bytes).unwrap();
            let end = bytes.windows(11).position(|w| w == b"end_header\n").unwrap() + 11;
            bytes.len() - end
        };
        assert_eq!(size(&mesh), 4 * 24 + 2 * 13);
        mesh.normals = vec![Vec3::Z; 4];
        mesh.uvs = vec![Vec2::ZERO; 4];
        mesh.colors = vec![Rgb::WHITE; 4];
        assert_eq!(size(&mesh), 4 * (24 + 32) + 2 * 13);
    }
}
