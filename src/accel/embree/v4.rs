//! Queries of Embree 4, whose default arguments are incoherent rays without a filter.

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

/// Finds the nearest hits of coherent rays, of those whose lane in `valid` is -1.
///
/// # Safety
/// `scene` is a committed scene that is not being changed.
#[inline]
pub(super) unsafe fn intersect16(scene: ffi::RTCScene, valid: &super::packet::Lanes, rays: &mut ffi::RTCRayHit16) {
    let mut arguments = ffi::RTCIntersectArguments {
        flags: ffi::RTCRayQueryFlags::RTC_RAY_QUERY_FLAG_COHERENT,
        feature_mask: ffi::RTCFeatureFlags::RTC_FEATURE_FLAG_ALL,
        ..Default::default()
    };
    // SAFETY: the caller answers for the scene; all else lives until the call returns and is aligned by its type.
    unsafe { ffi::rtcIntersect16(valid.0.as_ptr(), scene, rays, &mut arguments) }
}

/// Finds any hits of the rays whose lane in `valid` is -1.
///
/// # Safety
/// `scene` is a committed scene that is not being changed.
#[inline]
pub(super) unsafe fn occluded16(scene: ffi::RTCScene, valid: &super::packet::Lanes, rays: &mut ffi::RTCRay16) {
    // SAFETY: as for `intersect16`; null stands for the defaults.
    unsafe { ffi::rtcOccluded16(valid.0.as_ptr(), scene, rays, ptr::null_mut()) }
}
