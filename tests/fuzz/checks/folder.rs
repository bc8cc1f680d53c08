//! A scene on disk of which a check replaces files, and what must hold for whatever can be loaded from it.

use embrace::accel::brute::Brute;
use embrace::accel::{Accel, BuildOptions};
use embrace::film::Rect;
use embrace::image::{Image, MAX_PIXELS};
use embrace::integrator::{KernelChoice, Settings, kernel_for};
use embrace::material::{General, Material, Scattering, Spectrum};
use embrace::math::Rgb;
use embrace::render::{ErrorControl, Job, render};
use embrace::scene::{EnvironmentDesc, LoadOptions, Scene, SceneDesc, SceneOptions, load};
use embrace::texture::{Texture, TextureMap};
use std::fs;
use std::path::{Path, PathBuf};
use tempfile::TempDir;

/// Larger scenes are not rendered: every ray tests every triangle, and time says nothing there.
const MOST_TRIANGLES: u64 = 2000;

/// Larger maps get no sampling table, for the same reason.
const MOST_TEXELS: usize = 1 << 20;

/// A temporary folder (`TMPDIR` may place it in memory).
pub(crate) struct Folder(TempDir);

impl Folder {
    pub(crate) fn new() -> Folder {
        Folder(tempfile::tempdir().expect("a temporary folder"))
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    pub(crate) fn write(&self, name: &str, bytes: &[u8]) {
        let path = self.path(name);
        // Some file systems wait for the disk when a file is overwritten, but not when a new one takes its name.
        let _ = fs::remove_file(&path);
        fs::write(path, bytes).expect("a file in a temporary folder");
    }

    /// Loads a scene, and builds it and renders a few samples if there is one. Nothing may panic, errors name a file, and
    /// what is accepted keeps to what descriptions promise.
    pub(crate) fn check(&self, scene: &str) {
        match load(&self.path(scene), LoadOptions::default()) {
            Ok(desc) => {
                check_description(&desc);
                render_some(desc);
            }
            Err(error) => {
                // The folder's path is absolute, and so is any other that a scene can lead to.
                let message = error.to_string();
                assert!(
                    Path::new(&message).is_absolute(),
                    "the message names no file: {message}"
                );
            }
        }
    }
}

fn is_whole<T>(image: &Image<T>) -> bool {
    let pixels = image.pixels.len() as u64;
    (1..=MAX_PIXELS).contains(&pixels) && pixels == u64::from(image.width) * u64::from(image.height)
}

fn usable(rgb: Rgb) -> bool {
    rgb.to_array().iter().all(|c| c.is_finite() && *c >= 0.0)
}

fn in_unit(rgb: Rgb) -> bool {
    rgb.to_array().iter().all(|c| (0.0..=1.0).contains(c))
}

fn check_description(desc: &SceneDesc) {
    for mesh in &desc.meshes {
        mesh.validate().expect("a mesh that was loaded is valid");
    }
    for object in &desc.objects {
        assert!(object.mesh < desc.meshes.len() && object.material < desc.materials.len());
        assert!(object.to_world.is_finite() && object.to_world.matrix3.determinant() != 0.0);
        assert!(object.emission.is_none_or(|e| usable(e.radiance)));
    }
    for (name, material) in &desc.materials {
        assert!(is_sound(material, desc.textures.len()), "{name}: {material:?}");
    }
    for texture in &desc.textures {
        match texture {
            Texture::Rgb8(image, _) => assert!(is_whole(image)),
            Texture::Rgb32(image) => assert!(is_whole(image) && image.pixels.iter().all(|p| in_unit(*p))),
        }
    }
    match &desc.environment {
        None => {}
        Some(EnvironmentDesc::Constant(radiance)) => assert!(usable(*radiance)),
        Some(EnvironmentDesc::Map {
            image,
            scale,
            rotation_degrees,
            to_world,
        }) => {
            assert!(scale.is_finite() && *scale >= 0.0 && rotation_degrees.is_finite() && to_world.is_finite());
            assert!(is_whole(image));
            assert!(image.pixels.iter().all(|p| usable(*p) && usable(*p * *scale)));
        }
    }
    assert!(desc.warnings.iter().all(|warning| !warning.trim().is_empty()));
}

fn is_sound(material: &Material, textures: usize) -> bool {
    let map = |map: &TextureMap| (map.texture as usize) < textures && map.to_uv.is_finite();
    let unit = |v: f32| (0.0..=1.0).contains(&v);
    let mut spectra = true;
    material.visit_spectra(&mut |spectrum| {
        spectra &= match spectrum {
            Spectrum::Constant(rgb) => in_unit(*rgb),
            Spectrum::Bitmap(bitmap, tint) => map(bitmap) && in_unit(*tint),
            Spectrum::Checkerboard(pattern) => pattern.to_uv.is_finite() && pattern.colors.into_iter().all(in_unit),
            Spectrum::VertexColor(bitmap, tint) => bitmap.as_ref().is_none_or(map) && in_unit(*tint),
        }
    });
    let scattering = match &material.scattering {
        Scattering::Diffuse { .. } => true,
        Scattering::Conductor { eta, k, alpha } => usable(*eta) && usable(*k) && unit(*alpha),
        Scattering::Dielectric { ior, alpha } => *ior > 0.0 && ior.is_finite() && unit(*alpha),
        Scattering::Mirror { reflectance } => in_unit(*reflectance),
        Scattering::Plastic { specular, alpha, .. } => in_unit(*specular) && unit(*alpha),
        Scattering::General(General::Metal { eta, k, .. }) => usable(*eta) && usable(*k),
        Scattering::General(General::Glass { ior, .. } | General::ThinGlass { ior, .. }) => {
            *ior > 0.0 && ior.is_finite()
        }
        Scattering::General(General::CoatedDiffuse { .. } | General::Principled(_) | General::Blend { .. }) => true,
    };
    let relief = material.relief.is_none_or(|relief| map(&relief.map()));
    spectra && scattering && relief
}

/// A sample for each of the pixels in the middle.
fn render_some(desc: SceneDesc) {
    if matches!(&desc.environment, Some(EnvironmentDesc::Map { image, .. }) if image.pixels.len() > MOST_TEXELS) {
        return;
    }
    let Ok(scene) = Scene::build(desc, SceneOptions::default()) else {
        return;
    };
    if scene.triangles() > MOST_TRIANGLES {
        return;
    }
    let accel = Brute::build(&scene.geometry, BuildOptions::default()).expect("brute force always builds");
    let kernel = kernel_for(&scene, KernelChoice::Auto);
    let [x1, y1] = scene.camera.resolution();
    let job = Job {
        crop: Rect::block(x1 / 2, y1 / 2).intersection(Rect { x0: 0, y0: 0, x1, y1 }),
        spp: 1,
        error: ErrorControl::Ignored,
        split_direct: false,
        settings: Settings {
            max_depth: scene.max_depth,
            ..Settings::default()
        },
    };
    let (film, report) = render(&scene, &accel, kernel, &job);
    assert_eq!(report.paths, job.crop.pixels());
    assert!(report.dropped.count <= report.paths);
    assert!(
        film.develop().pixels.iter().all(|p| usable(*p)),
        "a pixel that is negative or not finite"
    );
}
