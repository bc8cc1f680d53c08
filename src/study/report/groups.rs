//! One section for each question.

use super::format::{estimate, number, slope};
use crate::study::analysis::{Estimate, Point};
use crate::study::plot::{COLOURS, Mark, Scale, Series, log_log, shape};
use crate::study::setting::Group;
use crate::study::{SettingResult, Study, Verdict};
use maud::{Markup, PreEscaped, html};

/// Nothing where the scene has no setting of the group.
pub(super) fn section(study: &Study, group: Group) -> Markup {
    let is_shown = |s: &&SettingResult| s.group == group || s.group == Group::Default;
    let settings: Vec<&SettingResult> = study.settings.iter().filter(is_shown).collect();
    if settings.iter().all(|s| s.group == Group::Default) {
        return html! {};
    }
    let numbered = || settings.iter().enumerate();
    let mut by_samples: Vec<Series> = numbered().map(|(i, s)| against_samples(s, i)).collect();
    by_samples.extend(guide(settings[0]));
    let by_time: Vec<Series> = numbered().map(|(i, s)| against_time(s, i)).collect();
    html! {
        h2 { (group.title()) }
        ul.legend {
            @for (i, s) in numbered() {
                li { span style=(format!("color:{}", css(i))) { (shape(i)) } " " (s.title) }
            }
            li.faint { "┄ slope −1" }
        }
        div.plots {
            @if let Some(svg) = log_log(&by_samples, "samples per pixel", "relMSE", Scale::Doublings) { (PreEscaped(svg)) }
            @if let Some(svg) = log_log(&by_time, "time to render [s]", "relMSE", Scale::Decades) { (PreEscaped(svg)) }
        }
        (table(&settings, group == Group::Precision))
    }
}

fn css(index: usize) -> String {
    let colour = COLOURS[index % COLOURS.len()];
    format!("rgb({},{},{})", colour.0, colour.1, colour.2)
}

fn table(settings: &[&SettingResult], with_build: bool) -> Markup {
    html! {
        div.wide {
            table {
                thead { tr {
                    th { "setting" } th { "most samples" } @if with_build { th { "build [s]" } } th { "render [s]" }
                    th { "relMSE" } th { "time / default's" } th { "relMSE / default's" } th { "efficiency" } th { "efficiency, trimmed" }
                    th { "slope of MSE" } th { "mean / reference" } th { "bias" }
                } }
                tbody {
                    @for s in settings {
                        @let last = s.last();
                        tr {
                            td { (s.title) }
                            td { (last.spp) }
                            @if with_build { td { (number(last.build_seconds)) } }
                            td { (estimate(last.seconds)) }
                            td { (error(last, last.relmse)) }
                            @if let Some(against) = s.against_default {
                                td { (number(against.seconds)) }
                                td { (number(against.relmse)) }
                                td { (estimate(Estimate {
                                    mean: against.efficiency,
                                    standard_error: against.relative_error * against.efficiency,
                                })) }
                                td { (number(against.efficiency_trimmed)) }
                            } @else { td { "–" } td { "–" } td { "–" } td { "–" } }
                            td { (slope(s.slope_mse)) }
                            td { (estimate(last.mean_ratio)) }
                            td { (verdict(s)) }
                        }
                    }
                }
            }
        }
    }
}

fn error(point: &Point, error: Estimate) -> String {
    if point.is_above_noise {
        estimate(error)
    } else {
        format!("({})", number(error.mean))
    }
}

/// Whether there is a bias, and how large one could be.
pub(super) fn verdict(s: &SettingResult) -> Markup {
    let bias = s.last().bias;
    html! {
        @match s.verdict {
            Verdict::Biased => span.flag { "floor " (number(bias.floor)) },
            Verdict::Consistent => span { "none seen; < " (number(bias.upper_bound())) },
        }
    }
}

/// Errors by samples; `index` chooses colour and shape.
fn against_samples(s: &SettingResult, index: usize) -> Series {
    series(s, index, |p| f64::from(p.spp))
}

/// Errors by time.
pub(super) fn against_time(s: &SettingResult, index: usize) -> Series {
    series(s, index, |p| p.seconds.mean)
}

fn series(s: &SettingResult, index: usize, x: impl Fn(&Point) -> f64) -> Series {
    let shown = s.points.iter().filter(|p| p.relmse.mean > 0.0);
    Series {
        name: s.title.clone(),
        marks: shown
            .map(|p| Mark {
                x: x(p),
                y: p.relmse.mean,
                error: p.relmse.standard_error,
            })
            .collect(),
        colour: COLOURS[index % COLOURS.len()],
        shape: index,
        is_guide: false,
    }
}

/// What errors of independent samples would do from the first point on.
fn guide(s: &SettingResult) -> Option<Series> {
    let (first, last) = (s.points.first()?, s.points.last()?);
    let at = |spp: f64| Mark {
        x: spp,
        y: first.relmse.mean * f64::from(first.spp) / spp,
        error: 0.0,
    };
    Some(Series {
        name: "slope −1".into(),
        marks: vec![at(f64::from(first.spp)), at(f64::from(last.spp))],
        colour: super::GREY,
        shape: 0,
        is_guide: true,
    })
}
