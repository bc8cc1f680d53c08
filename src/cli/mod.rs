//! The command line: arguments to settings, errors to exit codes.

use crate::accel::{BuildQuality, Intersector};
use crate::aov::Aov;
use crate::integrator::{BounceSampling, KernelChoice, Lighting, Roulette, Settings};
use crate::light::{EnvSampling, LightSampling};
use crate::sampling::SamplerKind;
use crate::scene::{Instancing, LoadOptions};
use clap::{Args, Parser, Subcommand, ValueEnum};
use std::ffi::OsString;
use std::fmt;
use std::io::{self, Write};
use std::path::PathBuf;
use std::process::ExitCode;
use std::time::Duration;

mod budget;
mod convert;
mod info;
mod interrupt;
mod layers;
mod outcome;
mod output;
mod progress;
mod progress_image;
mod render;
mod stats;
mod study;
mod tools;

/// Name and version, as written into images.
const SOFTWARE: &str = concat!("embrace ", env!("CARGO_PKG_VERSION"));

/// Renders scenes by path tracing on the processor.
#[derive(Debug, Parser)]
#[command(
    name = "embrace",
    version,
    after_help = "Exit codes: 0 done, 1 internal, 2 usage, 3 scene or input, 4 output, 5 target of --noise or --time not reached (the image is written), 130 and 143 interrupted (the image so far is written)."
)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Render a scene to EXR and PNG files
    Render(Box<RenderArgs>),
    /// Show what a scene contains, what it requires, and what memory it takes
    Info(InfoArgs),
    /// Write a scene of any format as a scene file that can be edited
    Convert(ConvertArgs),
    /// Compare two images; the first is the reference
    Compare(CompareArgs),
    /// Convert an EXR to an sRGB PNG
    Tonemap(TonemapArgs),
    /// Render a scene over a ladder of settings, and report what each costs and brings
    Study(study::StudyArgs),
}

/// Where the triangles are traced.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Backend {
    /// Intel Embree
    Embree,
    /// Pure Rust
    Obvhs,
}

impl Backend {
    /// Embree where it is built in.
    const DEFAULT: Backend = if cfg!(feature = "embree") {
        Backend::Embree
    } else {
        Backend::Obvhs
    };
}

#[derive(Debug, Args)]
struct RenderArgs {
    /// Scene file: .toml, .json, .gltf, .glb, .xml of Mitsuba 3, or an .obj or .ply on its own
    scene: PathBuf,
    /// Image to write, .exr or .png; may be repeated
    #[arg(short, long = "output", value_name = "OUT", required = true)]
    output: Vec<PathBuf>,
    /// Samples per pixel [default: 64]; the most of any pixel beside --noise [default: 16384] or --time [default: no limit]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    spp: Option<u32>,
    /// Render for this long: 30s, 1.5m, 250ms, 2h
    #[arg(long, value_name = "TIME", value_parser = budget::parse_time)]
    time: Option<Duration>,
    /// Count everything into --time, from the start of the program to the written image
    #[arg(long, requires = "time")]
    time_total: bool,
    /// Render to this relative root-mean-square error, with more samples where they are needed; 0.01 is one per cent
    #[arg(long, value_name = "ERROR", allow_negative_numbers = true, value_parser = budget::parse_noise)]
    noise: Option<f64>,
    /// With --noise, samples of every pixel before any gets more [default: 16]
    #[arg(long, value_name = "N", requires = "noise", value_parser = clap::value_parser!(u32).range(2..))]
    min_spp: Option<u32>,
    /// Seed of the random numbers
    #[arg(long, value_name = "N", default_value_t = 0)]
    seed: u64,
    /// Threads [default: all]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    threads: Option<u16>,
    /// What traces the rays
    #[arg(long, value_enum, default_value_t = Backend::DEFAULT)]
    backend: Backend,
    /// Most scattering events of a path: 0 emission only, 1 direct light [default: the scene's, else none]
    #[arg(long, value_name = "N")]
    max_depth: Option<u32>,
    /// Image size instead of the scene's
    #[arg(long, value_name = "WxH", value_parser = parse_resolution)]
    resolution: Option<[u32; 2]>,
    /// Pixels to render: columns x0 to x1 and rows y0 to y1, the ends excluded
    #[arg(long, value_name = "x0,y0,x1,y1", value_parser = parse_crop)]
    crop: Option<[u32; 4]>,
    /// Stops of exposure for PNG output
    #[arg(long, value_name = "EV", default_value_t = 0.0, allow_negative_numbers = true, value_parser = parse_exposure)]
    exposure: f32,
    /// Write the image so far after the first sample of every pixel, and from then on every so many seconds
    #[arg(long, value_name = "SECONDS", value_parser = parse_interval)]
    progress_image: Option<Duration>,
    /// Layers beside the image in .exr outputs: variance, samples, albedo, normal, depth, position, direct, indirect
    // The full path, because clap would take a plain `Vec` to be one value after another.
    #[arg(long, value_name = "NAME,...", value_parser = Aov::parse_list)]
    aov: Option<std::vec::Vec<Aov>>,
    /// Write statistics as JSON
    #[arg(long, value_name = "FILE")]
    stats: Option<PathBuf>,
    /// Print nothing but errors
    #[arg(short, long)]
    quiet: bool,
    /// Treat warnings about the scene as errors
    #[arg(long)]
    strict: bool,
    #[command(flatten)]
    load: LoadArgs,
    /// Leave the render time out of the EXR, so that equal renders are equal files
    #[arg(long)]
    reproducible: bool,
    #[command(flatten)]
    estimator: EstimatorArgs,
}

/// How the scene is read.
#[derive(Debug, Args)]
struct LoadArgs {
    /// Camera of a glTF file, by its name or that of its node [default: the first]
    #[arg(long, value_name = "NAME")]
    camera: Option<String>,
    /// Smooth meshes that have no normals, but for edges at which faces meet at this angle or more [default: flat faces]
    #[arg(long, value_name = "DEGREES", allow_negative_numbers = true, value_parser = parse_angle)]
    smooth_angle: Option<f64>,
    /// Value of a parameter ($NAME) of a Mitsuba scene; may be repeated
    #[arg(short = 'D', long = "define", value_name = "NAME=VALUE", value_parser = parse_define)]
    define: Vec<(String, String)>,
}

impl LoadArgs {
    fn options(&self, strict: bool) -> LoadOptions {
        LoadOptions {
            strict,
            smooth_angle: self.smooth_angle,
            camera: self.camera.clone(),
            defines: self.define.clone(),
        }
    }
}

#[derive(Debug, Args)]
#[command(next_help_heading = "Estimator")]
struct EstimatorArgs {
    /// A set of the settings below; any given beside it wins
    #[arg(long, value_enum)]
    preset: Option<Preset>,
    /// Which light: all of it, or emission and one scattering event
    #[arg(long, value_enum)]
    lighting: Option<LightingArg>,
    /// How directions towards the environment are drawn
    #[arg(long, value_enum)]
    env_sampling: Option<EnvSamplingArg>,
    /// How emitters are chosen: by what they bring to a point, or by power
    #[arg(long, value_enum)]
    light_sampling: Option<LightSamplingArg>,
    /// How bounces are drawn
    #[arg(long, value_enum)]
    bounce_sampling: Option<BounceSamplingArg>,
    /// Multiple importance sampling
    #[arg(long, value_enum)]
    mis: Option<Switch>,
    /// How paths end: throughput, off, or a fixed probability of survival in (0, 1)
    #[arg(long, value_name = "throughput|off|P", value_parser = parse_roulette)]
    roulette: Option<Roulette>,
    /// Which random numbers
    #[arg(long, value_enum)]
    sampler: Option<SamplerArg>,
    /// Remedy for hard shadow edges on smooth, coarse meshes
    #[arg(long, value_enum)]
    smooth_terminator: Option<Switch>,
    /// Compiled for what the scene requires, or for everything; the image is the same
    #[arg(long, value_enum, default_value = "auto")]
    kernel: KernelArg,
    /// Whether repeated meshes share their triangles
    #[arg(long, value_enum, default_value = "auto")]
    instancing: InstancingArg,
    /// Robust at the edges of triangles, or fast with some leaks there (embree only)
    #[arg(long, value_enum, default_value = "robust")]
    intersector: IntersectorArg,
    /// Time to build against time to trace: auto goes by the number of paths and triangles, and takes a list for a few
    #[arg(long, value_enum, default_value = "auto")]
    build_quality: BuildQualityArg,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum BuildQualityArg {
    Auto,
    Low,
    Medium,
    High,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum IntersectorArg {
    Robust,
    Fast,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum Preset {
    /// Uniform bounces, no multiple importance sampling, roulette with survival 0.8
    Article,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum LightingArg {
    Global,
    Direct,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum EnvSamplingArg {
    Importance,
    Uniform,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum LightSamplingArg {
    Contribution,
    Power,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum BounceSamplingArg {
    Bsdf,
    Cosine,
    Uniform,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum Switch {
    On,
    Off,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum SamplerArg {
    /// Stratified in two independent halves, which tell the error
    Sobol,
    /// Stratified as a whole: less noise, but the error is not known
    SobolWhole,
    /// Not stratified
    Independent,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum KernelArg {
    Auto,
    General,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum InstancingArg {
    Auto,
    Always,
    Never,
}

impl EstimatorArgs {
    fn settings(&self, seed: u64, max_depth: Option<u32>) -> Settings {
        let mut settings = match self.preset {
            Some(Preset::Article) => Settings::article(),
            None => Settings::default(),
        };
        settings.seed = seed;
        settings.max_depth = max_depth;
        if let Some(lighting) = self.lighting {
            settings.lighting = match lighting {
                LightingArg::Global => Lighting::Global,
                LightingArg::Direct => Lighting::Direct,
            };
        }
        if let Some(env_sampling) = self.env_sampling {
            settings.env_sampling = match env_sampling {
                EnvSamplingArg::Importance => EnvSampling::Importance,
                EnvSamplingArg::Uniform => EnvSampling::Uniform,
            };
        }
        if let Some(light_sampling) = self.light_sampling {
            settings.light_sampling = match light_sampling {
                LightSamplingArg::Contribution => LightSampling::Contribution,
                LightSamplingArg::Power => LightSampling::Power,
            };
        }
        if let Some(bounce_sampling) = self.bounce_sampling {
            settings.bounce_sampling = match bounce_sampling {
                BounceSamplingArg::Bsdf => BounceSampling::Bsdf,
                BounceSamplingArg::Cosine => BounceSampling::Cosine,
                BounceSamplingArg::Uniform => BounceSampling::Uniform,
            };
        }
        if let Some(mis) = self.mis {
            settings.mis = matches!(mis, Switch::On);
        }
        if let Some(roulette) = self.roulette {
            settings.roulette = roulette;
        }
        if let Some(sampler) = self.sampler {
            settings.sampler = match sampler {
                SamplerArg::Sobol => SamplerKind::Sobol,
                SamplerArg::SobolWhole => SamplerKind::SobolWhole,
                SamplerArg::Independent => SamplerKind::Independent,
            };
        }
        if let Some(smooth_terminator) = self.smooth_terminator {
            settings.smooth_terminator = matches!(smooth_terminator, Switch::On);
        }
        settings
    }

    /// Whether the samples tell the error of their mean.
    fn tells_error(&self) -> bool {
        !matches!(self.sampler, Some(SamplerArg::SobolWhole))
    }

    fn kernel(&self) -> KernelChoice {
        match self.kernel {
            KernelArg::Auto => KernelChoice::Auto,
            KernelArg::General => KernelChoice::General,
        }
    }

    fn intersector(&self) -> Intersector {
        match self.intersector {
            IntersectorArg::Robust => Intersector::Robust,
            IntersectorArg::Fast => Intersector::Fast,
        }
    }

    fn build_quality(&self, paths: u64, triangles: u64) -> BuildQuality {
        match self.build_quality {
            BuildQualityArg::Auto => BuildQuality::for_paths(paths, triangles, self.intersector()),
            BuildQualityArg::Low => BuildQuality::Low,
            BuildQualityArg::Medium => BuildQuality::Medium,
            BuildQualityArg::High => BuildQuality::High,
        }
    }

    fn instancing(&self) -> Instancing {
        match self.instancing {
            InstancingArg::Auto => Instancing::Auto,
            InstancingArg::Always => Instancing::Always,
            InstancingArg::Never => Instancing::Never,
        }
    }
}

#[derive(Debug, Args)]
struct InfoArgs {
    /// Scene file
    scene: PathBuf,
    /// Print one JSON object
    #[arg(long)]
    json: bool,
    /// Whose memory to show
    #[arg(long, value_enum, default_value_t = Backend::DEFAULT)]
    backend: Backend,
    #[command(flatten)]
    load: LoadArgs,
}

#[derive(Debug, Args)]
struct ConvertArgs {
    /// Scene file of any format
    scene: PathBuf,
    /// Scene file to write, .toml; meshes and images go to a folder beside it, OUT_files for OUT.toml
    output: PathBuf,
    /// Print nothing but errors
    #[arg(short, long)]
    quiet: bool,
    /// Treat warnings about the scene as errors
    #[arg(long)]
    strict: bool,
    #[command(flatten)]
    load: LoadArgs,
}

#[derive(Debug, Args)]
struct CompareArgs {
    /// Reference
    a: PathBuf,
    /// Image to judge
    b: PathBuf,
    /// Print one JSON object
    #[arg(long)]
    json: bool,
    /// Write the map of FLIP errors
    #[arg(long, value_name = "OUT.png")]
    diff: Option<PathBuf>,
}

#[derive(Debug, Args)]
struct TonemapArgs {
    /// Image to convert
    input: PathBuf,
    /// PNG to write
    output: PathBuf,
    /// Stops of exposure
    #[arg(long, value_name = "EV", default_value_t = 0.0, allow_negative_numbers = true, value_parser = parse_exposure)]
    exposure: f32,
}

fn parse_resolution(text: &str) -> Result<[u32; 2], String> {
    let sides = text
        .split_once('x')
        .and_then(|(w, h)| Some([w.parse().ok()?, h.parse().ok()?]));
    match sides {
        Some([w, h]) if w > 0 && h > 0 => Ok([w, h]),
        _ => Err("expected WIDTHxHEIGHT in pixels, such as 640x480".into()),
    }
}

fn parse_define(text: &str) -> Result<(String, String), String> {
    match text.split_once('=') {
        Some((name, value)) if !name.is_empty() => Ok((name.to_owned(), value.to_owned())),
        _ => Err("expected NAME=VALUE, such as spp=64".into()),
    }
}

fn parse_crop(text: &str) -> Result<[u32; 4], String> {
    let numbers: Option<Vec<u32>> = text.split(',').map(|n| n.trim().parse().ok()).collect();
    match numbers.and_then(|n| <[u32; 4]>::try_from(n).ok()) {
        Some([x0, y0, x1, y1]) if x0 < x1 && y0 < y1 => Ok([x0, y0, x1, y1]),
        _ => Err("expected x0,y0,x1,y1 with x0 < x1 and y0 < y1, such as 0,0,320,240".into()),
    }
}

fn parse_exposure(text: &str) -> Result<f32, String> {
    match text.parse::<f32>() {
        Ok(ev) if ev.abs() <= 100.0 => Ok(ev),
        _ => Err("expected a number of stops between -100 and 100".into()),
    }
}

fn parse_angle(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(degrees) if (0.0..=180.0).contains(&degrees) => Ok(degrees),
        _ => Err("expected a number of degrees between 0 and 180".into()),
    }
}

fn parse_interval(text: &str) -> Result<Duration, String> {
    text.parse()
        .ok()
        .and_then(|seconds| Duration::try_from_secs_f64(seconds).ok())
        .ok_or_else(|| "expected a number of seconds, 0 or more".into())
}

fn parse_roulette(text: &str) -> Result<Roulette, String> {
    match (text, text.parse::<f32>()) {
        ("throughput", _) => Ok(Roulette::Throughput),
        ("off", _) => Ok(Roulette::Off),
        (_, Ok(survival)) if survival > 0.0 && survival < 1.0 => Ok(Roulette::Fixed(survival)),
        _ => Err("expected throughput, off, or a probability of survival above 0 and below 1".into()),
    }
}

/// An error that ends the program.
#[derive(Debug)]
struct Failure {
    code: u8,
    message: String,
}

impl Failure {
    fn internal(message: impl ToString) -> Failure {
        Failure {
            code: 1,
            message: message.to_string(),
        }
    }

    fn usage(message: impl ToString) -> Failure {
        Failure {
            code: 2,
            message: message.to_string(),
        }
    }

    fn input(message: impl ToString) -> Failure {
        Failure {
            code: 3,
            message: message.to_string(),
        }
    }

    fn output(message: impl ToString) -> Failure {
        Failure {
            code: 4,
            message: message.to_string(),
        }
    }
}

/// What runs the work of a command on so many threads; by default on all of the machine.
fn thread_pool(threads: Option<u16>) -> Result<rayon::ThreadPool, Failure> {
    let mut pool = rayon::ThreadPoolBuilder::new();
    if let Some(threads) = threads {
        pool = pool.num_threads(usize::from(threads));
    }
    pool.build()
        .map_err(|e| Failure::internal(format!("threads cannot be started: {e}")))
}

/// Prints what was asked for to standard output.
fn print(text: &str) -> Result<(), Failure> {
    let mut stdout = io::stdout().lock();
    match stdout.write_all(text.as_bytes()).and_then(|()| stdout.flush()) {
        // A reader that has seen enough is no failure.
        Err(e) if e.kind() != io::ErrorKind::BrokenPipe => {
            Err(Failure::output(format!("standard output: cannot be written: {e}")))
        }
        _ => Ok(()),
    }
}

/// Prints a line to standard error. That nobody can read it is no reason to lose the image, which `eprintln` would.
fn tell(line: fmt::Arguments<'_>) {
    let _ = writeln!(io::stderr(), "{line}");
}

/// Runs the command line and returns the exit code: 0 done, 1 internal, 2 usage, 3 scene or input, 4 output, 5 a target that was not reached, 130 or 143
/// interrupted with the image so far written.
pub fn run(args: impl IntoIterator<Item = OsString>) -> ExitCode {
    let cli = match Cli::try_parse_from(args) {
        Ok(cli) => cli,
        Err(error) => {
            // Help and version are no errors; a closed pipe is nobody's concern.
            let _ = error.print();
            return ExitCode::from(u8::try_from(error.exit_code()).unwrap_or(2));
        }
    };
    let result = match &cli.command {
        Command::Render(args) => render::run(args),
        Command::Info(args) => info::run(args).map(|()| 0),
        Command::Convert(args) => convert::run(args).map(|()| 0),
        Command::Compare(args) => tools::compare(args).map(|()| 0),
        Command::Tonemap(args) => tools::tonemap(args).map(|()| 0),
        Command::Study(args) => study::run(args),
    };
    match result {
        Ok(code) => ExitCode::from(code),
        Err(Failure { code, message }) => {
            tell(format_args!("error: {message}"));
            ExitCode::from(code)
        }
    }
}

/// Runs a generic function for the backend chosen at run time: the one place where backends are dispatched.
macro_rules! with_backend {
    ($backend:expr, $function:ident($($argument:expr),*)) => {
        match $backend {
            #[cfg(feature = "embree")]
            $crate::cli::Backend::Embree => $function::<$crate::accel::embree::Embree>($($argument),*),
            #[cfg(feature = "obvhs")]
            $crate::cli::Backend::Obvhs => $function::<$crate::accel::obvhs::Obvhs>($($argument),*),
            #[cfg(not(all(feature = "embree", feature = "obvhs")))]
            other => Err($crate::cli::Failure::usage(format!(
                "the backend {} is not in this build; it was built with {} alone",
                format!("{other:?}").to_lowercase(),
                format!("{:?}", $crate::cli::Backend::DEFAULT).to_lowercase(),
            ))),
        }
    };
}
use with_backend;
