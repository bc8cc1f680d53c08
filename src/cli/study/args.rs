//! What the command line of a study says.

use crate::cli::{Backend, Failure, LoadArgs, SOFTWARE, parse_exposure, parse_resolution};
use crate::study::cell::FEWEST_SEEDS;
use crate::study::quoted;
use crate::study::setting::{Group, Setting};
use clap::Args;
use std::iter;
use std::path::PathBuf;

#[derive(Debug, Args)]
pub(in crate::cli) struct StudyArgs {
    /// Scene file: .toml, .json, .gltf, .glb, .xml of Mitsuba 3, or an .obj or .ply on its own
    pub(super) scene: PathBuf,
    /// Folder for the report and for what is finished [default: study-NAME]
    #[arg(short, long = "output", value_name = "DIR")]
    pub(super) output: Option<PathBuf>,
    /// Image to compare with, instead of one that is rendered first
    #[arg(long, value_name = "REF.exr", conflicts_with = "reference_spp")]
    pub(super) reference: Option<PathBuf>,
    /// Samples per pixel of the reference [default: 16384; with --quick 4096]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(8..=1 << 24))]
    pub(super) reference_spp: Option<u32>,
    /// Small images and short renders: an overview in about a minute
    #[arg(long)]
    pub(super) quick: bool,
    /// Most samples per pixel: the ladder is 1, 2, 4, up to this
    #[arg(long, value_name = "N", default_value_t = 1024, value_parser = clap::value_parser!(u32).range(1..=1 << 20))]
    pub(super) max_spp: u32,
    /// Time for all images of a setting with one number of samples; where twice the last would take longer, the
    /// setting's ladder ends [default: 60; with --quick 1]
    #[arg(long, value_name = "SECONDS", value_parser = parse_seconds)]
    pub(super) cell_time: Option<f64>,
    /// Images of each setting and number of samples, of different seeds
    #[arg(long, value_name = "N", default_value_t = FEWEST_SEEDS,
          value_parser = clap::value_parser!(u32).range(i64::from(FEWEST_SEEDS)..=10_000))]
    pub(super) seeds: u32,
    /// Seed of the first image
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub(super) seed: u64,
    /// Settings to compare with the default, by name [default: all that make sense for the scene]
    #[arg(long, value_name = "NAME,...", value_delimiter = ',')]
    pub(super) only: Vec<String>,
    /// Largest table of the comparison of ways to draw; 0 for none [default: 100000000; with --quick 1000000]
    #[arg(long, value_name = "ENTRIES", value_parser = clap::value_parser!(u64).range(0..=1_000_000_000))]
    pub(super) max_table: Option<u64>,
    /// Image size [default: that of the scene with --reference; else the scene's, made smaller until no side is longer than
    /// 256; with --quick 96]
    #[arg(long, value_name = "WxH", value_parser = parse_resolution)]
    pub(super) resolution: Option<[u32; 2]>,
    /// Most scattering events of a path [default: the scene's, else none]
    #[arg(long, value_name = "N")]
    pub(super) max_depth: Option<u32>,
    /// Threads [default: all]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    pub(super) threads: Option<u16>,
    /// What traces the rays of all settings but the one that compares the backends
    #[arg(long, value_enum, default_value_t = Backend::DEFAULT)]
    pub(super) backend: Backend,
    /// Stops of exposure of the report's images
    #[arg(long, value_name = "EV", default_value_t = 0.0, allow_negative_numbers = true, value_parser = parse_exposure)]
    pub(super) exposure: f32,
    /// Print nothing but errors
    #[arg(short, long)]
    pub(super) quiet: bool,
    /// Treat warnings about the scene as errors
    #[arg(long)]
    pub(super) strict: bool,
    #[command(flatten)]
    pub(super) load: LoadArgs,
}

fn parse_seconds(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(seconds) if seconds > 0.0 && seconds.is_finite() => Ok(seconds),
        _ => Err("expected a number of seconds above 0".into()),
    }
}

/// The arguments with their defaults.
pub(super) struct Plan {
    pub(super) folder: PathBuf,
    pub(super) backend: &'static str,
    pub(super) reference: Option<String>,
    pub(super) reference_spp: u32,
    pub(super) max_spp: u32,
    pub(super) cell_seconds: f64,
    pub(super) seeds: u32,
    pub(super) exposure: f32,
    max_table: u64,
    resolution: Option<[u32; 2]>,
    longest_side: u32,
    only: Vec<String>,
}

impl Plan {
    pub(super) fn new(args: &StudyArgs) -> Result<Plan, Failure> {
        let default_folder = || {
            let stem = args.scene.file_stem().unwrap_or_default();
            let mut name = std::ffi::OsString::from("study-");
            name.push(stem);
            PathBuf::from(name)
        };
        let quick = |quick: u32, full: u32| if args.quick { quick } else { full };
        Ok(Plan {
            folder: args.output.clone().unwrap_or_else(default_folder),
            backend: match args.backend {
                Backend::Embree => "embree",
                Backend::Obvhs => "obvhs",
            },
            reference: args.reference.as_ref().map(|path| path.display().to_string()),
            reference_spp: args.reference_spp.unwrap_or(quick(4096, 16384)),
            max_spp: args.max_spp,
            cell_seconds: args.cell_time.unwrap_or(if args.quick { 1.0 } else { 60.0 }),
            seeds: args.seeds,
            exposure: args.exposure,
            max_table: args
                .max_table
                .unwrap_or(if args.quick { 1_000_000 } else { 100_000_000 }),
            resolution: args.resolution,
            longest_side: match (&args.reference, args.quick) {
                (Some(_), _) => u32::MAX,
                (None, true) => 96,
                (None, false) => 256,
            },
            only: args.only.clone(),
        })
    }

    /// The study's image size.
    pub(super) fn resolution(&self, of_scene: [u32; 2]) -> [u32; 2] {
        let longest = of_scene[0].max(of_scene[1]);
        match self.resolution {
            Some(resolution) => resolution,
            None if longest <= self.longest_side => of_scene,
            None => {
                let factor = f64::from(self.longest_side) / f64::from(longest);
                of_scene.map(|side| ((f64::from(side) * factor).round() as u32).max(1))
            }
        }
    }

    /// Numbers of samples.
    pub(super) fn ladder(&self) -> impl Iterator<Item = u32> {
        let most = self.max_spp;
        iter::successors(Some(1u32), |spp| spp.checked_mul(2)).take_while(move |spp| *spp <= most)
    }

    /// Sizes of tables.
    pub(super) fn tables(&self) -> impl Iterator<Item = u64> {
        let most = self.max_table;
        iter::successors(Some(super::SMALLEST_TABLE), |entries| entries.checked_mul(10))
            .take_while(move |entries| *entries <= most)
    }

    /// The settings that are asked for, and always the default.
    pub(super) fn choose(&self, ladder: &[Setting]) -> Result<Vec<Setting>, Failure> {
        if let Some(unknown) = self
            .only
            .iter()
            .find(|name| ladder.iter().all(|s| s.id != name.as_str()))
        {
            let known: Vec<&str> = ladder.iter().map(|s| s.id).collect();
            return Err(Failure::usage(format!(
                "--only: this scene has no setting `{unknown}`; there are {}",
                known.join(", ")
            )));
        }
        let is_wanted = |s: &&Setting| {
            self.only.is_empty() || s.group == Group::Default || self.only.iter().any(|name| name == s.id)
        };
        Ok(ladder.iter().filter(is_wanted).cloned().collect())
    }

    /// The command that makes this study again.
    pub(super) fn command(&self, args: &StudyArgs) -> String {
        let mut command = format!(
            "embrace study {} -o {}",
            quoted(&args.scene.display().to_string()),
            quoted(&self.folder.display().to_string())
        );
        let mut add = |text: String| command += &(String::from(" ") + &text);
        match &self.reference {
            Some(file) => add(format!("--reference {}", quoted(file))),
            None => add(format!("--reference-spp {}", self.reference_spp)),
        }
        if args.quick {
            add("--quick".into());
        }
        add(format!("--max-spp {} --cell-time {}", self.max_spp, self.cell_seconds));
        add(format!("--seeds {} --seed {}", self.seeds, args.seed));
        if let Some(name) = &args.load.camera {
            add(format!("--camera {}", quoted(name)));
        }
        if let Some([width, height]) = self.resolution {
            add(format!("--resolution {width}x{height}"));
        }
        if let Some(depth) = args.max_depth {
            add(format!("--max-depth {depth}"));
        }
        if let Some(degrees) = args.load.smooth_angle {
            add(format!("--smooth-angle {degrees}"));
        }
        if let Some(threads) = args.threads {
            add(format!("--threads {threads}"));
        }
        if args.backend != Backend::DEFAULT {
            add(format!("--backend {}", self.backend));
        }
        if !self.only.is_empty() {
            add(format!("--only {}", self.only.join(",")));
        }
        command
    }

    pub(super) fn missing_backend(&self) -> String {
        format!("the backend {} is not in this build of {SOFTWARE}", self.backend)
    }
}
