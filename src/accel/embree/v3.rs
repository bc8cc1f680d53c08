//! Queries of Embree 3, which takes a context beside the rays.

use super::ffi;

/// Without a filter and outside of any instance.
fn context(flags: ffi::RTCIntersectContextFlags) -> ffi::RTCIntersectContext {
    let mut context = ffi::RTCIntersectContext {
        flags,
        filter: None,
        ..Default::default()
    };
    context.instID.fill(super::INVALID_ID);
    context
}

/// Rays that have little to do with each other.
const INCOHERENT: ffi::RTCIntersectContextFlags = ffi::RTCIntersectContextFlags::RTC_INTERSECT_CONTEXT_FLAG_INCOHERENT;

/// Rays that go much the same way.
const COHERENT: ffi::RTCIntersectContextFlags = ffi::RTCIntersectContextFlags::RTC_INTERSECT_CONTEXT_FLAG_COHERENT;

/// Finds the nearest hit.
///
/// # Safety
/// `scene` is a committed scene that is not being changed.
#[inline]
pub(super) unsafe fn intersect1(scene: ffi::RTCScene, ray_hit: &mut ffi::RTCRayHit) {
    // SAFETY: the caller answers for the scene; the context and the ray live until the call returns.
    unsafe { ffi::rtcIntersect1(scene, &mut context(INCOHERENT), ray_hit) }
}

/// Finds any hit.
///
/// # Safety
/// `scene` is a committed scene that is not being changed.
#[inline]
pub(super) unsafe fn occluded1(scene: ffi::RTCScene, ray: &mut ffi::RTCRay) {
    // SAFETY: as for `intersect1`.
    unsafe { ffi::rtcOccluded1(scene, &mut context(INCOHERENT), ray) }
}

/// Finds the nearest hits of coherent rays, of those whose lane in `valid` is -1.
///
/// # Safety
/// `scene` is a committed scene that is not being changed.
#[inline]
pub(super) unsafe fn intersect16(scene: ffi::RTCScene, valid: &super::packet::Lanes, rays: &mut ffi::RTCRayHit16) {
    // SAFETY: the caller answers for the scene; all else lives until the call returns and is aligned by its type.
    unsafe { ffi::rtcIntersect16(valid.0.as_ptr(), scene, &mut context(COHERENT), rays) }
}

/// Finds any hits of the rays whose lane in `valid` is -1.
///
/// # Safety
/// `scene` is a committed scene that is not being changed.
#[inline]
pub(super) unsafe fn occluded16(scene: ffi::RTCScene, valid: &super::packet::Lanes, rays: &mut ffi::RTCRay16) {
    // SAFETY: as for `intersect16`.
    unsafe { ffi::rtcOccluded16(valid.0.as_ptr(), scene, &mut context(INCOHERENT), rays) }
}
