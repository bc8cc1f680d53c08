//! What a scene does not need costs nothing, and what it needs is computed alike by the small kernel and the large one.

mod support;

use embrace::accel::{Accel, BuildOptions};
use embrace::film::Rect;
use embrace::image::Image;
use embrace::integrator::{BounceSampling, Kernel, KernelChoice, Roulette, Settings, kernel_for};
use embrace::light::EnvSampling;
use embrace::material::Back;
use embrace::math::{DVec3, Rgb};
use embrace::render::{ErrorControl, Job, render};
use embrace::scene::{Instancing, LightDesc, LoadOptions, Scene, SceneDesc, SceneFeatures, SceneOptions, load};
use embrace::texture::{Encoding, Texture};
use std::fs;
use std::path::{Path, PathBuf};
use support::for_each_backend;
use tempfile::TempDir;

for_each_backend! { but not brute:
    the_kernel_for_a_scene_gives_the_image_of_the_general_one
    the_kernel_for_a_set_of_features_gives_the_image_of_the_general_one
    every_estimator_is_the_same_in_both_kernels
    what_is_fetched_ahead_is_what_is_fetched_at_once
    instancing_does_not_change_what_a_scene_requires
}

/// The scenes of the repository, and what each requires.
const SCENES: [(&str, &[&str]); 6] = [
    ("cornell", &["area-lights"]),
    ("furnace", &["area-lights"]),
    (
        "glass",
        &["environment", "area-lights", "textures", "smooth-normals", "specular"],
    ),
    (
        "many-lights",
        &["area-lights", "textures", "smooth-normals", "specular"],
    ),
    (
        "spheres",
        &["environment", "area-lights", "textures", "smooth-normals", "specular"],
    ),
    ("veach-mis", &["area-lights", "smooth-normals", "specular"]),
];

fn scene_path(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("scenes/{name}/{name}.toml"))
}

/// The scene at a small resolution.
fn built(path: &Path, options: SceneOptions) -> Scene {
    Scene::build(described(path), options).unwrap()
}

fn described(path: &Path) -> SceneDesc {
    let mut desc = load(
        path,
        LoadOptions {
            strict: true,
            ..LoadOptions::default()
        },
    )
    .unwrap();
    desc.camera.resolution = [24, 16];
    desc
}

fn image<A: Accel>(scene: &Scene, accel: &A, kernel: Kernel, settings: Settings) -> Image<Rgb> {
    let [x1, y1] = scene.camera.resolution();
    let crop = Rect { x0: 0, y0: 0, x1, y1 };
    let job = Job {
        crop,
        spp: 8,
        error: ErrorControl::Ignored,
        split_direct: false,
        settings,
    };
    let (film, report) = render(scene, accel, kernel, &job);
    assert_eq!(report.dropped.count, 0);
    film.develop()
}

/// Renders by the kernel for the scene and by the general one, which must agree in every bit.
fn assert_kernels_agree<A: Accel>(scene: &Scene, settings: Settings, what: &str) {
    let accel = A::build(&scene.geometry, BuildOptions::default()).unwrap();
    let kernels = [KernelChoice::Auto, KernelChoice::General].map(|choice| kernel_for(scene, choice));
    let features = kernels[0].features;
    assert!(
        features.contains(scene.features),
        "{what}: {features} for {}",
        scene.features
    );
    let [special, general] = kernels.map(|kernel| image(scene, &accel, kernel, settings));
    assert!(
        bits(&special) == bits(&general),
        "{what}: the kernel {features} differs from the general one"
    );
    let is_lit = image_has_light(&special);
    let has_light = [
        SceneFeatures::ENVIRONMENT,
        SceneFeatures::AREA_LIGHTS,
        SceneFeatures::PUNCTUAL,
    ]
    .iter()
    .any(|lights| scene.features.contains(*lights));
    assert_eq!(is_lit, has_light, "{what}");
}

fn bits(image: &Image<Rgb>) -> Vec<[u32; 3]> {
    image.pixels.iter().map(|p| p.to_array().map(f32::to_bits)).collect()
}

fn image_has_light(image: &Image<Rgb>) -> bool {
    image.pixels.iter().any(|p| !p.is_black())
}

fn limited() -> Settings {
    Settings {
        max_depth: Some(6),
        ..Settings::default()
    }
}

fn the_kernel_for_a_scene_gives_the_image_of_the_general_one<A: Accel>() {
    for (name, _) in SCENES {
        let scene = built(&scene_path(name), SceneOptions::default());
        assert_kernels_agree::<A>(&scene, limited(), name);
    }
}

/// A scene with exactly these features: a floor, a ball above it, a lamp, a sky.
fn scene_with(features: SceneFeatures, env_sampling: EnvSampling) -> (TempDir, Scene) {
    let has = |feature| features.contains(feature);
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, content: &str| fs::write(folder.path().join(name), content).unwrap();
    let mut scene = String::from(
        "[camera]\nposition = [0, 1.2, 4]\nlook_at = [0, 0.5, 0]\nvfov = 40\nresolution = [24, 16]\n\
         [materials.grey]\ntype = \"diffuse\"\nrgb = [0.5, 0.6, 0.7]\n",
    );
    if has(SceneFeatures::ENVIRONMENT) {
        scene += "[environment]\nfile = \"sky.exr\"\n";
        let mut sky = Image::filled(8, 4, Rgb::new(0.1, 0.2, 0.4));
        sky.pixels[10] = Rgb::splat(20.0);
        let mut bytes = Vec::new();
        embrace::image::exr::write(&mut bytes, &sky, &Default::default(), Path::new("sky.exr")).unwrap();
        fs::write(folder.path().join("sky.exr"), bytes).unwrap();
    }
    // The floor names its own material, by which it gets a bitmap or holes.
    scene += "[[meshes]]\nfile = \"floor.obj\"\n";
    let mut library = String::from("newmtl floor\nKd 0.7 0.6 0.5\n");
    if has(SceneFeatures::TEXTURES) {
        library += "map_Kd tiles.png\n";
        let tiles = Image {
            width: 2,
            height: 1,
            pixels: vec![[200, 90, 30], [20, 90, 130]],
        };
        let mut bytes = Vec::new();
        embrace::image::ldr::write_png(&mut bytes, &tiles, Path::new("tiles.png")).unwrap();
        fs::write(folder.path().join("tiles.png"), bytes).unwrap();
    }
    if has(SceneFeatures::CUTOUTS) {
        library += "d 0.5\n";
    }
    write("floor.mtl", &library);
    write(
        "floor.obj",
        "mtllib floor.mtl\nusemtl floor\nv -2 0 2\nv 2 0 2\nv 2 0 -2\nv -2 0 -2\n\
         vt 0 0\nvt 3 0\nvt 3 3\nvt 0 3\nf 1/1 2/2 3/3 4/4\n",
    );
    // An octahedron, which is a rough ball when it has normals.
    let normals = "vn 1 0 0\nvn -1 0 0\nvn 0 1 0\nvn 0 -1 0\nvn 0 0 1\nvn 0 0 -1\n";
    let mut ball = String::from("v 0.6 0.7 0\nv -0.6 0.7 0\nv 0 1.3 0\nv 0 0.1 0\nv 0 0.7 0.6\nv 0 0.7 -0.6\n");
    let smooth = has(SceneFeatures::SMOOTH_NORMALS);
    if smooth {
        ball += normals;
    }
    for face in [
        [1, 3, 5],
        [3, 2, 5],
        [2, 4, 5],
        [4, 1, 5],
        [3, 1, 6],
        [2, 3, 6],
        [4, 2, 6],
        [1, 4, 6],
    ] {
        let corners = face.map(|v| if smooth { format!("{v}//{v}") } else { v.to_string() });
        ball += &format!("f {}\n", corners.join(" "));
    }
    write("ball.obj", &ball);
    let ball_material = if has(SceneFeatures::SPECULAR) { "metal" } else { "grey" };
    scene += &format!("[[meshes]]\nfile = \"ball.obj\"\nmaterial = \"{ball_material}\"\n");
    if has(SceneFeatures::AREA_LIGHTS) {
        write("lamp.obj", "v -0.5 2 0.5\nv 0.5 2 0.5\nv 0 2 -0.5\nf 1 3 2\n");
        scene += "[[meshes]]\nfile = \"lamp.obj\"\nmaterial = \"grey\"\nemission = { radiance = [9, 8, 7] }\n";
    }
    if has(SceneFeatures::SPECULAR) {
        scene += "[materials.metal]\ntype = \"conductor\"\neta = [0.2, 0.4, 1.4]\nk = [3.4, 2.3, 1.8]\nalpha = 0.2\n";
    }
    write("scene.toml", &scene);
    let options = SceneOptions {
        env_sampling,
        ..SceneOptions::default()
    };
    let mut desc = described(&folder.path().join("scene.toml"));
    if has(SceneFeatures::GENERAL) {
        for (_, material) in &mut desc.materials {
            material.back = Back::Black;
        }
    }
    if has(SceneFeatures::PUNCTUAL) {
        desc.lights = vec![
            LightDesc::Point {
                position: DVec3::new(1.0, 1.5, 1.0),
                intensity: Rgb::splat(2.0),
            },
            LightDesc::Distant {
                direction: DVec3::new(1.0, -2.0, -1.0),
                irradiance: Rgb::splat(2.0),
                radius: 0.1,
            },
        ];
    }
    let scene = Scene::build(desc, options).unwrap();
    assert_eq!(scene.features, features);
    (folder, scene)
}

/// All sets but those of what only the general kernel has, of which some must do.
fn all_sets() -> impl Iterator<Item = SceneFeatures> {
    let rare = SceneFeatures::GENERAL.union(SceneFeatures::PUNCTUAL).0;
    let is_taken = move |set: &u32| set & rare == 0 || matches!((set & !rare).count_ones(), 0 | 1 | 6);
    (0..=SceneFeatures::ALL.0).filter(is_taken).map(SceneFeatures)
}

fn the_kernel_for_a_set_of_features_gives_the_image_of_the_general_one<A: Accel>() {
    for features in all_sets() {
        let (_folder, scene) = scene_with(features, EnvSampling::Importance);
        assert_kernels_agree::<A>(&scene, limited(), &features.to_string());
    }
}

fn every_estimator_is_the_same_in_both_kernels<A: Accel>() {
    let sets = all_sets().filter(|f| f.0.count_ones() <= 2 || f.0.count_ones() >= 5);
    for features in sets {
        let (_folder, scene) = scene_with(features, EnvSampling::Uniform);
        for settings in [
            Settings {
                max_depth: Some(6),
                env_sampling: EnvSampling::Uniform,
                ..Settings::article()
            },
            Settings {
                bounce_sampling: BounceSampling::Cosine,
                mis: false,
                roulette: Roulette::Off,
                ..limited()
            },
            Settings {
                smooth_terminator: false,
                max_depth: Some(1),
                ..limited()
            },
        ] {
            assert_kernels_agree::<A>(&scene, settings, &format!("{features}, {settings:?}"));
        }
    }
}

fn what_is_fetched_ahead_is_what_is_fetched_at_once<A: Accel>() {
    for features in all_sets() {
        let (_folder, scene) = scene_with(features, EnvSampling::Importance);
        let accel = A::build(&scene.geometry, BuildOptions::default()).unwrap();
        for choice in [KernelChoice::Auto, KernelChoice::General] {
            let images = [false, true].map(|fetches_ahead| {
                let mut kernel = kernel_for(&scene, choice);
                kernel.fetches_ahead = fetches_ahead;
                image(&scene, &accel, kernel, limited())
            });
            assert!(bits(&images[0]) == bits(&images[1]), "{features}, {choice:?}");
        }
    }
}

#[test]
fn memory_is_asked_for_ahead_where_the_scene_outgrows_a_cache() {
    let (_folder, mut scene) = scene_with(SceneFeatures::TEXTURES, EnvSampling::Importance);
    assert!(!kernel_for(&scene, KernelChoice::Auto).fetches_ahead);
    let large = Image::filled(1024, 1024, [0; 3]);
    scene.textures.push(Texture::Rgb8(large, Encoding::Linear));
    assert!(kernel_for(&scene, KernelChoice::Auto).fetches_ahead);
}

fn instancing_does_not_change_what_a_scene_requires<A: Accel>() {
    for (name, _) in SCENES {
        let instanced = SceneOptions {
            instancing: Instancing::Always,
            ..SceneOptions::default()
        };
        let (flat, shared) = (
            built(&scene_path(name), SceneOptions::default()),
            built(&scene_path(name), instanced),
        );
        assert_eq!(flat.features, shared.features);
        assert_eq!(flat.triangles(), shared.triangles());
        assert_eq!(flat.lights.len(), shared.lights.len());
        assert_kernels_agree::<A>(&shared, limited(), name);
    }
}

#[test]
fn the_scenes_require_what_they_show_and_no_more() {
    for (name, requires) in SCENES {
        let scene = built(&scene_path(name), SceneOptions::default());
        assert_eq!(scene.features.names(), requires, "{name}");
    }
}

#[test]
fn a_scene_builds_no_table_for_what_it_lacks() {
    let bytes = |scene: &Scene, part: &str| scene.memory_by_part().iter().find(|(name, _)| *name == part).unwrap().1;
    for features in all_sets() {
        for env_sampling in [EnvSampling::Importance, EnvSampling::Uniform] {
            let (_folder, scene) = scene_with(features, env_sampling);
            let environment = features.contains(SceneFeatures::ENVIRONMENT);
            let table = environment && env_sampling == EnvSampling::Importance;
            assert_eq!(bytes(&scene, "environment") > 0, environment, "{features}");
            assert_eq!(
                bytes(&scene, "environment_table") > 0,
                table,
                "{features}, {env_sampling:?}"
            );
            assert_eq!(
                bytes(&scene, "textures") > 0,
                features.contains(SceneFeatures::TEXTURES),
                "{features}"
            );
            let lights = features.contains(SceneFeatures::AREA_LIGHTS) || features.contains(SceneFeatures::PUNCTUAL);
            assert_eq!(bytes(&scene, "lights") > 0, lights, "{features}");
        }
    }
}

#[test]
fn a_constant_environment_needs_no_table() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("mesh.obj");
    fs::write(&path, "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n").unwrap();
    // A mesh alone stands under a constant environment.
    let scene = built(&path, SceneOptions::default());
    assert_eq!(scene.features.names(), ["environment"]);
    let parts = scene.memory_by_part();
    assert!(
        parts.contains(&("environment_table", 0)) && parts.contains(&("textures", 0)),
        "{parts:?}"
    );
}
