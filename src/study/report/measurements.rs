//! Stability, sums in 32 bits, and ways to draw by weight.

use super::format::{bytes, estimate, number, power};
use crate::study::measure::{FIREFLY_FACTOR, FIREFLY_RADIUS};
use crate::study::plot::{COLOURS, Mark, Scale, Series, log_log, shape};
use crate::study::{Study, choice::Choice};
use maud::{Markup, PreEscaped, html};

pub(super) fn stability(study: &Study) -> Markup {
    html! {
        h2 { "Stability" }
        p {
            "Of the images with the most samples. A firefly is a pixel more than " (number(FIREFLY_FACTOR))
            " times as bright as the brightest pixel of the reference within " (FIREFLY_RADIUS)
            " pixels of it (plus 0.01). Where the trimmed relMSE is far below the relMSE, few pixels make the error. Dropped samples "
            "were NaN or infinite, and count as black."
        }
        div.wide {
            table {
                thead { tr {
                    th { "setting" } th { "samples" } th { "relMSE without the worst 0.1 %" } th { "relMSE" }
                    th { "fireflies per image" } th { "worst pixel: column, row" } th { "its luminance" }
                    th { "in the reference" } th { "dropped samples" }
                } }
                tbody {
                    @for s in &study.settings {
                        @let last = s.last();
                        tr {
                            td { (s.title) }
                            td { (last.spp) }
                            td { (estimate(last.relmse_trimmed)) }
                            td { (estimate(last.relmse)) }
                            td { (estimate(last.fireflies)) }
                            td { (last.worst.x) ", " (last.worst.y) }
                            td { (number(last.worst.luminance)) }
                            td { (number(last.worst.reference)) }
                            td { (last.dropped) }
                        }
                    }
                }
            }
        }
    }
}

pub(super) fn accumulation(study: &Study) -> Markup {
    let Some(accumulation) = &study.accumulation else {
        return html! {};
    };
    let saved = accumulation.f64_ns - accumulation.f32_ns;
    html! {
        h2 { "A film of 32 bits against 64" }
        p {
            "The same samples of " (accumulation.side) " × " (accumulation.side) " pixels in the middle of the image, added in f32 and as "
            "the film does, in f64 with what rounding takes (beyond " (accumulation.recorded_spp)
            " samples per pixel they are repeated). Adding a sample takes " (number(accumulation.f32_ns)) " ns in f32 and "
            (number(accumulation.f64_ns)) " ns in f64; computing it takes " (number(accumulation.sample_ns))
            " ns on one thread. f32 would save " (number(100.0 * saved / accumulation.sample_ns)) " % of the time."
        }
        div.wide {
            table {
                thead { tr { th { "samples" } th { "relMSE by f32 sums alone" } th { "change of the mean" } } }
                tbody {
                    @for point in &accumulation.points {
                        tr {
                            td { (point.spp) }
                            td { (number(point.relmse)) }
                            td { (number(100.0 * point.drift)) " %" }
                        }
                    }
                }
            }
        }
    }
}

pub(super) fn choices(study: &Study) -> Markup {
    if study.choices.is_empty() {
        return html! {};
    }
    type Time = fn(&Choice) -> Option<f64>;
    let methods: [(&str, Time); 3] = [
        ("alias method", |c| Some(c.alias_ns)),
        ("binary search in the cumulative table", |c| Some(c.binary_ns)),
        ("linear scan", |c| c.linear_ns),
    ];
    let series: Vec<Series> = methods
        .iter()
        .enumerate()
        .map(|(i, (name, time))| {
            let marks = study.choices.iter().filter_map(|c| {
                Some(Mark {
                    x: c.entries as f64,
                    y: time(c)?,
                    error: 0.0,
                })
            });
            Series {
                name: (*name).into(),
                marks: marks.collect(),
                colour: COLOURS[i],
                shape: i,
                is_guide: false,
            }
        })
        .collect();
    let counts_misses = study.choices.iter().any(|c| c.misses.iter().any(Option::is_some));
    html! {
        h2 { "Drawing by weight: alias method, binary search, linear scan" }
        p {
            "Time of a draw from tables as of an environment map with a sun, independent draws one after another, random numbers "
            "included; medians of five. Lines are the 64-byte lines of the cache that a draw touches: once a table no longer fits "
            "into a cache, each is likely to be a miss, except in the first steps of a binary search. "
            @if !counts_misses { "This system does not let a program count the misses themselves." }
        }
        ul.legend {
            @for (i, series) in series.iter().enumerate() {
                li { span style=(format!("color:rgb({},{},{})", series.colour.0, series.colour.1, series.colour.2)) { (shape(i)) }
                    " " (series.name) }
            }
        }
        @if let Some(svg) = log_log(&series, "entries", "time of a draw [ns]", Scale::Decades) { (PreEscaped(svg)) }
        div.wide {
            table {
                thead { tr {
                    th { "entries" } th { "table" } th { "fits into" } th { "alias [ns]" } th { "binary [ns]" } th { "linear [ns]" }
                    th { "lines: alias" } th { "lines: binary" } th { "lines: linear" }
                    @if counts_misses { th { "misses: alias" } th { "misses: binary" } th { "misses: linear" } }
                    th { "build alias [ns per entry]" } th { "build cumulative [ns per entry]" }
                } }
                tbody {
                    @for c in &study.choices {
                        tr {
                            td { (power(c.entries)) }
                            td { (bytes(c.table_bytes)) }
                            td { (fits_into(c.table_bytes, &study.conditions.caches)) }
                            td { (number(c.alias_ns)) }
                            td { (number(c.binary_ns)) }
                            td { (c.linear_ns.map_or("too long".into(), number)) }
                            @for lines in c.lines { td { (number(lines)) } }
                            @if counts_misses { @for misses in c.misses { td { (misses.map_or("–".into(), number)) } } }
                            td { (number(c.alias_build_ns)) }
                            td { (number(c.cumulative_build_ns)) }
                        }
                    }
                }
            }
        }
    }
}

/// The smallest cache that has room for a table.
fn fits_into(table: u64, caches: &[(u32, u64)]) -> String {
    let holds = caches.iter().filter(|(_, size)| *size >= table).min();
    holds.map_or("memory".into(), |(level, size)| format!("L{level}, {}", bytes(*size)))
}
