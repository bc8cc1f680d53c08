//! Speed against error, measured: a scene over a ladder of settings.
//!
//! ```text
//! setting::ladder -> renderer::Workshop -> reference, cell::run (per setting and samples) -> Study -> csv, report
//! ```
//!
//! Nothing here reads or writes files: that, progress and signals are the command line's.

pub mod accumulation;
pub mod analysis;
pub mod bias;
pub mod cell;
pub mod choice;
pub mod csv;
pub mod measure;
mod plot;
pub mod reference;
pub mod renderer;
pub mod report;
pub mod setting;

use accumulation::Accumulation;
use analysis::{BUDGETS, Point, Reached, Slope};
use cell::Cell;
use choice::Choice;
use reference::{Noise, Reference, Target};
use serde::Serialize;
use setting::{Group, Setting};

/// Version of the JSON object.
pub const SCHEMA: u32 = 1;

/// What a study was made of; the first part of `study.json`.
#[derive(Clone, Debug, Serialize)]
pub struct Conditions {
    /// Version of the JSON object.
    pub schema: u32,
    /// Name and version of the program.
    pub software: String,
    /// The scene file as it was given.
    pub scene: String,
    /// The scene and all its files.
    pub scene_hash: String,
    /// Columns and rows of the study's images.
    pub resolution: [u32; 2],
    /// Columns and rows that the scene asks for.
    pub scene_resolution: [u32; 2],
    /// Depth limit of scene or command line.
    pub max_depth: Option<u32>,
    /// Angle that meshes without normals are smoothed by in degrees.
    pub smooth_angle: Option<f64>,
    /// Backends with their versions; the first is the one of all settings but those that name another.
    pub backends: Vec<String>,
    /// How many threads rendered.
    pub threads: usize,
    /// Caches of the processor by level (bytes); empty where the system does not tell.
    pub caches: Vec<(u32, u64)>,
    /// Images of each cell.
    pub seeds: u32,
    /// Seed of the first of them.
    pub first_seed: u64,
    /// Time that a cell may take; a longer one ends its setting's ladder (s).
    pub cell_seconds: f64,
    /// Samples per pixel that the ladder ends with.
    pub max_spp: u32,
    /// The command that makes the study.
    pub command: String,
    /// What was left out, and why.
    pub notes: Vec<String>,
}

/// A reference in the JSON object.
#[derive(Clone, Debug, Serialize)]
pub struct ReferenceSummary {
    /// What light it has.
    pub target: Target,
    /// The file.
    pub file: String,
    /// Samples per pixel, if it was rendered.
    pub spp: Option<u32>,
    /// What it adds to errors, and what was subtracted; `None` if nobody knows.
    pub noise: Option<Noise>,
}

/// Whether a setting is without bias.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Verdict {
    /// Nothing is seen that more samples would not remove.
    Consistent,
    /// A part of the error stays, whatever the number of samples.
    Biased,
}

/// One setting of a study.
#[derive(Clone, Debug, Serialize)]
pub struct SettingResult {
    /// Short name.
    pub id: &'static str,
    /// For people.
    pub title: String,
    /// What it is compared for.
    pub group: Group,
    /// What it should converge to.
    pub target: Target,
    /// How to render one of its images: the one of the most samples and the first seed.
    pub command: String,
    /// By samples per pixel.
    pub points: Vec<Point>,
    /// Exponent of the MSE against samples.
    pub slope_mse: Option<Slope>,
    /// Exponent of the relMSE against samples.
    pub slope_relmse: Option<Slope>,
    /// Samples, as a factor, that halve the RMSE.
    pub samples_to_halve: Option<f64>,
    /// By the mean of all images with the most samples.
    pub verdict: Verdict,
    /// At the most samples both have; `None` for other targets.
    pub against_default: Option<Against>,
    /// What some times reach.
    pub reached: Vec<Reached>,
}

impl SettingResult {
    /// The point with the most samples.
    pub fn last(&self) -> &Point {
        self.points.last().expect("settings without points are left out")
    }

    /// Part of the relMSE that stays, if any is seen.
    pub fn floor(&self) -> f64 {
        match self.verdict {
            Verdict::Consistent => 0.0,
            Verdict::Biased => self.last().bias.floor,
        }
    }
}

/// A setting against the default with as many samples.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Against {
    /// Samples per pixel.
    pub spp: u32,
    /// Time over the default's.
    pub seconds: f64,
    /// The relMSE over the default's.
    pub relmse: f64,
    /// The default's relMSE × seconds over this setting's: 2 where the same error takes half of the time.
    pub efficiency: f64,
    /// Relative standard error of the efficiency.
    pub relative_error: f64,
    /// The same by the relMSE without the worst 0.1 % of the pixels: steadier where few pixels make the error.
    pub efficiency_trimmed: f64,
}

/// The best setting for a time.
#[derive(Clone, Debug, Serialize)]
pub struct Best {
    /// The time (s).
    pub seconds: f64,
    /// Settings by name, the best first, as far as they are not worse by more than chance; the default before all if it is
    /// among them.
    pub settings: Vec<&'static str>,
    /// What the first of them reaches.
    pub relmse: f64,
    /// Whether it lies beyond what was measured.
    pub is_extrapolated: bool,
}

/// A point of the Pareto front.
#[derive(Clone, Debug, Serialize)]
pub struct FrontPoint {
    /// Name of the setting.
    pub setting: &'static str,
    /// Samples per pixel.
    pub spp: u32,
    /// Time to render (s).
    pub seconds: f64,
    /// Its error.
    pub relmse: f64,
}

/// All that a study found: what `study.json` holds.
#[derive(Clone, Debug, Serialize)]
pub struct Study {
    /// What it was made of.
    #[serde(flatten)]
    pub conditions: Conditions,
    /// What images were compared with.
    pub references: Vec<ReferenceSummary>,
    /// By setting, the default first.
    pub settings: Vec<SettingResult>,
    /// By time.
    pub best: Vec<Best>,
    /// The measured points that no other is both faster and better than.
    pub pareto_front: Vec<FrontPoint>,
    /// Ways to draw by weight.
    pub choices: Vec<Choice>,
    /// Sums in f32.
    pub accumulation: Option<Accumulation>,
}

/// What a study is put together from.
pub struct Parts<'a> {
    /// What it was made of.
    pub conditions: Conditions,
    /// What images were compared with.
    pub references: &'a [(Target, Reference, ReferenceSummary)],
    /// Settings with their cells, by samples.
    pub settings: &'a [(Setting, Vec<Cell>)],
    /// Ways to draw by weight.
    pub choices: Vec<Choice>,
    /// Sums in f32.
    pub accumulation: Option<Accumulation>,
}

impl Study {
    /// Analyses cells.
    pub fn new(parts: Parts<'_>) -> Study {
        let measured: Vec<&(Setting, Vec<Cell>)> =
            parts.settings.iter().filter(|(_, cells)| !cells.is_empty()).collect();
        let noise = |target| {
            let reference = parts.references.iter().find(|(of, ..)| *of == target);
            reference.map_or(Noise::default(), |(_, reference, _)| reference.noise())
        };
        let mut settings: Vec<SettingResult> = measured
            .iter()
            .map(|(setting, cells)| {
                let target = Target::of(&setting.settings);
                result(setting, cells, noise(target), target, measured.len(), &parts.conditions)
            })
            .collect();
        if let Some(default) = settings.iter().position(|s| s.group == Group::Default) {
            let default = settings[default].points.clone();
            for setting in settings.iter_mut().filter(|s| s.target == Target::Global) {
                setting.against_default = against(&setting.points, &default);
            }
        }
        Study {
            best: BUDGETS.iter().filter_map(|&seconds| best(&settings, seconds)).collect(),
            pareto_front: front(&settings),
            conditions: parts.conditions,
            references: parts.references.iter().map(|(.., summary)| summary.clone()).collect(),
            settings,
            choices: parts.choices,
            accumulation: parts.accumulation,
        }
    }
}

fn result(
    setting: &Setting,
    cells: &[Cell],
    noise: Noise,
    target: Target,
    tests: usize,
    conditions: &Conditions,
) -> SettingResult {
    let points: Vec<Point> = cells.iter().map(|cell| Point::of(cell, noise)).collect();
    let [slope_mse, slope_relmse] = analysis::slopes(&cells.iter().collect::<Vec<_>>(), &points, noise);
    let bias = cells[cells.len() - 1].bias;
    let verdict = if bias.is_significant(tests) {
        Verdict::Biased
    } else {
        Verdict::Consistent
    };
    let floor = if verdict == Verdict::Biased { bias.floor } else { 0.0 };
    let spp = cells[cells.len() - 1].spp;
    SettingResult {
        id: setting.id,
        title: setting.title.clone(),
        group: setting.group,
        target,
        command: command(setting, spp, conditions),
        samples_to_halve: slope_mse.and_then(|s| analysis::samples_to_halve(s.slope.mean)),
        reached: BUDGETS
            .map(|seconds| analysis::reached(&points, slope_relmse, floor, seconds))
            .into(),
        points,
        slope_mse,
        slope_relmse,
        verdict,
        against_default: None,
    }
}

/// A word for a shell: in quotes if it has anything but what names usually have.
pub fn quoted(word: &str) -> String {
    if !word.is_empty() && word.chars().all(|c| c.is_alphanumeric() || "/._-+=:,@%".contains(c)) {
        return word.into();
    }
    format!("'{}'", word.replace('\'', r"'\''"))
}

/// What renders the first image with so many samples.
fn command(setting: &Setting, spp: u32, conditions: &Conditions) -> String {
    let [width, height] = conditions.resolution;
    let mut command = format!(
        "embrace render {} -o {}.exr --resolution {width}x{height} --spp {spp} --seed {} --threads {}",
        quoted(&conditions.scene),
        setting.id,
        conditions.first_seed,
        conditions.threads
    );
    if let Some(depth) = conditions.max_depth
        && setting.settings.max_depth == Some(depth)
        && !setting.arguments.contains("--max-depth")
    {
        command += &format!(" --max-depth {depth}");
    }
    if let Some(degrees) = conditions.smooth_angle {
        command += &format!(" --smooth-angle {degrees}");
    }
    if !setting.arguments.is_empty() {
        command += &format!(" {}", setting.arguments);
    }
    command
}

/// At the most samples that both have above the noise of the reference.
fn against(points: &[Point], default: &[Point]) -> Option<Against> {
    points.iter().rev().filter(|p| p.is_above_noise).find_map(|point| {
        let same = default.iter().find(|p| p.spp == point.spp && p.is_above_noise)?;
        let seconds = point.seconds.mean / same.seconds.mean;
        let relmse = point.relmse.mean / same.relmse.mean;
        let errors = [point.seconds, same.seconds, point.relmse, same.relmse];
        Some(Against {
            spp: point.spp,
            seconds,
            relmse,
            efficiency: 1.0 / (seconds * relmse),
            efficiency_trimmed: same.relmse_trimmed.mean / (seconds * point.relmse_trimmed.mean),
            relative_error: errors
                .iter()
                .map(|e| (e.standard_error / e.mean).powi(2))
                .sum::<f64>()
                .sqrt(),
        })
    })
}

/// Two standard errors decide whether a setting is worse by more than chance.
fn best(settings: &[SettingResult], seconds: f64) -> Option<Best> {
    let mut candidates: Vec<(&SettingResult, Reached, f64)> = settings
        .iter()
        .filter(|s| s.target == Target::Global)
        .filter_map(|s| {
            let reached = *s.reached.iter().find(|r| r.seconds == seconds)?;
            Some((s, reached, reached.relmse?))
        })
        .collect();
    candidates.sort_by(|a, b| a.2.total_cmp(&b.2));
    let &(_, first, relmse) = candidates.first()?;
    let is_as_good = |reached: &Reached, error: f64| {
        let difference = (error / relmse).ln();
        difference <= 2.0 * reached.relative_error.hypot(first.relative_error)
    };
    candidates.retain(|(_, reached, error)| is_as_good(reached, *error));
    candidates.sort_by_key(|(s, ..)| s.group != Group::Default);
    Some(Best {
        seconds,
        settings: candidates.iter().map(|(s, ..)| s.id).collect(),
        relmse: candidates[0].2,
        is_extrapolated: candidates[0].1.is_extrapolated,
    })
}

fn front(settings: &[SettingResult]) -> Vec<FrontPoint> {
    let points: Vec<FrontPoint> = settings
        .iter()
        .filter(|s| s.target == Target::Global)
        .flat_map(|s| {
            s.points.iter().filter(|p| p.is_above_noise).map(|p| FrontPoint {
                setting: s.id,
                spp: p.spp,
                seconds: p.seconds.mean,
                relmse: p.relmse.mean,
            })
        })
        .collect();
    let pairs: Vec<(f64, f64)> = points.iter().map(|p| (p.seconds, p.relmse)).collect();
    analysis::pareto_front(&pairs)
        .into_iter()
        .map(|i| points[i].clone())
        .collect()
}
