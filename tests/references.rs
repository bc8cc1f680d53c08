//! The project's scenes against reference images made by another renderer (tests/references/README.md).
//!
//! Two tests per scene and backend: the mean of each channel, and the means of blocks of 8 × 8 pixels. Single pixels are
//! not tested by themselves: a pixel in which the reference has missed a rare bright path has too small a mean *and* too
//! small a variance.

mod support;

use embrace::accel::Accel;
use embrace::image::{self, Image};
use embrace::integrator::Settings;
use embrace::math::Rgb;
use embrace::scene::{self, LoadOptions, SceneOptions};
use std::path::Path;
use support::{Prepared, Significance, Summary, assert_same_images};

/// Batches behind each reference.
const REFERENCE_BATCHES: usize = 64;
/// Edge of a block in pixels.
const BLOCK: u32 = 8;

fn read(name: &str) -> Image<Rgb> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("tests/references")
        .join(name);
    let bytes = std::fs::read(&path).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
    image::read_rgb(&path, &bytes).expect("a reference is an EXR")
}

/// Sums over blocks, times `scale`; incomplete blocks at the border count as they are.
fn blocks(image: &Image<Rgb>, scale: f32) -> Image<Rgb> {
    let (width, height) = (image.width.div_ceil(BLOCK), image.height.div_ceil(BLOCK));
    let mut sums = Image::filled(width, height, Rgb::BLACK);
    for y in 0..image.height {
        for x in 0..image.width {
            sums.pixels[(y / BLOCK * width + x / BLOCK) as usize] += *image.at(x, y) * scale;
        }
    }
    sums
}

fn agrees<A: Accel>(name: &str, spp: u32, seeds: u64) {
    let (mean, variance) = (read(&format!("{name}.exr")), read(&format!("{name}.variance.exr")));
    let file = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("scenes")
        .join(name)
        .join(format!("{name}.toml"));
    let mut desc = scene::load(
        &file,
        LoadOptions {
            strict: true,
            ..LoadOptions::default()
        },
    )
    .expect("the scenes have no faults");
    desc.camera.resolution = [mean.width, mean.height];
    // The reference has no remedy for the shadow terminator.
    let settings = Settings {
        max_depth: desc.max_depth,
        smooth_terminator: false,
        ..Settings::default()
    };
    let prepared = Prepared::<A>::new(desc, SceneOptions::default());
    let pixels = (BLOCK * BLOCK) as f32;
    let replications: Vec<Image<Rgb>> = (0..seeds)
        .map(|seed| blocks(&prepared.image(&Settings { seed, ..settings }, spp), 1.0 / pixels))
        .collect();
    let reference = Summary::from_images(
        &blocks(&mean, 1.0 / pixels),
        &blocks(&variance, 1.0 / (pixels * pixels)),
        REFERENCE_BATCHES,
    );
    assert_same_images(
        &format!("{name} against its reference on {}", A::NAME),
        &Summary::of(&replications),
        &reference,
        Significance::TEST,
    );
}

fn spheres_agree_with_the_reference<A: Accel>() {
    agrees::<A>("spheres", 16, 32);
}

fn the_cornell_box_agrees_with_the_reference<A: Accel>() {
    agrees::<A>("cornell", 16, 32);
}

fn veach_mis_agrees_with_the_reference<A: Accel>() {
    // The caustics of its plates are made of few and bright paths: it takes this many samples to know how noisy they are.
    agrees::<A>("veach-mis", 128, 32);
}

fn glass_agrees_with_the_reference<A: Accel>() {
    agrees::<A>("glass", 16, 32);
}

fn the_furnace_agrees_with_the_reference<A: Accel>() {
    agrees::<A>("furnace", 8, 16);
}

fn many_lights_agree_with_the_reference<A: Accel>() {
    agrees::<A>("many-lights", 16, 32);
}

support::for_each_backend!(but not brute:
    spheres_agree_with_the_reference
    the_cornell_box_agrees_with_the_reference
    veach_mis_agrees_with_the_reference
    glass_agrees_with_the_reference
    the_furnace_agrees_with_the_reference
    many_lights_agree_with_the_reference
);
