//! A scene on disk of which a check replaces files, and what must hold for whatever can be loaded from it.

use embrace::accel::brute::Brute;
use embrace::accel::{Accel, BuildOptions};
use embrace::film::Rect;
use embrace::image::{Image, MAX_PIXELS};
use embrace::integrator::{KernelChoice, Settings, kernel_for};
use embrace::material::{General, Material, Relief, Scattering, Spectrum};
use embrace::math::{DVec3, Rgb};
use embrace::render::{ErrorControl, Job, render};
use embrace::scene::{EnvironmentDesc, Export, LightDesc, LoadOptions, Scene, SceneDesc, SceneOptions, load};
use embrace::texture::{Texture, TextureMap};
use std::f64::consts::{FRAC_PI_2, PI};
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
    // Radiance and heights may exceed 1, everything else may not.
    let spots = desc.lights.iter().filter_map(|light| match light {
        LightDesc::Spot { slide, .. } => slide.as_ref()?.factor.texture(),
        LightDesc::Point { .. } | LightDesc::Distant { .. } => None,
    });
    let lamps = desc.objects.iter().filter_map(|o| o.emission_map?.texture());
    let lamps: Vec<u32> = lamps.chain(spots).collect();
    let heights = desc.materials.iter().filter_map(|(_, material)| match material.relief {
        Some(Relief::BumpMap { map, .. }) => Some(map.texture),
        _ => None,
    });
    let heights: Vec<u32> = heights.collect();
    for (index, texture) in (0..).zip(&desc.textures) {
        let is_in_range =
            |p: Rgb| in_unit(p) || lamps.contains(&index) && usable(p) || heights.contains(&index) && p.is_finite();
        match texture {
            Texture::Rgb8(image, _) => assert!(is_whole(image)),
            Texture::Rgb32(image) => assert!(is_whole(image) && image.pixels.iter().all(|p| is_in_range(*p))),
        }
    }
    for object in &desc.objects {
        if let Some(map) = &object.emission_map {
            assert!(object.emission.is_some() && is_sound_spectrum(map, desc.textures.len(), usable));
            assert!(!matches!(map, Spectrum::Constant(_)));
        }
    }
    assert!(
        desc.lights
            .iter()
            .all(|light| is_sound_light(light, desc.textures.len()))
    );
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
    // Whatever can be read can be written, but for views from farther away than anything is shown.
    if let Err(error) = Export::new(desc, "files") {
        assert!(error.key.starts_with("camera."), "{error}");
    }
}

fn is_sound_light(light: &LightDesc, textures: usize) -> bool {
    let is_direction = |d: &DVec3| d.is_finite() && *d != DVec3::ZERO;
    match light {
        LightDesc::Point { position, intensity } => position.is_finite() && usable(*intensity),
        LightDesc::Spot {
            position,
            direction,
            intensity,
            angles: [beam, edge],
            slide,
            ..
        } => {
            let is_sound_slide = slide.as_ref().is_none_or(|slide| {
                is_sound_spectrum(&slide.factor, textures, usable) && slide.axes.iter().all(is_direction)
            });
            let angles = 0.0 <= *beam && beam < edge && *edge <= PI;
            position.is_finite() && is_direction(direction) && usable(*intensity) && angles && is_sound_slide
        }
        LightDesc::Distant {
            direction,
            irradiance,
            radius,
        } => is_direction(direction) && usable(*irradiance) && (0.0..FRAC_PI_2).contains(radius),
    }
}

/// Whether indices and numbers of a colour are what they may be.
fn is_sound_spectrum(spectrum: &Spectrum, textures: usize, is_color: fn(Rgb) -> bool) -> bool {
    let map = |map: &TextureMap| (map.texture as usize) < textures && map.to_uv.is_finite();
    match spectrum {
        Spectrum::Constant(rgb) => is_color(*rgb),
        Spectrum::Bitmap(bitmap, tint) => map(bitmap) && is_color(*tint),
        Spectrum::Checkerboard(pattern) => pattern.to_uv.is_finite() && pattern.colors.into_iter().all(is_color),
        Spectrum::VertexColor(bitmap, tint) => bitmap.as_ref().is_none_or(map) && is_color(*tint),
    }
}

fn is_sound(material: &Material, textures: usize) -> bool {
    let map = |map: &TextureMap| (map.texture as usize) < textures && map.to_uv.is_finite();
    let unit = |v: f32| (0.0..=1.0).contains(&v);
    let mut spectra = true;
    let whole = Material {
        opacity: None,
        ..material.clone()
    };
    whole.visit_spectra(&mut |spectrum| spectra &= is_sound_spectrum(spectrum, textures, in_unit));
    // One channel can be all of the mean.
    let is_coverage = |rgb: Rgb| usable(rgb) && rgb.max_component() <= 3.0;
    let opacity = material.opacity.as_ref();
    spectra &= opacity.is_none_or(|spectrum| is_sound_spectrum(spectrum, textures, is_coverage));
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
