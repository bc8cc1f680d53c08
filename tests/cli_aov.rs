//! `embrace render --aov`: layers beside the image, and what the file says about it.

mod support;

use ::exr::meta::attribute::AttributeValue;
use embrace::aov::Aov;
use embrace::image::exr;
use std::collections::BTreeMap;
use std::path::Path;
use support::program::{CAMERA, FLOOR, Folder, LAMP, RED, SKY, attribute, int_attribute};

const ALL: &str = "variance,samples,albedo,normal,depth,position,direct,indirect";

/// A wall behind the floor, so that they light each other.
const WALL: &str = "[[meshes]]\nfile = \"floor.obj\"\nmaterial = \"red\"\n\
    transform = [[1, 0, 0, 0], [0, 0, -1, 1], [0, 1, 0, -1], [0, 0, 0, 1]]\n";

/// A layer of a file by pixel.
fn layer<const N: usize>(folder: &Folder, file: &str, aov: Aov) -> Vec<[f32; N]> {
    let channels = aov.channels().try_into().expect("as many channels");
    let image = exr::read_layer(&folder.read(file), Path::new(file), aov.name(), channels);
    image.unwrap().pixels
}

fn mean<const N: usize>(pixels: &[[f32; N]]) -> f64 {
    pixels.iter().flatten().map(|v| f64::from(*v)).sum::<f64>() / (pixels.len() * N) as f64
}

/// Names of the channels of a file.
fn channels(folder: &Folder, file: &str) -> Vec<String> {
    let bytes = folder.read(file);
    let meta = ::exr::meta::MetaData::read_from_buffered(&bytes[..], false).unwrap();
    let channels = &meta.headers[0].channels.list;
    channels.iter().map(|c| c.name.to_string()).collect()
}

/// What a file says about its error, by name.
fn errors(folder: &Folder, file: &str) -> BTreeMap<String, f32> {
    let bytes = folder.read(file);
    let names = ["relmse", "rmse"].map(|name| [name.to_owned(), format!("{name}_low"), format!("{name}_high")]);
    let found = names.into_iter().flatten().filter_map(|name| {
        let value = match attribute(&bytes, &name)? {
            AttributeValue::F32(value) => value,
            other => panic!("{name} is {other:?}"),
        };
        Some((name, value))
    });
    found.collect()
}

#[test]
fn a_layer_is_written_for_every_name_and_none_unasked() {
    let folder = Folder::with_scene();
    folder.done("render scene.toml -o plain.exr --spp 4 -q");
    assert_eq!(channels(&folder, "plain.exr"), ["B", "G", "R"]);
    folder.done("render scene.toml -o some.exr --spp 4 -q --aov depth,samples");
    assert_eq!(channels(&folder, "some.exr"), ["B", "G", "R", "depth.Z", "samples.Y"]);
    folder.done(&format!("render scene.toml -o all.exr --spp 4 -q --aov {ALL}"));
    let named = Aov::ALL
        .iter()
        .flat_map(|aov| aov.channels().iter().map(|c| format!("{}.{c}", aov.name())));
    let mut expected: Vec<String> = named.chain(["R", "G", "B"].map(str::to_owned)).collect();
    expected.sort();
    assert_eq!(channels(&folder, "all.exr"), expected);
}

#[test]
fn layers_do_not_change_the_image() {
    let folder = Folder::with_scene();
    for effort in [
        "--spp 7",
        "--resolution 64x48 --noise 0.01",
        "--spp 3 --sampler independent --crop 3,2,11,9",
    ] {
        let render = format!("render scene.toml -q --reproducible {effort}");
        folder.done(&format!("{render} -o plain.exr -o plain.png"));
        folder.done(&format!("{render} -o layers.exr -o layers.png --aov {ALL}"));
        assert_eq!(folder.exr("plain.exr"), folder.exr("layers.exr"), "{effort}");
        assert!(folder.read("plain.png") == folder.read("layers.png"), "{effort}");
        // The same file for any threads, and however often the image so far was written.
        folder.done(&format!(
            "{render} -o again.exr --aov {ALL} --threads 3 --progress-image 0"
        ));
        assert!(folder.read("layers.exr") == folder.read("again.exr"), "{effort}");
    }
}

#[test]
fn direct_and_indirect_light_are_the_image() {
    let folder = Folder::with(&[CAMERA, SKY, RED, FLOOR, LAMP, WALL].concat());
    for effort in ["--spp 8", "--resolution 64x48 --noise 0.03"] {
        folder.done(&format!(
            "render scene.toml -o out.exr -q {effort} --aov direct,indirect"
        ));
        let image = folder.exr("out.exr");
        let direct: Vec<[f32; 3]> = layer(&folder, "out.exr", Aov::Direct);
        let indirect: Vec<[f32; 3]> = layer(&folder, "out.exr", Aov::Indirect);
        let mut lit = 0;
        for (pixel, (direct, indirect)) in image.pixels.iter().zip(direct.iter().zip(&indirect)) {
            for c in 0..3 {
                let sum = f64::from(direct[c]) + f64::from(indirect[c]);
                // Each of the three numbers is rounded once.
                let bound = 1.5 * f64::from(f32::EPSILON) * f64::from(pixel[c]);
                assert!((sum - f64::from(pixel[c])).abs() <= bound, "{sum} for {}", pixel[c]);
                assert!(indirect[c] >= 0.0, "{indirect:?}");
            }
            lit += usize::from(direct[0] > 0.0 && indirect[0] > 0.0);
        }
        assert!(lit > 20, "{lit} pixels have both");
    }
    // The direct part is the image of direct light alone.
    folder.done("render scene.toml -o both.exr -q --spp 8 --aov direct");
    folder.done("render scene.toml -o direct.exr -q --spp 8 --lighting direct --aov indirect");
    let direct = folder
        .exr("direct.exr")
        .pixels
        .iter()
        .map(|p| p.to_array())
        .collect::<Vec<_>>();
    assert_eq!(layer::<3>(&folder, "both.exr", Aov::Direct), direct);
    assert_eq!(mean(&layer::<3>(&folder, "direct.exr", Aov::Indirect)), 0.0);
}

#[test]
fn variance_samples_and_attributes_agree_with_the_statistics() {
    let folder = Folder::with_scene();
    for (effort, is_adaptive) in [("--spp 8", false), ("--resolution 64x48 --noise 0.01", true)] {
        folder.done(&format!(
            "render scene.toml -o out.exr -q --stats s.json {effort} --aov variance,samples"
        ));
        let stats = folder.json("s.json");
        let number = |path: &str| {
            stats
                .pointer(path)
                .and_then(|v| v.as_f64())
                .unwrap_or_else(|| panic!("{path}"))
        };
        let is_near = |a: f64, b: f64| (a / b - 1.0).abs() < 1e-6;

        let variance = mean(&layer::<3>(&folder, "out.exr", Aov::Variance));
        assert!(
            variance > 0.0 && is_near(variance, number("/error/mse/value")),
            "{variance}"
        );
        let samples: Vec<[f32; 1]> = layer(&folder, "out.exr", Aov::Samples);
        assert!(is_near(mean(&samples), number("/spp_mean")));
        let least = samples.iter().fold(f32::INFINITY, |least, [n]| least.min(*n));
        let most = samples.iter().fold(0.0, |most: f32, [n]| most.max(*n));
        assert_eq!(
            (f64::from(least), f64::from(most)),
            (number("/spp"), number("/spp_most"))
        );
        assert_eq!(least < most, is_adaptive);

        let bytes = folder.read("out.exr");
        assert_eq!(f64::from(int_attribute(&bytes, "spp")), number("/spp"));
        assert_eq!(f64::from(int_attribute(&bytes, "spp_most")), number("/spp_most"));
        let errors = errors(&folder, "out.exr");
        assert_eq!(errors.len(), 6);
        for name in ["relmse", "rmse"] {
            for (suffix, end) in [("", "value"), ("_low", "low"), ("_high", "high")] {
                let value = f64::from(errors[&format!("{name}{suffix}")]);
                assert!(
                    is_near(value, number(&format!("/error/{name}/{end}"))),
                    "{name}{suffix}"
                );
            }
        }
    }
}

#[test]
fn a_file_without_an_estimate_of_its_error_claims_none() {
    let folder = Folder::with_scene();
    folder.done("render scene.toml -o out.exr -q --sampler sobol-whole --spp 4");
    assert!(errors(&folder, "out.exr").is_empty());
    folder.done("render scene.toml -o out.exr -q --spp 1 --aov variance");
    assert!(errors(&folder, "out.exr").is_empty());
    let variance: Vec<[f32; 3]> = layer(&folder, "out.exr", Aov::Variance);
    assert!(variance.iter().flatten().all(|v| *v == f32::INFINITY));
}

#[test]
fn layers_that_cannot_be_made_are_refused_before_anything_is_read() {
    let folder = Folder::empty();
    for (arguments, words) in [
        (
            "-o out.exr --aov depth,normla",
            &["--aov", "`normla` is not an AOV", "did you mean `normal`?"][..],
        ),
        ("-o out.exr --aov samples,samples", &["`samples` is named twice"]),
        ("-o out.exr --aov depth,", &["`` is not an AOV"]),
        ("-o out.exr --aov depth --aov normal", &["--aov", "multiple times"]),
        ("-o out.png --aov depth", &["--aov", ".exr among the outputs"]),
        (
            "-o out.exr --aov variance --sampler sobol-whole",
            &["--aov variance", "sobol-whole"],
        ),
    ] {
        folder.refused(&format!("render none.toml {arguments}"), 2, words);
    }
    let folder = Folder::with_scene();
    folder.done("render scene.toml -o out.exr -o out.png -q --spp 1 --sampler sobol-whole --aov depth,samples");
}

/// Sixteen samples of so many pixels take seconds.
#[test]
fn layers_without_time_are_left_out_with_a_warning_and_the_image_is_there() {
    let folder = Folder::with_scene();
    let render = || {
        folder.run(
            "render scene.toml -o out.exr --resolution 1200x900 --time 400ms --threads 1 --aov depth,samples,normal",
        )
    };
    // A machine that pauses for all of the time has no image to look at.
    let ran = (0..20)
        .map(|_| render())
        .find(|ran| !ran.stderr.contains("no time for a single sample"))
        .expect("some samples in one of the renders");
    // On a slow machine there is no sample for every pixel either.
    assert!([Some(0), Some(5)].contains(&ran.code), "{}", ran.stderr);
    let warning = "warning: there was no time for all of the layers depth, normal; they are left out";
    assert!(ran.stderr.contains(warning), "{}", ran.stderr);
    assert_eq!(channels(&folder, "out.exr"), ["B", "G", "R", "samples.Y"]);
    assert!(mean(&layer::<1>(&folder, "out.exr", Aov::Samples)) > 0.0);
}

#[cfg(unix)]
#[test]
fn an_interrupted_render_keeps_its_layers() {
    use std::process::Stdio;
    use std::time::{Duration, Instant};
    use support::program::{exit_code_within, send};
    let folder = Folder::with_scene();
    let mut child = folder
        .command(&format!(
            "render scene.toml -o out.exr -q --spp 100000000 --threads 1 --progress-image 0 --aov {ALL}"
        ))
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    // The image so far shows that it renders.
    let start = Instant::now();
    while !folder.path("out.exr").exists() {
        assert!(start.elapsed() < Duration::from_secs(60), "no image");
        std::thread::sleep(Duration::from_millis(10));
    }
    assert_eq!(
        channels(&folder, "out.exr"),
        ["B", "G", "R"],
        "no layers before the end"
    );
    send("INT", &child);
    assert_eq!(exit_code_within(&mut child, Duration::from_secs(5)), Some(130));
    assert_eq!(channels(&folder, "out.exr").len(), 3 + 20);
    let depths: Vec<[f32; 1]> = layer(&folder, "out.exr", Aov::Depth);
    assert!(depths.iter().any(|[z]| z.is_finite()) && depths.iter().any(|[z]| z.is_infinite()));
    let samples: Vec<[f32; 1]> = layer(&folder, "out.exr", Aov::Samples);
    assert!(samples.iter().all(|[n]| *n >= 1.0));
}
