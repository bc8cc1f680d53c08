//! What is written beside the image: first hits against what is known of planes and spheres, and the parts of the light
//! against the image.

mod support;

use embrace::accel::Accel;
use embrace::aov::{Aov, FirstHits};
use embrace::camera::Camera;
use embrace::film::Rect;
use embrace::integrator::{Batch, KernelChoice, Lighting, RayCounts, SampleId, Settings, kernel_for};
use embrace::material::{Material, Scattering, Spectrum};
use embrace::math::{Affine2, DAffine3, DVec3, Rgb, Vec2, Vec3};
use embrace::sampling::{Dimension, Sampler};
use embrace::scene::{Scene, SceneDesc, SceneOptions};
use embrace::texture::{Texture, TextureMap};
use support::{
    Estimate, Prepared, Significance, Stage, assert_mean, camera, diffuse, emission, for_each_backend, load_scene,
    opaque, quad, sphere,
};

fn settings(seed: u64) -> Settings {
    Settings {
        seed,
        ..Settings::default()
    }
}

fn load(name: &str) -> SceneDesc {
    let mut desc = load_scene(name);
    let [width, height] = desc.camera.resolution;
    desc.camera.resolution = [48, 48 * height / width];
    desc
}

fn whole(scene: &Scene) -> Rect {
    let [x1, y1] = scene.camera.resolution();
    Rect { x0: 0, y0: 0, x1, y1 }
}

fn first_hits_of<A: Accel>(prepared: &Prepared<A>, crop: Rect, seed: u64, spp: u32) -> FirstHits {
    let Prepared { scene, accel, .. } = prepared;
    let kernel = kernel_for(scene, KernelChoice::Auto);
    FirstHits::trace(scene, accel, kernel, &settings(seed), crop, spp, &|| false).expect("nobody stops it")
}

/// A layer of the whole image by pixel.
fn first_hits<A: Accel, const N: usize>(prepared: &Prepared<A>, seed: u64, spp: u32, aov: Aov) -> Vec<[f32; N]> {
    layer(&first_hits_of(prepared, whole(&prepared.scene), seed, spp), aov)
}

fn layer<const N: usize>(hits: &FirstHits, aov: Aov) -> Vec<[f32; N]> {
    let layer = hits.layer(aov).expect("a layer of the first hit");
    assert_eq!((layer.name, layer.channels.len()), (aov.name(), N));
    layer.values.as_chunks().0.to_vec()
}

/// A floor at y = 0, seen from a height of 2 by a camera with a lens, whose image has sky above.
fn floor_seen_through_a_lens() -> Stage {
    let mut view = camera(Vec3::new(0.3, 2.0, 1.0), Vec3::new(0.0, 1.0, -4.0), 60.0, [23, 18]);
    view.aperture_radius = 0.05;
    view.focus_distance = Some(6.0);
    let floor = quad(Vec3::new(-500.0, 0.0, 500.0), Vec3::X * 1000.0, Vec3::Z * -1000.0);
    Stage::new(view).add(floor, diffuse(0.5)).lit_by_constant(1.0)
}

/// By pixel, the means over the first samples of where their rays meet y = 0, in f64: point and depth; none if no ray does.
fn floor_by_hand(view: &Camera, spp: u32, seed: u64, forward: DVec3) -> Vec<Option<(DVec3, f64)>> {
    let [width, height] = view.resolution();
    let pixels = (0..height).flat_map(|y| (0..width).map(move |x| (x, y)));
    pixels
        .map(|(x, y)| {
            let points: Vec<(DVec3, f64)> = (0..spp)
                .filter_map(|sample| {
                    let sampler = Sampler::new(Settings::default().sampler, seed, x, y, sample);
                    let (jitter, lens) = (sampler.get_2d(Dimension::Pixel), sampler.get_2d(Dimension::Lens));
                    let ray = view.ray(x, y, jitter, lens);
                    let (o, d) = (ray.origin.as_dvec3(), ray.direction.as_dvec3());
                    let p = o + d * (-o.y / d.y);
                    // The floor ends at 500; few pixels see so far.
                    (d.y < 0.0 && p.abs().max_element() < 500.0).then(|| (p, (p - o).dot(forward)))
                })
                .collect();
            let n = points.len() as f64;
            let sum = |(p, z): (DVec3, f64), (q, w): &(DVec3, f64)| (p + q, z + w);
            (!points.is_empty()).then(|| {
                let (p, z) = points.iter().fold((DVec3::ZERO, 0.0), sum);
                (p / n, z / n)
            })
        })
        .collect()
}

/// Through the same points of pixel and lens as the image, box-filtered, at every distance.
fn a_plane_has_the_position_depth_and_normal_of_the_rays_of_the_image<A: Accel>() {
    let stage = floor_seen_through_a_lens();
    let prepared = stage.build::<A>(SceneOptions::default());
    let desc = &stage.0.camera;
    let forward = (desc.look_at - desc.position).normalize();
    for spp in [1, 16] {
        let hits = first_hits_of(&prepared, whole(&prepared.scene), 5, spp);
        let (positions, depths) = (layer::<3>(&hits, Aov::Position), layer::<1>(&hits, Aov::Depth));
        let normals = layer::<3>(&hits, Aov::Normal);
        let expected = floor_by_hand(&prepared.scene.camera, spp, 5, forward);
        let (mut floor, mut sky, mut horizon) = (0, 0, 0);
        for (i, expected) in expected.into_iter().enumerate() {
            let position = DVec3::from(positions[i].map(f64::from));
            let Some((p, z)) = expected else {
                assert_eq!(
                    (positions[i], normals[i], depths[i]),
                    ([0.0; 3], [0.0; 3], [f32::INFINITY])
                );
                sky += 1;
                continue;
            };
            assert!((position - p).length() <= 1e-4 * p.length(), "{position} for {p}");
            assert!(
                (f64::from(depths[i][0]) - z).abs() <= 1e-4 * z,
                "{:?} for {z}",
                depths[i]
            );
            // Rays of a pixel on the horizon that meet nothing have no normal.
            assert!(normals[i][0] == 0.0 && normals[i][2] == 0.0 && normals[i][1] <= 1.0);
            if normals[i][1] == 1.0 {
                floor += 1;
            } else {
                assert!(normals[i][1] > 0.0);
                horizon += 1;
            }
        }
        assert!(
            floor > 100 && sky > 50 && (spp == 1 || horizon > 10),
            "{floor} {sky} {horizon}"
        );
    }
}

/// The normal that vertex normals of a sphere interpolate to is the direction from its centre.
fn a_smooth_sphere_has_the_normals_of_a_sphere_towards_the_viewer<A: Accel>() {
    let (centre, radius) = (Vec3::new(1.0, 2.0, 3.0), 1.5f32);
    for (eye, side) in [(Vec3::new(1.0, 3.0, 9.0), 1.0), (Vec3::new(1.2, 2.5, 3.0), -1.0)] {
        let view = camera(eye, centre, 30.0, [20, 20]);
        let stage = Stage::new(view).add(sphere(centre, radius, 128, true), diffuse(0.5));
        let prepared = stage.build::<A>(SceneOptions::default());
        let normals = first_hits::<A, 3>(&prepared, 3, 1, Aov::Normal);
        let positions = first_hits::<A, 3>(&prepared, 3, 1, Aov::Position);
        let mut seen = 0;
        for (normal, position) in normals.into_iter().zip(positions) {
            let (normal, p) = (Vec3::from(normal), Vec3::from(position));
            if normal == Vec3::ZERO {
                continue;
            }
            let out = (p - centre).normalize();
            // At the silhouette normals are bent towards the viewer.
            if (out * side).dot((eye - p).normalize()) > 0.1 {
                assert!((normal - out * side).length() < 1e-4, "{normal} for {out}");
                seen += 1;
            }
            assert!(((p - centre).length() / radius - 1.0).abs() < 1e-3, "{p}");
            assert!(normal.dot((eye - p).normalize()) > 0.0);
        }
        assert!(seen > 100, "{seen} pixels");
    }
}

/// The image of the camera is two by two, and the bitmap repeats five times along it.
fn the_albedo_of_a_textured_floor_is_the_mean_of_its_texture<A: Accel>() {
    let pixels: Vec<Rgb> = (0..12u8)
        .map(|i| Rgb::new(f32::from(i) / 12.0, 0.25, f32::from(i % 5) / 5.0))
        .collect();
    let mean = [0, 1, 2].map(|c| pixels.iter().map(|p| f64::from(p[c])).sum::<f64>() / 12.0);
    let tint = Rgb::new(0.5, 1.0, 0.75);
    let reflectance = Spectrum::Bitmap(
        TextureMap {
            to_uv: Affine2::from_scale_angle_translation(Vec2::splat(10.0), 0.0, Vec2::new(0.1, 0.7)),
            ..TextureMap::new(0)
        },
        tint,
    );
    let floor = quad(Vec3::new(-2.0, 0.0, 2.0), Vec3::X * 4.0, Vec3::Z * -4.0);
    let view = camera(Vec3::Y, Vec3::ZERO, 90.0, [16, 16]);
    let mut stage = Stage::new(view).add(floor, opaque(Scattering::Diffuse { reflectance }));
    stage.0.textures.push(Texture::Rgb32(embrace::image::Image {
        width: 4,
        height: 3,
        pixels,
    }));
    let prepared = stage.build::<A>(SceneOptions::default());
    let means: Vec<[f64; 3]> = (0..16)
        .map(|seed| {
            let albedo = first_hits::<A, 3>(&prepared, seed, 16, Aov::Albedo);
            [0, 1, 2].map(|c| albedo.iter().map(|p| f64::from(p[c])).sum::<f64>() / albedo.len() as f64)
        })
        .collect();
    for c in 0..3 {
        let estimate = Estimate::of(&means.iter().map(|m| m[c]).collect::<Vec<_>>());
        assert!(estimate.standard_error < 2e-3, "{estimate:?}");
        let expected = mean[c] * f64::from(tint[c]);
        assert_mean("albedo", estimate, expected, Significance::TEST.split(3));
    }
}

/// Of a pane that a quarter of light meets, in front of a wall.
fn a_sample_sees_the_first_surface_that_is_there_for_it<A: Accel>() {
    let pane = Material {
        opacity: Some(Spectrum::Constant(Rgb::splat(0.25))),
        ..diffuse(1.0)
    };
    let wall = |z: f32| quad(Vec3::new(-20.0, -20.0, z), Vec3::X * 40.0, Vec3::Y * 40.0);
    let stage = Stage::new(camera(Vec3::ZERO, Vec3::NEG_Z, 40.0, [16, 16]))
        .add(wall(-2.0), pane)
        .add(wall(-6.0), diffuse(0.5));
    let prepared = stage.build::<A>(SceneOptions::default());
    let mut near = [0.0; 16];
    for (seed, near) in (0..).zip(&mut near) {
        let hits = first_hits_of(&prepared, whole(&prepared.scene), seed, 1);
        for ([depth], [albedo, ..]) in layer::<1>(&hits, Aov::Depth)
            .into_iter()
            .zip(layer::<3>(&hits, Aov::Albedo))
        {
            let is_near = (depth - 2.0).abs() < 1e-5;
            assert!(is_near || (depth - 6.0).abs() < 1e-5, "{depth}");
            assert_eq!(albedo, if is_near { 1.0 } else { 0.5 });
            *near += f64::from(u8::from(is_near)) / 256.0;
        }
    }
    assert_mean("share of the pane", Estimate::of(&near), 0.25, Significance::TEST);
}

/// The scene is rendered near the origin, and its positions are those of the file.
fn positions_are_in_the_coordinates_of_the_file_however_far_off<A: Accel>() {
    let stage = |shift: DVec3| {
        let mut stage = Stage::new(camera(Vec3::new(0.0, 1.0, 5.0), Vec3::ZERO, 40.0, [16, 12])).add_at(
            sphere(Vec3::ZERO, 1.0, 32, false),
            diffuse(0.5),
            None,
            &[DAffine3::from_translation(shift)],
        );
        stage.0.camera.position += shift;
        stage.0.camera.look_at += shift;
        stage.build::<A>(SceneOptions::default())
    };
    let shift = DVec3::new(4_000_000.0, -250.0, 1_000_000.0);
    let [near, far] = [DVec3::ZERO, shift].map(|shift| {
        let prepared = stage(shift);
        first_hits_of(&prepared, whole(&prepared.scene), 1, 4)
    });
    let mut seen = 0;
    for (i, depth) in layer::<1>(&near, Aov::Depth).into_iter().enumerate() {
        let far_depth = layer::<1>(&far, Aov::Depth)[i];
        if depth[0].is_infinite() {
            assert_eq!(far_depth, depth);
            continue;
        }
        seen += 1;
        assert!((far_depth[0] - depth[0]).abs() < 1e-4, "{far_depth:?} for {depth:?}");
        let [near, far] = [&near, &far].map(|hits| DVec3::from(layer::<3>(hits, Aov::Position)[i].map(f64::from)));
        // Half of the last place of the f32 that is written.
        let difference = (far - shift - near).abs();
        assert!(difference.cmple(DVec3::new(0.25, 1e-4, 0.0625)).all(), "{difference}");
    }
    assert!(seen > 30, "{seen} pixels");
}

fn first_hits_depend_neither_on_the_crop_nor_on_threads<A: Accel>() {
    let prepared = Prepared::<A>::new(load("glass"), SceneOptions::default());
    let [width, height] = prepared.scene.camera.resolution();
    let pool = |threads| {
        rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .expect("threads")
    };
    let all = pool(1).install(|| first_hits_of(&prepared, whole(&prepared.scene), 1, 8));
    let again = pool(3).install(|| first_hits_of(&prepared, whole(&prepared.scene), 1, 8));
    assert!(all == again, "with other threads");
    let crop = Rect {
        x0: 5,
        y0: 3,
        x1: width - 2,
        y1: height - 1,
    };
    let part = first_hits_of(&prepared, crop, 1, 8);
    for aov in [Aov::Albedo, Aov::Normal, Aov::Position] {
        let (all, part) = (layer::<3>(&all, aov), layer::<3>(&part, aov));
        let inside = crop.coordinates().map(|(x, y)| all[(y * width + x) as usize]);
        assert!(inside.eq(part), "{}", aov.name());
    }
    // No more than 64 samples are taken.
    let many = first_hits_of(&prepared, Rect { x1: 6, y1: 4, ..crop }, 1, 1000);
    assert!(many == first_hits_of(&prepared, Rect { x1: 6, y1: 4, ..crop }, 1, 64));
}

fn first_hits_can_be_stopped<A: Accel>() {
    let prepared = Prepared::<A>::new(load("glass"), SceneOptions::default());
    let Prepared { scene, accel, .. } = &prepared;
    let kernel = kernel_for(scene, KernelChoice::Auto);
    assert_eq!(
        FirstHits::trace(scene, accel, kernel, &settings(0), whole(scene), 4, &|| true),
        None
    );
}

/// Radiance and its direct part by sample.
fn samples<A: Accel>(
    prepared: &Prepared<A>,
    settings: &Settings,
    mut batch: Batch,
) -> Vec<(SampleId, Rgb, Option<Rgb>)> {
    let Prepared { scene, accel, .. } = prepared;
    let kernel = kernel_for(scene, KernelChoice::Auto);
    let mut ids = whole(scene).blocks().flat_map(|block| {
        (0..4).flat_map(move |sample| block.coordinates().map(move |(x, y)| SampleId { sample, y, x }))
    });
    let (mut samples, mut counts) = (Vec::new(), RayCounts::default());
    while batch.fill(&mut ids) {
        kernel.trace(scene, accel, settings, &mut batch, &mut counts);
        let direct: Vec<Rgb> = batch.direct().collect();
        let results = batch.results().enumerate();
        samples.extend(results.map(|(i, (id, radiance, _))| (id, radiance, direct.get(i).copied())));
    }
    samples
}

/// Sample by sample, to the bit: the image of direct light alone takes the same random numbers.
fn the_direct_part_of_a_sample_is_the_sample_of_direct_light_alone<A: Accel>() {
    for name in ["glass", "spheres", "cornell"] {
        let prepared = Prepared::<A>::new(load(name), SceneOptions::default());
        for base in [
            settings(3),
            Settings {
                seed: 3,
                ..Settings::article()
            },
        ] {
            let only = Settings {
                lighting: Lighting::Direct,
                ..base
            };
            let split = samples(&prepared, &base, Batch::with_direct());
            let plain = samples(&prepared, &base, Batch::default());
            let direct = samples(&prepared, &only, Batch::with_direct());
            let (mut with_direct, mut with_indirect) = (0, 0);
            for ((split, plain), direct) in split.iter().zip(&plain).zip(&direct) {
                assert_eq!((split.0, split.1, None), *plain, "{name}: the image does not change");
                let part = split.2.expect("the direct part");
                assert_eq!((split.0, part), (direct.0, direct.1), "{name}");
                assert_eq!(direct.2, Some(direct.1), "{name}: all of direct light is direct");
                let rest = split.1 - part;
                assert!([0, 1, 2].iter().all(|&c| rest[c] >= 0.0), "{name}: {rest:?}");
                with_direct += usize::from(!part.is_black());
                with_indirect += usize::from(!rest.is_black());
            }
            assert!(
                with_direct.min(with_indirect) > split.len() / 20,
                "{name}: {with_direct} {with_indirect}"
            );
        }
    }
}

/// A scene in which every path ends at once: what is seen is direct.
fn light_that_is_seen_directly_is_direct<A: Accel>() {
    let lamp = quad(Vec3::new(-20.0, -20.0, -2.0), Vec3::X * 40.0, Vec3::Y * 40.0);
    let stage = Stage::new(camera(Vec3::ZERO, Vec3::NEG_Z, 40.0, [4, 4]));
    for stage in [
        stage.clone().add_light(lamp, diffuse(0.0), emission(3.0)),
        stage.lit_by_constant(3.0),
    ] {
        let prepared = stage.prepare::<A>(&settings(1));
        for (_, radiance, direct) in samples(&prepared, &settings(1), Batch::with_direct()) {
            assert_eq!((radiance, direct), (Rgb::splat(3.0), Some(Rgb::splat(3.0))));
        }
    }
}

/// But for the few rays that a vertex or an edge leads elsewhere.
#[cfg(all(feature = "embree", feature = "obvhs"))]
#[test]
fn backends_see_the_same_first_surfaces() {
    use embrace::accel::{BuildOptions, embree::Embree, obvhs::Obvhs};
    fn of<A: Accel>(scene: &Scene) -> FirstHits {
        let accel = A::build(&scene.geometry, BuildOptions::default()).expect("the backend can be built");
        let kernel = kernel_for(scene, KernelChoice::Auto);
        FirstHits::trace(scene, &accel, kernel, &settings(1), whole(scene), 4, &|| false).expect("nobody stops it")
    }
    for name in ["glass", "spheres", "cornell", "many-lights"] {
        let scene = Scene::build(load(name), SceneOptions::default()).expect("the scenes can be built");
        let (a, b) = (of::<Embree>(&scene), of::<Obvhs>(&scene));
        for aov in [Aov::Albedo, Aov::Normal, Aov::Position] {
            let (a, b) = (layer::<3>(&a, aov), layer::<3>(&b, aov));
            let differ = |(a, b): &(&[f32; 3], &[f32; 3])| {
                let [a, b] = [a, b].map(|v| Vec3::from(**v));
                (a - b).length() > 1e-3 * a.length().max(1.0)
            };
            let count = a.iter().zip(&b).filter(differ).count();
            assert!(
                count * 500 <= a.len(),
                "{name}, {}: {count} of {} pixels",
                aov.name(),
                a.len()
            );
        }
    }
}

for_each_backend! {
    a_plane_has_the_position_depth_and_normal_of_the_rays_of_the_image
    a_smooth_sphere_has_the_normals_of_a_sphere_towards_the_viewer
    the_albedo_of_a_textured_floor_is_the_mean_of_its_texture
    a_sample_sees_the_first_surface_that_is_there_for_it
    positions_are_in_the_coordinates_of_the_file_however_far_off
    light_that_is_seen_directly_is_direct
}

mod without_brute {
    use super::*;
    for_each_backend! {
        but not brute:
        first_hits_depend_neither_on_the_crop_nor_on_threads
        first_hits_can_be_stopped
        the_direct_part_of_a_sample_is_the_sample_of_direct_light_alone
    }
}
