//! The reference: every ray against every triangle.

use super::triangle::{self, Corners, TriangleRay};
use super::{Accel, AccelError, BuildOptions, Geometry, Hit, Intersector, Ray};

/// All triangles in world coordinates, without any hierarchy. For tests and for scenes of a few triangles.
pub struct Brute {
    triangles: Vec<BruteTriangle>,
}

struct BruteTriangle {
    corners: Corners,
    placement: u32,
    triangle: u32,
}

impl Accel for Brute {
    const NAME: &'static str = "brute";
    const INTERSECTORS: &'static [Intersector] = &[Intersector::Robust];

    fn build(geometry: &Geometry, _options: BuildOptions) -> Result<Brute, AccelError> {
        let mut triangles = Vec::new();
        for (placement, mesh) in geometry.placements.iter().map(|p| p.mesh).enumerate() {
            for triangle in 0..geometry.meshes[mesh as usize].indices.len() {
                let (placement, triangle) = (placement as u32, triangle as u32);
                let corners = geometry.world_triangle(placement, triangle);
                if triangle::can_be_hit(&corners) {
                    triangles.push(BruteTriangle {
                        corners: corners.into(),
                        placement,
                        triangle,
                    });
                }
            }
        }
        Ok(Brute { triangles })
    }

    fn intersect(&self, ray: &Ray) -> Option<Hit> {
        let prepared = TriangleRay::new(ray)?;
        let mut nearest = None;
        let mut t_max = ray.t_max;
        for triangle in &self.triangles {
            if let Some(hit) = prepared.intersect(&triangle.corners, t_max) {
                t_max = hit.t;
                nearest = Some(Hit {
                    t: hit.t,
                    placement: triangle.placement,
                    triangle: triangle.triangle,
                    u: hit.u,
                    v: hit.v,
                });
            }
        }
        nearest
    }

    fn occluded(&self, ray: &Ray) -> bool {
        TriangleRay::new(ray).is_some_and(|prepared| {
            self.triangles
                .iter()
                .any(|triangle| prepared.intersect(&triangle.corners, ray.t_max).is_some())
        })
    }

    fn memory_bytes(&self) -> usize {
        size_of_val(&*self.triangles)
    }

    fn version() -> String {
        env!("CARGO_PKG_VERSION").to_owned()
    }
}
