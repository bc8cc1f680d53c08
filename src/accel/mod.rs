//! Ray queries: one trait, implemented by Embree, by obvhs and by a brute-force reference.
//!
//! A backend only finds triangles. Positions, normals, texture coordinates and ray offsets are computed from our own
//! vertices in [`crate::interaction`], so that every backend shades alike.

use crate::math::Vec3;
use crate::mesh::TriangleMesh;
use glam::Affine3A;
use list::TriangleList;
use prefetch_index::prefetch_index;
use std::sync::Arc;
use thiserror::Error;

pub mod brute;
#[cfg(feature = "embree")]
#[allow(unsafe_code, reason = "Embree FFI")]
pub mod embree;
pub mod list;
#[cfg(feature = "obvhs")]
pub mod obvhs;
pub mod triangle;

/// A ray segment: the open interval (`t_min`, `t_max`) along a unit direction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ray {
    /// Start point, in world coordinates; from beyond [`triangle::LARGEST_COORDINATE`] a backend may hit nothing.
    pub origin: Vec3,
    /// Unit direction.
    pub direction: Vec3,
    /// Hits at or before this distance do not count; 0 or more. Usually 0: origins are already off their surface.
    pub t_min: f32,
    /// Hits at or beyond this distance do not count; may be infinite.
    pub t_max: f32,
}

impl Ray {
    /// An unbounded ray from its origin on.
    pub fn new(origin: Vec3, direction: Vec3) -> Ray {
        Ray {
            origin,
            direction,
            t_min: 0.0,
            t_max: f32::INFINITY,
        }
    }
}

/// The nearest intersection of a ray.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// Distance along the ray.
    pub t: f32,
    /// Index into [`Geometry::placements`].
    pub placement: u32,
    /// Index of the triangle in its mesh.
    pub triangle: u32,
    /// Barycentric weight of the second corner.
    pub u: f32,
    /// Barycentric weight of the third corner.
    pub v: f32,
}

/// A mesh standing somewhere in the world.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Placement {
    /// Index into [`Geometry::meshes`].
    pub mesh: u32,
    /// Mesh to world coordinates; invertible. `None`: the mesh is in world coordinates already.
    pub to_world: Option<Affine3A>,
}

/// What a backend is built from. Placements with a transform share one acceleration structure per mesh.
#[derive(Clone, Debug, Default)]
pub struct Geometry {
    /// Validated meshes.
    pub meshes: Vec<Arc<TriangleMesh>>,
    /// Where they stand; a hit names one of these.
    pub placements: Vec<Placement>,
}

impl Geometry {
    /// The corners of the triangle of a hit, as indices into its mesh.
    #[inline(always)]
    pub fn corners(&self, hit: &Hit) -> [u32; 3] {
        let placement = &self.placements[hit.placement as usize];
        self.meshes[placement.mesh as usize].indices[hit.triangle as usize]
    }

    /// Asks for the memory that [`Geometry::corners`] reads.
    #[inline(always)]
    pub fn prefetch_corners(&self, hit: &Hit) {
        let placement = &self.placements[hit.placement as usize];
        prefetch_index(&self.meshes[placement.mesh as usize].indices, hit.triangle as usize);
    }

    /// Asks for the vertices of a triangle of a placement.
    #[inline(always)]
    pub fn prefetch_vertices(&self, placement: u32, corners: [u32; 3]) {
        let mesh = &*self.meshes[self.placements[placement as usize].mesh as usize];
        for i in corners.map(|i| i as usize) {
            prefetch_index(&mesh.positions, i);
            if !mesh.normals.is_empty() {
                prefetch_index(&mesh.normals, i);
            }
            if !mesh.uvs.is_empty() {
                prefetch_index(&mesh.uvs, i);
            }
        }
    }

    /// World-space corners of a triangle of a placement: the one place where instance vertices are transformed.
    #[inline]
    pub fn world_triangle(&self, placement: u32, triangle: u32) -> [Vec3; 3] {
        let placement = &self.placements[placement as usize];
        let corners = self.meshes[placement.mesh as usize].triangle(triangle as usize);
        match &placement.to_world {
            None => corners,
            Some(to_world) => corners.map(|p| to_world.transform_point3(p)),
        }
    }

    /// Smallest and largest corner of the world-space box around everything; `None` without any placement.
    pub fn bounds(&self) -> Option<(Vec3, Vec3)> {
        let mut bounds: Option<(Vec3, Vec3)> = None;
        for placement in &self.placements {
            let mesh = &self.meshes[placement.mesh as usize];
            let (lo, hi) = match &placement.to_world {
                None => mesh.bounds(),
                Some(to_world) => mesh
                    .positions
                    .iter()
                    .map(|p| to_world.transform_point3(*p))
                    .fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(lo, hi), p| {
                        (lo.min(p), hi.max(p))
                    }),
            };
            bounds = Some(bounds.map_or((lo, hi), |(a, b)| (a.min(lo), b.max(hi))));
        }
        bounds
    }
}

/// How closely a backend looks at the edges of triangles and boxes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Intersector {
    /// Rays do not slip through between neighbours.
    #[default]
    Robust,
    /// The fastest test of the library, which lets some rays through at edges and corners.
    Fast,
}

/// How much time goes into the structure, so that rays take less.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum BuildQuality {
    /// A medium tree, and beside it a list of all triangles, which serves bounces and shadow rays ([`Accel::list`]). For
    /// scenes of a few triangles, and for robust intersectors: a fast one has no list.
    List,
    /// Sorted along a curve: the fastest to build.
    Low,
    /// By the surface-area heuristic.
    #[default]
    Medium,
    /// With all that the library offers; for some intersectors no more than medium.
    High,
}

impl BuildQuality {
    /// A list where triangles are few, and low where paths are: a triangle saves more time in a low tree than a path of a few
    /// rays loses (docs/performance.md).
    pub fn for_paths(paths: u64, triangles: u64, intersector: Intersector) -> BuildQuality {
        if triangles <= MOST_LISTED && intersector == Intersector::Robust {
            BuildQuality::List
        } else if paths < triangles {
            BuildQuality::Low
        } else {
            BuildQuality::Medium
        }
    }
}

/// Most triangles of a scene in which a list is faster than a tree (docs/performance.md).
const MOST_LISTED: u64 = 64;

/// How to build.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct BuildOptions {
    /// Must be one of [`Accel::INTERSECTORS`].
    pub intersector: Intersector,
    /// Changes nothing that is found, but which of two triangles at the same distance.
    pub quality: BuildQuality,
}

/// Why a backend could not be built.
#[derive(Debug, Error)]
pub enum AccelError {
    /// The ray-tracing library failed.
    #[error("{library}: {message}")]
    Library {
        /// Name and version of the library.
        library: String,
        /// What it said.
        message: String,
    },
}

/// Closest-hit and any-hit queries over triangles. A backend is built once and then read by all threads.
pub trait Accel: Sized + Send + Sync {
    /// The name on the command line.
    const NAME: &'static str;

    /// What there is to choose from.
    const INTERSECTORS: &'static [Intersector];

    /// Builds the structure on as many threads as the current rayon pool has.
    ///
    /// # Errors
    /// Only when the library behind the backend fails (out of memory, wrong version). Empty geometry is no error.
    fn build(geometry: &Geometry, options: BuildOptions) -> Result<Self, AccelError>;

    /// The nearest hit in the open interval of the ray, of either side of a triangle.
    fn intersect(&self, ray: &Ray) -> Option<Hit>;

    /// Whether anything is hit in the open interval of the ray.
    fn occluded(&self, ray: &Ray) -> bool;

    /// Appends [`Accel::intersect`] of each ray, for up to 16 rays that go much the same way, as a camera's do. A backend
    /// may trace them together, and then pick another one of two triangles at the same distance than for a ray alone.
    fn intersect_coherent(&self, rays: &[Ray], hits: &mut Vec<Option<Hit>>) {
        hits.extend(rays.iter().map(|ray| self.intersect(ray)));
    }

    /// Appends [`Accel::occluded`] of each ray. A backend may trace neighbours in the list together, which must not change
    /// the answer.
    fn occluded_many(&self, rays: &[Ray], occluded: &mut Vec<bool>) {
        occluded.extend(rays.iter().map(|ray| self.occluded(ray)));
    }

    /// All triangles, if that is the faster way to trace rays that have nothing in common, several together.
    fn list(&self) -> Option<&TriangleList> {
        None
    }

    /// Bytes of the acceleration structure, as far as the library tells.
    fn memory_bytes(&self) -> usize;

    /// Version of the library in use.
    fn version() -> String;
}
