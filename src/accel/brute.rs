//! The reference: every ray against every triangle.

use super::list::TriangleList;
use super::triangle::TriangleRay;
use super::{Accel, AccelError, BuildOptions, Geometry, Hit, Intersector, Ray};

/// All triangles in world coordinates, without any hierarchy. For tests.
pub struct Brute {
    list: TriangleList,
}

impl Accel for Brute {
    const NAME: &'static str = "brute";
    const INTERSECTORS: &'static [Intersector] = &[Intersector::Robust];

    fn build(geometry: &Geometry, _options: BuildOptions) -> Result<Brute, AccelError> {
        let list = TriangleList::new(geometry);
        Ok(Brute { list })
    }

    fn intersect(&self, ray: &Ray) -> Option<Hit> {
        let prepared = TriangleRay::new(ray)?;
        let mut nearest = None;
        let mut t_max = ray.t_max;
        for triangle in self.list.triangles() {
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
            let mut triangles = self.list.triangles().iter();
            triangles.any(|triangle| prepared.intersect(&triangle.corners, ray.t_max).is_some())
        })
    }

    fn list(&self) -> Option<&TriangleList> {
        Some(&self.list)
    }

    fn memory_bytes(&self) -> usize {
        self.list.memory_bytes()
    }

    fn version() -> String {
        env!("CARGO_PKG_VERSION").to_owned()
    }
}
