//! Single-ray queries of Embree 4, whose default arguments are incoherent rays without a filter.

use super::ffi;
use std::ptr;

/// Finds the nearest hit.
///
/// # Safety
/// `scene` is a committed scene that is not being changed.
#[inline]
pub(super) unsafe fn intersect1(scene: ffi::RTCScene, ray_hit: &mut ffi::RTCRayHit) {
    // SAFETY: the caller answers for the scene; the ray lives until the call returns; null stands for the defaults.
    unsafe { ffi::rtcIntersect1(scene, ray_hit, ptr::null_mut()) }
}

/// Finds any hit.
///
/// # Safety
/// `scene` is a committed scene that is not being changed.
#[inline]
pub(super) unsafe fn occluded1(scene: ffi::RTCScene, ray: &mut ffi::RTCRay) {
    // SAFETY: as for `intersect1`.
    unsafe { ffi::rtcOccluded1(scene, ray, ptr::null_mut()) }
}
