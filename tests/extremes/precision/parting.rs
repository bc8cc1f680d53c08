//! Where a path in f32 and the same path in f64 part, and why.

use super::recorder;
use crate::reference::{Ray, Reference, TriangleName, Vertex};
use embrace::accel;

/// Directions that differ by more than this were not drawn alike, unless rounding has grown that far.
const PARTED: f64 = 0.1;

/// How close a decision must be to put its outcome down to rounding: this many times the difference that the rays have
/// come to, but at least a thousand times the rounding of a ray. A decision of another cause passes for one of these with
/// about that probability.
const GROWTH: f64 = 30.0;
const CLOSE: f64 = 1e-3;

/// The decision that turned out differently.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Cause {
    /// The ray met another triangle, or one of the two none.
    Hit,
    /// Only one of the two had an emitter sample that was worth a ray.
    Light,
    /// Only one of the two shadow rays arrived.
    Occlusion,
    /// The bounce took another lobe, or the same one around other tangents.
    Lobe,
    /// Only one of the two paths went on.
    End,
    /// None: rounding alone, and what surfaces have made of it on the way.
    Rounding,
}

impl Cause {
    pub(super) const ALL: [Cause; 6] = [
        Cause::Hit,
        Cause::Light,
        Cause::Occlusion,
        Cause::Lobe,
        Cause::End,
        Cause::Rounding,
    ];
}

/// How two paths compare.
#[derive(Clone, Copy, Debug)]
pub(super) struct Parting {
    /// Of the first decision that differs.
    pub(super) cause: Cause,
    /// Scattering events before it.
    pub(super) bounce: usize,
    /// Whether that decision was so close that rounding turns it.
    pub(super) close: bool,
    /// By how much the rays differed until then, summed over the path: in direction, or in position over `size`.
    pub(super) drift: f64,
}

/// Finds the first difference. `size` is the length that differences of position are measured in.
pub(super) fn find(reference: &Reference, narrow: &[recorder::Vertex], wide: &[Vertex], size: f64) -> Parting {
    let mut parting = Parting {
        cause: Cause::Rounding,
        bounce: 0,
        close: true,
        drift: 0.0,
    };
    let closeness = |error: f64| (GROWTH * error).max(CLOSE);
    let mut error = 0.0;
    for (bounce, (a, b)) in narrow.iter().zip(wide).enumerate() {
        parting.bounce = bounce;
        let turned = (a.ray.direction.as_dvec3() - b.ray.direction).length();
        if turned > PARTED {
            assert!(bounce > 0, "camera rays differ");
            let margins = &wide[bounce - 1].margins;
            let lobe_is_close = margins.lobe.min(margins.frame) < closeness(error);
            return Parting {
                cause: if lobe_is_close { Cause::Lobe } else { Cause::Rounding },
                close: lobe_is_close || turned < closeness(error),
                ..parting
            };
        }
        error = turned.max(distance(a, b) / size);
        parting.drift += error;
        if let Some((cause, close)) = difference(reference, a, b, closeness(error)) {
            return Parting {
                cause,
                close,
                ..parting
            };
        }
    }
    if narrow.len() != wide.len() {
        let margins = &wide[parting.bounce].margins;
        let margin = margins
            .roulette
            .min(margins.bounce)
            .min(margins.lobe)
            .min(margins.frame);
        parting.cause = Cause::End;
        parting.close = margin < closeness(error);
    }
    parting
}

/// How far the rays start, or end on the same triangle, from each other.
fn distance(a: &recorder::Vertex, b: &Vertex) -> f64 {
    let start = a.ray.origin.as_dvec3().distance(b.ray.origin);
    match (a.hit, b.hit) {
        (Some(a_hit), Some(b_hit)) if name(&a_hit) == b_hit.name => {
            let end = widen(&a.ray).at(a_hit.t.into());
            start.max(end.distance(b.ray.at(b_hit.t)))
        }
        _ => start,
    }
}

/// The first difference at a vertex that two paths share, and whether it was close.
fn difference(reference: &Reference, a: &recorder::Vertex, b: &Vertex, closeness: f64) -> Option<(Cause, bool)> {
    let geometry = &reference.geometry;
    let found = a.hit.as_ref().map(name);
    if found != b.hit.map(|hit| hit.name) {
        let same_ray = widen(&a.ray);
        let answer = geometry.intersect(&same_ray).map(|hit| hit.name);
        return Some((
            Cause::Hit,
            answer == found || geometry.grazes_border(&same_ray, closeness),
        ));
    }
    match (&a.shadow, b.occluded) {
        (Some((ray, narrow)), Some(wide)) if *narrow != wide => {
            let same_ray = widen(ray);
            let answer = geometry.occluded(&same_ray);
            Some((
                Cause::Occlusion,
                answer == *narrow || geometry.grazes_border(&same_ray, closeness),
            ))
        }
        (Some(_), None) | (None, Some(_)) => Some((Cause::Light, b.margins.light < closeness)),
        _ => None,
    }
}

fn name(hit: &accel::Hit) -> TriangleName {
    TriangleName {
        placement: hit.placement,
        triangle: hit.triangle,
    }
}

/// The ray in f32, exactly.
fn widen(ray: &accel::Ray) -> Ray {
    Ray {
        origin: ray.origin.as_dvec3(),
        direction: ray.direction.as_dvec3(),
        t_max: ray.t_max.into(),
    }
}
