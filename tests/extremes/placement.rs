//! Scenes of any size, anywhere: the same image.

use crate::support::{Estimate, Prepared, Significance, assert_mean, assert_same_images, for_each_backend};
use embrace::accel::Accel;
use embrace::image::Image;
use embrace::image::compare::compare;
use embrace::integrator::Settings;
use embrace::math::{DAffine3, DVec3, Rgb};
use embrace::scene::{LoadOptions, SceneDesc, SceneOptions, load};
use std::fs;
use std::path::Path;
use std::sync::Arc;

for_each_backend! { but not brute:
    a_scene_scaled_by_a_power_of_two_gives_the_same_bits
    a_scene_scaled_by_a_power_of_ten_gives_the_same_image
    a_scene_moved_far_away_gives_the_same_image
    a_mesh_file_far_from_the_origin_gives_the_same_image
}

const SCENES: [&str; 2] = ["cornell", "spheres"];

fn scene(name: &str) -> SceneDesc {
    let path = format!("{}/scenes/{name}/{name}.toml", env!("CARGO_MANIFEST_DIR"));
    let mut desc = load(Path::new(&path), LoadOptions::default()).expect("a scene of the repository");
    desc.camera.resolution = [40, 30];
    desc
}

/// Geometry, camera and all its lengths. The radiance stays.
fn scaled(mut desc: SceneDesc, scale: f64) -> SceneDesc {
    let camera = &mut desc.camera;
    camera.position *= scale;
    camera.look_at *= scale;
    camera.aperture_radius *= scale;
    camera.focus_distance = camera.focus_distance.map(|d| d * scale);
    place(desc, DAffine3::from_scale(DVec3::splat(scale)))
}

fn move_camera(desc: &mut SceneDesc, by: DVec3) {
    desc.camera.position += by;
    desc.camera.look_at += by;
}

fn moved(mut desc: SceneDesc, by: DVec3) -> SceneDesc {
    move_camera(&mut desc, by);
    place(desc, DAffine3::from_translation(by))
}

fn place(mut desc: SceneDesc, transform: DAffine3) -> SceneDesc {
    for object in &mut desc.objects {
        object.to_world = transform * object.to_world;
    }
    desc
}

/// The same scene with the translation in the vertices instead of the transforms.
fn baked(mut desc: SceneDesc, by: DVec3) -> SceneDesc {
    move_camera(&mut desc, by);
    for object in &mut desc.objects {
        let mut mesh = (*desc.meshes[object.mesh]).clone();
        let to_vertices = object.to_world.inverse().transform_vector3(by);
        mesh.positions.iter_mut().for_each(|p| *p += to_vertices);
        desc.meshes.push(Arc::new(mesh));
        object.mesh = desc.meshes.len() - 1;
    }
    desc
}

fn prepare<A: Accel>(desc: SceneDesc) -> Prepared<A> {
    Prepared::new(desc, SceneOptions::default())
}

/// An image of the seed `seed`.
fn image<A: Accel>(desc: SceneDesc, seed: u64) -> Image<Rgb> {
    prepare::<A>(desc).image(
        &Settings {
            seed,
            ..Settings::default()
        },
        16,
    )
}

fn relmse(reference: &Image<Rgb>, image: &Image<Rgb>) -> f64 {
    compare(reference, image).expect("images of one size").relmse
}

fn a_scene_scaled_by_a_power_of_two_gives_the_same_bits<A: Accel>() {
    for name in SCENES {
        let expected = image::<A>(scene(name), 1);
        for exponent in [-20, -7, 5, 20] {
            let found = image::<A>(scaled(scene(name), f64::from(exponent).exp2()), 1);
            let different = expected
                .pixels
                .iter()
                .zip(&found.pixels)
                .filter(|(a, b)| a != b)
                .count();
            assert_eq!(different, 0, "{}: {name} scaled by 2^{exponent}", A::NAME);
        }
    }
}

fn a_scene_scaled_by_a_power_of_ten_gives_the_same_image<A: Accel>() {
    let settings = Settings::default();
    for name in SCENES {
        let same_seed = image::<A>(scene(name), 1);
        let noise = relmse(&same_seed, &image::<A>(scene(name), 2));
        let expected = prepare::<A>(scene(name)).replicate(&settings, 4, 0..16);
        for exponent in [-6, -3, 3, 6] {
            let desc = scaled(scene(name), 10f64.powi(exponent));
            let found = prepare::<A>(desc.clone()).replicate(&settings, 4, 100..116);
            let what = format!("{} {name} scaled by 1e{exponent}", A::NAME);
            assert_same_images(&what, &found, &expected, Significance::TEST.split(16));
            let difference = relmse(&same_seed, &image::<A>(desc, 1));
            println!("{what}: relMSE {difference:.1e} with the same seed, {noise:.1e} with another");
        }
    }
}

/// Renders with the same seed, so that what differs is what rounding changes: far less than another seed would, and in
/// the mean nothing.
fn assert_rounding_alone(what: &str, expected: &Image<Rgb>, other_seed: &Image<Rgb>, found: &Image<Rgb>) {
    let (difference, noise) = (relmse(expected, found), relmse(expected, other_seed));
    println!("{what}: relMSE {difference:.1e} with the same seed, {noise:.1e} with another");
    assert!(
        difference < noise,
        "{what}: relMSE {difference:.1e} against {noise:.1e} of noise"
    );
    let differences: Vec<f64> = expected
        .pixels
        .iter()
        .zip(&found.pixels)
        .map(|(a, b)| f64::from(b.luminance()) - f64::from(a.luminance()))
        .collect();
    let mean = expected.pixels.iter().map(|p| f64::from(p.luminance())).sum::<f64>() / differences.len() as f64;
    // Relative to the image's mean, so that its rounding is what the test forgives.
    let difference = Estimate::of(&differences.iter().map(|d| 1.0 + d / mean).collect::<Vec<_>>());
    assert_mean(what, difference, 1.0, Significance::TEST.split(64));
}

fn a_scene_moved_far_away_gives_the_same_image<A: Accel>() {
    let direction = DVec3::new(0.7, -0.4, 1.0);
    for name in SCENES {
        let (expected, other_seed) = (image::<A>(scene(name), 1), image::<A>(scene(name), 2));
        // At 1e9, f64 itself has steps of 1e-7.
        for exponent in [1, 2, 3, 4, 5, 6, 7, 9] {
            let by = direction * 10f64.powi(exponent);
            let in_transforms = image::<A>(moved(scene(name), by), 1);
            assert_rounding_alone(
                &format!("{} {name} moved by 1e{exponent}", A::NAME),
                &expected,
                &other_seed,
                &in_transforms,
            );
            let in_vertices = image::<A>(baked(scene(name), by), 1);
            assert_rounding_alone(
                &format!("{} {name} with vertices moved by 1e{exponent}", A::NAME),
                &expected,
                &other_seed,
                &in_vertices,
            );
        }
    }
}

/// The files of the Cornell box with all coordinates moved, as a program would write them that computes in f64.
fn a_mesh_file_far_from_the_origin_gives_the_same_image<A: Accel>() {
    let by = DVec3::new(4e6, 120.0, -5e5);
    let folder = tempfile::tempdir().expect("a folder");
    let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/cornell");
    for entry in fs::read_dir(&source).expect("the scene's folder") {
        let path = entry.expect("an entry").path();
        if path.extension().is_some_and(|e| e == "obj") {
            let text = fs::read_to_string(&path).expect("a mesh file");
            let moved: String = text.lines().map(|line| move_vertex(line, by) + "\n").collect();
            fs::write(folder.path().join(path.file_name().expect("a name")), moved).expect("a moved mesh file");
        }
    }
    let text = fs::read_to_string(source.join("cornell.toml")).expect("the scene file");
    let mut file: serde_json::Value = toml::from_str(&text).expect("a scene file");
    for key in ["position", "look_at"] {
        for (axis, by) in by.to_array().into_iter().enumerate() {
            let value = &mut file["camera"][key][axis];
            *value = (value.as_f64().expect("a coordinate") + by).into();
        }
    }
    let path = folder.path().join("moved.json");
    fs::write(&path, file.to_string()).expect("the moved scene file");
    let mut desc = load(
        &path,
        LoadOptions {
            strict: true,
            ..LoadOptions::default()
        },
    )
    .expect("the moved scene, without warnings");
    desc.camera.resolution = scene("cornell").camera.resolution;
    assert_rounding_alone(
        &format!("{} cornell in files moved by 4e6", A::NAME),
        &image::<A>(scene("cornell"), 1),
        &image::<A>(scene("cornell"), 2),
        &image::<A>(desc, 1),
    );
}

fn move_vertex(line: &str, by: DVec3) -> String {
    let Some(rest) = line.strip_prefix("v ") else {
        return line.to_owned();
    };
    let p: Vec<f64> = rest.split_whitespace().map(|n| n.parse().expect("a number")).collect();
    format!("v {} {} {}", p[0] + by.x, p[1] + by.y, p[2] + by.z)
}
