//! Rays against triangles, and shading data at a hit.

use embrace::math::DVec3;

/// Rays start and end this far off a surface, in units of its largest coordinate: far below what f32 resolves, far above
/// the rounding of f64.
const OFFSET: f64 = 1.0 / (1u64 << 40) as f64;

/// The cosine to the viewer that a shading normal is left with when it is bent.
const MIN_COS: f64 = 1e-3;

/// The open segment from the origin to `t_max`, along a unit direction.
#[derive(Clone, Copy)]
pub(crate) struct Ray {
    pub(crate) origin: DVec3,
    pub(crate) direction: DVec3,
    pub(crate) t_max: f64,
}

/// Which triangle, as backends name it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct TriangleName {
    pub(crate) placement: u32,
    pub(crate) triangle: u32,
}

/// All triangles of a scene.
pub(crate) struct Geometry(pub(super) Vec<Triangle>);

pub(super) struct Triangle {
    pub(super) name: TriangleName,
    pub(super) corners: [DVec3; 3],
    normals: Option<[DVec3; 3]>,
}

/// Where a ray meets a triangle.
#[derive(Clone, Copy)]
pub(crate) struct Hit {
    pub(crate) name: TriangleName,
    pub(crate) t: f64,
    index: usize,
    /// Barycentric, of the three corners.
    weights: [f64; 3],
}

impl Ray {
    pub(crate) fn at(&self, t: f64) -> DVec3 {
        self.origin + self.direction * t
    }
}

impl Geometry {
    pub(super) fn new(geometry: &embrace::accel::Geometry) -> Geometry {
        let mut triangles = Vec::new();
        for (placement, place) in (0..).zip(&geometry.placements) {
            assert!(place.to_world.is_none(), "the reference has no instances");
            let mesh = &geometry.meshes[place.mesh as usize];
            for (triangle, indices) in (0..).zip(&mesh.indices) {
                let normals = || indices.map(|i| mesh.normals[i as usize].as_dvec3());
                triangles.push(Triangle {
                    name: TriangleName { placement, triangle },
                    corners: geometry.world_triangle(placement, triangle).map(|p| p.as_dvec3()),
                    normals: (!mesh.normals.is_empty()).then(normals),
                });
            }
        }
        Geometry(triangles)
    }

    /// The nearest hit.
    pub(crate) fn intersect(&self, ray: &Ray) -> Option<Hit> {
        self.hits(ray).min_by(|a, b| a.t.total_cmp(&b.t))
    }

    pub(crate) fn occluded(&self, ray: &Ray) -> bool {
        self.hits(ray).next().is_some()
    }

    fn hits(&self, ray: &Ray) -> impl Iterator<Item = Hit> {
        self.planes_met(ray)
            .filter(|hit| hit.t > 0.0 && hit.t < ray.t_max && hit.weights.iter().all(|w| *w >= 0.0))
    }

    /// Where a ray meets the planes of all triangles (Möller and Trumbore 1997).
    fn planes_met(&self, ray: &Ray) -> impl Iterator<Item = Hit> {
        self.0.iter().enumerate().filter_map(|(index, triangle)| {
            let [a, b, c] = triangle.corners;
            let (ab, ac, from_a) = (b - a, c - a, ray.origin - a);
            let determinant = ab.dot(ray.direction.cross(ac));
            let v_times = from_a.cross(ab);
            let weight_b = from_a.dot(ray.direction.cross(ac)) / determinant;
            let weight_c = ray.direction.dot(v_times) / determinant;
            (determinant != 0.0).then(|| Hit {
                name: triangle.name,
                index,
                t: ac.dot(v_times) / determinant,
                weights: [1.0 - weight_b - weight_c, weight_b, weight_c],
            })
        })
    }

    /// Whether a ray passes the border of any triangle, or ends on one, by so little: `tolerance` in units of triangles
    /// and of the ray's length.
    pub(crate) fn grazes_border(&self, ray: &Ray, tolerance: f64) -> bool {
        self.planes_met(ray).any(|hit| {
            let inside = hit.weights.into_iter().fold(f64::INFINITY, f64::min);
            let near_border = inside.abs() < tolerance && hit.t > 0.0 && hit.t < ray.t_max * (1.0 + tolerance);
            let near_end = inside > -tolerance && (hit.t / ray.t_max - 1.0).abs() < tolerance;
            near_border || near_end
        })
    }

    /// The largest coordinate.
    pub(crate) fn reach(&self) -> f64 {
        self.0.iter().map(Triangle::reach).fold(0.0, f64::max)
    }
}

impl Triangle {
    pub(super) fn normal(&self) -> DVec3 {
        self.twice_area().normalize()
    }

    pub(super) fn area(&self) -> f64 {
        0.5 * self.twice_area().length()
    }

    fn twice_area(&self) -> DVec3 {
        let [a, b, c] = self.corners;
        (b - a).cross(c - a)
    }

    fn reach(&self) -> f64 {
        self.corners.iter().map(|p| p.abs().max_element()).fold(0.0, f64::max)
    }

    pub(super) fn offset(&self) -> f64 {
        self.reach() * OFFSET
    }
}

/// What shading needs to know about a hit: src/interaction.rs has the reasons.
pub(super) struct Interaction {
    pub(super) p: DVec3,
    pub(super) wo: DVec3,
    /// Of the triangle, on the side of `wo`.
    pub(super) ng: DVec3,
    pub(super) frame: Frame,
    pub(super) front: bool,
    lift: DVec3,
    offset: f64,
}

impl Interaction {
    pub(super) fn new(geometry: &Geometry, hit: &Hit, wo: DVec3, lifted: bool) -> Interaction {
        let triangle = &geometry.0[hit.index];
        let blend = |values: [DVec3; 3]| {
            values
                .iter()
                .zip(hit.weights)
                .map(|(value, weight)| value * weight)
                .sum()
        };
        let p: DVec3 = blend(triangle.corners);
        let front = wo.dot(triangle.normal()) >= 0.0;
        let side = if front { 1.0 } else { -1.0 };
        let ng = triangle.normal() * side;
        let (mut ns, mut lift) = (ng, DVec3::ZERO);
        if let Some(normals) = triangle.normals {
            let normals = normals.map(|n| n * side);
            ns = blend(normals).normalize();
            if ns.dot(wo) < MIN_COS {
                ns = (ns + wo * (MIN_COS - ns.dot(wo))).normalize();
            }
            if lifted {
                // To the mean of the projections onto the tangent planes of the corners, where those lie above.
                let above = |i: usize| normals[i] * -(p - triangle.corners[i]).dot(normals[i]).min(0.0);
                lift = blend([0, 1, 2].map(above));
            }
        }
        Interaction {
            p,
            wo,
            ng,
            frame: Frame::new(ns),
            front,
            lift,
            offset: triangle.offset(),
        }
    }

    fn origin(&self, transmitted: bool) -> DVec3 {
        if transmitted {
            self.p - self.ng * self.offset
        } else {
            self.p + self.lift + self.ng * self.offset
        }
    }

    pub(super) fn spawn_ray(&self, direction: DVec3, transmitted: bool) -> Ray {
        Ray {
            origin: self.origin(transmitted),
            direction,
            t_max: f64::INFINITY,
        }
    }

    pub(super) fn spawn_ray_to(&self, target: DVec3, transmitted: bool) -> Ray {
        let origin = self.origin(transmitted);
        Ray {
            origin,
            direction: (target - origin).normalize(),
            t_max: (target - origin).length(),
        }
    }
}

/// Local coordinates around a normal (Duff et al. 2017): where its tangents point decides where a sample goes.
pub(super) struct Frame([DVec3; 3]);

impl Frame {
    pub(super) fn normal(&self) -> DVec3 {
        self.0[2]
    }

    fn new(n: DVec3) -> Frame {
        let sign = 1f64.copysign(n.z);
        let a = -1.0 / (sign + n.z);
        let b = n.x * n.y * a;
        Frame([
            DVec3::new(1.0 + sign * n.x * n.x * a, sign * b, -sign * n.x),
            DVec3::new(b, sign + n.y * n.y * a, -n.y),
            n,
        ])
    }

    /// How far the normal is from tangents that point elsewhere.
    pub(super) fn margin(&self) -> f64 {
        self.0[2].z.abs()
    }

    pub(super) fn to_local(&self, v: DVec3) -> DVec3 {
        DVec3::from(self.0.map(|axis| axis.dot(v)))
    }

    pub(super) fn to_world(&self, v: DVec3) -> DVec3 {
        self.0[0] * v.x + self.0[1] * v.y + self.0[2] * v.z
    }
}
