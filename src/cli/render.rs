//! `embrace render`

use super::interrupt::Interrupt;
use super::output::{self, Target};
use super::progress::Progress;
use super::progress_image::{self, ProgressImage, Snapshot};
use super::{Failure, RenderArgs, tell, with_backend};
use crate::accel::{Accel, BuildOptions, BuildQuality, Intersector};
use crate::film::Rect;
use crate::image::exr::ExrMetadata;
use crate::integrator::{Roulette, Settings, kernel_for};
use crate::render::{DroppedSamples, Job, render, render_passes};
use crate::scene::{self, LoadOptions, Scene, SceneOptions};
use rustix::time::{ClockId, clock_gettime};
use serde::Serialize;
use std::thread;
use std::time::Instant;

/// What `--stats` writes.
#[derive(Serialize)]
struct Stats<'a> {
    version: &'a str,
    scene: String,
    scene_hash: &'a str,
    backend: &'a str,
    backend_version: String,
    kernel: String,
    intersector: &'static str,
    build_quality: &'static str,
    threads: usize,
    width: u32,
    height: u32,
    spp: u32,
    seed: u64,
    interrupted: bool,
    load_seconds: f64,
    build_seconds: f64,
    render_seconds: f64,
    render_cpu_seconds: f64,
    write_seconds: f64,
    triangles: u64,
    instances: usize,
    lights: usize,
    paths: u64,
    paths_per_second: f64,
    rays: Rays,
    dropped_samples: DroppedSamples,
    peak_memory_bytes: u64,
    warnings: &'a [String],
}

#[derive(Serialize)]
struct Rays {
    camera: u64,
    bounce: u64,
    shadow: u64,
}

pub(super) fn run(args: &RenderArgs) -> Result<u8, Failure> {
    let targets = args
        .output
        .iter()
        .map(|path| Target::new(path))
        .collect::<Result<Vec<_>, _>>()?;
    if let Some(stats) = &args.stats {
        output::check_writable(stats)?;
    }
    let interrupt = Interrupt::watch().map_err(|e| Failure::internal(format!("signals cannot be watched: {e}")))?;
    let mut pool = rayon::ThreadPoolBuilder::new();
    if let Some(threads) = args.threads {
        pool = pool.num_threads(usize::from(threads));
    }
    let pool = pool
        .build()
        .map_err(|e| Failure::internal(format!("threads cannot be started: {e}")))?;
    pool.install(|| with_backend!(args.backend, run_on(args, &targets, &interrupt)))
}

fn run_on<A: Accel>(args: &RenderArgs, targets: &[Target], interrupt: &Interrupt) -> Result<u8, Failure> {
    let intersector = args.estimator.intersector();
    if !A::INTERSECTORS.contains(&intersector) {
        return Err(Failure::usage(format!(
            "the backend {} has no fast intersector: leave out --intersector, or take --backend embree",
            A::NAME
        )));
    }
    let start = Instant::now();
    let mut desc = scene::load(&args.scene, LoadOptions { strict: args.strict }).map_err(Failure::input)?;
    let load_seconds = start.elapsed().as_secs_f64();
    let warnings = std::mem::take(&mut desc.warnings);
    if !args.quiet {
        for warning in &warnings {
            tell(format_args!("warning: {warning}"));
        }
    }

    if let Some(resolution) = args.resolution {
        desc.camera.resolution = resolution;
    }
    let max_depth = args.max_depth.or(desc.max_depth);
    let settings = args.estimator.settings(args.seed, max_depth);
    check_settings(&settings)?;

    let start = Instant::now();
    let options = SceneOptions {
        env_sampling: settings.env_sampling,
        light_sampling: settings.light_sampling,
        mis: settings.mis,
        instancing: args.estimator.instancing(),
    };
    let scene = Scene::build(desc, options).map_err(|e| Failure::input(format!("{}: {e}", args.scene.display())))?;
    let [width, height] = scene.camera.resolution();
    let crop = crop(args, [width, height])?;
    let paths = crop.pixels() * u64::from(args.spp);
    // By the whole image, so that a crop is traced in the same tree: trees differ in which of two triangles at the same
    // distance is hit.
    let whole = u64::from(width) * u64::from(height) * u64::from(args.spp);
    let quality = args.estimator.build_quality(whole, scene.triangles());
    let accel = A::build(&scene.geometry, BuildOptions { intersector, quality }).map_err(Failure::internal)?;
    let build_seconds = start.elapsed().as_secs_f64();

    let kernel = kernel_for(&scene, args.estimator.kernel());
    let job = Job {
        crop,
        spp: args.spp,
        settings,
    };
    let progress = Progress::new(paths, args.quiet);

    let write = |(image, spp): &Snapshot, seconds: f64| {
        let metadata = ExrMetadata {
            scene_hash: Some(scene.hash.clone()),
            spp: Some(*spp),
            seed: Some(args.seed),
            backend: Some(format!("{} {}", A::NAME, A::version())),
            seconds: (!args.reproducible).then_some(seconds),
            display_size: Some([width, height]),
            offset: [crop.x0, crop.y0],
            ..output::metadata()
        };
        targets
            .iter()
            .try_for_each(|target| target.write(image, &metadata, args.exposure))
    };

    interrupt.keep_image();
    let (start, start_cpu) = (Instant::now(), process_seconds());
    let stop = || interrupt.raised().is_some();
    let update = |done| progress.update(done);
    let (film, report) = match args.progress_image {
        None => render(&scene, &accel, kernel, &job, &stop, &update),
        Some(interval) => {
            let (mut image, snapshots) = ProgressImage::new(interval);
            thread::scope(|scope| {
                let write = |snapshot: &Snapshot| write(snapshot, start.elapsed().as_secs_f64());
                scope.spawn(move || progress_image::write_all(snapshots, args.quiet, write));
                let result = render_passes(&scene, &accel, kernel, &job, &stop, &update, &mut |film| {
                    image.offer(film)
                });
                // Ends the writer, which the scope waits for.
                drop(image);
                result
            })
        }
    };
    let (render_seconds, render_cpu_seconds) = (start.elapsed().as_secs_f64(), process_seconds() - start_cpu);
    let (fewest, most) = film.sample_range();
    let interrupted = fewest < args.spp;
    progress.finish(!interrupted);

    let start = Instant::now();
    let snapshot = (film.develop(), fewest);
    write(&snapshot, render_seconds)?;
    let (image, _) = snapshot;
    let write_seconds = start.elapsed().as_secs_f64();

    if report.dropped.count > 0 && !args.quiet {
        tell(format_args!("warning: {}", describe_dropped(&report.dropped)));
    }
    if let Some(path) = &args.stats {
        let stats = Stats {
            version: env!("CARGO_PKG_VERSION"),
            scene: args.scene.display().to_string(),
            scene_hash: &scene.hash,
            backend: A::NAME,
            backend_version: A::version(),
            kernel: kernel.features.to_string(),
            intersector: match intersector {
                Intersector::Robust => "robust",
                Intersector::Fast => "fast",
            },
            build_quality: match quality {
                BuildQuality::Low => "low",
                BuildQuality::Medium => "medium",
                BuildQuality::High => "high",
            },
            threads: rayon::current_num_threads(),
            width: image.width,
            height: image.height,
            spp: fewest,
            seed: args.seed,
            interrupted,
            load_seconds,
            build_seconds,
            render_seconds,
            render_cpu_seconds,
            write_seconds,
            triangles: scene.triangles(),
            instances: scene.instances(),
            lights: scene.lights.len(),
            paths: report.paths,
            paths_per_second: report.paths as f64 / render_seconds.max(1e-9),
            rays: Rays {
                camera: report.rays.camera,
                bounce: report.rays.bounce,
                shadow: report.rays.shadow,
            },
            dropped_samples: report.dropped,
            peak_memory_bytes: peak_memory_bytes(),
            warnings: &warnings,
        };
        output::write_atomically(path, |writer| serde_json::to_writer_pretty(writer, &stats))?;
    }
    if !interrupted {
        return Ok(0);
    }
    if !args.quiet {
        tell(format_args!(
            "interrupted: the image has {fewest} to {most} of {} samples per pixel",
            args.spp
        ));
    }
    Ok(interrupt.raised().unwrap_or(1))
}

/// Settings under which a path may never end.
fn check_settings(settings: &Settings) -> Result<(), Failure> {
    if settings.roulette == Roulette::Off && settings.depth_limit() == u32::MAX {
        return Err(Failure::usage(
            "without roulette only a depth limit ends paths; give --max-depth, or integrator.max_depth in the scene",
        ));
    }
    Ok(())
}

fn crop(args: &RenderArgs, [width, height]: [u32; 2]) -> Result<Rect, Failure> {
    let Some([x0, y0, x1, y1]) = args.crop else {
        return Ok(Rect {
            x0: 0,
            y0: 0,
            x1: width,
            y1: height,
        });
    };
    if x1 > width || y1 > height {
        return Err(Failure::usage(format!(
            "--crop {x0},{y0},{x1},{y1} goes beyond the image of {width} x {height}"
        )));
    }
    Ok(Rect { x0, y0, x1, y1 })
}

fn describe_dropped(dropped: &DroppedSamples) -> String {
    let first = dropped.first.map_or_else(String::new, |f| {
        format!(
            ": the first is sample {} of the pixel in column {}, row {}",
            f.sample, f.x, f.y
        )
    });
    format!("{} samples were not finite and count as black{first}", dropped.count)
}

/// Processor time of all threads so far.
fn process_seconds() -> f64 {
    let time = clock_gettime(ClockId::ProcessCPUTime);
    time.tv_sec as f64 + time.tv_nsec as f64 * 1e-9
}

/// The most memory that the process has held; 0 where the system does not tell.
fn peak_memory_bytes() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let kibibytes = status
        .lines()
        .find_map(|line| line.strip_prefix("VmHWM:"))
        .and_then(|rest| rest.trim().trim_end_matches("kB").trim().parse::<u64>().ok());
    kibibytes.unwrap_or(0) * 1024
}
