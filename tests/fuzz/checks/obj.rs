//! OBJ files and their material libraries: text up to the first zero byte is the mesh, the rest is any library it names.

use embrace::math::Rgb;
use embrace::scene::obj::{self, MapRef, MtlMaterial};
use std::path::Path;

pub(crate) fn check(data: &[u8]) {
    let (mesh, library) = split(data);
    let scene = match obj::read(Path::new("dir/mesh.obj"), mesh, |_| Ok(library.to_vec())) {
        Ok(scene) => scene,
        Err(error) => {
            let message = error.to_string();
            assert!(message.starts_with("dir/mesh.obj:"), "{message}");
            return;
        }
    };
    assert!(!scene.parts.is_empty());
    for part in &scene.parts {
        part.mesh.validate().expect("a mesh that was read is valid");
        assert!(part.material.is_none_or(|m| m < scene.materials.len()));
        for n in &part.mesh.normals {
            let length = n.length();
            assert!(
                length == 0.0 || (length - 1.0).abs() < 1e-6,
                "a normal of length {length}"
            );
        }
        assert!(part.mesh.uvs.iter().all(|uv| uv.is_finite()));
        let is_reflectance = |c: f32| (0.0..=1.0).contains(&c);
        assert!(
            part.mesh
                .colors
                .iter()
                .all(|c| c.to_array().into_iter().all(is_reflectance))
        );
    }
    scene.materials.iter().for_each(check_material);
    assert!(scene.warnings.iter().all(|warning| !warning.trim().is_empty()));
}

/// The text before the first zero byte, and what follows it.
pub(crate) fn split(data: &[u8]) -> (&[u8], &[u8]) {
    match data.iter().position(|&byte| byte == 0) {
        Some(at) => (&data[..at], &data[at + 1..]),
        None => (data, &[]),
    }
}

fn check_material(material: &MtlMaterial) {
    assert!(!material.name.is_empty());
    let usable = |v: f32| v.is_finite() && v >= 0.0;
    for rgb in [material.kd, material.ks, material.ke].into_iter().flatten() {
        assert!(Rgb::to_array(rgb).into_iter().all(usable), "{material:?}");
    }
    for value in [material.ns, material.ni, material.pr, material.pm]
        .into_iter()
        .flatten()
    {
        assert!(usable(value), "{material:?}");
    }
    assert!(material.d.is_none_or(|d| (0.0..=1.0).contains(&d)), "{material:?}");
    for MapRef {
        file,
        scale,
        offset,
        strength,
        ..
    } in material.maps.iter().flatten()
    {
        assert!(!file.is_empty());
        let numbers = scale.iter().chain(offset).chain([strength]);
        assert!(numbers.into_iter().all(|v| v.is_finite()), "{material:?}");
    }
}
