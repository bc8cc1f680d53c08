//! The render tests of Mitsuba's own data (github.com/mitsuba-renderer/mitsuba-data) by the method of Mitsuba's
//! `test_renders.py`: docs/mitsuba.md says how to run them and what came out.
//!
//! Each pixel and channel (CIE XYZ) is a two-sided z-test of our mean against the reference's, with the reference's variance
//! of a sample, at least 1e-4, over our number of samples: two million for the image. The significance of 1 % is corrected
//! for the number of pixels (Šidák), and 99.75 % of pixels and channels have to pass.

mod support;

use embrace::image::{self, Image};
use embrace::integrator::Settings;
use embrace::math::Rgb;
use embrace::scene::{LoadError, LoadOptions, SceneDesc, SceneOptions, load};
use statrs::function::erf::erfc;
use std::path::{Path, PathBuf};
use support::{Prepared, write_failure};

#[cfg(feature = "embree")]
type Backend = embrace::accel::embree::Embree;
#[cfg(not(feature = "embree"))]
type Backend = embrace::accel::obvhs::Obvhs;

const SAMPLE_BUDGET: u64 = 2_000_000;
const SIGNIFICANCE: f64 = 0.01;
const SHARE_TO_ACCEPT: f64 = 0.9975;
const LEAST_VARIANCE: f64 = 1e-4;

/// Scenes that are refused for what they use, and what the message names.
const REFUSED: [(&str, &str); 17] = [
    ("bsdf_spheres/test_texturedprincipledthin", "principledthin"),
    ("orthographic_sensor/test_orthographic", "orthographic"),
    ("participating_media/test_hetero_sigmat", "<medium>"),
    ("participating_media/test_hetero_sigmat_albedo", "<medium>"),
    ("participating_media/test_hetero_spectral_sigmat", "<medium>"),
    (
        "participating_media/test_hetero_spectral_sigmat_no_scattering",
        "<medium>",
    ),
    ("participating_media/test_homo_area_light", "<medium>"),
    ("participating_media/test_homo_dielectric_envmap", "<medium>"),
    ("participating_media/test_homo_emitter_inside_medium", "<medium>"),
    ("participating_media/test_homo_null_envmap", "<medium>"),
    ("participating_media/test_homo_obj_inside_medium", "<medium>"),
    ("participating_media/test_homo_roughdielectric_spot", "<medium>"),
    ("participating_media/test_homo_spectral_sigmat", "<medium>"),
    ("projector/test_projector_constant", "projector"),
    ("projector/test_projector_textured", "projector"),
    ("various_emitters/test_various_emitters", "ptracer"),
    ("various_shapes/test_various_shapes", "sdfgrid"),
];

/// Scenes that we render with so many times the samples, which leaves what is wrong in the mean and takes noise away: what
/// Mitsuba evaluates at every sample, we choose at random.
const NOISIER: [(&str, u32); 1] = [("mesh_attributes/test_mesh_attributes_1_face", 64)];

/// What became of a scene.
enum Outcome {
    Refused(LoadError),
    Tested { accepted: f64, least_p: f64 },
}

#[test]
#[ignore = "needs the data of Mitsuba's tests: EMBRACE_MITSUBA_DATA=path of a checkout (docs/mitsuba.md)"]
fn scenes_of_mitsuba_pass_its_render_tests() {
    let data = std::env::var_os("EMBRACE_MITSUBA_DATA")
        .expect("EMBRACE_MITSUBA_DATA is the path of a checkout of github.com/mitsuba-renderer/mitsuba-data");
    let only = std::env::var("EMBRACE_MITSUBA_ONLY").unwrap_or_default();
    let mut rows = Vec::new();
    let mut is_good = true;
    for (name, file) in scenes(&PathBuf::from(data).join("tests/scenes")) {
        if !name.contains(&only) {
            continue;
        }
        let outcome = test(&name, &file);
        let expected = REFUSED.iter().find(|(refused, _)| *refused == name);
        let (verdict, is_expected) = match (&outcome, expected) {
            (Outcome::Refused(error), Some((_, why))) => (format!("refused: {error}"), error.to_string().contains(why)),
            (Outcome::Refused(error), None) => (format!("refused: {error}"), false),
            (Outcome::Tested { accepted, least_p }, expected) => {
                let passes = *accepted >= SHARE_TO_ACCEPT;
                let word = if passes { "passed" } else { "failed" };
                (
                    format!("{word} | {least_p:.2e} | {:.3} %", 100.0 * accepted),
                    passes && expected.is_none(),
                )
            }
        };
        println!("| {name} | {verdict} |");
        is_good &= is_expected;
        rows.push(name);
    }
    assert!(!rows.is_empty(), "no scenes there");
    assert!(
        is_good,
        "a scene failed, or was refused for what it should not be; see the table"
    );
}

/// The scenes with references, and their names without the integrator.
fn scenes(folder: &Path) -> Vec<(String, PathBuf)> {
    let entries = |folder: &Path| -> Vec<PathBuf> {
        let entries = std::fs::read_dir(folder).unwrap_or_else(|e| panic!("{}: {e}", folder.display()));
        entries.map(|entry| entry.expect("an entry").path()).collect()
    };
    let mut scenes: Vec<(String, PathBuf)> = entries(folder)
        .iter()
        .filter(|path| path.is_dir())
        .flat_map(|folder| entries(folder))
        .filter(|path| path.extension().is_some_and(|e| e == "xml"))
        .map(|path| {
            let stem = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
            let stem = stem.rsplit_once('_').map_or(stem.clone(), |(name, _)| name.to_owned());
            let parent = path.parent().and_then(Path::file_name).unwrap_or_default();
            (format!("{}/{stem}", parent.to_string_lossy()), path)
        })
        .collect();
    scenes.sort();
    scenes
}

fn read(path: &Path) -> Image<Rgb> {
    let bytes = std::fs::read(path).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
    image::read_rgb(path, &bytes).expect("a reference is an EXR")
}

fn test(name: &str, file: &Path) -> Outcome {
    let desc = match load(file, LoadOptions::default()) {
        Ok(desc) => desc,
        Err(error) => return Outcome::Refused(error),
    };
    let stem = name.rsplit('/').next().unwrap_or(name);
    let reference = |suffix: &str| read(&file.with_file_name(format!("refs/{stem}_ref_rgb{suffix}.exr")));
    let (mean, variance) = (reference(""), reference("_var"));
    let pixels = u64::from(mean.width) * u64::from(mean.height);
    assert_eq!(desc.camera.resolution, [mean.width, mean.height], "{name}");
    let spp = (SAMPLE_BUDGET / pixels) as u32;
    let settings = Settings {
        max_depth: desc.max_depth,
        // Mitsuba has no remedy for the shadow terminator.
        smooth_terminator: false,
        ..Settings::default()
    };
    let is_filtered = desc
        .warnings
        .iter()
        .any(|warning| warning.contains("filter is \"gaussian\""));
    let ours = if is_filtered {
        filtered(desc, &settings, spp)
    } else {
        let factor = NOISIER
            .iter()
            .find(|(noisier, _)| *noisier == name)
            .map_or(1, |(_, factor)| *factor);
        Prepared::<Backend>::new(desc, SceneOptions::default()).image(&settings, spp * factor)
    };
    let alpha = 1.0 - (1.0 - SIGNIFICANCE).powf(1.0 / pixels as f64);
    let (mut accepted, mut least_p) = (0u64, 1f64);
    let mut z = Image::filled(mean.width, mean.height, Rgb::BLACK);
    for (k, out) in z.pixels.iter_mut().enumerate() {
        let [a, b, v] = [&ours, &mean, &variance].map(|image| xyz(image.pixels[k]));
        *out = Rgb::from([0, 1, 2].map(|c| {
            let z = (a[c] - b[c]).abs() * (f64::from(spp) / v[c].max(LEAST_VARIANCE)).sqrt();
            let p = erfc(z / std::f64::consts::SQRT_2);
            accepted += u64::from(p > alpha);
            least_p = least_p.min(p);
            z as f32
        }));
    }
    let accepted = accepted as f64 / (3 * pixels) as f64;
    if accepted < SHARE_TO_ACCEPT || std::env::var_os("EMBRACE_MITSUBA_KEEP").is_some() {
        let images = [("ours", &ours), ("reference", &mean), ("z", &z)];
        println!("{}", write_failure(&name.replace('/', "-"), &images).display());
    }
    Outcome::Tested { accepted, least_p }
}

/// The image with the filter that Mitsuba has by default: a Gaussian of standard deviation 1/2 up to a distance of 2, less
/// its value there. Of pixels that are a fraction of the image's.
fn filtered(mut desc: SceneDesc, settings: &Settings, spp: u32) -> Image<Rgb> {
    const FINER: u32 = 8;
    let [width, height] = desc.camera.resolution;
    desc.camera.resolution = [width * FINER, height * FINER];
    let fine = Prepared::<Backend>::new(desc, SceneOptions::default()).image(settings, (spp / FINER.pow(2)).max(1));
    let weight = |from: u32, to: u32| {
        let distance = (f64::from(from) + 0.5) / f64::from(FINER) - (f64::from(to) + 0.5);
        ((-2.0 * distance * distance).exp() - (-8f64).exp()).max(0.0) as f32
    };
    let reach = |to: u32, size: u32| (to * FINER).saturating_sub(2 * FINER)..((to + 3) * FINER).min(size * FINER);
    let mut image = Image::filled(width, height, Rgb::BLACK);
    for y in 0..height {
        for x in 0..width {
            let (mut sum, mut weights) = (Rgb::BLACK, 0.0);
            for fine_y in reach(y, height) {
                for fine_x in reach(x, width) {
                    let weight = weight(fine_x, x) * weight(fine_y, y);
                    sum += *fine.at(fine_x, fine_y) * weight;
                    weights += weight;
                }
            }
            image.pixels[(y * width + x) as usize] = sum * (1.0 / weights);
        }
    }
    image
}

/// CIE XYZ of linear Rec. 709 RGB.
fn xyz(rgb: Rgb) -> [f64; 3] {
    let [r, g, b] = rgb.to_array().map(f64::from);
    [
        0.412453 * r + 0.357580 * g + 0.180423 * b,
        0.212671 * r + 0.715160 * g + 0.072169 * b,
        0.019334 * r + 0.119193 * g + 0.950227 * b,
    ]
}
