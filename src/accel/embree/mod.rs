//! Ray queries by Intel Embree 3 or 4, whichever header `build.rs` found.
//!
//! Placements without a transform are triangle geometries of the top scene; the others are instances of one scene per
//! mesh. In both cases Embree's id on the top level is the index of the placement.
//!
//! Embree promises nothing at the ends of a segment (its triangle test counts a hit at `tfar`, and rounding may put one
//! at `tnear`), so the open interval is enforced here.

use super::list::TriangleList;
use super::triangle::LARGEST_COORDINATE;
use super::{Accel, AccelError, BuildOptions, BuildQuality, Geometry, Hit, Intersector, Ray};
use crate::math::Vec3;
use crate::mesh::TriangleMesh;
use glam::{Affine3A, Vec4};
use rayon::prelude::*;
use std::ffi::{CStr, CString, c_char, c_void};
use std::ptr;
use std::sync::atomic::{AtomicIsize, Ordering};
use std::sync::{Arc, Mutex, OnceLock, PoisonError};

mod ffi;
mod packet;
#[cfg(target_os = "linux")]
mod pages;
#[cfg(embree_major = "3")]
mod v3;
#[cfg(embree_major = "3")]
use v3 as query;
#[cfg(embree_major = "4")]
mod v4;
#[cfg(embree_major = "4")]
use v4 as query;

/// `RTC_INVALID_GEOMETRY_ID`, a macro that bindings cannot express.
const INVALID_ID: u32 = u32::MAX;

/// Bytes of a tree from which on large pages are asked for: those of a few large pages.
#[cfg(target_os = "linux")]
const LEAST_FOR_LARGE_PAGES: isize = 8 << 20;

/// What Embree's callbacks write. Shared with the library by address.
#[derive(Default)]
struct Monitor {
    /// Bytes held by the library for this device.
    bytes: AtomicIsize,
    /// The first error since the last check.
    error: Mutex<Option<String>>,
}

/// Called by Embree, on any thread, for every allocation (positive) and release (negative).
unsafe extern "C" fn on_memory(monitor: *mut c_void, bytes: isize, _post: bool) -> bool {
    // SAFETY: the pointer was made from the `Arc<Monitor>` that outlives the device; only `&Monitor` are ever made.
    let monitor = unsafe { &*monitor.cast::<Monitor>() };
    monitor.bytes.fetch_add(bytes, Ordering::Relaxed);
    true
}

/// Called by Embree, on any thread, when a call fails.
unsafe extern "C" fn on_error(monitor: *mut c_void, code: ffi::RTCError, text: *const c_char) {
    // SAFETY: as in `on_memory`.
    let monitor = unsafe { &*monitor.cast::<Monitor>() };
    let text = if text.is_null() {
        "no message".into()
    } else {
        // SAFETY: Embree passes a zero-terminated string that lives until this function returns.
        unsafe { CStr::from_ptr(text) }.to_string_lossy()
    };
    // Not even a poisoned lock may panic here: unwinding into C aborts.
    let mut first = monitor.error.lock().unwrap_or_else(PoisonError::into_inner);
    first.get_or_insert_with(|| format!("{text} ({})", error_name(code)));
}

fn error_name(code: ffi::RTCError) -> &'static str {
    match code {
        ffi::RTCError::RTC_ERROR_INVALID_ARGUMENT => "invalid argument",
        ffi::RTCError::RTC_ERROR_INVALID_OPERATION => "invalid operation",
        ffi::RTCError::RTC_ERROR_OUT_OF_MEMORY => "out of memory",
        ffi::RTCError::RTC_ERROR_UNSUPPORTED_CPU => "unsupported processor",
        ffi::RTCError::RTC_ERROR_CANCELLED => "cancelled",
        _ => "unknown error",
    }
}

fn build_quality(quality: BuildQuality) -> ffi::RTCBuildQuality {
    match quality {
        BuildQuality::Low => ffi::RTCBuildQuality::RTC_BUILD_QUALITY_LOW,
        BuildQuality::List | BuildQuality::Medium => ffi::RTCBuildQuality::RTC_BUILD_QUALITY_MEDIUM,
        BuildQuality::High => ffi::RTCBuildQuality::RTC_BUILD_QUALITY_HIGH,
    }
}

fn library_error(message: String) -> AccelError {
    AccelError::Library {
        library: format!("Embree {}", Embree::version()),
        message,
    }
}

/// Version of the loaded library, or that of the header if no device can be made.
fn loaded_version() -> String {
    // SAFETY: a zero-terminated string that lives until the call returns.
    let device = unsafe { ffi::rtcNewDevice(c"threads=1".as_ptr()) };
    if device.is_null() {
        return ffi::RTC_VERSION_STRING.to_string_lossy().into_owned();
    }
    let parts = [
        ffi::RTCDeviceProperty::RTC_DEVICE_PROPERTY_VERSION_MAJOR,
        ffi::RTCDeviceProperty::RTC_DEVICE_PROPERTY_VERSION_MINOR,
        ffi::RTCDeviceProperty::RTC_DEVICE_PROPERTY_VERSION_PATCH,
    ];
    // SAFETY: the device is valid.
    let parts = parts.map(|part| unsafe { ffi::rtcGetDeviceProperty(device, part) }.to_string());
    // SAFETY: the handle is ours and released once.
    unsafe { ffi::rtcReleaseDevice(device) };
    parts.join(".")
}

/// A device: Embree's context of threads, memory and errors.
struct Device {
    handle: ffi::RTCDevice,
    /// Behind an `Arc` because Embree holds its address, which must survive moves of the device.
    monitor: Arc<Monitor>,
}

// SAFETY: Embree's API may be called from any thread, and the handle is reference-counted atomically.
unsafe impl Send for Device {}
// SAFETY: shared use is `check` and the creation of objects, which Embree allows from several threads at once.
unsafe impl Sync for Device {}

impl Device {
    fn new() -> Result<Arc<Device>, AccelError> {
        // Embree's own threads, of which the caller of a build is one: ours would join, but find little to do there
        // (docs/performance.md). They sleep while rays are traced.
        let threads = rayon::current_num_threads();
        let config = CString::new(format!("threads={threads}")).map_err(|error| library_error(error.to_string()))?;
        // SAFETY: a zero-terminated string that lives until the call returns.
        let handle = unsafe { ffi::rtcNewDevice(config.as_ptr()) };
        if handle.is_null() {
            // SAFETY: a null device asks for the error of this thread.
            let code = unsafe { ffi::rtcGetDeviceError(ptr::null_mut()) };
            return Err(library_error(format!("no device could be made: {}", error_name(code))));
        }
        let device = Device {
            handle,
            monitor: Arc::new(Monitor::default()),
        };
        let monitor = Arc::as_ptr(&device.monitor).cast_mut().cast::<c_void>();
        // SAFETY: the device is valid; `Device` releases it before it drops the monitor that the callbacks use.
        unsafe {
            ffi::rtcSetDeviceErrorFunction(handle, Some(on_error), monitor);
            ffi::rtcSetDeviceMemoryMonitorFunction(handle, Some(on_memory), monitor);
        }
        device.require_version_of_header()?;
        Ok(Arc::new(device))
    }

    /// Structures such as the hit record differ between minor versions: a library of another one would write past ours.
    fn require_version_of_header(&self) -> Result<(), AccelError> {
        let property = |name| {
            // SAFETY: the device is valid.
            unsafe { ffi::rtcGetDeviceProperty(self.handle, name) as u32 }
        };
        let loaded = (
            property(ffi::RTCDeviceProperty::RTC_DEVICE_PROPERTY_VERSION_MAJOR),
            property(ffi::RTCDeviceProperty::RTC_DEVICE_PROPERTY_VERSION_MINOR),
        );
        let compiled = (ffi::RTC_VERSION_MAJOR, ffi::RTC_VERSION_MINOR);
        if loaded != compiled {
            return Err(library_error(format!(
                "this program was built for version {}.{} of the library, but version {}.{} was loaded; \
                 rebuild it, or put the other library on the loader's path",
                compiled.0, compiled.1, loaded.0, loaded.1
            )));
        }
        self.check()
    }

    /// The first error since the last check, on whatever thread it happened.
    fn check(&self) -> Result<(), AccelError> {
        let error = self.monitor.error.lock().unwrap_or_else(PoisonError::into_inner).take();
        error.map_or(Ok(()), |message| Err(library_error(message)))
    }
}

impl Drop for Device {
    fn drop(&mut self) {
        // SAFETY: the handle is ours and released once. Scenes hold an `Arc` of this device, so it is the last user; the
        // monitor is dropped after this.
        unsafe { ffi::rtcReleaseDevice(self.handle) }
    }
}

/// A geometry that is ready to be attached. Scenes keep their own reference.
struct GeometryHandle {
    handle: ffi::RTCGeometry,
    device: Arc<Device>,
}

impl GeometryHandle {
    fn new(device: &Arc<Device>, kind: ffi::RTCGeometryType) -> Result<GeometryHandle, AccelError> {
        // SAFETY: the device is valid.
        let handle = unsafe { ffi::rtcNewGeometry(device.handle, kind) };
        device.check()?;
        if handle.is_null() {
            return Err(library_error("no geometry could be made".to_owned()));
        }
        let device = Arc::clone(device);
        Ok(GeometryHandle { handle, device })
    }

    /// # Safety
    /// The index buffer is shared: `mesh` must outlive every scene that the geometry is attached to.
    unsafe fn triangles(
        device: &Arc<Device>,
        mesh: &TriangleMesh,
        quality: BuildQuality,
    ) -> Result<GeometryHandle, AccelError> {
        let vertices = mesh.positions.len();
        // Embree reads vertices by index without a check while it traces.
        assert!(
            mesh.indices
                .par_iter()
                .all(|corners| corners.iter().all(|&i| (i as usize) < vertices)),
            "the mesh was not validated"
        );
        let geometry = GeometryHandle::new(device, ffi::RTCGeometryType::RTC_GEOMETRY_TYPE_TRIANGLE)?;
        // The vertices are copied: Embree loads 16 bytes at each of the 12-byte positions, past the end of our array.
        // SAFETY: the geometry is valid.
        let buffer = unsafe {
            ffi::rtcSetNewGeometryBuffer(
                geometry.handle,
                ffi::RTCBufferType::RTC_BUFFER_TYPE_VERTEX,
                0,
                ffi::RTCFormat::RTC_FORMAT_FLOAT3,
                size_of::<[f32; 3]>(),
                vertices,
            )
        };
        device.check()?;
        if buffer.is_null() {
            return Err(library_error("no vertex buffer could be made".to_owned()));
        }
        // SAFETY: the buffer has room for `vertices` positions of three floats, which is what `Vec3` is; Embree aligns it
        // to 16 bytes or more, and nobody else has a pointer to it.
        unsafe { ptr::copy_nonoverlapping(mesh.positions.as_ptr(), buffer.cast(), vertices) };
        // SAFETY: the array holds `len` triples of `u32`, and lives and stays unchanged as long as the geometry by the
        // caller's promise.
        unsafe {
            ffi::rtcSetSharedGeometryBuffer(
                geometry.handle,
                ffi::RTCBufferType::RTC_BUFFER_TYPE_INDEX,
                0,
                ffi::RTCFormat::RTC_FORMAT_UINT3,
                mesh.indices.as_ptr().cast(),
                0,
                size_of::<[u32; 3]>(),
                mesh.indices.len(),
            );
        }
        // SAFETY: the geometry is valid.
        unsafe { ffi::rtcSetGeometryBuildQuality(geometry.handle, build_quality(quality)) };
        geometry.commit()?;
        Ok(geometry)
    }

    fn instance(device: &Arc<Device>, scene: &Scene, to_world: &Affine3A) -> Result<GeometryHandle, AccelError> {
        let geometry = GeometryHandle::new(device, ffi::RTCGeometryType::RTC_GEOMETRY_TYPE_INSTANCE)?;
        let columns = to_world.to_cols_array();
        // SAFETY: both handles are valid, the geometry takes its own reference to the scene, and the matrix of 12 floats
        // is copied before the call returns.
        unsafe {
            ffi::rtcSetGeometryInstancedScene(geometry.handle, scene.handle);
            ffi::rtcSetGeometryTransform(
                geometry.handle,
                0,
                ffi::RTCFormat::RTC_FORMAT_FLOAT3X4_COLUMN_MAJOR,
                columns.as_ptr().cast(),
            );
        }
        geometry.commit()?;
        Ok(geometry)
    }

    fn commit(&self) -> Result<(), AccelError> {
        // SAFETY: the geometry is valid. The mask is set because its default is all ones in Embree 3 and 1 in Embree 4.
        unsafe {
            ffi::rtcSetGeometryMask(self.handle, u32::MAX);
            ffi::rtcCommitGeometry(self.handle);
        }
        self.device.check()
    }
}

impl Drop for GeometryHandle {
    fn drop(&mut self) {
        // SAFETY: the handle is ours and released once.
        unsafe { ffi::rtcReleaseGeometry(self.handle) }
    }
}

/// A scene, which keeps its device alive.
struct Scene {
    handle: ffi::RTCScene,
    device: Arc<Device>,
}

// SAFETY: Embree's API may be called from any thread, and the handle is reference-counted atomically.
unsafe impl Send for Scene {}
// SAFETY: through `&Scene` a scene is only traced, which does not change it. Attaching and building need `&mut Scene`.
unsafe impl Sync for Scene {}

impl Scene {
    fn new(device: &Arc<Device>, options: BuildOptions) -> Result<Scene, AccelError> {
        // SAFETY: the device is valid.
        let handle = unsafe { ffi::rtcNewScene(device.handle) };
        device.check()?;
        if handle.is_null() {
            return Err(library_error("no scene could be made".to_owned()));
        }
        let scene = Scene {
            handle,
            device: Arc::clone(device),
        };
        // SAFETY: the scene is valid.
        unsafe { ffi::rtcSetSceneBuildQuality(handle, build_quality(options.quality)) };
        let mut flags = ffi::RTCSceneFlags::RTC_SCENE_FLAG_NONE;
        if options.intersector == Intersector::Robust {
            flags.0 |= ffi::RTCSceneFlags::RTC_SCENE_FLAG_ROBUST.0;
        }
        if options.quality == BuildQuality::Low {
            // Without copies of the vertices in the leaves: writing these takes longer than few rays save by them.
            flags.0 |= ffi::RTCSceneFlags::RTC_SCENE_FLAG_COMPACT.0;
        }
        // SAFETY: the scene is valid.
        unsafe { ffi::rtcSetSceneFlags(handle, flags) };
        device.check()?;
        Ok(scene)
    }

    fn attach(&mut self, geometry: &GeometryHandle, id: u32) -> Result<(), AccelError> {
        // SAFETY: both handles are valid; the scene takes its own reference.
        unsafe { ffi::rtcAttachGeometryByID(self.handle, geometry.handle, id) };
        self.device.check()
    }

    /// Builds the hierarchy on Embree's threads.
    fn commit(&mut self) -> Result<(), AccelError> {
        // SAFETY: the scene is valid, and nothing else uses it during the call.
        unsafe { ffi::rtcCommitScene(self.handle) };
        self.device.check()
    }
}

impl Drop for Scene {
    fn drop(&mut self) {
        // SAFETY: the handle is ours and released once, before the device.
        unsafe { ffi::rtcReleaseScene(self.handle) }
    }
}

/// The Embree backend.
pub struct Embree {
    /// Holds the instanced scenes through its geometries.
    scene: Scene,
    /// For [`BuildQuality::List`].
    list: Option<TriangleList>,
    /// Their index arrays are in use by the scene, which is declared first and therefore dropped first.
    _meshes: Vec<Arc<TriangleMesh>>,
}

impl Embree {
    /// The distance that Embree itself finds, infinite if nothing is hit: one call, without a look at the ends of the segment.
    /// What benches compare [`Accel::intersect`] with.
    #[inline]
    pub fn distance_unchecked(&self, ray: &Ray) -> f32 {
        let query = Embree::query_ray(ray, ray.t_min, ray.t_max);
        query.map_or(f32::INFINITY, |ray| self.query(ray).ray.tfar)
    }

    /// One call of Embree.
    #[inline(always)]
    fn query(&self, ray: ffi::RTCRay) -> ffi::RTCRayHit {
        let mut query = ffi::RTCRayHit {
            ray,
            ..Default::default()
        };
        query.hit.geomID = INVALID_ID;
        query.hit.instID = [INVALID_ID; _];
        // SAFETY: the scene was committed in `build`, and nothing changes it after that.
        unsafe { query::intersect1(self.scene.handle, &mut query) };
        query
    }

    /// The ray as Embree wants it; `None` if it can hit nothing (an empty segment) or is not a number.
    #[inline]
    fn query_ray(ray: &Ray, t_min: f32, t_max: f32) -> Option<ffi::RTCRay> {
        // Whole vectors: Embree reads these sixteen bytes at a time, which must not wait for four small stores.
        let lanes = [
            ray.origin.extend(t_min),
            ray.direction.extend(0.0),
            Vec4::new(t_max, f32::from_bits(u32::MAX), 0.0, 0.0),
        ];
        // SAFETY: `RTCRay` is twelve words (asserted below) of plain numbers, in this order: origin and tnear, direction
        // and time, tfar, mask (all ones), id and flags (zero). Every bit pattern is a valid value of each.
        is_traceable(ray, t_min, t_max).then(|| unsafe { std::mem::transmute::<[Vec4; 3], ffi::RTCRay>(lanes) })
    }
}

/// Whether a ray is made of numbers, starts where Embree can compute, and has an inside. Beyond its limit Embree hits
/// nothing, and a library built with assertions, as Debian's is, ends the process.
#[inline]
fn is_traceable(ray: &Ray, t_min: f32, t_max: f32) -> bool {
    let is_within = |v: Vec3| v.abs().cmple(Vec3::splat(LARGEST_COORDINATE)).all();
    is_within(ray.origin) && is_within(ray.direction) && t_min < t_max
}

/// The ends of the segment for an any-hit query: Embree may count hits at the ends, the trait does not, and there is no
/// distance to look at. Both ends move inwards by more than the rounding of Embree's comparisons.
#[inline]
fn open_ends(ray: &Ray) -> (f32, f32) {
    const ROUNDING: f32 = 4.0 * f32::EPSILON;
    (
        (ray.t_min * (1.0 + ROUNDING)).max(f32::MIN_POSITIVE),
        ray.t_max * (1.0 - ROUNDING),
    )
}

/// Embree's ids of a hit as ours: the top level's is the index of the placement.
#[inline]
fn placement(geometry: u32, instance: u32) -> u32 {
    if instance == INVALID_ID { geometry } else { instance }
}

const _: () = assert!(size_of::<ffi::RTCRay>() == size_of::<[Vec4; 3]>());

impl Accel for Embree {
    const NAME: &'static str = "embree";
    const INTERSECTORS: &'static [Intersector] = &[Intersector::Robust, Intersector::Fast];

    fn build(geometry: &Geometry, options: BuildOptions) -> Result<Embree, AccelError> {
        let device = Device::new()?;
        let mut top = Scene::new(&device, options)?;
        let mut instanced: Vec<Option<Scene>> = geometry.meshes.iter().map(|_| None).collect();
        for (id, placement) in geometry.placements.iter().enumerate() {
            let mesh = &geometry.meshes[placement.mesh as usize];
            if mesh.indices.is_empty() {
                continue;
            }
            // SAFETY: `Embree` keeps all meshes until its scene is gone; after an error, `geometry` outlives the scenes.
            let triangles = || unsafe { GeometryHandle::triangles(&device, mesh, options.quality) };
            let handle = match &placement.to_world {
                None => triangles()?,
                Some(to_world) => {
                    let slot = &mut instanced[placement.mesh as usize];
                    let scene = match slot {
                        Some(scene) => scene,
                        None => {
                            let mut scene = Scene::new(&device, options)?;
                            scene.attach(&triangles()?, 0)?;
                            scene.commit()?;
                            slot.insert(scene)
                        }
                    };
                    GeometryHandle::instance(&device, scene, to_world)?
                }
            };
            top.attach(&handle, id as u32)?;
        }
        top.commit()?;
        // A tree that is built in a hurry is for few rays, and a small one stays in the caches.
        #[cfg(target_os = "linux")]
        if options.quality != BuildQuality::Low && device.monitor.bytes.load(Ordering::Relaxed) > LEAST_FOR_LARGE_PAGES
        {
            pages::enlarge();
        }
        Ok(Embree {
            scene: top,
            list: TriangleList::if_wanted(geometry, options),
            _meshes: geometry.meshes.clone(),
        })
    }

    #[inline(always)]
    fn intersect(&self, ray: &Ray) -> Option<Hit> {
        let mut start = Embree::query_ray(ray, ray.t_min, ray.t_max)?;
        loop {
            let query = self.query(start);
            let t = query.ray.tfar;
            if query.hit.geomID == INVALID_ID || t >= ray.t_max || !t.is_finite() {
                return None;
            }
            if t > ray.t_min {
                return Some(Hit {
                    t,
                    placement: placement(query.hit.geomID, query.hit.instID[0]),
                    triangle: query.hit.primID,
                    u: query.hit.u,
                    v: query.hit.v,
                });
            }
            // Embree compares before it divides, and the division rounded the hit onto t_min: look behind it. From 0
            // on in large steps, because products with the smallest numbers vanish in Embree's comparison.
            start.tnear = if ray.t_min > 0.0 {
                start.tnear.next_up()
            } else {
                (start.tnear * 16.0).max(f32::MIN_POSITIVE)
            };
        }
    }

    #[inline]
    fn occluded(&self, ray: &Ray) -> bool {
        let (t_min, t_max) = open_ends(ray);
        let Some(mut query) = Embree::query_ray(ray, t_min, t_max) else {
            return false;
        };
        // SAFETY: the scene was committed in `build`, and nothing changes it after that.
        unsafe { query::occluded1(self.scene.handle, &mut query) };
        query.tfar == f32::NEG_INFINITY
    }

    fn intersect_coherent(&self, rays: &[Ray], hits: &mut Vec<Option<Hit>>) {
        packet::intersect(self, rays, hits);
    }

    fn occluded_many(&self, rays: &[Ray], occluded: &mut Vec<bool>) {
        packet::occluded(self, rays, occluded);
    }

    fn list(&self) -> Option<&TriangleList> {
        self.list.as_ref()
    }

    fn memory_bytes(&self) -> usize {
        let bytes = self.scene.device.monitor.bytes.load(Ordering::Relaxed);
        usize::try_from(bytes).unwrap_or(0) + self.list.as_ref().map_or(0, TriangleList::memory_bytes)
    }

    fn version() -> String {
        // Asked of the library once, because the header need only agree with it in major and minor version.
        static VERSION: OnceLock<String> = OnceLock::new();
        VERSION.get_or_init(loaded_version).clone()
    }
}
