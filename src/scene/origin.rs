//! Where the coordinates of rendering have their origin.
//!
//! Rendering computes in f32, whose steps grow with the distance from the origin. A description keeps f64; on building,
//! everything is moved so that a scene which stands far off is rendered as if it stood at the origin. Scenes that stand
//! there already are not touched: their coordinates are rendered as they were written.

use super::desc::SceneDesc;
use crate::math::{DAffine3, DVec3};
use rayon::prelude::*;

/// What is farther from the origin than this many of its radii stands far off. Nothing that is built around its origin is,
/// and two of 24 bits are lost at most.
const FAR: f64 = 2.0;

/// Rounding of the camera's position that shifts the image by less than anyone can see, in radii of the scene.
const CAMERA_ROUNDING: f64 = 1e-6;

/// Smallest and largest corner of the box around the boxes of all objects; `None` without any.
pub(super) fn bounds(desc: &SceneDesc) -> Option<(DVec3, DVec3)> {
    let boxes: Vec<(DVec3, DVec3)> = desc.meshes.par_iter().map(|mesh| mesh.bounds()).collect();
    desc.objects
        .iter()
        .map(|object| transformed_box(boxes[object.mesh], &object.to_world))
        .reduce(|(a, b), (c, d)| (a.min(c), b.max(d)))
}

/// The box around a transformed box.
pub(super) fn transformed_box((lo, hi): (DVec3, DVec3), transform: &DAffine3) -> (DVec3, DVec3) {
    let corners = (0..8).map(|i| {
        let corner = DVec3::select(glam::BVec3::new(i & 1 != 0, i & 2 != 0, i & 4 != 0), hi, lo);
        transform.transform_point3(corner)
    });
    corners.fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(lo, hi), p| {
        (lo.min(p), hi.max(p))
    })
}

/// The middle of a box that stands far from zero, else zero.
pub(super) fn of_box(lo: DVec3, hi: DVec3) -> DVec3 {
    let (middle, radius) = (0.5 * (lo + hi), 0.5 * (hi - lo).length());
    if middle.length() > FAR * radius && middle.is_finite() {
        middle
    } else {
        DVec3::ZERO
    }
}

/// The point that becomes the origin: zero for a scene that stands there anyway; else near its centre, and such that the
/// position of the camera is exact, however far away it is.
pub(super) fn choose(desc: &SceneDesc) -> DVec3 {
    let Some((lo, hi)) = bounds(desc) else {
        return DVec3::ZERO;
    };
    let rounding = |p: DVec3| p - p.as_vec3().as_dvec3();
    let camera = desc.camera.position;
    let middle = of_box(lo, hi);
    let radius = 0.5 * (hi - lo).length();
    let off = rounding(camera - middle);
    if middle == DVec3::ZERO && off.abs().max_element() <= CAMERA_ROUNDING * radius {
        return DVec3::ZERO;
    }
    let origin = middle + off;
    if origin.is_finite() { origin } else { DVec3::ZERO }
}
