//! `embrace study`

mod args;
mod given;
mod machine;
mod store;

use super::interrupt::Interrupt;
use super::progress::Progress;
use super::{Failure, SOFTWARE, tell, thread_pool};
use crate::image::display;
use crate::integrator::Settings;
use crate::light::EnvSampling;
use crate::scene::{self, SceneDesc};
use crate::study::cell::{self, Cell, CellKey};
use crate::study::reference::{self, REPLICATIONS, Reference, Target};
use crate::study::renderer::{Stop, Workshop, backends};
use crate::study::report::{self, Picture};
use crate::study::setting::{Setting, ladder};
use crate::study::{Conditions, Parts, ReferenceSummary, SCHEMA, Study, accumulation, choice, csv};
use args::Plan;
pub(super) use args::StudyArgs;
use store::{ReferenceKey, Store, picture_names, reference_name};

/// Smallest table of the comparison of ways to draw.
const SMALLEST_TABLE: u64 = 1000;

/// The most samples a pixel gets in the comparison of f32 and f64 sums.
const ACCUMULATED_SPP: u32 = 1 << 20;

/// Every ladder goes so far, however long it takes: there is something to compare.
const FEWEST_SPP: u32 = 4;

/// Pictures are compared at the most samples up to this that all settings have.
const PICTURE_SPP: u32 = 16;

/// Why there is no result.
enum Ended {
    Interrupted,
    Failed(Failure),
}

impl From<Failure> for Ended {
    fn from(failure: Failure) -> Ended {
        Ended::Failed(failure)
    }
}

pub(super) fn run(args: &StudyArgs) -> Result<u8, Failure> {
    let plan = Plan::new(args)?;
    let interrupt = Interrupt::watch().map_err(|e| Failure::internal(format!("signals cannot be watched: {e}")))?;
    thread_pool(args.threads)?.install(|| match study(args, &plan, &interrupt) {
        Ok(()) => Ok(0),
        Err(Ended::Failed(failure)) => Err(failure),
        Err(Ended::Interrupted) => {
            if !args.quiet {
                let folder = plan.folder.display();
                tell(format_args!(
                    "interrupted: what is finished is kept in {folder}; the same command goes on from there"
                ));
            }
            Ok(interrupt.raised().unwrap_or(1))
        }
    })
}

fn study(args: &StudyArgs, plan: &Plan, interrupt: &Interrupt) -> Result<(), Ended> {
    let mut desc = scene::load(&args.scene, args.load.options(args.strict)).map_err(Failure::input)?;
    if !args.quiet {
        for warning in &desc.warnings {
            tell(format_args!("warning: {warning}"));
        }
        if desc.crop.is_some() {
            tell(format_args!("warning: camera.crop: a study renders the whole image"));
        }
    }
    let scene_resolution = desc.camera.resolution;
    desc.camera.resolution = plan.resolution(scene_resolution);
    let given = match &args.reference {
        Some(path) => Some(given::read(path, desc.camera.resolution)?),
        None => None,
    };
    let mut backends = backends();
    let first = backends.iter().position(|backend| backend.name == plan.backend);
    backends.swap(0, first.ok_or_else(|| Failure::usage(plan.missing_backend()))?);
    let max_depth = args.max_depth.or(desc.max_depth);
    let ladder = ladder(&desc, max_depth, &backends);
    let settings = plan.choose(&ladder)?;
    let store = Store::new(&plan.folder, args.quiet, args.exposure)?;

    let steps = 2 * u64::from(REPLICATIONS) + settings.len() as u64 * plan.ladder().count() as u64;
    interrupt.keep_image();
    let conditions = Conditions {
        schema: SCHEMA,
        software: SOFTWARE.into(),
        scene: args.scene.display().to_string(),
        scene_hash: desc.hash.clone(),
        resolution: desc.camera.resolution,
        scene_resolution,
        max_depth,
        smooth_angle: args.load.smooth_angle,
        backends: backends
            .iter()
            .map(|b| format!("{} {}", b.name, (b.version)()))
            .collect(),
        threads: rayon::current_num_threads(),
        caches: machine::caches(),
        seeds: plan.seeds,
        first_seed: args.seed,
        cell_seconds: plan.cell_seconds,
        max_spp: plan.max_spp,
        command: plan.command(args),
        notes: Vec::new(),
    };
    let mut run = Run {
        plan,
        workshop: Workshop::new(&desc, &backends),
        desc: &desc,
        store: &store,
        stop: &|| interrupt.raised().is_some(),
        progress: Progress::steps(args.quiet),
        steps: steps + plan.tables().count() as u64 + 1,
        done: 0,
        conditions,
    };
    run.all(settings, &ladder, given)
}

/// A study under way.
struct Run<'a> {
    plan: &'a Plan,
    workshop: Workshop<'a>,
    desc: &'a SceneDesc,
    store: &'a Store,
    stop: Stop<'a>,
    progress: Progress,
    /// Steps there are at most, and steps done.
    steps: u64,
    done: u64,
    conditions: Conditions,
}

type References = Vec<(Target, Reference, ReferenceSummary)>;

impl Run<'_> {
    fn all(&mut self, settings: Vec<Setting>, ladder: &[Setting], given: Option<Reference>) -> Result<(), Ended> {
        let references = self.references(&settings, ladder, given)?;
        let mut measured = Vec::new();
        for setting in settings {
            let target = Target::of(&setting.settings);
            let (_, reference, _) = references
                .iter()
                .find(|(of, ..)| *of == target)
                .expect("each target has one");
            let cells = self.cells(&setting, reference)?;
            measured.push((setting, cells));
        }
        let choices = self.choices()?;
        let accumulation = self.accumulation(&measured[0].0)?;
        self.progress.finish(true);
        self.store.text("study.csv", &csv::table(&measured))?;
        let study = Study::new(Parts {
            conditions: self.conditions.clone(),
            references: &references,
            settings: &measured,
            choices,
            accumulation: Some(accumulation),
        });
        let json = serde_json::to_string_pretty(&study).map_err(Failure::internal)?;
        self.store.text("study.json", &(json + "\n"))?;
        let pictures = self.pictures(&study, &references);
        Ok(self.store.text("report.html", &report::page(&study, &pictures))?)
    }

    fn step(&mut self, steps: u64) {
        self.done += steps;
        self.progress.update(self.done, self.steps);
    }

    fn check_stop(&self) -> Result<(), Ended> {
        if (self.stop)() {
            self.progress.finish(false);
            return Err(Ended::Interrupted);
        }
        Ok(())
    }

    /// One for each target that a setting has.
    fn references(
        &mut self,
        settings: &[Setting],
        ladder: &[Setting],
        mut given: Option<Reference>,
    ) -> Result<References, Ended> {
        let mut references: References = Vec::new();
        for setting in settings {
            let target = Target::of(&setting.settings);
            if references.iter().any(|(of, ..)| *of == target) {
                continue;
            }
            let entry = match given.take_if(|_| target == Target::Global) {
                Some(reference) => {
                    self.conditions.notes.push(
                        "The noise of the given reference is not known: it is in every error, and what is flagged as bias \
                         may be that noise."
                            .into(),
                    );
                    let summary = ReferenceSummary {
                        target,
                        file: self.plan.reference.clone().unwrap_or_default(),
                        spp: None,
                        noise: None,
                    };
                    (target, reference, summary)
                }
                None => self.render_reference(target, ladder)?,
            };
            let name = format!("pictures/reference-{}.png", target.name());
            self.store.png(
                &name,
                &display::to_srgb8(&entry.1.pixels.to_image(), self.plan.exposure),
            )?;
            references.push(entry);
        }
        // Steps of a reference that is not needed.
        self.done = 2 * u64::from(REPLICATIONS);
        Ok(references)
    }

    fn render_reference(
        &mut self,
        target: Target,
        ladder: &[Setting],
    ) -> Result<(Target, Reference, ReferenceSummary), Ended> {
        self.progress.describe(|| format!("reference, {}", target.name()));
        let is_best =
            |s: &&Setting| Target::of(&s.settings) == target && s.settings.env_sampling == EnvSampling::Importance;
        let setting = ladder.iter().find(is_best).expect("the default, or direct light");
        let spp = reference::samples_each(self.plan.reference_spp) * REPLICATIONS;
        let key = ReferenceKey {
            version: SOFTWARE.into(),
            scene_hash: self.conditions.scene_hash.clone(),
            target,
            resolution: self.conditions.resolution,
            arguments: setting.arguments.clone(),
            max_depth: self.conditions.max_depth,
            backend: self.conditions.backends[0].clone(),
            spp,
            seed: self.conditions.first_seed,
        };
        let reference = match self.store.reference(&key) {
            Some(reference) => {
                self.step(u64::from(REPLICATIONS));
                reference
            }
            None => {
                let (renderer, _) = self
                    .workshop
                    .renderer(setting, spp / REPLICATIONS)
                    .map_err(Failure::input)?;
                let (before, steps, progress) = (self.done, self.steps, &self.progress);
                let settings = Settings {
                    seed: self.conditions.first_seed,
                    ..setting.settings
                };
                let rendered = reference::render(renderer, &settings, spp, self.stop, &mut |images| {
                    progress.update(before + u64::from(images), steps);
                });
                let Some(reference) = rendered else {
                    self.progress.finish(false);
                    return Err(Ended::Interrupted);
                };
                self.done += u64::from(REPLICATIONS);
                self.store.keep_reference(&key, &reference)?;
                reference
            }
        };
        let summary = ReferenceSummary {
            target,
            file: reference_name(target),
            spp: Some(spp),
            noise: Some(reference.noise()),
        };
        Ok((target, reference, summary))
    }

    /// The ladder of a setting, as far as its cells end in time.
    fn cells(&mut self, setting: &Setting, reference: &Reference) -> Result<Vec<Cell>, Ended> {
        let levels = self.plan.ladder().count() as u64;
        let start = self.done;
        let mut cells: Vec<Cell> = Vec::new();
        for spp in self.plan.ladder() {
            let before = cells
                .last()
                .map_or(0.0, |cell| cell.runs.iter().map(|run| run.seconds).sum::<f64>());
            if spp > FEWEST_SPP && 2.0 * before > self.plan.cell_seconds {
                break;
            }
            self.check_stop()?;
            self.progress.describe(|| format!("{}, {spp} samples", setting.title));
            cells.push(self.cell(setting, spp, reference)?);
            self.step(1);
        }
        self.done = start + levels;
        self.progress.update(self.done, self.steps);
        Ok(cells)
    }

    fn cell(&mut self, setting: &Setting, spp: u32, reference: &Reference) -> Result<Cell, Ended> {
        let key = CellKey {
            version: SOFTWARE.into(),
            scene_hash: self.conditions.scene_hash.clone(),
            reference_hash: reference.hash.clone(),
            resolution: self.conditions.resolution,
            setting: setting.id.into(),
            arguments: setting.arguments.clone(),
            max_depth: setting.settings.max_depth,
            backend: self.conditions.backends[setting.backend].clone(),
            spp,
            first_seed: self.conditions.first_seed,
            seeds: self.plan.seeds,
            threads: self.conditions.threads,
            exposure: self.plan.exposure.to_string(),
        };
        if let Some(cell) = self.store.cell(&key) {
            return Ok(cell);
        }
        let (renderer, build_seconds) = self.workshop.renderer(setting, spp).map_err(Failure::input)?;
        match cell::run(renderer, &setting.settings, &key, reference, build_seconds, self.stop) {
            Some((cell, pictures)) => {
                self.store.keep_cell(&key, &cell, &pictures)?;
                Ok(cell)
            }
            None => {
                self.progress.finish(false);
                Err(Ended::Interrupted)
            }
        }
    }

    /// Ways to draw by weight, for growing tables.
    fn choices(&mut self) -> Result<Vec<choice::Choice>, Ended> {
        let mut choices = Vec::new();
        for entries in self.plan.tables() {
            self.check_stop()?;
            self.progress.describe(|| format!("tables of {entries} entries"));
            let (name, key) = (format!("cells/table-{entries}.json"), (SOFTWARE.to_owned(), entries));
            let available = machine::available_memory();
            if let Some(choice) = self.store.kept(&name, &key) {
                choices.push(choice);
            } else if available.is_some_and(|bytes| choice::memory_bytes(entries) > bytes) {
                let needed = choice::memory_bytes(entries) >> 20;
                self.conditions.notes.push(format!(
                    "Tables of {entries} entries are left out: they need {needed} MiB while they are built."
                ));
            } else {
                let choice = choice::measure(entries);
                self.store.keep(&name, &key, &choice)?;
                choices.push(choice);
            }
            self.step(1);
        }
        Ok(choices)
    }

    fn accumulation(&mut self, setting: &Setting) -> Result<accumulation::Accumulation, Ended> {
        self.check_stop()?;
        self.progress.describe(|| "sums in 32 bits".into());
        let name = "cells/accumulation.json";
        let key = (SOFTWARE.to_owned(), self.desc.hash.clone(), self.conditions.resolution);
        if let Some(kept) = self.store.kept(name, &key) {
            return Ok(kept);
        }
        let (renderer, _) = self
            .workshop
            .renderer(setting, self.plan.max_spp)
            .map_err(Failure::input)?;
        let measured = accumulation::measure(renderer, &setting.settings, ACCUMULATED_SPP);
        self.store.keep(name, &key, &measured)?;
        Ok(measured)
    }

    /// What the report shows side by side: the references, and an image of each setting with the same number of samples.
    fn pictures(&self, study: &Study, references: &References) -> Vec<Picture> {
        let common = study
            .settings
            .iter()
            .map(|s| s.last().spp)
            .min()
            .unwrap_or(1)
            .min(PICTURE_SPP);
        let of_reference = references.iter().map(|(target, ..)| Picture {
            id: format!("reference-{}", target.name()),
            title: format!("reference, {} light", target.name()),
            target: *target,
            flip: None,
            png: self.store.read(&format!("pictures/reference-{}.png", target.name())),
            flip_png: None,
        });
        let of_settings = study.settings.iter().map(|s| {
            let [png, flip_png] = picture_names(s.id, common);
            Picture {
                id: s.id.into(),
                title: format!("{}, {common} spp", s.title),
                target: s.target,
                flip: s.points.iter().find(|p| p.spp == common).map(|p| p.flip),
                png: self.store.read(&png),
                flip_png: self.store.read(&flip_png),
            }
        });
        of_reference.chain(of_settings).collect()
    }
}
