//! Environment maps as they are read.

use super::desc::EnvironmentDesc;
use super::file::EnvironmentEntry;
use super::input::read_file;
use super::load::LoadError;
use crate::image::{self, Image};
use crate::math::Rgb;
use std::path::Path;
use std::sync::Arc;

pub(super) type LoadedEnvironment = (EnvironmentDesc, blake3::Hash, Vec<String>);

pub(super) fn load_environment(entry: &EnvironmentEntry, base: &Path) -> Result<LoadedEnvironment, LoadError> {
    let (file, scale, rotation_degrees, to_world) = match entry {
        EnvironmentEntry::Constant(radiance) => {
            return Ok((EnvironmentDesc::Constant(*radiance), blake3::hash(b""), Vec::new()));
        }
        EnvironmentEntry::File {
            file,
            scale,
            rotation_degrees,
            to_world,
        } => (file, *scale, *rotation_degrees, *to_world),
    };
    let path = base.join(file);
    let bytes = read_file(&path)?;
    let hash = blake3::hash(&bytes);
    let mut image = image::read_rgb(&path, &bytes)?;
    drop(bytes);
    let mut warnings = sanitise_radiance(&mut image, scale, &path);
    if image.pixels.iter().all(|p| p.is_black()) {
        warnings.push(format!(
            "{}: the environment map is black; it gives no light",
            path.display()
        ));
    }
    Ok((
        EnvironmentDesc::Map {
            image: Arc::new(image),
            scale,
            rotation_degrees,
            to_world,
        },
        hash,
        warnings,
    ))
}

/// Makes every texel finite and 0 or more, also after scaling, and says how many were not.
pub(super) fn sanitise_radiance(image: &mut Image<Rgb>, scale: f32, path: &Path) -> Vec<String> {
    let channels = || image.pixels.iter().flat_map(|p| p.to_array());
    // Small enough that sums over the map and products with reflectances stay finite.
    let limit = 1e30 / scale.max(1.0);
    let largest = channels().filter(|c| *c <= limit).fold(0.0, f32::max);
    let (mut negative, mut nan, mut infinite) = (0u64, 0u64, 0u64);
    for pixel in &mut image.pixels {
        for channel in [&mut pixel.r, &mut pixel.g, &mut pixel.b] {
            if channel.is_nan() {
                nan += 1;
                *channel = 0.0;
            } else if *channel < 0.0 {
                negative += 1;
                *channel = 0.0;
            } else if *channel > limit {
                infinite += 1;
                *channel = largest;
            }
        }
    }
    let mut warnings = Vec::new();
    let mut warn = |count: u64, what: &str, instead: String| {
        if count > 0 {
            warnings.push(format!(
                "{}: {count} texel values are {what}; {instead} is used",
                path.display()
            ));
        }
    };
    warn(negative, "negative", "0".into());
    warn(nan, "NaN", "0".into());
    warn(
        infinite,
        "infinite or beyond 1e30",
        format!("the largest other value, {largest},"),
    );
    warnings
}
