//! What a description says that rendering cannot honour: 32-bit coordinates and directions have their limits, and two
//! lamps in one place do not add up.

use super::desc::{ObjectDesc, SceneDesc};
use super::origin;
use crate::accel::triangle::LARGEST_COORDINATE;
use crate::math::{DAffine3, DVec3};
use crate::mesh::TriangleMesh;
use rayon::prelude::*;
use std::collections::HashSet;

/// A triangle is lost if its longest side has fewer steps of f32 than this.
const LEAST_STEPS: f64 = 16.0;

/// Share of a mesh's triangles that may be lost before a warning is due: scans have some.
const LOST_SHARE: f64 = 0.01;

/// A sentence for everything that will not be shown as it is described.
pub(super) fn of(desc: &SceneDesc) -> Vec<String> {
    let to_rendering = DAffine3::from_translation(-origin::choose(desc));
    let sizes: Vec<Size> = desc.meshes.par_iter().map(|mesh| Size::of(mesh)).collect();
    let mut lamps = HashSet::new();
    let mut warnings = Vec::new();
    for object in &desc.objects {
        let mesh = &desc.meshes[object.mesh];
        let to_rendering = to_rendering * object.to_world;
        let size = &sizes[object.mesh];
        let far = far_triangles(mesh, size, &to_rendering);
        if far > 0 {
            warnings.push(format!(
                "{}: {far} of {} triangles have a corner beyond {LARGEST_COORDINATE:e} and are not shown",
                object.name,
                mesh.indices.len()
            ));
        }
        let doubled = doubled_lamps(mesh, object, &mut lamps);
        if doubled > 0 {
            warnings.push(format!(
                "{}: {doubled} emitting triangles are in the place of others; their light is counted more than once",
                object.name
            ));
        }
        let lost = lost_triangles(mesh, size, &to_rendering);
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

/// Triangles that no ray can hit.
fn far_triangles(mesh: &TriangleMesh<DVec3>, size: &Size, to_rendering: &DAffine3) -> usize {
    let is_far = |p: DVec3| p.abs().max_element() > f64::from(LARGEST_COORDINATE);
    let (lo, hi) = origin::transformed_box(size.bounds, to_rendering);
    // What does not even fit f32 is an error on building.
    let fits = lo.as_vec3().is_finite() && hi.as_vec3().is_finite();
    if !fits || !is_far(lo) && !is_far(hi) {
        return 0;
    }
    let far: Vec<bool> = mesh
        .positions
        .iter()
        .map(|p| is_far(to_rendering.transform_point3(*p)))
        .collect();
    let is_lost = |corners: &&[u32; 3]| corners.iter().any(|&i| far[i as usize]);
    mesh.indices.iter().filter(is_lost).count()
}

/// The longest side of a triangle, measured along the axes.
fn longest_side([a, b, c]: [DVec3; 3]) -> f64 {
    let [ab, ac, bc] = [b - a, c - a, c - b].map(DVec3::abs);
    ab.max(ac).max(bc).max_element()
}

/// What is to know of a mesh before all of its triangles are looked at for each object.
struct Size {
    bounds: (DVec3, DVec3),
    /// The longest side of the smallest triangle that has one; infinite without any.
    finest: f64,
}

impl Size {
    fn of(mesh: &TriangleMesh<DVec3>) -> Size {
        Size {
            bounds: mesh.bounds(),
            finest: mesh
                .indices
                .par_iter()
                .map(|corners| longest_side(corners.map(|i| mesh.positions[i as usize])))
                .filter(|side| *side > 0.0)
                .reduce(|| f64::INFINITY, f64::min),
        }
    }
}

/// Triangles that have an extent, but hardly one in f32.
fn lost_triangles(mesh: &TriangleMesh<DVec3>, size: &Size, to_rendering: &DAffine3) -> usize {
    let least = |magnitude: f64| LEAST_STEPS * 0.5 * f64::from(f32::EPSILON) * magnitude;
    let (lo, hi) = origin::transformed_box(size.bounds, to_rendering);
    // A transform shrinks lengths at most by its determinant over the square of its largest stretch.
    let m = to_rendering.matrix3;
    let stretch = (m.x_axis.length_squared() + m.y_axis.length_squared() + m.z_axis.length_squared()).sqrt();
    let shrunk = size.finest * m.determinant().abs() / stretch.powi(2);
    if shrunk > least(lo.abs().max(hi.abs()).max_element()) * 3f64.sqrt() {
        return 0;
    }
    mesh.indices
        .par_iter()
        .filter(|corners| {
            let corners = corners.map(|i| to_rendering.transform_point3(mesh.positions[i as usize]));
            let side = longest_side(corners);
            side > 0.0 && side < least(corners[0].abs().max_element())
        })
        .count()
}

/// Emitting triangles with the same corners as one in `lamps`, to which all are added. The nearest hit shows one of them,
/// but light is sampled from each.
fn doubled_lamps(mesh: &TriangleMesh<DVec3>, object: &ObjectDesc, lamps: &mut HashSet<[[u64; 3]; 3]>) -> usize {
    if object.emission.is_none() {
        return 0;
    }
    let is_doubled = |corners: &&[u32; 3]| {
        let mut place = corners.map(|i| {
            let p = object.to_world.transform_point3(mesh.positions[i as usize]);
            p.to_array().map(f64::to_bits)
        });
        place.sort_unstable();
        !lamps.insert(place)
    };
    mesh.indices.iter().filter(is_doubled).count()
}
