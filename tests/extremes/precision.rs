//! What f32 costs: the renderer against the same estimator in f64, with identical random numbers.

mod parting;
mod recorder;
mod report;

use crate::reference::Reference;
use crate::support::{
    ROUNDING, Stage, camera, cuboid, diffuse, emission, for_each_backend, opaque, quad, sphere, write_failure,
};
use embrace::accel::Accel;
use embrace::camera::CameraDesc;
use embrace::image::{Image, flip};
use embrace::integrator::{SampleId, Settings};
use embrace::material::{Material, Scattering, Spectrum};
use embrace::math::{DAffine3, DVec3, Rgb, Vec3, srgb_decode};
use parting::{Cause, Parting};
use recorder::Recorder;
use report::Report;

const RESOLUTION: u32 = 64;
const SPP: u32 = 16;

/// Change of radiance per change of direction, relative: of the scenes' sharpest lobe, GGX of width 0.02 with at most 2
/// over its width.
const STEEPEST: f64 = 100.0;

/// What counts as a visible difference of a pixel.
const VISIBLE: f64 = 0.01;

for_each_backend! {
    a_box_of_metal_and_glass_is_rendered_as_in_f64
    smooth_balls_under_a_sky_are_rendered_as_in_f64
}

fn coloured(r: f32, g: f32, b: f32) -> Material {
    opaque(Scattering::Diffuse {
        reflectance: Spectrum::Constant(Rgb::new(r, g, b)),
    })
}

fn glass(alpha: f32) -> Material {
    opaque(Scattering::Dielectric { ior: 1.5, alpha })
}

fn plastic() -> Material {
    opaque(Scattering::Plastic {
        reflectance: Spectrum::Constant(Rgb::new(0.5, 0.45, 0.3)),
        specular: Rgb::splat(0.04),
        alpha: 0.15,
    })
}

fn gold(alpha: f32) -> Material {
    opaque(Scattering::Conductor {
        eta: Rgb::new(0.183, 0.422, 1.373),
        k: Rgb::new(3.424, 2.346, 1.770),
        alpha,
    })
}

/// A room, open in front, with a mirror on a wall and a lamp at its ceiling, a block of rough metal and one of clear glass.
fn metal_and_glass() -> Stage {
    let white = diffuse(0.75);
    let mirror = opaque(Scattering::Mirror {
        reflectance: Rgb::new(0.9, 0.85, 0.8),
    });
    let [x, y, z] = [Vec3::X * 2.0, Vec3::Y * 2.0, Vec3::Z * 2.0];
    let block = |half: Vec3| cuboid(-half, half, false);
    let turned = |angle: f64, place: DVec3| [DAffine3::from_translation(place) * DAffine3::from_rotation_y(angle)];
    Stage::new(camera(
        Vec3::new(0.1, 0.2, 3.9),
        Vec3::new(0.0, -0.05, 0.0),
        37.0,
        [RESOLUTION; 2],
    ))
    .add(quad(Vec3::new(-1.0, -1.0, -1.0), z, x), plastic())
    .add(quad(Vec3::new(-1.0, 1.0, -1.0), x, z), white.clone())
    .add(quad(Vec3::new(-1.0, -1.0, -1.0), x, y), white.clone())
    .add(quad(Vec3::new(-1.0, -1.0, -1.0), y, z), coloured(0.63, 0.06, 0.05))
    .add(quad(Vec3::new(1.0, -1.0, -1.0), z, y), coloured(0.14, 0.45, 0.09))
    .add(quad(Vec3::new(0.98, -0.4, -0.6), z * 0.4, y * 0.4), mirror)
    .add_light(
        quad(Vec3::new(-0.3, 0.99, -0.3), Vec3::X * 0.6, Vec3::Z * 0.6),
        white,
        emission(15.0),
    )
    .add_at(
        block(Vec3::new(0.28, 0.55, 0.28)),
        gold(0.2),
        None,
        &turned(0.3, DVec3::new(-0.4, -0.449, -0.35)),
    )
    .add_at(
        block(Vec3::new(0.25, 0.25, 0.25)),
        glass(0.0),
        None,
        &turned(-0.4, DVec3::new(0.4, -0.74, 0.3)),
    )
}

/// Coarse spheres with smooth normals, of plaster, rough glass and mirror-like metal, under a sky with a sun, through a lens.
fn balls() -> Stage {
    let ball = |x: f32, z: f32| sphere(Vec3::new(x, 0.5, z), 0.5, 4, true);
    let sky = Image {
        width: 16,
        height: 8,
        pixels: (0..128)
            .map(|i| match i {
                37 => Rgb::new(60.0, 50.0, 40.0),
                _ => Rgb::new(0.4, 0.5, 0.7) * (1.0 + 0.1 * (i % 7) as f32),
            })
            .collect(),
    };
    let view = camera(
        Vec3::new(0.3, 1.7, 4.2),
        Vec3::new(0.0, 0.4, 0.0),
        42.0,
        [RESOLUTION; 2],
    );
    Stage::new(CameraDesc {
        aperture_radius: 0.03,
        ..view
    })
    .add(
        quad(Vec3::new(-3.0, 0.0, -3.0), Vec3::Z * 6.0, Vec3::X * 6.0),
        plastic(),
    )
    .add(ball(-1.05, 0.0), diffuse(0.8))
    .add(ball(0.0, 0.3), glass(0.15))
    .add(ball(1.05, 0.0), gold(0.02))
    .lit_by_map(sky, 25.0)
}

fn a_box_of_metal_and_glass_is_rendered_as_in_f64<A: Accel>() {
    compare_at_the_extremes::<A>("box", &metal_and_glass());
}

fn smooth_balls_under_a_sky_are_rendered_as_in_f64<A: Accel>() {
    compare_at_the_extremes::<A>("balls", &balls());
}

/// A scene of about unit size as it is, tiny (and under a grey sky), huge, and off in the corner of a scene a thousand times
/// its size.
fn compare_at_the_extremes<A: Accel>(name: &str, stage: &Stage) {
    let scaled = |scale: f64| moved(stage, DAffine3::from_scale(DVec3::splat(scale)), 32);
    compare::<A>(name, stage, 1.0);
    compare::<A>(&format!("{name} of 3e-6"), &scaled(3e-6).lit_by_constant(0.2), 3e-6);
    compare::<A>(&format!("{name} of 1e6"), &scaled(1e6), 1e6);
    let corner = DVec3::splat(1000.0);
    let opposite = quad(-corner.as_vec3(), Vec3::X, Vec3::Y);
    let in_a_corner = moved(stage, DAffine3::from_translation(corner), 32).add(opposite, diffuse(0.5));
    compare::<A>(&format!("{name} in a corner"), &in_a_corner, 1.0);
}

/// The same scene elsewhere, seen at another resolution.
fn moved(stage: &Stage, to_world: DAffine3, resolution: u32) -> Stage {
    let mut stage = stage.clone();
    let camera = &mut stage.0.camera;
    camera.position = to_world.transform_point3(camera.position);
    camera.look_at = to_world.transform_point3(camera.look_at);
    camera.aperture_radius *= to_world.matrix3.x_axis.length();
    camera.resolution = [resolution; 2];
    for object in &mut stage.0.objects {
        object.to_world = to_world * object.to_world;
    }
    stage
}

/// A sample in both precisions.
struct Sample {
    id: SampleId,
    narrow: DVec3,
    wide: DVec3,
    parting: Parting,
}

/// A pixel in both precisions.
struct Pixel {
    samples: Vec<Sample>,
    narrow: DVec3,
    wide: DVec3,
}

impl Sample {
    /// Whether the two paths part at a decision that rounding turns, or part nowhere and differ by no more than the sharpest
    /// lobe makes of the distance between their rays.
    fn is_explained(&self) -> bool {
        let Parting {
            cause, close, drift, ..
        } = self.parting;
        close
            && (cause != Cause::Rounding || relative_difference(self.narrow, self.wide) <= STEEPEST * drift + ROUNDING)
    }
}

impl Pixel {
    fn new(samples: Vec<Sample>) -> Pixel {
        let mean = |of: fn(&Sample) -> DVec3| samples.iter().map(of).sum::<DVec3>() / samples.len() as f64;
        Pixel {
            narrow: mean(|s| s.narrow),
            wide: mean(|s| s.wide),
            samples,
        }
    }

    fn relative_difference(&self) -> f64 {
        relative_difference(self.narrow, self.wide)
    }

    /// What is left of the difference without the samples that are explained.
    fn unexplained_difference(&self) -> f64 {
        let samples = self.samples.iter().filter(|s| !s.is_explained());
        let rest: DVec3 = samples.map(|s| s.narrow - s.wide).sum();
        relative_difference(self.wide + rest / self.samples.len() as f64, self.wide)
    }

    /// The sample that differs most.
    fn culprit(&self) -> &Sample {
        let difference = |s: &Sample| (s.narrow - s.wide).abs().max_element();
        let worst = self
            .samples
            .iter()
            .max_by(|a, b| difference(a).total_cmp(&difference(b)));
        worst.expect("a pixel has samples")
    }
}

/// The largest difference of a channel over the largest channel.
fn relative_difference(narrow: DVec3, wide: DVec3) -> f64 {
    let largest = narrow.max(wide).max_element();
    if largest > 0.0 {
        (narrow - wide).abs().max_element() / largest
    } else {
        0.0
    }
}

/// Renders a scene in both precisions and holds every difference against what rounding can do. `size` is that of its
/// features.
fn compare<A: Accel>(name: &str, stage: &Stage, size: f64) {
    let settings = Settings::default();
    let prepared = stage.prepare::<Recorder<A>>(&settings);
    let reference = Reference::new(&stage.0, &prepared.scene, &settings);
    let sample = |id| {
        let narrow = recorder::path(&prepared.scene, &prepared.accel, &settings, id);
        let wide = reference.path(id);
        Sample {
            id,
            narrow: DVec3::from(narrow.radiance.to_array().map(f64::from)),
            wide: wide.radiance,
            parting: parting::find(&reference, &narrow.vertices, &wide.vertices, size),
        }
    };
    let [width, height] = stage.0.camera.resolution;
    let pixel = |i: u32| {
        let (x, y) = (i % width, i / width);
        Pixel::new((0..SPP).map(|s| sample(SampleId { sample: s, y, x })).collect())
    };
    let pixels: Vec<Pixel> = (0..width * height).map(pixel).collect();
    let name = format!("{name} on {}", A::NAME);

    // What was compared is what is rendered.
    let rendered = stage.prepare::<A>(&settings).image(&settings, SPP);
    let narrow = Image {
        width,
        height,
        pixels: pixels.iter().map(|p| Rgb::from(p.narrow.to_array())).collect(),
    };
    assert!(narrow == rendered, "{name}: single samples do not give the image");

    // Rays start 2^-20 of the largest coordinate off their surface: where f32 differs most from f64.
    let offset = 2f64.powi(-20) * reference.geometry.reach() / size;
    let report = Report::new(&pixels);
    println!("{name}: {report}");
    let problems = report.problems(&pixels, offset);
    if !problems.is_empty() || std::env::var_os("EMBRACE_TEST_IMAGES").is_some() {
        let folder = write_failure(
            &name,
            &[("f32", &narrow), ("difference", &difference_map(width, &pixels))],
        );
        assert!(
            problems.is_empty(),
            "{name}: {}; images in {}",
            problems.join("; "),
            folder.display()
        );
    }
}

/// Decades of relative difference from 1e-8, black, to 1, white.
fn difference_map(width: u32, pixels: &[Pixel]) -> Image<Rgb> {
    let decades = |p: &Pixel| (1.0 + p.relative_difference().max(1e-8).log10() / 8.0) as f32;
    let map = flip::heat_map(&Image {
        width,
        height: pixels.len() as u32 / width,
        pixels: pixels.iter().map(decades).collect(),
    });
    Image {
        width: map.width,
        height: map.height,
        // Writing encodes them again.
        pixels: map
            .pixels
            .iter()
            .map(|p| Rgb::from(p.map(|c| srgb_decode(f32::from(c) / 255.0))))
            .collect(),
    }
}
