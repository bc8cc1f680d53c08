//! The program as people run it: messages, exit codes, files.

mod support;

use embrace::image::exr::ExrMetadata;
use embrace::image::{Image, exr, ldr};
use embrace::math::{Rgb, Vec3};
use embrace::scene::ply::write_ply;
use serde_json::Value;
use std::fs;
use std::io::{BufRead, BufReader, Read};
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};
use support::program::{CAMERA, FLOOR, Folder, LAMP, RED, SKY, SQUARE, exit_code_within, int_attribute, send};

/// A scene that is refused whole.
fn scene_is_refused(scene: &str, words: &[&str]) {
    let folder = Folder::with(scene);
    let words = [&["scene.toml"], words].concat();
    folder.refused(
        "render scene.toml -o out.exr -o out.png --stats s.json --spp 1",
        3,
        &words,
    );
    folder.refused("info scene.toml --json", 3, &words);
}

fn exr_of(image: &Image<Rgb>) -> Vec<u8> {
    let mut bytes = Vec::new();
    exr::write(&mut bytes, image, &ExrMetadata::default(), Path::new("sky.exr")).unwrap();
    bytes
}

fn png_of(image: &Image<[u8; 3]>) -> Vec<u8> {
    let mut bytes = Vec::new();
    ldr::write_png(&mut bytes, image, Path::new("tiles.png")).unwrap();
    bytes
}

fn hdr_of(image: &Image<Rgb>) -> Vec<u8> {
    let pixels: Vec<image::Rgb<f32>> = image.pixels.iter().map(|p| image::Rgb(p.to_array())).collect();
    let mut bytes = Vec::new();
    image::codecs::hdr::HdrEncoder::new(&mut bytes)
        .encode(&pixels, image.width as usize, image.height as usize)
        .unwrap();
    bytes
}

// Bad input: every message names the file and what to do.

#[test]
fn a_missing_file_is_named() {
    let folder = Folder::with_scene();
    folder.refused(
        "render none.toml -o out.exr",
        3,
        &["none.toml", "cannot be read", "No such file"],
    );
    fs::remove_file(folder.path("floor.obj")).unwrap();
    folder.refused("render scene.toml -o out.exr", 3, &["floor.obj", "cannot be read"]);
    let folder = Folder::with(
        &[
            CAMERA,
            "[environment]
file = \"none.exr\"
",
        ]
        .concat(),
    );
    folder.refused("render scene.toml -o out.exr", 3, &["none.exr", "cannot be read"]);
}

#[test]
fn a_file_that_is_no_scene_is_named_with_what_is() {
    let folder = Folder::with_scene();
    folder.refused(
        "render floor.blend -o out.exr",
        3,
        &["floor.blend", ".toml", ".json", ".obj"],
    );
}

#[test]
fn an_unknown_key_is_an_error_that_suggests_the_nearest() {
    scene_is_refused(&CAMERA.replace("vfov", "vfvo"), &["camera.vfov", "is missing"]);
    scene_is_refused(
        &[CAMERA, "apeture_radius = 0.1\n"].concat(),
        &["camera.apeture_radius", "did you mean `aperture_radius`?"],
    );
    scene_is_refused(
        &[CAMERA, "[enviroment]\nradiance = [1, 1, 1]\n"].concat(),
        &["enviroment", "did you mean `environment`?"],
    );
    scene_is_refused(
        &[CAMERA, RED, FLOOR, "transfrom = []\n"].concat(),
        &["meshes[0].transfrom", "did you mean `transform`?"],
    );
    scene_is_refused(
        &[CAMERA, RED, &FLOOR.replace("\"red\"", "\"rad\"")].concat(),
        &["meshes[0].material", "did you mean \"red\"?"],
    );
    scene_is_refused(
        &[CAMERA, &RED.replace("diffuse", "difuse")].concat(),
        &["materials.red.type", "did you mean \"diffuse\"?"],
    );
    scene_is_refused(
        &[CAMERA, &RED.replace("rgb", "zzz")].concat(),
        &["materials.red", "rgb", "texture"],
    );
}

#[test]
fn a_wrong_type_is_named_with_the_right_one() {
    for (scene, words) in [
        (
            CAMERA.replace("40", "\"wide\""),
            ["camera.vfov", "expected a number", "a string"],
        ),
        (
            CAMERA.replace("[0, 1, 4]", "[0, 1]"),
            ["camera.position", "3 numbers", "2"],
        ),
        (
            CAMERA.replace("[0, 1, 4]", "[0, 1, nan]"),
            ["camera.position[2]", "number", "not finite"],
        ),
        (
            CAMERA.replace("[16, 12]", "[16.5, 12]"),
            ["camera.resolution[0]", "whole number", "found a number"],
        ),
        (
            CAMERA.replace("[16, 12]", "[16, -12]"),
            ["camera.resolution[1]", "whole number", "0 or more"],
        ),
        ("camera = 3".into(), ["camera", "expected a table", "a number"]),
        (
            [CAMERA, "[integrator]\nmax_depth = -1\n"].concat(),
            ["integrator.max_depth", "whole", "number"],
        ),
        (
            [CAMERA, "[[environment]]\nscale = 1\n"].concat(),
            ["environment", "expected a table", "an array"],
        ),
        (
            [CAMERA, &RED.replace("0.7", "1.7")].concat(),
            ["materials.red.rgb[0]", "1.7", "within 0 to 1"],
        ),
    ] {
        scene_is_refused(&scene, &words);
    }
}

#[test]
fn a_syntax_error_is_named_with_its_line() {
    scene_is_refused("[camera\nposition = 1", &["line 1"]);
    let folder = Folder::empty();
    folder.write("scene.json", "{\n  \"camera\": {,\n}");
    folder.refused("render scene.json -o out.exr", 3, &["scene.json", "line 2"]);
    folder.write("scene.json", b"\xff\xfe");
    folder.refused("render scene.json -o out.exr", 3, &["scene.json", "UTF-8"]);
}

#[test]
fn a_key_that_stands_twice_is_an_error() {
    scene_is_refused(&[CAMERA, "vfov = 30\nvfov = 40\n"].concat(), &["duplicate key"]);
    let folder = Folder::empty();
    folder.write("scene.json", "{\n  \"materials\": {\"red\": {},\n  \"red\": {}}\n}");
    folder.refused("render scene.json -o out.exr", 3, &["\"red\"", "twice", "line 3"]);
}

#[test]
fn a_singular_transform_is_an_error() {
    let flat = "transform = [[1, 0, 0, 0], [0, 0, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]\n";
    scene_is_refused(
        &[CAMERA, RED, FLOOR, flat].concat(),
        &["meshes[0].transform", "singular"],
    );
    let projective = "transform = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 1, 1]]\n";
    scene_is_refused(
        &[CAMERA, RED, FLOOR, projective].concat(),
        &["meshes[0].transform[3]", "[0, 0, 0, 1]"],
    );
    let huge = "transform = [[1e39, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]\n";
    scene_is_refused(
        &[CAMERA, RED, FLOOR, huge].concat(),
        &["meshes[0] (floor.obj): transform", "32-bit"],
    );
}

#[test]
fn an_image_without_pixels_or_a_view_without_direction_is_an_error() {
    scene_is_refused(&CAMERA.replace("[16, 12]", "[0, 12]"), &["camera.resolution"]);
    scene_is_refused(&CAMERA.replace("[0, 0.5, 0]", "[0, 1, 4]"), &["camera.look_at"]);
    scene_is_refused(&CAMERA.replace("40", "180"), &["camera.vfov", "180"]);
    scene_is_refused(&[CAMERA, "up = [0, 0, 0]\n"].concat(), &["camera.up"]);
    scene_is_refused(&[CAMERA, "up = [0, -0.5, -4]\n"].concat(), &["camera.up", "parallel"]);
    let folder = Folder::with_scene();
    folder.refused(
        "render scene.toml -o out.png --resolution 4000000000x4000000000",
        3,
        &["resolution"],
    );
}

#[test]
fn what_32_bits_cannot_hold_is_a_warning_with_its_name() {
    let warns = |scene: &str, words: &[&str]| {
        let folder = Folder::with(scene);
        let ran = folder.done("render scene.toml -o out.exr --spp 1");
        for word in words {
            assert!(ran.stderr.contains(word), "{word} is missing: {}", ran.stderr);
        }
        folder.refused("render scene.toml -o out.exr --strict", 3, &["--strict"]);
    };
    let at = |x: &str| format!("{FLOOR}transform = [[1, 0, 0, {x}], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]\n");
    // Alone it may stand anywhere: that becomes the origin. Together with another, one of the two is far off.
    let far = CAMERA
        .replace("[0, 1, 4]", "[1e9, 1, 4]")
        .replace("[0, 0.5, 0]", "[1e9, 0.5, 0]");
    let folder = Folder::with(&[&far, SKY, RED, &at("1e9")].concat());
    folder.done("render scene.toml -o out.exr --spp 1 --strict");
    warns(
        &[CAMERA, SKY, RED, FLOOR, &at("1e9")].concat(),
        &["warning: meshes[1] (floor.obj)", "2 of 2 triangles"],
    );
    warns(
        &[CAMERA, SKY, RED, FLOOR, &at("-1e30")].concat(),
        &["warning: meshes[1] (floor.obj)", "are not shown"],
    );
    warns(
        &[&CAMERA.replace("40", "1e-5"), SKY, RED, FLOOR].concat(),
        &["camera.vfov"],
    );
    warns(
        &[CAMERA, SKY, RED, FLOOR, LAMP, LAMP].concat(),
        &["warning: meshes[2] (floor.obj)", "more than once"],
    );
}

#[test]
fn a_damaged_mesh_is_named_with_the_line() {
    for (obj, words) in [
        (SQUARE.replace("v 1 0 1\n", "v 1 nan 1\n"), &["floor.obj", "finite"][..]),
        (SQUARE.replace("3/3", "9/3"), &["floor.obj:9", "vertex 9", "4"]),
        (SQUARE.replace("3/3", "-5/3"), &["floor.obj:9", "vertex -5", "4"]),
        (SQUARE.replace("3/3", "3/7"), &["floor.obj:9", "texture coordinate 7"]),
        (
            SQUARE.replace("v 1 0 1\n", "v 1 zero 1\n"),
            &["floor.obj:2", "`v 1 zero 1`", "expected"],
        ),
        (String::new(), &["floor.obj", "no faces"]),
        ("v 0 0 0\n".into(), &["floor.obj", "no faces"]),
    ] {
        let folder = Folder::with_scene();
        folder.write("floor.obj", obj);
        folder.refused("render scene.toml -o out.exr -o out.png", 3, words);
        folder.refused("render floor.obj -o out.exr", 3, words);
    }
}

#[cfg(unix)]
#[test]
fn a_device_in_place_of_a_file_is_refused_and_not_read_for_ever() {
    let mesh = FLOOR.replace("floor.obj", "/dev/zero");
    let texture = RED.replace("rgb = [0.7, 0.2, 0.1]", "texture = \"/dev/zero\"");
    for scene in [[CAMERA, SKY, RED, &mesh], [CAMERA, SKY, &texture, FLOOR]] {
        let folder = Folder::with(&scene.concat());
        folder.refused("render scene.toml -o out.png", 3, &["/dev/zero", "regular file"]);
    }
}

#[test]
fn a_damaged_image_is_named() {
    let sky = Image::filled(8, 4, Rgb::WHITE);
    let textured = RED.replace("rgb = [0.7, 0.2, 0.1]", "texture = \"tiles.png\"");
    let folder = Folder::with(&[CAMERA, &textured, FLOOR].concat());
    folder.refused("render scene.toml -o out.exr", 3, &["tiles.png", "cannot be read"]);
    let png = png_of(&Image::filled(8, 8, [9, 99, 200]));
    folder.write("tiles.png", &png[..png.len() * 2 / 3]);
    folder.refused(
        "render scene.toml -o out.exr",
        3,
        &["tiles.png", "PNG", "export the file again"],
    );
    folder.write("tiles.png", "a picture");
    folder.refused("render scene.toml -o out.exr", 3, &["tiles.png", "expected", "PNG"]);

    for (name, format, bytes) in [("sky.exr", "OpenEXR", exr_of(&sky)), ("sky.hdr", "HDR", hdr_of(&sky))] {
        let folder = Folder::with(&[CAMERA, &format!("[environment]\nfile = \"{name}\"\n")].concat());
        folder.write(name, &bytes);
        folder.done("render scene.toml -o out.png --spp 1");
        fs::remove_file(folder.path("out.png")).unwrap();
        folder.write(name, &bytes[..bytes.len() * 2 / 3]);
        folder.refused("render scene.toml -o out.png --spp 1", 3, &[name, format, "again"]);
        folder.write(name, &png);
        folder.refused(
            "render scene.toml -o out.png --spp 1",
            3,
            &[name, "expected an OpenEXR or Radiance HDR"],
        );
    }
}

#[test]
fn an_environment_with_texels_that_are_no_light_renders_with_a_warning_that_counts_them() {
    let folder = Folder::with(&[CAMERA, "[environment]\nfile = \"sky.exr\"\n", RED, FLOOR].concat());
    let mut sky = Image::filled(8, 4, Rgb::new(0.5, 1.0, 2.0));
    sky.pixels[3] = Rgb::new(-1.0, -2.0, 1.0);
    sky.pixels[9] = Rgb::new(f32::NAN, 1.0, 1.0);
    sky.pixels[17] = Rgb::splat(f32::INFINITY);
    folder.write("sky.exr", exr_of(&sky));
    let ran = folder.done("render scene.toml -o out.exr --spp 4");
    for words in [
        "sky.exr: 2 texel values are negative; 0 is used",
        "sky.exr: 1 texel values are NaN; 0 is used",
        "sky.exr: 3 texel values are infinite",
    ] {
        assert!(ran.stderr.contains(&format!("warning: {words}")), "{}", ran.stderr);
    }
    let image = folder.exr("out.exr");
    assert!(image.pixels.iter().all(|p| p.is_finite() && !p.is_black()));
    fs::remove_file(folder.path("out.exr")).unwrap();
    folder.refused(
        "render scene.toml -o out.exr --spp 4 --strict",
        3,
        &["sky.exr", "2 texel values", "--strict"],
    );
}

#[test]
fn a_black_environment_renders_black_with_a_warning() {
    let folder = Folder::with(&[CAMERA, "[environment]\nfile = \"sky.exr\"\n", RED, FLOOR].concat());
    folder.write("sky.exr", exr_of(&Image::filled(8, 4, Rgb::BLACK)));
    for sampling in ["importance", "uniform"] {
        let ran = folder.done(&format!(
            "render scene.toml -o out.exr --spp 2 --env-sampling {sampling}"
        ));
        assert!(
            ran.stderr.contains("warning: sky.exr: the environment map is black"),
            "{}",
            ran.stderr
        );
        assert!(folder.exr("out.exr").pixels.iter().all(|p| p.is_black()));
    }
}

#[test]
fn a_place_that_cannot_be_written_is_found_before_anything_is_read() {
    let folder = Folder::with_scene();
    fs::create_dir(folder.path("taken.png")).unwrap();
    // The scene is missing, too: that it is not named shows the order.
    for (output, words) in [
        (
            "none/out.exr",
            &["none/out.exr", "cannot be written", "make the directory"][..],
        ),
        ("scene.toml/out.exr", &["scene.toml/out.exr", "cannot be written"]),
        ("taken.png", &["taken.png", "is a directory"]),
        ("ok.png -o none/out.exr", &["none/out.exr", "cannot be written"]),
        ("ok.png --stats none/s.json", &["none/s.json", "cannot be written"]),
        ("ok.png --stats taken.png", &["taken.png", "is a directory"]),
        ("ok.png --stats /dev/null", &["/dev/null", "not a regular file"]),
    ] {
        folder.refused(&format!("render missing.toml -o {output}"), 4, words);
    }
    folder.refused("compare a.exr b.exr --diff none/d.png", 4, &["none/d.png"]);
    folder.refused("tonemap a.exr none/d.png", 4, &["none/d.png"]);
}

#[test]
fn wrong_usage_is_told_with_what_is_right() {
    let folder = Folder::with_scene();
    let render = "render scene.toml -o out.png";
    for (arguments, words) in [
        ("render scene.toml".to_owned(), &["--output"][..]),
        ("render -o out.png".into(), &["<SCENE>"]),
        ("redner scene.toml".into(), &["redner", "render"]),
        (format!("{render} --backend cuda"), &["cuda", "embree, obvhs"]),
        ("render scene.toml -o out.jpg".into(), &["out.jpg", ".exr or .png"]),
        ("render scene.toml -o out".into(), &["out:", ".exr or .png"]),
        (format!("{render} --crop 0,0,0,4"), &["--crop", "x0 < x1"]),
        (format!("{render} --crop 0,0,4"), &["--crop", "x0,y0,x1,y1"]),
        (format!("{render} --crop 0,0,17,4"), &["--crop 0,0,17,4", "16 x 12"]),
        (
            format!("{render} --resolution 8x8 --crop 0,0,8,9"),
            &["--crop 0,0,8,9", "8 x 8"],
        ),
        (format!("{render} --resolution 0x8"), &["--resolution", "640x480"]),
        (format!("{render} --resolution 8"), &["--resolution", "640x480"]),
        (format!("{render} --roulette 1"), &["--roulette", "above 0 and below 1"]),
        (format!("{render} --roulette 0"), &["--roulette", "above 0 and below 1"]),
        (
            format!("{render} --roulette nan"),
            &["--roulette", "above 0 and below 1"],
        ),
        (format!("{render} --roulette off"), &["without roulette", "--max-depth"]),
        (format!("{render} --spp 0"), &["--spp", "0"]),
        (format!("{render} --spp many"), &["--spp", "many"]),
        (format!("{render} --spp 5000000000"), &["--spp"]),
        (format!("{render} --threads 0"), &["--threads"]),
        (format!("{render} --exposure inf"), &["--exposure", "stops"]),
        (format!("{render} --spp 1 --spp 2"), &["--spp"]),
        (format!("{render} --sppp 1"), &["--sppp", "--spp"]),
        ("compare a.exr b.exr --diff d.jpg".into(), &["d.jpg", ".png"]),
        ("tonemap a.exr b.exr".into(), &["b.exr", ".png"]),
    ] {
        folder.refused(&arguments, 2, words);
    }
    for limit in ["--max-depth 3", "--lighting direct"] {
        folder.done(&format!("{render} --spp 1 --roulette off {limit}"));
    }
}

#[test]
fn the_fast_intersector_is_used_where_there_is_one_and_refused_where_not() {
    let folder = Folder::with_scene();
    let render = "render scene.toml -o out.exr --spp 1 --intersector fast";
    if cfg!(feature = "embree") {
        folder.done(&format!("{render} --stats stats.json"));
        assert_eq!(folder.json("stats.json")["intersector"], "fast");
    }
    if cfg!(feature = "obvhs") {
        let folder = Folder::with_scene();
        folder.refused(&format!("{render} --backend obvhs"), 2, &["obvhs", "--intersector"]);
    }
}

#[cfg(not(all(feature = "embree", feature = "obvhs")))]
#[test]
fn a_backend_that_is_not_in_the_build_is_told_with_the_one_that_is() {
    let absent = if cfg!(feature = "embree") { "obvhs" } else { "embree" };
    let folder = Folder::with_scene();
    folder.refused(
        &format!("render scene.toml -o out.png --backend {absent}"),
        2,
        &[absent, "not in this build"],
    );
}

#[test]
fn what_a_mesh_refers_to_and_is_missing_is_a_warning_that_names_it() {
    let floor = FLOOR.replace("material = \"red\"\n", "");
    let folder = Folder::with(&[CAMERA, SKY, &floor].concat());
    let is_warned = |words: &[&str]| {
        let ran = folder.done("render scene.toml -o out.png --spp 1");
        for word in words {
            assert!(ran.stderr.contains(word), "no `{word}` in {}", ran.stderr);
        }
        assert!(ran.stderr.starts_with("warning: "), "{}", ran.stderr);
        assert_eq!(folder.done("render scene.toml -o out.png --spp 1 -q").stderr, "");
        folder.refused("render scene.toml -o out.png --strict", 3, &["--strict"]);
        let info: Value = serde_json::from_str(&folder.done("info scene.toml --json").stdout).unwrap();
        assert!(!info["warnings"].as_array().unwrap().is_empty());
    };
    folder.write("floor.obj", format!("mtllib floor.mtl\nusemtl tiles\n{SQUARE}"));
    is_warned(&["floor.mtl", "tiles"]);
    folder.write("floor.mtl", "newmtl tiles\nmap_Kd tiles.png\n");
    is_warned(&["tiles.png", "magenta"]);
    folder.write("tiles.png", "damaged");
    is_warned(&["tiles.png", "magenta"]);
    folder.write("floor.mtl", "newmtl tiles\nKd 0.5 0.5\n");
    is_warned(&["floor.mtl:2", "Kd 0.5 0.5"]);
}

// Output.

#[test]
fn both_outputs_show_the_same_image_and_the_exr_says_what_made_it() {
    let folder = Folder::with_scene();
    let ran = folder.done("render scene.toml -o out.exr -o out.png --spp 8 --seed 18446744073709551615 --exposure 0.5");
    assert_eq!(ran.stdout, "");
    let image = folder.exr("out.exr");
    assert_eq!((image.width, image.height), (16, 12));
    // The sky is seen directly in the corner, and has no noise.
    let corner = image.at(0, 0).to_array();
    assert!(
        corner.iter().zip([0.5, 0.6, 0.8]).all(|(a, b)| (a - b).abs() < 1e-6),
        "{corner:?}"
    );
    let encoded = embrace::image::display::to_srgb8(&image, 0.5);
    assert_eq!(folder.png("out.png"), encoded);

    let bytes = folder.read("out.exr");
    let meta = ::exr::meta::MetaData::read_from_buffered(&bytes[..], false).unwrap();
    let attributes = &meta.headers[0].own_attributes;
    let software = attributes.software_name.as_ref().unwrap().to_string();
    assert!(software.starts_with("embrace "), "{software}");
    assert_eq!(int_attribute(&bytes, "spp"), 8);
    for (name, value) in [("seed", "18446744073709551615"), ("backend", "")] {
        let text = &attributes.other[&::exr::meta::attribute::Text::from(name)];
        assert!(format!("{text:?}").contains(value), "{text:?}");
    }
    assert!(meta.headers[0].shared_attributes.chromaticities.is_some());
    assert_eq!(folder.names().len(), 4, "no temporary file stays");
}

#[test]
fn statistics_have_every_key_with_a_sensible_value() {
    let folder = Folder::with_scene();
    folder.done("render scene.toml -o out.exr --spp 4 --seed 7 --threads 2 --stats stats.json");
    let stats = folder.json("stats.json");
    let text = |key: &str| stats[key].as_str().unwrap_or_else(|| panic!("{key} in {stats}"));
    let count = |key: &str| stats[key].as_u64().unwrap_or_else(|| panic!("{key} in {stats}"));
    let seconds = |key: &str| stats[key].as_f64().unwrap_or_else(|| panic!("{key} in {stats}"));
    assert_eq!(text("version"), env!("CARGO_PKG_VERSION"));
    assert_eq!(text("scene_hash").len(), 64);
    assert!(["embree", "obvhs"].contains(&text("backend")));
    assert!(!text("backend_version").is_empty() && !text("kernel").is_empty());
    for (key, value) in [
        ("threads", 2),
        ("width", 16),
        ("height", 12),
        ("spp", 4),
        ("seed", 7),
        ("triangles", 4),
        ("instances", 0),
        // Two triangles and the sky.
        ("lights", 3),
        ("paths", 16 * 12 * 4),
    ] {
        assert_eq!(count(key), value, "{key}");
    }
    for key in [
        "load_seconds",
        "build_seconds",
        "render_seconds",
        "render_cpu_seconds",
        "write_seconds",
    ] {
        assert!((0.0..60.0).contains(&seconds(key)), "{key}");
    }
    let rays = |kind: &str| stats["rays"][kind].as_u64().unwrap();
    assert_eq!(rays("camera"), count("paths"));
    assert!(rays("bounce") > 0 && rays("shadow") > 0);
    assert_eq!(stats["dropped_samples"]["count"], 0);
    assert_eq!(stats["dropped_samples"]["first"], Value::Null);
    assert!(count("peak_memory_bytes") > 1 << 20 || cfg!(not(target_os = "linux")));
    assert_eq!(stats["interrupted"], false);
    assert_eq!(stats["warnings"], Value::Array(Vec::new()));
}

#[test]
fn standard_error_has_plain_progress_lines_and_nothing_when_quiet() {
    let folder = Folder::with_scene();
    assert_progress(&folder.done("render scene.toml -o out.png --spp 4").stderr);
    let ran = folder.done("render scene.toml -o out.png --spp 4 -q");
    assert_eq!((ran.stdout, ran.stderr), (String::new(), String::new()));
}

/// Every line is `Progress: 42.0%`, ascending to 100, but the last, which is the error.
fn assert_progress(stderr: &str) {
    let mut last = 0.0;
    let (lines, error) = stderr.trim_end().rsplit_once('\n').unwrap();
    assert!(error.starts_with("Estimated error: "), "{stderr}");
    for line in lines.lines() {
        let number = line.strip_prefix("Progress: ").and_then(|rest| rest.strip_suffix('%'));
        let number = number.unwrap_or_else(|| panic!("{stderr}"));
        assert_eq!(
            number.split_once('.').map(|(_, decimals)| decimals.len()),
            Some(1),
            "{line}"
        );
        let percent: f64 = number.parse().unwrap();
        assert!(percent >= last, "{stderr}");
        last = percent;
    }
    assert_eq!(last, 100.0, "{stderr}");
}

#[test]
fn a_render_ends_in_time() {
    let folder = Folder::with_scene();
    folder.done("render scene.toml -o out.exr --resolution 160x120 --time 0.7s --stats s.json -q");
    let stats = folder.json("s.json");
    assert_eq!(stats["stopped_by"], "time");
    let seconds = stats["render_seconds"].as_f64().unwrap();
    assert!((0.7..0.9).contains(&seconds), "{seconds}");
    assert!(stats["spp"].as_u64() > Some(0));

    let start = Instant::now();
    folder.done("render scene.toml -o out.exr --resolution 160x120 --time 700ms --time-total -q");
    let seconds = start.elapsed().as_secs_f64();
    assert!((0.5..0.9).contains(&seconds), "{seconds}");

    // Samples end it first.
    folder.done("render scene.toml -o out.exr --spp 4 --time 1h --stats s.json -q");
    let stats = folder.json("s.json");
    assert_eq!((&stats["stopped_by"], &stats["spp"]), (&"spp".into(), &4.into()));
}

#[test]
fn a_time_too_short_for_a_sample_writes_nothing_and_says_so() {
    let folder = Folder::with_scene();
    let before = folder.names();
    let ran = folder.run("render scene.toml -o out.exr --time 0.001ms");
    assert_eq!(ran.code, Some(5), "{}", ran.stderr);
    assert!(ran.stderr.contains("no time for a single sample"), "{}", ran.stderr);
    assert_eq!(folder.names(), before);
}

#[test]
fn a_render_ends_at_the_error_that_is_asked_for() {
    let folder = Folder::with_scene();
    let ran = folder.done("render scene.toml -o out.exr --resolution 64x48 --noise 0.01 --stats s.json");
    let stats = folder.json("s.json");
    assert_eq!(stats["stopped_by"], "noise");
    let error = &stats["error"]["relative_rmse"];
    let [value, low, high] = ["value", "low", "high"].map(|key| error[key].as_f64().unwrap());
    assert!(value <= 0.01 && value > 0.0075, "{value}");
    assert!(low < value && value < high && stats["error"]["confidence"] == 0.95);
    let [fewest, mean, most] = ["spp", "spp_mean", "spp_most"].map(|key| stats[key].as_f64().unwrap());
    assert!((16.0..mean).contains(&fewest) && mean < most, "{fewest} {mean} {most}");
    assert!(
        ran.stderr.contains("Estimated error: ") && ran.stderr.contains(" on average"),
        "{}",
        ran.stderr
    );
}

#[test]
fn an_error_out_of_reach_is_an_exit_code_of_its_own_and_keeps_the_image() {
    let folder = Folder::with_scene();
    let ran = folder.run("render scene.toml -o out.exr --noise 1e-6 --spp 40 --stats s.json");
    assert_eq!(ran.code, Some(5), "{}", ran.stderr);
    assert!(
        ran.stderr.contains("the target --noise 0.000001 is not reached"),
        "{}",
        ran.stderr
    );
    assert_eq!(folder.exr("out.exr").width, 16);
    let stats = folder.json("s.json");
    assert_eq!(
        (&stats["stopped_by"], &stats["spp"], &stats["spp_most"]),
        (&"spp".into(), &40.into(), &40.into())
    );
    // Fewer samples than are usual before the error is judged; and one, which tells nothing of it.
    for spp in [8, 2, 1] {
        let ran = folder.run(&format!(
            "render scene.toml -o few.exr --noise 1e-6 --spp {spp} --stats s.json"
        ));
        assert_eq!(ran.code, Some(5), "{spp}: {}", ran.stderr);
        assert_eq!(folder.json("s.json")["spp"], spp);
    }
    let ran = folder.run("render scene.toml -o late.exr --noise 1e-6 --time 300ms");
    assert_eq!(ran.code, Some(5), "{}", ran.stderr);
    assert_eq!(folder.exr("late.exr").width, 16);
}

#[test]
fn an_adaptive_render_gives_the_same_bytes_for_any_number_of_threads() {
    let folder = Folder::with_scene();
    for threads in [1, 2, 3] {
        folder.done(&format!(
            "render scene.toml -o {threads}.exr --resolution 64x48 --noise 0.03 --threads {threads} --reproducible -q"
        ));
    }
    assert!(folder.read("1.exr") == folder.read("2.exr") && folder.read("1.exr") == folder.read("3.exr"));
}

#[test]
fn efforts_that_make_no_sense_are_refused() {
    let folder = Folder::with_scene();
    for (arguments, expected) in [
        ("--time 0", "above zero"),
        ("--time 10parsecs", "30s"),
        ("--time-total", "--time"),
        ("--noise 0", "above 0"),
        ("--noise -1", "--noise"),
        ("--noise nan", "above 0"),
        ("--min-spp 4", "--noise"),
        ("--noise 0.1 --min-spp 1", "min-spp"),
        (
            "--noise 0.1 --min-spp 64 --spp 32",
            "--min-spp 64 is more than --spp 32",
        ),
        ("--noise 0.1 --sampler sobol-whole", "sobol-whole"),
    ] {
        let ran = folder.run(&format!("render scene.toml -o out.exr {arguments}"));
        assert_eq!(ran.code, Some(2), "{arguments}: {}", ran.stderr);
        assert!(ran.stderr.contains(expected), "{arguments}: {}", ran.stderr);
    }
}

#[test]
fn a_sampler_that_does_not_tell_its_error_and_a_single_sample_report_none() {
    let folder = Folder::with_scene();
    for arguments in ["--sampler sobol-whole --spp 4", "--spp 1"] {
        folder.done(&format!("render scene.toml -o out.exr --stats s.json -q {arguments}"));
        assert!(folder.json("s.json")["error"].is_null(), "{arguments}");
    }
}

#[test]
fn info_prints_one_object_of_what_the_scene_has_and_requires() {
    let folder = Folder::with_scene();
    let before = folder.names();
    let ran = folder.done("info scene.toml --json");
    let info: Value = serde_json::from_str(&ran.stdout).unwrap();
    assert_eq!(ran.stderr, "");
    for (key, value) in [
        ("width", 16),
        ("height", 12),
        ("triangles", 4),
        ("lights", 3),
        ("textures", 0),
    ] {
        assert_eq!(info[key], value, "{key}");
    }
    assert_eq!(info["requires"], serde_json::json!(["environment", "area-lights"]));
    assert_eq!(info["materials"], serde_json::json!(["red"]));
    assert_eq!(info["memory_bytes"]["environment_table"], 0);
    assert_eq!(info["format"], "scene file (TOML)");
    assert_eq!(info["lights_by_kind"]["emitting_triangles"], 2);
    assert_eq!(info["lights_by_kind"]["environment"], 1);
    let table = folder.done("info scene.toml").stdout;
    assert!(
        table.contains("environment, area-lights") && table.contains("16 x 12"),
        "{table}"
    );
    assert_eq!(folder.names(), before);
}

#[test]
fn info_lists_materials_bitmaps_and_lights_by_kind() {
    let worn = "[materials.worn]\ntype = \"blend\"\nmaterials = [\"red\", \"tiles\"]\nweight = 0.5\nopacity = 0.5\nback = \"black\"\n\
        [materials.tiles]\ntype = \"principled\"\ntexture = \"tiles.png\"\nback = \"red\"\n\
        normal_map = { texture = \"tiles.png\" }\n";
    let lights = "[[lights]]\ntype = \"point\"\nposition = [0, 1, 0]\nintensity = [1, 1, 1]\n\
        [[lights]]\ntype = \"distant\"\ndirection = [0, -1, 0]\nirradiance = [1, 1, 1]\n";
    let folder = Folder::with(&[CAMERA, RED, worn, &FLOOR.replace("\"red\"", "\"worn\""), lights].concat());
    folder.write("tiles.png", png_of(&Image::filled(5, 4, [255; 3])));
    let info: Value = serde_json::from_str(&folder.done("info scene.toml --json").stdout).unwrap();
    assert_eq!(info["materials"], serde_json::json!(["worn", "red", "tiles"]));
    let details = &info["material_details"];
    assert_eq!(details[0]["type"], "blend");
    assert_eq!(details[0]["blended"], serde_json::json!(["red", "tiles"]));
    assert_eq!(details[0]["with"], serde_json::json!(["opacity", "black back"]));
    assert_eq!(details[2]["type"], "principled");
    assert_eq!(details[2]["textures"], serde_json::json!([0, 1]));
    assert_eq!(details[2]["with"], serde_json::json!(["normal map", "back of red"]));
    let texels = |i: usize| info["texture_details"][i]["texels"].as_str().unwrap().to_owned();
    assert_eq!((texels(0).as_str(), texels(1).as_str()), ("8-bit sRGB", "8-bit linear"));
    assert_eq!(info["texture_details"][0]["width"], 5);
    let table = folder.done("info scene.toml").stdout;
    for line in [
        "worn: blend of red and tiles, opacity, black back",
        "tiles: principled, normal map, back of red, texture 0, texture 1",
        "0: 5 x 4, 8-bit sRGB",
        "1 point, 1 distant",
    ] {
        assert!(table.contains(line), "no `{line}` in {table}");
    }
}

#[test]
fn an_image_equals_itself_and_differs_from_another() {
    let folder = Folder::with_scene();
    folder.done("render scene.toml -o a.exr --spp 2 --seed 1");
    folder.done("render scene.toml -o b.exr --spp 2 --seed 2");
    folder.done("render scene.toml -o c.exr --spp 1 --resolution 8x8");
    let compared = |arguments: &str| -> Value {
        let ran = folder.done(arguments);
        assert_eq!(ran.stderr, "");
        serde_json::from_str(&ran.stdout).unwrap()
    };
    let same = compared("compare a.exr a.exr --json");
    for key in ["mse", "rmse", "relmse", "relmse_trimmed", "flip"] {
        assert_eq!(same[key], 0.0, "{key}");
    }
    assert_eq!(same["mean_ratio"], serde_json::json!([1.0, 1.0, 1.0]));
    let other = compared("compare a.exr b.exr --json --diff diff.png");
    assert!(other["mse"].as_f64().unwrap() > 0.0 && other["flip"].as_f64().unwrap() > 0.0);
    assert_eq!(folder.png("diff.png").width, 16);
    let table = folder.done("compare a.exr b.exr").stdout;
    assert!(
        ["MSE", "RMSE", "relMSE", "mean ratio", "FLIP"]
            .iter()
            .all(|w| table.contains(w)),
        "{table}"
    );
    folder.refused(
        "compare a.exr c.exr --diff d.png",
        3,
        &["a.exr", "c.exr", "16 x 12", "8 x 8"],
    );
    folder.refused("compare a.exr diff.png", 3, &["diff.png", "expected an OpenEXR"]);
    folder.refused("compare a.exr none.exr", 3, &["none.exr", "cannot be read"]);
}

#[test]
fn tonemap_writes_the_png_that_render_would() {
    let folder = Folder::with_scene();
    folder.done("render scene.toml -o out.exr -o out.png --spp 2 --exposure -1.5");
    let ran = folder.done("tonemap out.exr mapped.png --exposure -1.5");
    assert_eq!((ran.stdout, ran.stderr), (String::new(), String::new()));
    assert_eq!(folder.png("mapped.png"), folder.png("out.png"));
    folder.refused("tonemap none.exr x.png", 3, &["none.exr", "cannot be read"]);
    folder.refused("tonemap scene.toml x.png", 3, &["scene.toml", "expected an OpenEXR"]);
}

#[test]
fn help_and_version_are_no_errors() {
    let folder = Folder::empty();
    assert!(folder.done("--version").stdout.starts_with("embrace "));
    let help = folder.done("render --help").stdout;
    for option in ["--spp", "--crop", "--stats", "--preset", "--strict"] {
        assert!(help.contains(option), "{option}");
    }
    assert!(folder.done("--help").stdout.contains("Exit codes"));
}

#[cfg(target_os = "linux")]
#[test]
fn a_reader_that_goes_away_is_no_crash() {
    let folder = Folder::with_scene();
    let full = || fs::OpenOptions::new().write(true).open("/dev/full").unwrap();
    // Progress that nobody can read does not stop the render.
    let status = folder
        .command("render scene.toml -o out.png --spp 2")
        .stderr(full())
        .status()
        .unwrap();
    assert_eq!(status.code(), Some(0));
    folder.png("out.png");
    folder.done("render scene.toml -o out.exr --spp 2");
    for arguments in [
        "info scene.toml",
        "info scene.toml --json",
        "compare out.exr out.exr",
        "compare out.exr out.exr --json",
    ] {
        let output = folder.command(arguments).stdout(full()).output().unwrap();
        let stderr = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(4), "{arguments}: {stderr}");
        assert!(stderr.contains("standard output"), "{stderr}");
    }
}

// Overrides and determinism.

#[test]
fn a_mesh_alone_renders_without_a_scene_file() {
    let folder = Folder::with_scene();
    folder.done("render floor.obj -o out.exr --spp 1 --resolution 20x10");
    let image = folder.exr("out.exr");
    assert_eq!((image.width, image.height), (20, 10));
    let is_sky = |p: &Rgb| p.to_array() == [1.0; 3];
    assert!(image.pixels.iter().any(is_sky) && !image.pixels.iter().all(is_sky));
}

#[test]
fn a_crop_has_exactly_the_pixels_of_the_full_image_and_says_where_it_lies() {
    let folder = Folder::with_scene();
    folder.done("render scene.toml -o full.exr --spp 3");
    folder.done("render scene.toml -o crop.exr -o crop.png --spp 3 --crop 3,2,11,9 --stats stats.json");
    let (full, crop) = (folder.exr("full.exr"), folder.exr("crop.exr"));
    assert_eq!((crop.width, crop.height), (8, 7));
    for y in 0..7 {
        for x in 0..8 {
            assert_eq!(crop.at(x, y), full.at(x + 3, y + 2));
        }
    }
    let meta = ::exr::meta::MetaData::read_from_buffered(&folder.read("crop.exr")[..], false).unwrap();
    let header = &meta.headers[0];
    assert_eq!(header.own_attributes.layer_position, ::exr::math::Vec2(3, 2));
    assert_eq!(header.shared_attributes.display_window.size, ::exr::math::Vec2(16, 12));
    assert_eq!(folder.png("crop.png").width, 8);
    assert_eq!(folder.json("stats.json")["paths"], 8 * 7 * 3);
}

#[test]
fn the_command_line_overrides_the_scene() {
    let folder = Folder::with(&[CAMERA, "[integrator]\nmax_depth = 0\n", SKY, RED, FLOOR].concat());
    let image = |arguments: &str| {
        folder.done(&format!("render scene.toml -o out.exr -q --spp 2 {arguments}"));
        folder.exr("out.exr")
    };
    let is_black = |image: &Image<Rgb>| image.pixels.iter().any(|p| p.is_black());
    assert!(is_black(&image("")), "the floor has no light of its own");
    assert!(!is_black(&image("--max-depth 1")));
    assert_eq!(
        image("--max-depth 1"),
        image("--max-depth 9 --lighting direct --mis on")
    );
    let wide = image("--resolution 24x6");
    assert_eq!((wide.width, wide.height), (24, 6));
    folder.done("render scene.toml -o dim.png --spp 1 --exposure -20");
    folder.done("render scene.toml -o bright.png --spp 1 --exposure 20");
    assert_eq!(folder.png("dim.png").at(0, 0), &[0; 3]);
    assert_eq!(folder.png("bright.png").at(0, 0), &[255; 3]);
}

/// The bytes of both outputs.
fn bytes_of(folder: &Folder, arguments: &str) -> [Vec<u8>; 2] {
    folder.done(&format!(
        "render scene.toml -o out.exr -o out.png --spp 5 --reproducible {arguments}"
    ));
    [folder.read("out.exr"), folder.read("out.png")]
}

#[test]
fn a_preset_is_its_settings_and_what_stands_beside_it_wins() {
    let folder = Folder::with_scene();
    let article = bytes_of(&folder, "--preset article");
    assert!(article == bytes_of(&folder, "--bounce-sampling uniform --mis off --roulette 0.8"));
    assert!(article == bytes_of(&folder, "--preset article --roulette 0.8"));
    let default = bytes_of(&folder, "");
    assert!(article != default);
    assert!(
        default
            == bytes_of(
                &folder,
                "--preset article --bounce-sampling bsdf --mis on --roulette throughput"
            )
    );
}

#[test]
fn equal_renders_are_equal_files_for_any_threads_and_kernel_but_not_for_another_seed() {
    let folder = Folder::with_scene();
    let one = bytes_of(&folder, "--threads 1");
    for same in [
        "--threads 2",
        "--threads 3",
        "--kernel general",
        "--kernel auto",
        "--seed 0",
    ] {
        assert!(one == bytes_of(&folder, same), "{same}");
    }
    assert!(one[0] != bytes_of(&folder, "--seed 1")[0]);
    folder.done("render scene.toml -o plain.png --spp 5 --threads 3");
    assert!(folder.read("plain.png") == one[1], "a PNG needs no --reproducible");
}

#[test]
fn progress_images_do_not_change_the_image_at_the_end() {
    let folder = Folder::with_scene();
    let plain = bytes_of(&folder, "");
    assert!(plain == bytes_of(&folder, "--progress-image 0"));
    assert!(plain == bytes_of(&folder, "--progress-image 1e9 --threads 1"));
    assert_eq!(folder.names().iter().filter(|name| name.starts_with('.')).count(), 0);
}

#[test]
fn the_first_image_is_written_long_before_the_last() {
    let folder = Folder::with_scene();
    let asked = 100_000_000;
    let mut child = folder
        .command(&format!(
            "render scene.toml -o out.exr -q --spp {asked} --progress-image 1e9"
        ))
        .spawn()
        .unwrap();
    let start = Instant::now();
    while !folder.path("out.exr").exists() {
        assert!(start.elapsed() < Duration::from_secs(60), "no image");
        std::thread::sleep(Duration::from_millis(10));
    }
    // Whole as soon as it is there, and no other comes in a billion seconds.
    let first = folder.read("out.exr");
    assert_eq!(int_attribute(&first, "spp"), 1);
    assert!(folder.exr("out.exr").pixels.iter().all(|p| p.is_finite()));
    std::thread::sleep(Duration::from_millis(200));
    assert!(first == folder.read("out.exr"));
    child.kill().unwrap();
    child.wait().unwrap();
}

#[test]
fn the_build_quality_is_chosen_by_paths_and_triangles_unless_it_is_given() {
    let folder = Folder::with_scene();
    let quality = |arguments: &str| {
        folder.done(&format!("render scene.toml -o out.exr --stats stats.json {arguments}"));
        folder.json("stats.json")["build_quality"].as_str().unwrap().to_owned()
    };
    assert_eq!(quality("--spp 1"), "list");
    for given in ["low", "medium", "high"] {
        assert_eq!(quality(&format!("--spp 1 --build-quality {given}")), given);
    }
    // Some hundred triangles for a path.
    let mut text = String::new();
    for i in 0..7000 {
        text += &format!("v {i} 0 0\nv {i} 1 0\nv {i} 0 1\nf -3 -2 -1\n");
    }
    folder.write("many.obj", text);
    folder.done("render many.obj -o out.exr --stats stats.json --spp 1 --resolution 8x8");
    assert_eq!(folder.json("stats.json")["build_quality"], "low");
}

#[test]
fn a_scene_is_the_same_in_toml_and_in_json_with_relative_and_absolute_paths() {
    let folder = Folder::with_scene();
    let scene: Value = toml::from_str(&String::from_utf8(folder.read("scene.toml")).unwrap()).unwrap();
    folder.write("scene.json", serde_json::to_string(&scene).unwrap());
    let mut absolute = scene;
    for mesh in absolute["meshes"].as_array_mut().unwrap() {
        mesh["file"] = folder.path("floor.obj").to_str().unwrap().into();
    }
    let elsewhere = Folder::empty();
    elsewhere.write("absolute.json", serde_json::to_string(&absolute).unwrap());
    folder.done("render scene.toml -o toml.exr --spp 2");
    folder.done("render scene.json -o json.exr --spp 2");
    elsewhere.done("render absolute.json -o out.exr --spp 2");
    assert_eq!(folder.exr("toml.exr"), folder.exr("json.exr"));
    assert_eq!(folder.exr("toml.exr"), elsewhere.exr("out.exr"));
}

// Interruption.

#[cfg(unix)]
fn interrupted_render_keeps_its_image(signal: &str, code: i32) {
    let folder = Folder::with_scene();
    let asked = 100_000_000;
    let mut child = folder
        .command(&format!(
            "render scene.toml -o out.exr -o out.png --stats stats.json --spp {asked} --threads 1"
        ))
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    // The first line of progress shows that it renders.
    let mut stderr = BufReader::new(child.stderr.take().unwrap());
    let mut line = String::new();
    stderr.read_line(&mut line).unwrap();
    assert!(line.starts_with("Progress: "), "{line}");
    send(signal, &child);
    assert_eq!(exit_code_within(&mut child, Duration::from_secs(5)), Some(code));

    let mut rest = String::new();
    stderr.read_to_string(&mut rest).unwrap();
    assert!(rest.contains("interrupted: the image has"), "{rest}");
    let spp = int_attribute(&folder.read("out.exr"), "spp");
    assert!((1..asked).contains(&spp), "{spp}");
    assert!(folder.exr("out.exr").pixels.iter().all(|p| p.is_finite()));
    assert_eq!(folder.png("out.png").width, 16);
    let stats = folder.json("stats.json");
    assert_eq!(stats["interrupted"], true);
    assert_eq!(stats["spp"], spp);
    assert_eq!(folder.names().len(), 5, "no temporary file stays");
}

#[cfg(unix)]
#[test]
fn an_interrupted_render_keeps_its_image() {
    interrupted_render_keeps_its_image("INT", 130);
}

#[cfg(unix)]
#[test]
fn a_terminated_render_keeps_its_image() {
    interrupted_render_keeps_its_image("TERM", 143);
}

#[cfg(unix)]
#[test]
fn an_interruption_before_the_first_sample_leaves_nothing() {
    for (signal, code) in [("INT", 130), ("TERM", 143)] {
        let folder = Folder::empty();
        // A scene that never arrives holds the program in loading.
        assert!(
            Command::new("mkfifo")
                .arg(folder.path("scene.toml"))
                .status()
                .unwrap()
                .success()
        );
        let mut child = folder
            .command("render scene.toml -o out.exr --stats stats.json")
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        // Opening for writing returns once the program has opened it for reading.
        let _writer = fs::OpenOptions::new()
            .write(true)
            .open(folder.path("scene.toml"))
            .unwrap();
        send(signal, &child);
        assert_eq!(exit_code_within(&mut child, Duration::from_secs(5)), Some(code));
        assert_eq!(folder.names().len(), 1, "{:?}", folder.names());
    }
}

// Documentation.

#[test]
fn the_complete_example_of_the_documentation_renders_without_a_warning() {
    let document = include_str!("../docs/scene-format.md");
    let example = document
        .split_once("## A complete example")
        .and_then(|(_, rest)| rest.split_once("```toml\n"))
        .and_then(|(_, rest)| rest.split_once("```"))
        .map(|(example, _)| example)
        .unwrap();
    let folder = Folder::empty();
    folder.write("scene.toml", example);
    folder.write("floor.obj", SQUARE);
    folder.write("ball.obj", SQUARE);
    folder.write("lamp.obj", SQUARE);
    let mut scan = Vec::new();
    let square = support::quad(Vec3::ZERO, Vec3::Z, Vec3::X).into_f64();
    write_ply(&square, &mut scan).unwrap();
    folder.write("scan.ply", scan);
    let bitmap = png_of(&Image::filled(4, 4, [90, 60, 200]));
    for name in [
        "tiles.png",
        "leather.jpg",
        "leather-roughness.png",
        "leather-height.png",
    ] {
        // Formats are told by the content.
        folder.write(name, &bitmap);
    }
    folder.write("sky.exr", exr_of(&Image::filled(8, 4, Rgb::new(0.2, 0.3, 0.6))));
    let ran = folder.done("render scene.toml -o out.exr --spp 2 --resolution 32x24 --strict");
    assert_progress(&ran.stderr);
    assert!(folder.exr("out.exr").pixels.iter().all(|p| p.is_finite()));
}
