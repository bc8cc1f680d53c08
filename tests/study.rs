//! `embrace study`: its files, how it goes on, what it refuses, its statistics, and its report in a browser.

mod support;

use embrace::image::Image;
use embrace::image::exr::{self, ExrMetadata};
use embrace::math::Rgb;
use embrace::study::analysis::{Estimate, Point, Slope, pareto_front, reached, samples_to_halve, slope, slopes};
use embrace::study::bias::{self, Bias};
use embrace::study::cell::{Cell, Run};
use embrace::study::measure::{Errors, Pixels, Replications, errors};
use embrace::study::reference::{Noise, REPLICATIONS, Reference};

use embrace::study::{SCHEMA, quoted};
use serde_json::Value;
use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant, SystemTime};
use support::Random;
use tempfile::TempDir;

const SCENE: &str = r#"
[camera]
position = [0, 1, 4]
look_at = [0, 0.5, 0]
vfov = 40
resolution = [16, 12]
[environment]
radiance = [0.5, 0.6, 0.8]
[materials.red]
type = "diffuse"
rgb = [0.7, 0.2, 0.1]
[[meshes]]
file = "floor.obj"
material = "red"
[[meshes]]
file = "floor.obj"
material = "red"
transform = [[0.3, 0, 0, 0], [0, -1, 0, 1.5], [0, 0, -0.3, 0], [0, 0, 0, 1]]
emission = { radiance = [9, 8, 7], sides = "both" }
"#;
const SQUARE: &str = "v -1 0 1\nv 1 0 1\nv 1 0 -1\nv -1 0 -1\nf 1 2 3 4\n";

/// A small study: three numbers of samples, and one setting beside the default.
const SMALL: &str = "--max-spp 4 --reference-spp 64 --max-table 1000 --threads 2 --only mis-off,direct";

struct Ran {
    code: Option<i32>,
    stderr: String,
}

struct Folder(TempDir);

impl Folder {
    fn with_scene(name: &str) -> Folder {
        let folder = Folder(tempfile::tempdir().unwrap());
        fs::write(folder.path(name), SCENE).unwrap();
        fs::write(folder.path("floor.obj"), SQUARE).unwrap();
        folder
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn command(&self, scene: &str, arguments: &str) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_embrace"));
        command.current_dir(self.0.path()).args(["study", scene]);
        command.args(arguments.split_whitespace()).stdin(Stdio::null());
        command
    }

    fn run(&self, scene: &str, arguments: &str) -> Ran {
        let output = self.command(scene, arguments).output().unwrap();
        assert!(output.stdout.is_empty());
        Ran {
            code: output.status.code(),
            stderr: String::from_utf8(output.stderr).unwrap(),
        }
    }

    fn done(&self, scene: &str, arguments: &str) -> Ran {
        let ran = self.run(scene, arguments);
        assert_eq!(ran.code, Some(0), "{arguments}: {}", ran.stderr);
        ran
    }

    fn json(&self, name: &str) -> Value {
        serde_json::from_slice(&fs::read(self.path(name)).unwrap()).unwrap()
    }

    /// Finished cells and when they were written.
    fn cells(&self, study: &str) -> BTreeMap<String, SystemTime> {
        let Ok(entries) = fs::read_dir(self.path(study).join("cells")) else {
            return BTreeMap::new();
        };
        let names = entries
            .map(|e| e.unwrap())
            .filter(|e| e.path().extension().is_some_and(|e| e == "json"));
        names
            .map(|e| {
                (
                    e.file_name().into_string().unwrap(),
                    e.metadata().unwrap().modified().unwrap(),
                )
            })
            .collect()
    }
}

// The command.

#[test]
fn a_study_writes_its_files_and_another_run_renders_nothing_again() {
    let folder = Folder::with_scene("scene.toml");
    folder.done("scene.toml", SMALL);
    let study = folder.json("study-scene/study.json");
    assert_eq!(study["schema"], SCHEMA);
    let settings = study["settings"].as_array().unwrap();
    let ids: Vec<&str> = settings.iter().map(|s| s["id"].as_str().unwrap()).collect();
    assert_eq!(ids, ["default", "direct", "mis-off"]);
    for setting in settings {
        let points = setting["points"].as_array().unwrap();
        assert_eq!(
            points.iter().map(|p| p["spp"].as_u64().unwrap()).collect::<Vec<_>>(),
            [1, 2, 4]
        );
        assert!(points.iter().all(|p| p["relmse"]["mean"].as_f64().unwrap() > 0.0));
        assert!(points.iter().all(|p| p["seconds"]["mean"].as_f64().unwrap() > 0.0));
        assert!(
            setting["command"]
                .as_str()
                .unwrap()
                .starts_with("embrace render scene.toml")
        );
    }
    assert_eq!(study["best"].as_array().unwrap().len(), 3);
    assert_eq!(study["choices"].as_array().unwrap().len(), 1);
    assert!(study["accumulation"]["points"].as_array().unwrap().len() > 5);

    let csv = fs::read_to_string(folder.path("study-scene/study.csv")).unwrap();
    let columns = csv.lines().next().unwrap().split(',').count();
    assert_eq!(csv.lines().count(), 1 + 3 * 3 * 8);
    assert!(csv.lines().all(|line| line.split(',').count() == columns));

    // All but the times of writing stays as it is.
    let before = folder.cells("study-scene");
    // Cells, references, a table and the sums.
    assert_eq!(before.len(), 3 * 3 + 2 + 1 + 1, "{before:?}");
    let report = fs::read(folder.path("study-scene/report.html")).unwrap();
    let ran = folder.done("scene.toml", SMALL);
    assert!(!ran.stderr.contains("note:"), "{}", ran.stderr);
    assert_eq!(folder.cells("study-scene"), before);
    assert!(folder.json("study-scene/study.json") == study);
    assert!(report == fs::read(folder.path("study-scene/report.html")).unwrap());

    // A damaged cell is made again, and no other.
    let cell = "study-scene/cells/mis-off-2.json";
    let content = fs::read(folder.path(cell)).unwrap();
    fs::write(folder.path(cell), &content[..content.len() / 2]).unwrap();
    let ran = folder.done("scene.toml", SMALL);
    assert!(ran.stderr.contains("mis-off-2.json is damaged"), "{}", ran.stderr);
    let after = folder.cells("study-scene");
    let changed: Vec<&String> = before.keys().filter(|name| before[*name] != after[*name]).collect();
    assert_eq!(changed, ["mis-off-2.json"]);

    // Another scene of the same name has nothing in common but the tables.
    fs::write(
        folder.path("scene.toml"),
        SCENE.replace("0.7, 0.2, 0.1", "0.1, 0.2, 0.7"),
    )
    .unwrap();
    let ran = folder.done("scene.toml", SMALL);
    assert!(
        ran.stderr.contains("default-1.json is of another scene"),
        "{}",
        ran.stderr
    );
    let last = folder.cells("study-scene");
    assert!(
        last.keys()
            .all(|name| (last[name] == after[name]) == name.starts_with("table")),
        "{last:?}"
    );
}

#[cfg(unix)]
#[test]
fn an_interrupted_study_keeps_what_is_finished_and_goes_on_from_there() {
    let folder = Folder::with_scene("scene.toml");
    for (signal, code) in [("INT", 130), ("TERM", 143)] {
        let out = format!("-o {signal} --reference-spp 64 --max-table 0 --threads 2 --only direct");
        let mut child = folder
            .command("scene.toml", &format!("{out} --max-spp 1048576 --cell-time 1e9"))
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        wait_until(&mut child, || folder.cells(signal).contains_key("default-2.json"));
        let kill = format!("kill -{signal} {}", child.id());
        assert!(Command::new("sh").args(["-c", &kill]).status().unwrap().success());
        let output = child.wait_with_output().unwrap();
        assert_eq!(output.status.code(), Some(code));
        let stderr = String::from_utf8(output.stderr).unwrap();
        assert!(stderr.contains("the same command goes on"), "{stderr}");
        assert!(!folder.path(signal).join("report.html").exists());

        let kept = folder.cells(signal);
        folder.done("scene.toml", &format!("{out} --max-spp 2"));
        let after = folder.cells(signal);
        assert!(kept.keys().all(|name| kept[name] == after[name]), "{kept:?} {after:?}");
        assert!(folder.path(signal).join("report.html").exists());
    }
}

#[cfg(unix)]
fn wait_until(child: &mut Child, is_so: impl Fn() -> bool) {
    let start = Instant::now();
    while !is_so() {
        assert!(child.try_wait().unwrap().is_none(), "ended early");
        assert!(start.elapsed() < Duration::from_secs(120), "nothing is finished");
        std::thread::sleep(Duration::from_millis(5));
    }
}

#[test]
fn what_cannot_be_studied_is_refused_before_anything_is_made() {
    let folder = Folder::with_scene("scene.toml");
    let write = |name: &str, image: &Image<Rgb>| {
        let mut bytes = Vec::new();
        exr::write(&mut bytes, image, &ExrMetadata::default(), Path::new(name)).unwrap();
        fs::write(folder.path(name), bytes).unwrap();
    };
    write("small.exr", &Image::filled(8, 6, Rgb::splat(0.5)));
    let mut image = Image::filled(16, 12, Rgb::splat(0.5));
    image.pixels[16 * 2 + 3] = Rgb::splat(f32::NAN);
    image.pixels[16 * 5] = Rgb::splat(f32::INFINITY);
    write("nan.exr", &image);
    fs::write(folder.path("file"), "").unwrap();
    let cases: [(&str, i32, &[&str]); 9] = [
        (
            "--reference small.exr",
            3,
            &["small.exr", "8 x 6", "16 x 12", "--resolution 8x6"],
        ),
        ("--reference nan.exr", 3, &["nan.exr", "2 pixels", "column 3, row 2"]),
        ("--reference none.exr", 3, &["none.exr", "cannot be read"]),
        ("-o file", 4, &["file", "cannot be made"]),
        ("-o /dev/null/study", 4, &["/dev/null/study"]),
        ("--cell-time 0", 2, &["above 0"]),
        ("--cell-time nan", 2, &["above 0"]),
        ("--seeds 7", 2, &["8"]),
        ("--only nonsense", 2, &["nonsense", "roulette-fixed"]),
    ];
    let names = || fs::read_dir(folder.path("")).unwrap().count();
    let before = names();
    for (arguments, code, words) in cases {
        let ran = folder.run("scene.toml", arguments);
        assert_eq!(ran.code, Some(code), "{arguments}: {}", ran.stderr);
        for word in words {
            assert!(ran.stderr.contains(word), "{arguments}: no `{word}` in {}", ran.stderr);
        }
        assert_eq!(names(), before, "{arguments}");
    }
    // A good one is taken, and that its noise is not known is said.
    image.pixels.fill(Rgb::splat(0.5));
    write("good.exr", &image);
    folder.done(
        "scene.toml",
        "--reference good.exr --max-spp 16 --max-table 0 --only mis-off",
    );
    let study = folder.json("study-scene/study.json");
    assert!(study["references"][0]["noise"].is_null());
    assert!(
        study["notes"][0]
            .as_str()
            .unwrap()
            .contains("noise of the given reference")
    );
    // It has nothing to do with the scene, and the test says so.
    assert_eq!(study["settings"][0]["verdict"], "biased");
}

// Statistics.

/// Nearly normal: the sum of twelve uniform numbers.
fn normal(random: &mut Random) -> f64 {
    (0..12).map(|_| f64::from(random.unit())).sum::<f64>() - 6.0
}

#[test]
fn the_fit_finds_slopes_that_are_known_within_their_errors() {
    let mut random = Random(1);
    for true_slope in [-1.0, -1.5, -0.5] {
        let spp: Vec<u32> = (0..11).map(|k| 1 << k).collect();
        let errors: Vec<Vec<f64>> = spp
            .iter()
            .map(|&n| {
                let error = 3.0 * f64::from(n).powf(true_slope);
                (0..8).map(|_| error * (0.1 * normal(&mut random)).exp()).collect()
            })
            .collect();
        let fit = slope(&spp, &errors).unwrap();
        let Estimate { mean, standard_error } = fit.slope;
        assert!(
            (mean - true_slope).abs() < 4.0 * standard_error,
            "{mean} ± {standard_error}"
        );
        assert!(standard_error > 0.0 && standard_error < 0.02, "{standard_error}");
        assert_eq!(fit.spp, [1, 1024]);
    }
    assert!(slope(&[1], &[vec![1.0; 8]]).is_none());
    // What is not above zero, the noise of the reference subtracted, is no error to fit.
    assert!(slope(&[1, 2], &[vec![1.0; 8], vec![-1.0; 8]]).is_none());
    assert_eq!(samples_to_halve(-1.0), Some(4.0));
    assert_eq!(samples_to_halve(0.1), None);
}

/// The verdict on 8 images of 40 x 30 pixels with `noise`, and an `offset` in a tenth of the pixels, against a reference of
/// less noise.
fn verdict(seed: u64, noise: f64, offset: f64) -> Bias {
    let mut random = Random(seed);
    let mut image = |noise: f64, offset: f64| Pixels {
        width: 40,
        height: 30,
        values: (0..1200)
            .map(|i| {
                let value = 0.5 + noise * normal(&mut random) + if i % 10 == 0 { offset } else { 0.0 };
                [value; 3]
            })
            .collect(),
    };
    let mut reference = Replications::new(1200);
    (0..REPLICATIONS).for_each(|_| reference.add(&image(0.3 * noise, 0.0)));
    let variance = reference.variance_of_mean().iter().map(|v| v[3]).collect();
    let pixels = Pixels {
        width: 40,
        height: 30,
        values: reference.mean(),
    };
    let mut images = Replications::new(1200);
    (0..8).for_each(|_| images.add(&image(noise, offset)));
    bias::of(&images, &Reference::new(pixels, Some((Noise::default(), variance))))
}

#[test]
fn a_bias_below_the_noise_is_flagged_and_noise_alone_is_not() {
    // 0.15 off in a tenth of the pixels, under noise of 0.2 in each: 1/18 of the MSE.
    let floor = 0.15 * 0.15 * 0.1 / (0.5 * 0.5 + 0.01);
    for seed in 0..50 {
        let clean = verdict(seed, 0.2, 0.0);
        // 20 settings of which none is biased: 1 in 100 studies has a flag.
        assert!(!clean.is_significant(20), "{clean:?}");
        assert!(clean.floor.abs() < 4.5 * clean.standard_error, "{clean:?}");
        let biased = verdict(seed, 0.2, 0.15);
        assert!(biased.is_significant(20), "{biased:?}");
        assert!((biased.floor / floor - 1.0).abs() < 0.7, "{} {floor}", biased.floor);
        assert!(biased.upper_bound() > floor * 0.7);
    }
    let mean = (0..50).map(|seed| verdict(seed, 0.2, 0.15).floor).sum::<f64>() / 50.0;
    assert!((mean / floor - 1.0).abs() < 0.05, "{mean} {floor}");
}

#[test]
fn rare_bright_samples_do_not_pass_for_a_bias() {
    for seed in 0..50 {
        let mut random = Random(seed);
        // One sample in a thousand brings all the light.
        let mut image = || Pixels {
            width: 40,
            height: 30,
            values: (0..1200)
                .map(|_| [if random.below(1000) == 0 { 500.0 } else { 0.0 }; 3])
                .collect(),
        };
        let mut images = Replications::new(1200);
        (0..8).for_each(|_| images.add(&image()));
        let exact = Pixels {
            width: 40,
            height: 30,
            values: vec![[0.5; 3]; 1200],
        };
        let bias = bias::of(&images, &Reference::new(exact, None));
        assert!(!bias.is_significant(1), "{bias:?}");
    }
}

#[test]
fn errors_are_those_of_compare_and_fireflies_are_counted() {
    let reference = Image::filled(20, 10, Rgb::new(0.5, 0.25, 1.0));
    let mut image = Image::filled(20, 10, Rgb::new(0.6, 0.25, 0.9));
    image.pixels[45] = Rgb::splat(50.0);
    let compared = embrace::image::compare::compare(&reference, &image).unwrap();
    let [a, b] = [&reference, &image].map(Pixels::of_image);
    let errors = errors(&b, &a, &Reference::new(a.clone(), None).brightest);
    for (ours, theirs) in [
        (errors.mse, compared.mse),
        (errors.relmse, compared.relmse),
        (errors.relmse_trimmed, compared.relmse_trimmed),
    ] {
        assert!((ours / theirs - 1.0).abs() < 1e-12, "{ours} {theirs}");
    }
    assert_eq!((errors.worst.x, errors.worst.y, errors.fireflies), (5, 2, 1));
}

/// A setting whose error is 8 / samples^`power`, with `noise` from seed to seed; a sample takes a tenth of a second.
fn cells(power: f64, noise: f64) -> Vec<Cell> {
    let mut random = Random(7);
    let mut run = |spp: u32, seed: u64| Run {
        seed,
        seconds: 0.1 * f64::from(spp),
        errors: Errors {
            mse: 8.0 / f64::from(spp).powf(power) * (noise * normal(&mut random)).exp(),
            relmse: 8.0 / f64::from(spp).powf(power) * (noise * normal(&mut random)).exp(),
            ..Errors::default()
        },
        dropped: 0,
    };
    let mut cell = |spp: u32| Cell {
        spp,
        build_seconds: 0.0,
        runs: (0..8).map(|seed| run(spp, seed)).collect(),
        bias: Bias::default(),
        flip: 0.0,
    };
    [4, 8, 16, 32].map(&mut cell).into()
}

#[test]
fn what_a_time_reaches_is_interpolated_and_beyond_the_measurements_extrapolated_and_marked() {
    let noise = Noise { mse: 0.0, relmse: 1e-3 };
    // The noise of the reference is subtracted; with it errors fall as samples to the power 1.5.
    let cells_of = |power, spread| -> (Vec<Point>, Option<Slope>) {
        let cells = cells(power, spread);
        let points: Vec<Point> = cells.iter().map(|cell| Point::of(cell, noise)).collect();
        let [_, slope] = slopes(&cells.iter().collect::<Vec<_>>(), &points, noise);
        (points, slope)
    };
    let (points, slope) = cells_of(1.5, 0.0);
    let at = |seconds| reached(&points, slope, 0.0, seconds);
    assert_eq!(at(0.1).relmse, None);
    let between = at(0.8 * 2f64.sqrt());
    assert!(!between.is_extrapolated);
    let expected = ((8.0 / 8f64.powf(1.5) - 1e-3) * (8.0 / 16f64.powf(1.5) - 1e-3)).sqrt();
    assert!((between.relmse.unwrap() / expected - 1.0).abs() < 1e-9);
    let beyond = at(32.0);
    assert!(beyond.is_extrapolated);
    assert!((beyond.spp / 320.0 - 1.0).abs() < 1e-9);
    let last = 8.0 / 32f64.powf(1.5) - 1e-3;
    let slope = slope.unwrap().slope.mean;
    assert!((beyond.relmse.unwrap() / (last * 10f64.powf(slope)) - 1.0).abs() < 1e-9);
    // It never falls below a floor.
    let floor = reached(&points, None, 0.01, 1e9).relmse.unwrap();
    assert!((floor - 0.01).abs() < 1e-6, "{floor}");
    // A slope that is not known well is not trusted.
    let (points, slope) = cells_of(1.5, 1.0);
    assert!(slope.unwrap().slope.standard_error > 0.1);
    let ratio = reached(&points, slope, 0.0, 32.0).relmse.unwrap() / points[3].relmse.mean;
    assert!((ratio - 0.1).abs() < 1e-9, "{ratio}");
    // What is lost in the noise of the reference takes no part.
    let lost = Noise { mse: 1.0, relmse: 1.0 };
    let cells = cells(1.0, 0.0);
    let points: Vec<Point> = cells.iter().map(|cell| Point::of(cell, lost)).collect();
    assert!(points.iter().all(|p| !p.is_above_noise));
    assert_eq!(reached(&points, None, 0.0, 1.0).relmse, None);
}

#[test]
fn the_pareto_front_has_what_nothing_else_beats() {
    let points = [(1.0, 5.0), (2.0, 6.0), (2.0, 3.0), (4.0, 3.0), (8.0, 1.0), (0.5, 9.0)];
    assert_eq!(pareto_front(&points), [5, 0, 2, 4]);
}

// The report.

#[test]
fn the_report_refers_to_nothing_outside_and_escapes_the_names_of_files() {
    let hostile = r#"<img src=x onerror=alert(1)>&"'.toml"#;
    let folder = Folder::with_scene(hostile);
    folder.done(hostile, &format!("-o out {SMALL}"));
    let html = fs::read_to_string(folder.path("out/report.html")).unwrap();
    assert!(!html.contains("<img src=x"));
    assert!(html.contains("&lt;img src=x onerror=alert(1)&gt;"));
    assert!(html.contains("<svg"));
    for outside in [
        "http:", "https:", "url(", "@import", "<link", "<iframe", "fetch(", "src=\"/", "href",
    ] {
        assert!(!html.contains(outside), "{outside}");
    }
    let sources: Vec<&str> = html.split("src=\"").skip(1).collect();
    assert!(sources.len() > 6);
    assert!(sources.iter().all(|s| s.starts_with("data:image/png;base64,")));
    assert_eq!(quoted("a b'c"), r"'a b'\''c'");
}

/// The browser, if there is one. That a test is left out is said even where output is captured.
fn chromium(test: &str) -> Option<PathBuf> {
    let paths = std::env::var_os("PATH")?;
    let found = std::env::split_paths(&paths)
        .map(|path| path.join("chromium"))
        .find(|path| path.is_file());
    if found.is_none() {
        use std::io::Write;
        let _ = writeln!(std::io::stderr(), "SKIPPED {test}: no chromium on PATH");
    }
    found
}

/// The page after its scripts have run, and what the browser's console says.
fn load(chromium: &Path, page: &Path, width: u32) -> (String, Vec<String>) {
    let profile = tempfile::tempdir().unwrap();
    let output = Command::new(chromium)
        .args([
            "--headless",
            "--no-sandbox",
            "--disable-gpu",
            "--disable-dev-shm-usage",
            "--enable-logging=stderr",
        ])
        .args([
            "--virtual-time-budget=5000",
            "--dump-dom",
            "--no-first-run",
            "--disable-extensions",
        ])
        .arg(format!("--user-data-dir={}", profile.path().display()))
        .arg(format!("--window-size={width},900"))
        .arg(page)
        .output()
        .unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let console = String::from_utf8_lossy(&output.stderr);
    let console = console
        .lines()
        .filter(|line| line.contains("CONSOLE"))
        .map(str::to_owned)
        .collect();
    (String::from_utf8(output.stdout).unwrap(), console)
}

/// Uses the page as a person would, and leaves what happened in an attribute.
const USE: &str = r##"<script>
addEventListener("load", () => {
  const one = (s) => document.querySelector(s), all = (s) => [...document.querySelectorAll(s)];
  const clip = () => getComputedStyle(one(".stack .right")).clipPath;
  const before = clip();
  one("#split").value = 80;
  one("#split").dispatchEvent(new Event("input"));
  const shown = one(".stack .right").src;
  one("#right").selectedIndex = 0;
  one("#right").dispatchEvent(new Event("change"));
  document.documentElement.dataset.result = [
    before, clip(), shown !== one(".stack .right").src, one(".flip").hidden,
    all(".gallery img").length, all(".gallery img").every((i) => i.complete && i.naturalWidth === 16),
    all("svg.plot").length,
    all("svg.plot").every((s) => s.getBoundingClientRect().width > 200 && s.querySelectorAll("circle, polygon").length > 2),
    document.documentElement.scrollWidth <= innerWidth,
  ].join("|");
});
</script>"##;

#[test]
fn in_a_browser_the_report_has_its_plots_the_slider_moves_and_the_console_is_silent() {
    let Some(chromium) = chromium("the report in a browser") else {
        return;
    };
    let folder = Folder::with_scene("scene.toml");
    folder.done("scene.toml", &format!("-o out {SMALL}"));
    let html = fs::read_to_string(folder.path("out/report.html")).unwrap();
    let page = folder.path("out/used.html");
    for width in [1200, 500] {
        fs::write(&page, html.clone() + USE).unwrap();
        let (dom, console) = load(&chromium, &page, width);
        assert!(console.is_empty(), "{console:?}");
        let result = dom
            .split("data-result=\"")
            .nth(1)
            .expect("the page was used")
            .split('"')
            .next()
            .unwrap();
        let result: Vec<&str> = result.split('|').collect();
        assert_eq!(
            result[..4],
            ["inset(0px 0px 0px 50%)", "inset(0px 0px 0px 80%)", "true", "true"]
        );
        // Two references, and three settings with their FLIP maps.
        assert_eq!(result[4..6], ["8", "true"]);
        // The overview, two for each of two groups, the tables.
        assert_eq!(result[6..], ["6", "true", "true"]);
    }
    // The console would have been heard.
    fs::write(&page, html + "<script>undefined_function()</script>").unwrap();
    let (_, console) = load(&chromium, &page, 1200);
    assert!(
        console.iter().any(|line| line.contains("undefined_function")),
        "{console:?}"
    );
}
