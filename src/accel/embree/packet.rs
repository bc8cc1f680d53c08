//! Sixteen rays at a time: what Embree traces together, it fetches its tree once for.

use super::{Accel, Embree, Hit, INVALID_ID, Ray, ffi, is_traceable, open_ends, placement, query};

/// Rays in a packet.
const WIDTH: usize = 16;

/// Which lanes hold a ray: -1, the others 0. Aligned as Embree reads it.
#[repr(align(64))]
pub(super) struct Lanes(pub(super) [i32; WIDTH]);

/// Fills the lanes of a packet; the segment of each ray is what `ends` says.
#[inline]
fn fill(packet: &mut ffi::RTCRay16, rays: &[Ray], ends: impl Fn(&Ray) -> (f32, f32)) -> Lanes {
    let mut valid = Lanes([0; WIDTH]);
    for (i, ray) in rays.iter().enumerate() {
        let (t_min, t_max) = ends(ray);
        [packet.org_x[i], packet.org_y[i], packet.org_z[i]] = ray.origin.to_array();
        [packet.dir_x[i], packet.dir_y[i], packet.dir_z[i]] = ray.direction.to_array();
        packet.tnear[i] = t_min;
        packet.tfar[i] = t_max;
        valid.0[i] = -i32::from(is_traceable(ray, t_min, t_max));
    }
    packet.mask = [u32::MAX; WIDTH];
    valid
}

/// The nearest hits of rays that go much the same way.
pub(super) fn intersect(embree: &Embree, rays: &[Ray], hits: &mut Vec<Option<Hit>>) {
    for rays in rays.chunks(WIDTH) {
        let mut packet = ffi::RTCRayHit16::default();
        packet.hit.geomID = [INVALID_ID; WIDTH];
        packet.hit.instID = [[INVALID_ID; WIDTH]; _];
        let valid = fill(&mut packet.ray, rays, |ray| (ray.t_min, ray.t_max));
        // SAFETY: the scene was committed in `build`, and nothing changes it after that.
        unsafe { query::intersect16(embree.scene.handle, &valid, &mut packet) };
        hits.extend(rays.iter().enumerate().map(|(i, ray)| {
            if packet.hit.geomID[i] == INVALID_ID {
                return None;
            }
            let t = packet.ray.tfar[i];
            if t > ray.t_min && t < ray.t_max {
                return Some(Hit {
                    t,
                    placement: placement(packet.hit.geomID[i], packet.hit.instID[0][i]),
                    triangle: packet.hit.primID[i],
                    u: packet.hit.u[i],
                    v: packet.hit.v[i],
                });
            }
            // At an end of the segment: rare, and the single query knows what to do.
            embree.intersect(ray)
        }));
    }
}

/// Whether the rays hit anything.
pub(super) fn occluded(embree: &Embree, rays: &[Ray], occluded: &mut Vec<bool>) {
    for rays in rays.chunks(WIDTH) {
        let mut packet = ffi::RTCRay16::default();
        let valid = fill(&mut packet, rays, open_ends);
        // SAFETY: the scene was committed in `build`, and nothing changes it after that.
        unsafe { query::occluded16(embree.scene.handle, &valid, &mut packet) };
        let lanes = valid.0.iter().zip(packet.tfar).take(rays.len());
        occluded.extend(lanes.map(|(valid, t)| *valid != 0 && t == f32::NEG_INFINITY));
    }
}
