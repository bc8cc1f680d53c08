//! Where the coordinates of rendering have their origin, and what they cannot hold.
//!
//! Rendering computes in f32, whose steps grow with the distance from the origin. A description keeps f64; on building,
//! everything is moved so that a scene which stands far off is rendered as if it stood at the origin. Scenes that stand
//! there already are not touched: their coordinates are rendered as they were written.

use super::desc::SceneDesc;
use crate::math::{DAffine3, DVec3};
use crate::mesh::TriangleMesh;
use rayon::prelude::*;

/// What is farther from the origin than this many of its radii stands far off. Nothing that is built around its origin is,
/// and two of 24 bits are lost at most.
const FAR: f64 = 2.0;

/// Rounding of the camera's position that shifts the image by less than anyone can see, in radii of the scene.
const CAMERA_ROUNDING: f64 = 1e-6;

/// A triangle is lost if its longest side has fewer steps of f32 than this.
const LEAST_STEPS: f64 = 16.0;

/// Share of a mesh's triangles that may be lost before a warning is due: scans have some.
const LOST_SHARE: f64 = 0.01;

/// Smallest and largest corner of the box around the boxes of all objects; `None` without any.
pub(super) fn bounds(desc: &SceneDesc) -> Option<(DVec3, DVec3)> {
    let boxes: Vec<(DVec3, DVec3)> = desc.meshes.par_iter().map(|mesh| mesh.bounds()).collect();
    desc.objects
        .iter()
        .map(|object| {
            let (lo, hi) = boxes[object.mesh];
            transformed_box(lo, hi, &object.to_world)
        })
        .reduce(|(a, b), (c, d)| (a.min(c), b.max(d)))
}

fn transformed_box(lo: DVec3, hi: DVec3, transform: &DAffine3) -> (DVec3, DVec3) {
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

/// A sentence for everything that f32 cannot hold although the description does.
pub(super) fn warnings(desc: &SceneDesc) -> Vec<String> {
    let to_rendering = DAffine3::from_translation(-choose(desc));
    let mut warnings = Vec::new();
    for object in &desc.objects {
        let mesh = &desc.meshes[object.mesh];
        let lost = lost_triangles(mesh, &(to_rendering * object.to_world));
        if lost as f64 > LOST_SHARE * mesh.indices.len() as f64 {
            warnings.push(format!(
                "{}: {lost} of {} triangles are smaller than {LEAST_STEPS} steps of the 32-bit coordinates that far from \
                 the middle of the scene, and will be distorted; make the mesh larger, or the scene smaller",
                object.name,
                mesh.indices.len()
            ));
        }
    }
    let camera = &desc.camera;
    let pixel = 2.0 * (camera.vfov_degrees.to_radians() * 0.5).tan() / f64::from(camera.resolution[1].max(1));
    // Two directions are told apart at a few steps of their largest component, which is near 1.
    if pixel < 4.0 * f64::from(f32::EPSILON) {
        warnings.push(format!(
            "camera.vfov: a pixel spans {pixel:.1e} radians, finer than 32-bit directions; neighbours will look alike: \
             move the camera nearer and widen the angle"
        ));
    }
    warnings
}

/// Triangles that have an extent, but hardly one in f32.
fn lost_triangles(mesh: &TriangleMesh<DVec3>, to_rendering: &DAffine3) -> usize {
    let step = f64::from(f32::EPSILON) * 0.5;
    let stretch = to_rendering.matrix3;
    mesh.indices
        .par_iter()
        .filter(|corners| {
            let [a, b, c] = corners.map(|i| mesh.positions[i as usize]);
            let side = [b - a, c - a, c - b]
                .into_iter()
                .map(|edge| (stretch * edge).abs().max_element())
                .fold(0.0, f64::max);
            let magnitude = to_rendering.transform_point3(a).abs().max_element();
            side > 0.0 && side < LEAST_STEPS * step * magnitude
        })
        .count()
}
