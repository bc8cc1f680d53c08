//! Plots as SVG text, log-log: decades are labelled, their parts have fine lines.

use super::report::superscript;
use plotters::coord::ranged1d::{KeyPointHint, Ranged, ValueFormatter};
use plotters::prelude::*;
use std::ops::Range;

/// Size of a plot; the page scales it.
const SIZE: (u32, u32) = (640, 400);

/// Colours that stay apart for the colour-blind and on paper (Okabe and Ito 2008), the default's black first.
pub(super) const COLOURS: [RGBColor; 7] = [
    RGBColor(0, 0, 0),
    RGBColor(213, 94, 0),
    RGBColor(0, 114, 178),
    RGBColor(0, 158, 115),
    RGBColor(204, 121, 167),
    RGBColor(150, 110, 0),
    RGBColor(86, 180, 233),
];

/// A point with its error bar.
#[derive(Clone, Copy, Debug)]
pub(super) struct Mark {
    pub(super) x: f64,
    pub(super) y: f64,
    /// Half of the length of the bar.
    pub(super) error: f64,
}

/// Points of one colour.
#[derive(Clone, Debug)]
pub(super) struct Series {
    pub(super) name: String,
    pub(super) marks: Vec<Mark>,
    pub(super) colour: RGBColor,
    /// Number of the shape of its points.
    pub(super) shape: usize,
    /// Line without points, dashed: a guide for the eye.
    pub(super) is_guide: bool,
}

/// Shape of a series' points, so that colour alone need not tell.
pub(super) fn shape(index: usize) -> &'static str {
    ["●", "■", "▲", "◆", "▼", "✚", "○"][index % 7]
}

/// What the lines of an axis are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Scale {
    /// Powers of ten.
    Decades,
    /// Powers of two: numbers of samples.
    Doublings,
}

/// A decimal logarithm along an axis.
struct Axis(Range<f64>, Scale);

impl Ranged for Axis {
    type FormatOption = plotters::coord::ranged1d::NoDefaultFormatting;
    type ValueType = f64;

    fn map(&self, value: &f64, (low, high): (i32, i32)) -> i32 {
        let fraction = (value - self.0.start) / (self.0.end - self.0.start);
        low + (fraction * f64::from(high - low)).round() as i32
    }

    fn key_points<H: KeyPointHint>(&self, hint: H) -> Vec<f64> {
        let decades = self.0.start.floor() as i32..=self.0.end.ceil() as i32;
        let is_inside = |x: &f64| (self.0.start - 1e-9..=self.0.end + 1e-9).contains(x);
        let all = |digits: &[f64]| -> Vec<f64> {
            let points = decades
                .clone()
                .flat_map(|d| digits.iter().map(move |m| f64::from(d) + m.log10()));
            points.filter(is_inside).collect()
        };
        if self.1 == Scale::Doublings {
            let doublings = (0..63).map(|k| f64::from(k) * 2f64.log10()).filter(is_inside);
            return doublings.collect();
        }
        let labels = all(&[1.0]);
        if hint.weight().allow_light_points() {
            return all(&[1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0]);
        }
        // Less than two decades would leave an axis with hardly a number.
        let (labels, most) = match labels.len() {
            0..=2 => (all(&[1.0, 2.0, 5.0]), usize::MAX),
            _ => (labels, 8),
        };
        let step = labels.len().div_ceil(most.max(1));
        labels.into_iter().step_by(step.max(1)).collect()
    }

    fn range(&self) -> Range<f64> {
        self.0.clone()
    }
}

impl ValueFormatter<f64> for Axis {
    fn format_ext(&self, value: &f64) -> String {
        match self.1 {
            Scale::Decades => number(10f64.powf(*value)),
            Scale::Doublings => format!("{:.0}", 10f64.powf(*value)),
        }
    }
}

/// A power of ten, or a small multiple of one, shortly.
fn number(value: f64) -> String {
    if (0.001..10_000.0).contains(&value) {
        let digits = (-value.log10().floor()).max(0.0) as usize;
        format!("{value:.digits$}")
    } else {
        let text = format!("{value:.0e}");
        match text.split_once('e') {
            Some((digit, exponent)) => {
                let power = format!("10{}", superscript(exponent.parse().unwrap_or(0)));
                if digit == "1" {
                    power
                } else {
                    format!("{digit}·{power}")
                }
            }
            None => text,
        }
    }
}

/// A log-log plot; `None` without any positive point.
pub(super) fn log_log(series: &[Series], x_label: &str, y_label: &str, scale: Scale) -> Option<String> {
    let marks = || series.iter().flat_map(|s| &s.marks).filter(|m| m.x > 0.0 && m.y > 0.0);
    let x = padded(marks().map(|m| m.x))?;
    // The guide does not stretch the axis.
    let points = || series.iter().filter(|s| !s.is_guide).flat_map(|s| &s.marks);
    let y = padded(points().filter(|m| m.x > 0.0 && m.y > 0.0).map(|m| m.y))?;
    let mut svg = String::new();
    draw(
        &mut svg,
        series,
        (Axis(x, scale), Axis(y, Scale::Decades)),
        x_label,
        y_label,
    )
    .ok()?;
    Some(accessible(&svg, x_label, y_label))
}

/// The range of decimal logarithms, a little wider.
fn padded(values: impl Iterator<Item = f64>) -> Option<Range<f64>> {
    let (low, high) = values.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), v| {
        (low.min(v.log10()), high.max(v.log10()))
    });
    let pad = ((high - low) * 0.05).max(0.1);
    (low <= high).then_some(low - pad..high + pad)
}

type Failure = Box<dyn std::error::Error>;

fn draw(
    svg: &mut String,
    series: &[Series],
    (x, y): (Axis, Axis),
    x_label: &str,
    y_label: &str,
) -> Result<(), Failure> {
    let y_range = y.0.clone();
    let area = SVGBackend::with_string(svg, SIZE).into_drawing_area();
    let mut chart = ChartBuilder::on(&area)
        .margin(8)
        .margin_right(16)
        .x_label_area_size(46)
        .y_label_area_size(74)
        .build_cartesian_2d(x, y)?;
    chart
        .configure_mesh()
        .x_desc(x_label)
        .y_desc(y_label)
        .axis_desc_style(("sans-serif", 16))
        .label_style(("sans-serif", 15))
        .bold_line_style(RGBColor(205, 205, 205))
        .light_line_style(RGBColor(238, 238, 238))
        .axis_style(RGBColor(90, 90, 90))
        .draw()?;
    for series in series {
        let inside: Vec<&Mark> = series.marks.iter().filter(|m| m.x > 0.0 && m.y > 0.0).collect();
        let line = inside.iter().map(|m| (m.x.log10(), m.y.log10()));
        if series.is_guide {
            let clipped = line.filter(|(_, v)| y_range.contains(v));
            chart.draw_series(DashedLineSeries::new(clipped, 6, 5, series.colour.stroke_width(1)))?;
            continue;
        }
        chart.draw_series(LineSeries::new(line, series.colour.stroke_width(2)))?;
        for mark in inside {
            let (at, low, high) = (
                mark.x.log10(),
                // A bar that reaches zero ends at the axis.
                (mark.y - mark.error).max(0.0).log10().max(y_range.start),
                (mark.y + mark.error).log10().min(y_range.end),
            );
            chart.plotting_area().draw(&PathElement::new(
                vec![(at, low), (at, high)],
                series.colour.stroke_width(1),
            ))?;
            for end in [low, high] {
                let cap = EmptyElement::at((at, end)) + PathElement::new(vec![(-4, 0), (4, 0)], series.colour);
                chart.plotting_area().draw(&cap)?;
            }
            draw_shape(&chart, series.shape, (at, mark.y.log10()), series.colour)?;
        }
    }
    area.present()?;
    Ok(())
}

/// The same shapes as [`shape`] names.
fn draw_shape<DB: DrawingBackend>(
    chart: &ChartContext<'_, DB, Cartesian2d<Axis, Axis>>,
    index: usize,
    at: (f64, f64),
    colour: RGBColor,
) -> Result<(), Failure>
where
    DB::ErrorType: 'static,
{
    let corners: &[(i32, i32)] = match index % 7 {
        1 => &[(-4, -4), (4, -4), (4, 4), (-4, 4)],
        2 => &[(0, -5), (5, 4), (-5, 4)],
        3 => &[(0, -5), (5, 0), (0, 5), (-5, 0)],
        4 => &[(0, 5), (5, -4), (-5, -4)],
        5 => &[
            (-5, -2),
            (-2, -2),
            (-2, -5),
            (2, -5),
            (2, -2),
            (5, -2),
            (5, 2),
            (2, 2),
            (2, 5),
            (-2, 5),
            (-2, 2),
            (-5, 2),
        ],
        _ => &[],
    };
    let area = chart.plotting_area();
    if corners.is_empty() {
        let style = if index.is_multiple_of(7) {
            colour.filled()
        } else {
            colour.stroke_width(2)
        };
        area.draw(&Circle::new(at, 4, style))?;
    } else {
        area.draw(&(EmptyElement::at(at) + Polygon::new(corners.to_vec(), colour.filled())))?;
    }
    Ok(())
}

/// Scales with the page, and says what it shows.
fn accessible(svg: &str, x_label: &str, y_label: &str) -> String {
    let body = svg.split_once('>').map_or("", |(_, body)| body);
    let (width, height) = SIZE;
    let title = maud::html! { title { (y_label) " against " (x_label) } }.into_string();
    format!(r#"<svg class="plot" role="img" viewBox="0 0 {width} {height}">{title}{body}"#)
}
