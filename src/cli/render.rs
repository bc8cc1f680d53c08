//! `embrace render`

use super::budget::{Budget, Clock};
use super::interrupt::Interrupt;
use super::layers::{FIRST_HITS_SHARE, Layers};
use super::outcome::{Ending, Outcome};
use super::output::{self, Target};
use super::progress::Progress;
use super::progress_image::{self, ProgressImage, Snapshot};
use super::stats::{ErrorStats, Stats, peak_memory_bytes, process_seconds};
use super::{Failure, RenderArgs, tell, thread_pool, with_backend};
use crate::accel::{Accel, BuildOptions, BuildQuality, Intersector};
use crate::error;
use crate::film::{Film, Rect};
use crate::image::Image;
use crate::image::exr::{ExrMetadata, Layer};
use crate::integrator::{Roulette, Settings, kernel_for};
use crate::math::Rgb;
use crate::render::{DroppedSamples, Job, RenderReport, Watch, render_watched};
use crate::scene::{self, Scene, SceneOptions};
use std::thread;
use std::time::Instant;

pub(super) fn run(args: &RenderArgs) -> Result<u8, Failure> {
    let budget = Budget::new(args, Instant::now())?;
    let targets = args
        .output
        .iter()
        .map(|path| Target::new(path))
        .collect::<Result<Vec<_>, _>>()?;
    let layers = Layers::new(args, &targets, &budget)?;
    if let Some(stats) = &args.stats {
        output::check_writable(stats)?;
    }
    let interrupt = Interrupt::watch().map_err(|e| Failure::internal(format!("signals cannot be watched: {e}")))?;
    thread_pool(args.threads)?
        .install(|| with_backend!(args.backend, run_on(args, &budget, &targets, layers, &interrupt)))
}

fn run_on<A: Accel>(
    args: &RenderArgs,
    budget: &Budget,
    targets: &[Target],
    mut layers: Layers,
    interrupt: &Interrupt,
) -> Result<u8, Failure> {
    let intersector = args.estimator.intersector();
    if !A::INTERSECTORS.contains(&intersector) {
        return Err(Failure::usage(format!(
            "the backend {} has no fast intersector: leave out --intersector, or take --backend embree",
            A::NAME
        )));
    }
    let start = Instant::now();
    let mut desc = scene::load(&args.scene, args.load.options(args.strict)).map_err(Failure::input)?;
    let load_seconds = start.elapsed().as_secs_f64();
    let warnings = std::mem::take(&mut desc.warnings);
    if !args.quiet {
        for warning in &warnings {
            tell(format_args!("warning: {warning}"));
        }
    }

    if let Some(resolution) = args.resolution {
        desc.camera.resolution = resolution;
        // In pixels of the scene's own size.
        desc.crop = None;
    }
    let crop_of_scene = desc.crop;
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
    let crop = crop(args.crop.or(crop_of_scene), [width, height])?;
    // By the whole image, so that a crop is traced in the same tree: trees differ in which of two triangles at the same
    // distance is hit.
    let whole = budget.paths(u64::from(width) * u64::from(height));
    let quality = args.estimator.build_quality(whole, scene.triangles());
    let accel = A::build(&scene.geometry, BuildOptions { intersector, quality }).map_err(Failure::internal)?;
    let build_seconds = start.elapsed().as_secs_f64();

    let kernel = kernel_for(&scene, args.estimator.kernel());
    let job = Job {
        crop,
        spp: budget.spp,
        error: budget.error,
        split_direct: layers.split_direct(),
        settings,
    };

    let metadata = |spp: u32, seconds: f64| ExrMetadata {
        scene_hash: Some(scene.hash.clone()),
        spp: Some(spp),
        seed: Some(args.seed),
        backend: Some(format!("{} {}", A::NAME, A::version())),
        seconds: (!args.reproducible).then_some(seconds),
        display_size: Some([width, height]),
        offset: [crop.x0, crop.y0],
        ..output::metadata()
    };
    let write = |image: &Image<Rgb>, layers: &[Layer], metadata: &ExrMetadata| {
        let mut targets = targets.iter();
        targets.try_for_each(|target| target.write(image, layers, metadata, args.exposure))
    };
    let write_snapshot = |(image, spp): &Snapshot, seconds: f64| write(image, &[], &metadata(*spp, seconds));

    interrupt.keep_image();
    let clock = budget.start(crop.pixels(), layers.channels_written(targets));
    let start_cpu = process_seconds();
    let stop = || interrupt.raised().is_some() || clock.is_past(FIRST_HITS_SHARE);
    layers.trace(&scene, &accel, kernel, &job, &stop);
    let (film, report) = watched(args, interrupt, &clock, write_snapshot, |watch| {
        render_watched(&scene, &accel, kernel, &job, watch)
    });
    let (render_seconds, render_cpu_seconds) = (clock.elapsed().as_secs_f64(), process_seconds() - start_cpu);

    let outcome = Outcome {
        samples: film.sample_range(),
        mean_samples: report.paths as f64 / crop.pixels() as f64,
        error: settings
            .sampler
            .has_independent_halves()
            .then(|| error::estimate(&film))
            .flatten(),
        signal: interrupt.raised(),
    };
    let ((fewest, most), ending) = (outcome.samples, outcome.ending(budget));
    if most == 0 {
        return Err(Failure {
            code: outcome.exit_code(budget),
            message: match ending {
                Ending::Signal => "interrupted before the first sample; nothing is written".into(),
                _ => "there was no time for a single sample; nothing is written".into(),
            },
        });
    }

    let start = Instant::now();
    let image = film.develop();
    let metadata = ExrMetadata {
        spp_most: Some(most),
        relmse: outcome.error.map(|error| error.relmse.to_array()),
        rmse: outcome.error.map(|error| error.rmse().to_array()),
        ..metadata(fewest, render_seconds)
    };
    write(&image, &layers.of(&film, args.quiet), &metadata)?;
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
                BuildQuality::List => "list",
                BuildQuality::Low => "low",
                BuildQuality::Medium => "medium",
                BuildQuality::High => "high",
            },
            threads: rayon::current_num_threads(),
            width: image.width,
            height: image.height,
            spp: fewest,
            spp_most: most,
            spp_mean: outcome.mean_samples,
            seed: args.seed,
            interrupted: ending == Ending::Signal,
            stopped_by: ending,
            error: outcome.error.map(ErrorStats::from),
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
            rays: report.rays.into(),
            dropped_samples: report.dropped,
            peak_memory_bytes: peak_memory_bytes(),
            warnings: &warnings,
        };
        output::write_atomically(path, |writer| serde_json::to_writer_pretty(writer, &stats))?;
    }
    if !args.quiet {
        for line in outcome.describe(budget).lines() {
            tell(format_args!("{line}"));
        }
    }
    Ok(outcome.exit_code(budget))
}

/// Renders with signs of life, and with the image so far on disk, if that is wanted.
fn watched(
    args: &RenderArgs,
    interrupt: &Interrupt,
    clock: &Clock,
    write: impl Fn(&Snapshot, f64) -> Result<(), Failure> + Sync,
    render: impl FnOnce(Watch<'_>) -> (Film, RenderReport),
) -> (Film, RenderReport) {
    let progress = Progress::new(args.quiet);
    let stop = || interrupt.raised().is_some() || clock.is_up();
    let update = |done, expected| progress.update(done, clock.expect(done, expected));
    let result = match args.progress_image {
        None => render(Watch {
            stop: &stop,
            progress: &update,
            after_pass: &mut |_| (),
        }),
        Some(interval) => {
            let (mut image, snapshots) = ProgressImage::new(interval);
            thread::scope(|scope| {
                let write = |snapshot: &Snapshot| write(snapshot, clock.elapsed().as_secs_f64());
                scope.spawn(move || progress_image::write_all(snapshots, args.quiet, write));
                let result = render(Watch {
                    stop: &stop,
                    progress: &update,
                    after_pass: &mut |film| image.offer(film),
                });
                // Ends the writer, which the scope waits for.
                drop(image);
                result
            })
        }
    };
    progress.finish(interrupt.raised().is_none());
    result
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

fn crop(crop: Option<[u32; 4]>, [width, height]: [u32; 2]) -> Result<Rect, Failure> {
    let Some([x0, y0, x1, y1]) = crop else {
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
