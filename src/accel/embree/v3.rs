//! Single-ray queries of Embree 3, which takes a context beside the ray.

use super::ffi;

/// Single rays that have little to do with each other, without a filter and outside of any instance.
fn context() -> ffi::RTCIntersectContext {
    let mut context = ffi::RTCIntersectContext {
        flags: ffi::RTCIntersectContextFlags::RTC_INTERSECT_CONTEXT_FLAG_INCOHERENT,
        filter: None,
        ..Default::default()
    };
    context.instID.fill(super::INVALID_ID);
    context
}

/// Finds the nearest hit.
///
/// # Safety
/// `scene` is a committed scene that is not being changed.
#[inline]
pub(super) unsafe fn intersect1(scene: ffi::RTCScene, ray_hit: &mut ffi::RTCRayHit) {
    // SAFETY: the caller answers for the scene; the context and the ray live until the call returns.
    unsafe { ffi::rtcIntersect1(scene, &mut context(), ray_hit) }
}

/// Finds any hit.
///
/// # Safety
/// `scene` is a committed scene that is not being changed.
#[inline]
pub(super) unsafe fn occluded1(scene: ffi::RTCScene, ray: &mut ffi::RTCRay) {
    // SAFETY: as for `intersect1`.
    unsafe { ffi::rtcOccluded1(scene, &mut context(), ray) }
}
