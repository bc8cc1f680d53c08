//! PLY files. What is read can be written, and is the same when it is read again.

use embrace::scene::ply::{self, write_ply};
use std::path::Path;

pub(crate) fn check(data: &[u8]) {
    let path = Path::new("dir/mesh.ply");
    let read = match ply::read(path, data) {
        Ok(read) => read,
        Err(error) => {
            let message = error.to_string();
            assert!(message.starts_with("dir/mesh.ply:"), "{message}");
            return;
        }
    };
    assert!(read.warnings.iter().all(|warning| !warning.trim().is_empty()));
    for attribute in &read.attributes {
        assert!((1..=4).contains(&attribute.channels), "{}", attribute.name);
        assert_eq!(attribute.values.len() % attribute.channels, 0);
        let mesh = read.clone().into_mesh_colored_by(&attribute.name).expect("it is there");
        mesh.validate().expect("a mesh that was read is valid");
        assert_eq!(mesh.colors.len(), mesh.positions.len());
    }
    let mesh = read.into_mesh().expect("a small mesh");
    mesh.validate().expect("a mesh that was read is valid");
    for n in &mesh.normals {
        let length = n.length();
        assert!(
            length == 0.0 || (length - 1.0).abs() < 1e-6,
            "a normal of length {length}"
        );
    }
    assert!(mesh.uvs.iter().all(|uv| uv.is_finite()));
    assert!(
        mesh.colors
            .iter()
            .all(|c| c.is_finite() && c.to_array().into_iter().all(|c| c >= 0.0))
    );
    let mut bytes = Vec::new();
    write_ply(&mesh, &mut bytes).expect("memory can be written to");
    let again = ply::read(path, &bytes)
        .expect("what was written can be read")
        .into_mesh()
        .expect("a small mesh");
    assert!(again == mesh, "not the same mesh again");

    let mut smooth = mesh;
    smooth.normals.clear();
    smooth.smooth(f64::from(data.len() as u8));
    smooth.validate().expect("a smoothed mesh is valid");
}
