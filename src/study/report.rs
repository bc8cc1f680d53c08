//! The report: one HTML file without anything from elsewhere, for screen, phone and paper.
//!
//! All text goes through [`maud`], which escapes it.

mod format;
mod groups;
mod measurements;
mod pictures;

pub(super) use format::superscript;
pub use pictures::Picture;

use super::analysis::Estimate;
use super::plot::{COLOURS, Mark, Scale, Series, log_log};
use super::reference::Target;
use super::setting::Group;
use super::{Best, SettingResult, Study, Verdict, bias};
use format::{estimate, number, times};
use maud::{DOCTYPE, Markup, PreEscaped, html};
use plotters::style::RGBColor;

/// Nothing may be fetched, whatever a scene is called.
const POLICY: &str = include_str!("report/policy.txt");

/// The colour of what is in the background.
const GREY: RGBColor = RGBColor(190, 190, 190);

/// The whole page.
pub fn page(study: &Study, pictures: &[Picture]) -> String {
    let conditions = &study.conditions;
    let title = format!("Speed against error: {}", conditions.scene);
    html! {
        (DOCTYPE)
        html lang="en" {
            head {
                meta charset="utf-8";
                meta name="viewport" content="width=device-width, initial-scale=1";
                meta http-equiv="Content-Security-Policy" content=(POLICY);
                title { (title) }
                style { (PreEscaped(include_str!("report/report.css"))) }
            }
            body {
                h1 { (title) }
                (lead(study))
                (answers(study))
                (overview(study))
                (pictures::section(pictures))
                @for group in Group::ALL { (groups::section(study, group)) }
                (measurements::stability(study))
                (measurements::accumulation(study))
                (measurements::choices(study))
                (method(study))
                script { (PreEscaped(include_str!("report/report.js"))) }
            }
        }
    }
    .into_string()
}

fn lead(study: &Study) -> Markup {
    let conditions = &study.conditions;
    let [width, height] = conditions.resolution;
    let [full_width, full_height] = conditions.scene_resolution;
    let factor = f64::from(full_width) * f64::from(full_height) / (f64::from(width) * f64::from(height));
    html! {
        p.lead {
            (conditions.software) ", " (conditions.backends.join(", ")) ", " (conditions.threads) " threads; images of "
            (width) " × " (height) " pixels, " (conditions.seeds) " seeds for every number. "
            @if factor > 1.01 {
                "At the scene's own " (full_width) " × " (full_height) " the same error takes about "
                (times(factor)) " the time."
            }
        }
        p { code { (conditions.command) } }
        @for note in &conditions.notes { p.faint { (note) } }
    }
}

fn answers(study: &Study) -> Markup {
    let flagged: Vec<&SettingResult> = study.settings.iter().filter(|s| s.verdict == Verdict::Biased).collect();
    let title = |id: &'static str| {
        study
            .settings
            .iter()
            .find(|s| s.id == id)
            .map_or(id, |s| s.title.as_str())
    };
    let setting = |best: &Best| {
        let others = best.settings.len() - 1;
        html! {
            (title(best.settings[0]))
            @if others > 0 { span.faint { "; " (others) " others do as well, within two standard errors (green below)" } }
        }
    };
    html! {
        h2 { "What to choose" }
        div.wide {
            table {
                thead { tr { th { "time to render" } th { "relMSE reached" } th.left { "best setting" } } }
                tbody {
                    @for best in &study.best {
                        tr {
                            td { (best.seconds) " s" }
                            td { (number(best.relmse)) @if best.is_extrapolated { " *" } }
                            td.left style="white-space:normal" { (setting(best)) }
                        }
                    }
                }
            }
        }
        p.faint {
            "* beyond what was measured: by the fitted slope where its standard error is at most 0.1, else by slope −1."
        }
        ul {
            @for sentence in sentences(study) { li { (sentence) } }
        }
        @if flagged.is_empty() {
            p {
                "No setting shows a bias: no mean image differs from its reference by more than noise "
                "(" (100.0 * bias::SIGNIFICANCE) " % significance for the whole study)."
            }
        } @else {
            @for setting in flagged {
                p {
                    span.flag { "Biased: " (setting.title) "." }
                    " A part of its relMSE, " (estimate(Estimate {
                        mean: setting.last().bias.floor,
                        standard_error: setting.last().bias.standard_error,
                    })) ", stays whatever the number of samples."
                }
            }
        }
    }
}

/// What a person wants to know first.
fn sentences(study: &Study) -> Vec<String> {
    let find = |id: &str| study.settings.iter().find(|s| s.id == id);
    let mut sentences = Vec::new();
    let halving = |s: &SettingResult| Some((s.samples_to_halve?, s.slope_mse?));
    if let Some((factor, slope)) = find("default").and_then(halving) {
        let mut sentence = format!(
            "Half of the error (RMSE) takes {} the samples: the MSE falls with samples to the power {}",
            times(factor),
            estimate(slope.slope)
        );
        if let Some((_, slope)) = find("sampler-independent").and_then(halving) {
            sentence += &format!(", with independent random numbers {}", estimate(slope.slope));
        }
        sentences.push(sentence + ".");
    }
    let mut worth = |id: &str, what: &str| {
        if let Some(against) = find(id).and_then(|s| s.against_default) {
            let better = Estimate {
                mean: 1.0 / against.efficiency,
                standard_error: against.relative_error / against.efficiency,
            };
            sentences.push(format!(
                "{what}: the same error takes {} × as long ({} × the error in {} × the time at {} samples).",
                estimate(better),
                number(against.relmse),
                number(against.seconds),
                against.spp
            ));
        }
    };
    worth("env-uniform", "Without importance sampling of the environment");
    worth("mis-off", "Without multiple importance sampling");
    worth("bounce-uniform", "With uniform bounces");
    worth("roulette-fixed", "With the article's fixed roulette");
    worth("roulette-off", "Without roulette, but with a depth limit");
    worth("lights-power", "With emitters chosen by power");
    worth("article", "With the article's estimator");
    sentences
}

fn overview(study: &Study) -> Markup {
    let global = || study.settings.iter().filter(|s| s.target == Target::Global);
    let mut series: Vec<Series> = global()
        .map(|s| Series {
            colour: GREY,
            ..groups::against_time(s, 0)
        })
        .collect();
    // The front is drawn last, over the others.
    series.push(Series {
        name: "Pareto front".into(),
        marks: study
            .pareto_front
            .iter()
            .map(|p| Mark {
                x: p.seconds,
                y: p.relmse,
                error: 0.0,
            })
            .collect(),
        colour: COLOURS[1],
        shape: 1,
        is_guide: false,
    });
    html! {
        h2 { "Error against time" }
        p {
            "All settings in grey; in colour the Pareto front, the measurements that no other is both faster and better "
            "than. Errors are less the noise of the reference; bars are standard errors over seeds."
        }
        @if let Some(svg) = log_log(&series, "time to render [s]", "relMSE", Scale::Decades) { (PreEscaped(svg)) }
        div.wide {
            table {
                thead { tr {
                    th { "setting" }
                    @for best in &study.best { th { "relMSE after " (best.seconds) " s" } }
                    th { "time for the default's error" }
                    th { "slope of MSE" }
                    th { "samples for half of the RMSE" }
                    th { "bias" }
                } }
                tbody {
                    @for s in global() {
                        tr {
                            td { (s.title) }
                            @for (reached, best) in study.best.iter().filter_map(|best| {
                                Some((s.reached.iter().find(|r| r.seconds == best.seconds)?, best))
                            }) {
                                td.best[best.settings.contains(&s.id)] {
                                    (reached.relmse.map_or("–".into(), number))
                                    @if reached.is_extrapolated { " *" }
                                }
                            }
                            td { (s.against_default.map_or("–".into(), |a| estimate(Estimate {
                                mean: 1.0 / a.efficiency,
                                standard_error: a.relative_error / a.efficiency,
                            }) + " ×")) }
                            td { (format::slope(s.slope_mse)) }
                            td { (s.samples_to_halve.map_or("–".into(), times)) }
                            td { (groups::verdict(s)) }
                        }
                    }
                }
            }
        }
        p.faint {
            "Green: best, or no worse within two standard errors. * beyond what was measured, see above. – : even one "
            "sample takes longer, or the error is lost in the noise of the reference."
        }
    }
}

fn method(study: &Study) -> Markup {
    let conditions = &study.conditions;
    html! {
        h2 { "How it was measured" }
        p {
            "Each number is over " (conditions.seeds) " images of different seeds: mean ± standard error. relMSE is the mean of "
            "(a − b)² / (a² + 0.01) over pixels and channels, a the reference. A setting gets 1, 2, 4, … samples per pixel until twice the "
            "time of its last images would be more than " (conditions.cell_seconds) " s (4 in any case), at most "
            (conditions.max_spp) ". Times are from the first to the last sample, without reading and building."
        }
        p {
            "Slopes are fitted to each seed on its own, and only where the error is at least twice the noise of the reference. "
            "A bias is what the mean image of all seeds differs from the reference beyond the spread of both (two-sample test in many "
            "dimensions, Chen and Qin 2010); " (100.0 * bias::SIGNIFICANCE) " % is the chance that any setting is "
            "flagged without reason."
        }
        p {
            "Comparisons with the default are at the most samples that both have. Efficiency is the default's relMSE × time over the "
            "setting's: 2 is the same error in half of the time; trimmed, without the worst 0.1 % of the pixels, which is steadier "
            "where few pixels make the error. Errors are less the noise of the reference, and in parentheses where "
            "they are below twice that noise."
        }
        ul {
            @for reference in &study.references {
                li {
                    "Reference, " (reference.target.name()) " light: " code { (reference.file) }
                    @if let (Some(spp), Some(noise)) = (reference.spp, reference.noise) {
                        ", " (spp) " samples per pixel; its own noise, MSE " (number(noise.mse)) " and relMSE "
                        (number(noise.relmse)) ", is estimated from its " (super::reference::REPLICATIONS)
                        " independent parts and subtracted."
                    } @else { ", given; its noise is not known." }
                }
            }
        }
        h3 { "Commands" }
        p {
            "The image of the first seed with the most samples; other samples and seeds by " code { "--spp" } " and "
            code { "--seed" } ". " code { "embrace compare REFERENCE IMAGE" } " prints its errors, the reference's noise included. "
            "Reference files are in the folder of the report."
        }
        div.wide {
            table {
                thead { tr { th { "setting" } th.left { "command" } } }
                tbody {
                    @for s in &study.settings {
                        tr { td { (s.title) } td.command { code { (s.command) } } }
                    }
                }
            }
        }
    }
}
