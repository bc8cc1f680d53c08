//! The choice between emitting triangles and points by what they contribute at a point: a tree of clusters of them.
//!
//! After Conty Estevez and Kulla 2018, "Importance Sampling of Many Lights with Adaptive Tree Splitting". At each node a
//! child is drawn in proportion to an estimate of the irradiance that it brings without occlusion,
//!
//! Σ L A · cos at the emitter · cos at the receiver / distance²,     (1)
//!
//! down to a single emitter; the probability of that is the product along the way. Two things differ from the paper:
//! - Nodes have eight children in structure-of-arrays form. The estimate is straight-line arithmetic on all eight at once,
//!   and a million triangles are seven steps away.
//! - The cosines are means, not bounds. A bound gives a sphere of triangles, half of which face away and most of the others
//!   askew, four times the share of one lamp of the same power that faces the receiver. The mean of max(0, cos) over the
//!   normals of a cluster is (E cos + E |cos|) / 2 with E |cos| ≤ √E cos²: from the first and second moments of the normals
//!   along one axis, exact for planes, 15 % high for spheres.
//!
//! Bounds decide when a child gets exactly 0, and only then: it is below the receiver's horizon, or all of it faces away,
//! rounding included. Every emitter that can contribute is therefore drawn at times. Where no child of a node can
//! contribute, nothing is drawn.
//!
//! A point is a cluster without extent whose normals go all ways, and a narrow spot one with a single normal whose light ends
//! before a right angle to it; L A is then what makes equation (1) its intensity over squared distance.

use crate::math::Vec3;

mod build;

pub(super) use build::{Leaf, Profile};

/// Children of a node.
const WIDTH: usize = 8;

/// Rounding of places relative to the root and of unit vectors, per distance: eight ulps.
const ROUNDING: f32 = 1.0 / 1_048_576.0;

/// Sine up to which the normals of a cluster are those of one plane.
const PARALLEL: f32 = 1e-6;

/// Least mean cosine at the emitter of a cluster that may face the receiver.
const LEAST_COS: f32 = 0.01;

/// Least squared distance to a cluster, in squared radii. Triangles near the receiver count most, and are nearer than the
/// centre: 1 was twice as noisy among lamps that stand around the receiver. Less than 0.1 changes nothing.
const LEAST_DISTANCE2: f32 = 0.1;

/// Mean cosine at the receiver of a cluster that its horizon cuts in half, over the sine of the angle that it subtends.
const HALF_UP: f32 = 0.4;

/// Farthest place of a receiver that is told apart from others in its direction, in sizes of the root.
const FARTHEST: f32 = 1e8;

/// Bit of a child's name that says it is an emitter; the rest is its index, or that of a node.
const LEAF: u32 = 1 << 31;

/// Rounding of the cosine between two unit vectors.
const COS_ROUNDING: f32 = 1e-6;

/// Eight children. Places are relative to the root's and in units of its size; without children, the mass is 0.
#[derive(Clone, Copy, Debug)]
#[repr(align(64))]
struct Node {
    center: [[f32; WIDTH]; 3],
    /// Of a sphere around the centre that holds all emitters.
    radius: [f32; WIDTH],
    /// Unit vector that normals are measured along.
    axis: [[f32; WIDTH]; 3],
    /// Mean of the cosine between axis and normal, and of its square.
    mean_cos: [f32; WIDTH],
    mean_cos2: [f32; WIDTH],
    /// Of the largest angle between the axis and a normal; 2 from a right angle on. Light goes as far as a right angle beyond;
    /// negative where it does not go as far: minus the cosine of the largest angle to the axis.
    sin_spread: [f32; WIDTH],
    /// Σ L A, both sides counted where both emit, over the largest in this node.
    mass: [f32; WIDTH],
    child: [u32; WIDTH],
}

/// Where light arrives.
struct Receiver {
    p: [f32; 3],
    n: [f32; 3],
    /// 1 if it takes light from both sides.
    both: f32,
    rounding: f32,
}

/// The importance of a node's children, their running sum, and the sum of all.
struct Shares {
    importance: [f32; WIDTH],
    before: [f64; WIDTH],
    total: f64,
}

/// What the importance of a child depends on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Mode {
    /// Equation (1).
    Place,
    /// The same; there are emitters whose light ends before a right angle to their axis.
    Cones,
    /// Mass alone: it was asked for, or it is one lamp.
    Power,
}

/// A tree of emitters.
#[derive(Clone, Debug)]
pub(super) struct LightTree {
    /// The root first.
    nodes: Vec<Node>,
    /// By node: the slot that it fills, as eight times the node above plus the child.
    parents: Vec<u32>,
    /// By emitter: the slot that it fills; `u32::MAX` for one without power.
    slots: Vec<u32>,
    origin: Vec3,
    /// One over the root's size.
    scale: f32,
    /// Irradiance [W·m⁻²] that a sum of importance at the root stands for.
    irradiance: f64,
    mode: Mode,
}

/// Steps from the root to an emitter, at most.
const MAX_DEPTH: usize = 32;

#[inline(always)]
fn max(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}

#[inline(always)]
fn min(a: f32, b: f32) -> f32 {
    if a < b { a } else { b }
}

impl Node {
    /// Equation (1) for each child. `CONES`: whether there may be negative spreads.
    #[inline(always)]
    fn importance<const CONES: bool>(&self, at: &Receiver) -> [f32; WIDTH] {
        let mut importance = [0.0; WIDTH];
        #[allow(clippy::needless_range_loop, reason = "a child is read in many columns at once")]
        for i in 0..WIDTH {
            let v = [0, 1, 2].map(|k| self.center[k][i] - at.p[k]);
            let dot = |a: [f32; 3], b: [f32; 3]| a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
            let radius = self.radius[i] + at.rounding;
            let radius2 = radius * radius;
            let d2 = dot(v, v);
            let inv_d = 1.0 / max(d2, 1e-30).sqrt();
            let axis = [0, 1, 2].map(|k| self.axis[k][i]);
            let cos_emitter = -dot(v, axis) * inv_d;
            let cos_receiver = dot(v, at.n) * inv_d + at.both;

            // Sine of the angle that the cluster subtends, and square of its cosine.
            let sin = min(radius * inv_d, 1.0);
            let cos2 = 1.0 - sin * sin;
            // The mean over a sphere that the horizon may cut; 0 only below it.
            let receiver = max(cos_receiver, HALF_UP * (cos_receiver + sin));
            // The mean over all normals; from close by, the direction that they are seen from is any.
            let mean = self.mean_cos[i] * cos_emitter * cos2;
            let aside = 0.5 * (1.0 - self.mean_cos2[i]);
            let mean2 = aside + (self.mean_cos2[i] - aside) * cos_emitter * cos_emitter;
            let mean2 = mean2 * cos2 + (1.0 - cos2) * (1.0 / 3.0);
            let emitter = max(0.5 * (mean + mean2.sqrt()), LEAST_COS);

            // Planes have no thickness: how far apart their points are does not matter to which side is seen.
            let spread = self.sin_spread[i];
            let planar = if CONES {
                spread.abs() < PARALLEL
            } else {
                spread < PARALLEL
            };
            let sin_thick = if planar { at.rounding * inv_d } else { sin };
            // A bound on the sine of how far beyond a right angle light goes. Sines of a sum are at most their sum, but not
            // those of a difference unless it is negative.
            let beyond = spread + sin_thick;
            let near_cone = CONES & (spread < 0.0) & (beyond > 0.0);
            let beyond = if near_cone { sin_thick + COS_ROUNDING } else { beyond };
            let away = cos_emitter < -beyond;
            let never = away | (receiver <= 0.0) | (self.mass[i] <= 0.0);
            let value = self.mass[i] * emitter * receiver / max(d2, LEAST_DISTANCE2 * radius2);
            importance[i] = if never { 0.0 } else { max(value, f32::MIN_POSITIVE) };
        }
        importance
    }
}

impl Shares {
    /// In f64: a child of 1e-12 of the sum has its share, too.
    #[inline(always)]
    fn new(importance: [f32; WIDTH]) -> Shares {
        let w = importance.map(f64::from);
        let (w01, w23, w45, w67) = (w[0] + w[1], w[2] + w[3], w[4] + w[5], w[6] + w[7]);
        let w0123 = w01 + w23;
        let w012345 = w0123 + w45;
        Shares {
            importance,
            before: [0.0, w[0], w01, w01 + w[2], w0123, w0123 + w[4], w012345, w012345 + w[6]],
            total: w0123 + (w45 + w67),
        }
    }

    /// The probability of a child.
    #[inline(always)]
    fn pmf(&self, child: usize) -> f64 {
        f64::from(self.importance[child]) / self.total
    }

    /// The child that a number in [0, 1) falls on, and its place there.
    #[inline(always)]
    fn choose(&self, u: f64) -> (usize, f64) {
        let at = u * self.total;
        let mut child = 0;
        for i in 1..WIDTH {
            child += usize::from(self.before[i] <= at);
        }
        // Children of no importance end where they begin; rounding may leave the last of them.
        while self.importance[child] == 0.0 {
            child -= 1;
        }
        let u = (at - self.before[child]) / f64::from(self.importance[child]);
        (child, u.clamp(0.0, 1.0f64.next_down()))
    }
}

impl LightTree {
    /// The scale of a receiver's surroundings: importance is computed relative to the root.
    #[inline(always)]
    fn receiver(&self, p: Vec3, n: Vec3) -> Receiver {
        let p = (p - self.origin) * self.scale;
        // What has overflowed becomes a number, and what squares would lets the direction be.
        let p = p.to_array().map(|x| max(-1e38, min(x, 1e38)));
        let farthest = max(max(p[0].abs(), p[1].abs()), p[2].abs());
        let nearer = FARTHEST / max(farthest, FARTHEST);
        let (p, farthest) = (p.map(|x| x * nearer), min(farthest, FARTHEST));
        Receiver {
            p,
            n: n.to_array(),
            both: f32::from(n == Vec3::ZERO),
            rounding: ROUNDING * (1.0 + farthest),
        }
    }

    #[inline(always)]
    fn shares(&self, node: u32, at: &Receiver) -> Shares {
        let node = &self.nodes[node as usize];
        Shares::new(match self.mode {
            Mode::Place => node.importance::<false>(at),
            Mode::Cones => node.importance::<true>(at),
            Mode::Power => node.mass,
        })
    }

    /// Looks at the tree from the point `p` of a surface with the unit normal `n`, or with none if it takes light from both
    /// sides.
    #[inline(always)]
    pub(super) fn visit(&self, p: Vec3, n: Vec3) -> Visit<'_> {
        let at = self.receiver(p, n);
        Visit {
            tree: self,
            root: self.shares(0, &at),
            at,
        }
    }

    /// Bytes held.
    pub(super) fn memory_bytes(&self) -> usize {
        size_of_val(&*self.nodes) + size_of_val(&*self.parents) + size_of_val(&*self.slots)
    }
}

/// The tree as seen from a point.
pub(super) struct Visit<'a> {
    tree: &'a LightTree,
    at: Receiver,
    root: Shares,
}

impl Visit<'_> {
    /// Estimated irradiance by all emitters, without occlusion [W·m⁻²]: luminance.
    #[inline(always)]
    pub(super) fn irradiance(&self) -> f32 {
        (self.root.total * self.tree.irradiance) as f32
    }

    /// Draws an emitter by `u` in [0, 1): its index and probability. `None` where nothing can contribute.
    #[inline(always)]
    pub(super) fn choose(&self, u: f64) -> Option<(u32, f32)> {
        if self.root.total <= 0.0 {
            return None;
        }
        let (slot, mut u) = self.root.choose(u);
        let mut pmf = self.root.pmf(slot);
        let mut child = self.tree.nodes[0].child[slot];
        while child & LEAF == 0 {
            let shares = self.tree.shares(child, &self.at);
            if shares.total <= 0.0 {
                return None;
            }
            let slot;
            (slot, u) = shares.choose(u);
            pmf *= shares.pmf(slot);
            child = self.tree.nodes[child as usize].child[slot];
        }
        Some((child & !LEAF, pmf as f32))
    }

    /// The probability with which [`Visit::choose`] draws an emitter: the same bits.
    #[inline(always)]
    pub(super) fn pmf(&self, emitter: u32) -> f32 {
        let mut slot = self.tree.slots[emitter as usize];
        if slot == u32::MAX || self.root.total <= 0.0 {
            return 0.0;
        }
        // Upwards, then multiplied downwards as in choosing.
        let mut way = [0; MAX_DEPTH];
        let mut steps = 0;
        while slot as usize >= WIDTH {
            way[steps] = slot;
            steps += 1;
            slot = self.tree.parents[slot as usize / WIDTH];
        }
        let mut pmf = self.root.pmf(slot as usize);
        for slot in way[..steps].iter().rev() {
            let shares = self.tree.shares(slot / WIDTH as u32, &self.at);
            if shares.total <= 0.0 {
                return 0.0;
            }
            pmf *= shares.pmf(*slot as usize % WIDTH);
        }
        pmf as f32
    }
}
