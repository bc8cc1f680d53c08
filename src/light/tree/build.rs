//! Building the tree, level by level: every node halves its emitters until it has eight parts, each time so that mass ×
//! spread of normals × squared diagonal becomes least (after Conty Estevez and Kulla 2018). The nodes of a level are built
//! by as many threads as there are; the result does not depend on them.

use super::{LEAF, LightTree, MAX_DEPTH, Mode, Node, PARALLEL, WIDTH};
use crate::math::{DVec3, Vec3};
use rayon::prelude::*;
use std::f64::consts::PI;

/// Bins of a split along one axis.
const BINS: usize = 16;

/// Emitters up to which every split is tried, and not only those between bins.
const SWEPT: usize = 64;

/// Level from which on halves have equal numbers, so that the depth has a limit: 2³² emitters are another 11 levels.
const BALANCED_LEVEL: usize = MAX_DEPTH - 12;

/// Share of the disc around it from which on a plane of few triangles is one lamp, and not several.
const LAMP_SHARE: f64 = 0.2;

/// Where to an emitter sends its light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(in crate::light) enum Profile {
    /// To the side of the normal, by the cosine: a triangle.
    Front,
    /// To both sides, by the cosine: a triangle.
    BothSides,
    /// By the cosine, too, but only within this angle of the normal [rad], less than a right one.
    Narrow(f32),
    /// In all directions within this angle of the normal [rad] alike.
    Wide(f32),
    /// In all directions alike.
    Sphere,
}

/// An emitting triangle, or a point.
#[derive(Clone, Copy, Debug)]
pub(in crate::light) struct Leaf {
    pub(in crate::light) index: u32,
    /// All the same for a point.
    pub(in crate::light) corners: [Vec3; 3],
    pub(in crate::light) normal: Vec3,
    pub(in crate::light) profile: Profile,
    /// Luminance of the radiance × area, of both sides if both emit; of a point, what brings as much.
    pub(in crate::light) mass: f64,
}

/// A leaf relative to the root.
#[derive(Clone, Copy, Debug)]
struct Item {
    center: Vec3,
    /// Of a sphere around the centre that holds it.
    radius: f32,
    normal: Vec3,
    profile: Profile,
    index: u32,
    /// Over the largest.
    mass: f32,
}

impl Profile {
    /// Whether there is an axis to it.
    fn is_directed(self) -> bool {
        !matches!(self, Profile::BothSides | Profile::Sphere)
    }

    fn is_cone(self) -> bool {
        matches!(self, Profile::Narrow(_) | Profile::Wide(_))
    }
}

impl LightTree {
    /// Builds the tree of `leaves`, whose masses are positive, out of `emitters` in all. `None` if there are none.
    /// `is_alone`: whether there is nothing but these, so that what one lamp brings need not be known. `by_power`: whether
    /// places do not count. `least_size`: what the root is taken for at least, so that distances from a single point are some
    /// number of it.
    pub(in crate::light) fn new(
        leaves: &[Leaf],
        emitters: usize,
        is_alone: bool,
        by_power: bool,
        least_size: f64,
    ) -> Option<LightTree> {
        let largest = leaves.iter().map(|leaf| leaf.mass).fold(0.0, f64::max);
        let corners = || leaves.iter().flat_map(|leaf| leaf.corners);
        let lo = corners().fold(Vec3::INFINITY, Vec3::min).as_dvec3();
        let hi = corners().fold(Vec3::NEG_INFINITY, Vec3::max).as_dvec3();
        let origin = (0.5 * (lo + hi)).as_vec3();
        // A power of two, so that scaling is exact; and within the range of f32.
        let size = (0.5 * (hi - lo).max_element()).max(least_size);
        let scale = (-size.log2().ceil()).clamp(-126.0, 100.0).exp2();
        let mut items: Vec<Item> = leaves
            .par_iter()
            .map(|leaf| {
                let corners = leaf.corners.map(|c| (c.as_dvec3() - origin.as_dvec3()) * scale);
                let center = ((corners[0] + corners[1] + corners[2]) / 3.0).as_vec3();
                let reach = |c: DVec3| c.distance(center.as_dvec3()) as f32;
                Item {
                    center,
                    radius: corners.map(reach).into_iter().fold(0.0, f32::max) * (1.0 + 1e-6),
                    normal: leaf.normal,
                    profile: leaf.profile,
                    index: leaf.index,
                    mass: (leaf.mass / largest) as f32,
                }
            })
            .filter(|item| item.mass > 0.0)
            .collect();
        if items.is_empty() {
            return None;
        }
        let root = Summary::of(&items);
        let has_cones = items.iter().any(|item| item.profile.is_cone());
        let mut tree = LightTree {
            nodes: Vec::new(),
            parents: Vec::new(),
            slots: vec![u32::MAX; emitters],
            origin,
            scale: scale as f32,
            irradiance: 0.0,
            mode: match (by_power, has_cones) {
                (true, _) => Mode::Power,
                (false, true) => Mode::Cones,
                (false, false) => Mode::Place,
            },
        };
        tree.build_levels(&mut items);
        tree.irradiance = largest * scale * scale * heaviest_child(&tree.nodes[0], root.mass);
        if is_alone && tree.nodes.len() == 1 && root.sin_spread.abs() < PARALLEL {
            let area: f64 = leaves.iter().map(Leaf::area).sum();
            if area > LAMP_SHARE * PI * (f64::from(root.radius) / scale).powi(2) {
                tree.mode = Mode::Power;
            }
        }
        Some(tree)
    }

    fn build_levels(&mut self, items: &mut [Item]) {
        let mut level = vec![(u32::MAX, items)];
        for depth in 0.. {
            let built: Vec<(u32, Node, Vec<&mut [Item]>)> = level
                .into_par_iter()
                .map(|(parent, items)| {
                    let parts = parts(items, depth);
                    (parent, Node::of(&parts), parts)
                })
                .collect();
            level = Vec::new();
            let next = self.nodes.len() + built.len();
            for (parent, mut node, parts) in built {
                let name = self.nodes.len();
                for (i, part) in parts.into_iter().enumerate() {
                    let slot = (name * WIDTH + i) as u32;
                    if let [item] = part {
                        node.child[i] = item.index | LEAF;
                        self.slots[item.index as usize] = slot;
                    } else {
                        node.child[i] = (next + level.len()) as u32;
                        level.push((slot, part));
                    }
                }
                self.nodes.push(node);
                self.parents.push(parent);
            }
            if level.is_empty() {
                return;
            }
        }
    }
}

/// Mass of the child that the masses of the root are relative to, given that of the root.
fn heaviest_child(root: &Node, mass: f64) -> f64 {
    mass / root.mass.iter().copied().map(f64::from).sum::<f64>()
}

impl Leaf {
    fn area(&self) -> f64 {
        let [a, b, c] = self.corners.map(|c| c.as_dvec3());
        0.5 * (b - a).cross(c - a).length()
    }
}

impl Node {
    /// The node of up to eight sets of items, without the names of its children.
    fn of(parts: &[&mut [Item]]) -> Node {
        let mut node = Node {
            center: [[0.0; WIDTH]; 3],
            radius: [0.0; WIDTH],
            axis: [[0.0; WIDTH]; 3],
            mean_cos: [0.0; WIDTH],
            mean_cos2: [0.0; WIDTH],
            sin_spread: [0.0; WIDTH],
            mass: [0.0; WIDTH],
            child: [LEAF; WIDTH],
        };
        let summaries: Vec<Summary> = parts.iter().map(|items| Summary::of(items)).collect();
        let heaviest = summaries.iter().map(|s| s.mass).fold(0.0, f64::max);
        for (i, summary) in summaries.iter().enumerate() {
            for k in 0..3 {
                node.center[k][i] = summary.center[k];
                node.axis[k][i] = summary.axis[k];
            }
            node.radius[i] = summary.radius;
            node.mean_cos[i] = summary.mean_cos;
            node.mean_cos2[i] = summary.mean_cos2;
            node.sin_spread[i] = summary.sin_spread;
            node.mass[i] = ((summary.mass / heaviest) as f32).max(f32::MIN_POSITIVE);
        }
        node
    }
}

/// What a node knows of a child.
struct Summary {
    center: Vec3,
    radius: f32,
    axis: Vec3,
    mean_cos: f32,
    mean_cos2: f32,
    sin_spread: f32,
    mass: f64,
}

impl Summary {
    fn of(items: &[Item]) -> Summary {
        let (mut mass, mut center, mut normal) = (0.0, DVec3::ZERO, DVec3::ZERO);
        for item in items {
            let m = f64::from(item.mass);
            mass += m;
            center += item.center.as_dvec3() * m;
            if item.profile.is_directed() {
                normal += item.normal.as_dvec3() * m;
            }
        }
        let center = (center / mass).as_vec3();
        // Where normals cancel, any of them is as good an axis.
        let axis = if normal.length() > 1e-3 * mass {
            normal.normalize().as_vec3()
        } else {
            items[0].normal
        };
        let (mut cos, mut cos2, mut spread) = (0.0, 0.0, f64::NEG_INFINITY);
        let (mut radius, mut thickness) = (0.0f32, 0.0f32);
        let mut has_cones = false;
        for item in items {
            let m = f64::from(item.mass);
            let n = item.normal.as_dvec3();
            let c = n.dot(axis.as_dvec3()).clamp(-1.0, 1.0);
            match item.profile {
                Profile::Front | Profile::Narrow(_) => {
                    cos += m * c;
                    cos2 += m * c * c;
                }
                Profile::BothSides => cos2 += m * c * c,
                Profile::Wide(_) | Profile::Sphere => cos2 += m / 3.0,
            }
            let sin = n.cross(axis.as_dvec3()).length();
            spread = spread.max(match item.profile {
                Profile::Front if c > 0.0 => sin,
                Profile::Front | Profile::BothSides | Profile::Sphere => 2.0,
                Profile::Narrow(angle) | Profile::Wide(angle) => {
                    let widest = sin.atan2(c) + f64::from(angle);
                    if widest < PI { -widest.cos() } else { 2.0 }
                }
            });
            has_cones |= item.profile.is_cone();
            let offset = item.center - center;
            radius = radius.max(offset.length() + item.radius);
            thickness = thickness.max(offset.dot(axis).abs());
        }
        // Parallel but at different heights: not one plane. Nor are cones, however they stand.
        let is_plane = thickness < 2.5e-7 && !has_cones;
        let least_spread = if is_plane { 0.0 } else { 2.0 * PARALLEL };
        let spread = spread as f32 + 3e-7;
        Summary {
            center,
            radius: radius * (1.0 + 1e-6),
            axis,
            mean_cos: (cos / mass) as f32,
            mean_cos2: (cos2 / mass) as f32,
            sin_spread: if spread < -2.0 * PARALLEL {
                spread
            } else {
                spread.max(least_spread)
            },
            mass,
        }
    }
}

/// Up to eight parts, together all items, in their order.
fn parts(items: &mut [Item], depth: usize) -> Vec<&mut [Item]> {
    let mut parts = vec![(cost_of(items), items)];
    let open = |parts: &mut Vec<(f32, &mut [Item])>, i: usize, split: &dyn Fn(&mut [Item]) -> usize| {
        let (_, items) = parts.remove(i);
        let middle = split(items);
        let (left, right) = items.split_at_mut(middle);
        parts.insert(i, (cost_of(right), right));
        parts.insert(i, (cost_of(left), left));
    };
    while parts.len() < WIDTH {
        let large = (0..parts.len()).filter(|&i| parts[i].1.len() > WIDTH);
        let Some(i) = large.max_by(|&i, &j| parts[i].0.total_cmp(&parts[j].0)) else {
            break;
        };
        open(&mut parts, i, &|items| {
            if depth < BALANCED_LEVEL {
                split(items)
            } else {
                halve(items)
            }
        });
    }
    // Parts that fit into what is left need no node of their own.
    loop {
        let small = (0..parts.len()).filter(|&i| parts[i].1.len() > 1);
        match small.min_by_key(|&i| parts[i].1.len()) {
            Some(i) if parts.len() + parts[i].1.len() <= WIDTH + 1 => {
                for k in 0..parts[i].1.len() - 1 {
                    open(&mut parts, i + k, &|_| 1);
                }
            }
            _ => break,
        }
    }
    parts.into_iter().map(|(_, items)| items).collect()
}

/// Sums over a set of items, for its cost.
#[derive(Clone, Copy)]
struct Sums {
    lo: Vec3,
    hi: Vec3,
    mass: f32,
    normal: Vec3,
    count: usize,
}

impl Sums {
    const NONE: Sums = Sums {
        lo: Vec3::INFINITY,
        hi: Vec3::NEG_INFINITY,
        mass: 0.0,
        normal: Vec3::ZERO,
        count: 0,
    };

    fn with(self, item: &Item) -> Sums {
        self.plus(&Sums {
            lo: item.center - item.radius,
            hi: item.center + item.radius,
            mass: item.mass,
            normal: if item.profile.is_directed() {
                item.normal * item.mass
            } else {
                Vec3::ZERO
            },
            count: 1,
        })
    }

    fn plus(self, other: &Sums) -> Sums {
        Sums {
            lo: self.lo.min(other.lo),
            hi: self.hi.max(other.hi),
            mass: self.mass + other.mass,
            normal: self.normal + other.normal,
            count: self.count + other.count,
        }
    }

    /// Mass × squared diagonal × solid angle that the normals point to and may be seen from, in units of that of a plane:
    /// about 1 for one normal and 4 for all.
    fn cost(&self) -> f32 {
        if self.count == 0 {
            return 0.0;
        }
        let mean2 = self.normal.length_squared() / (self.mass * self.mass);
        self.mass * (self.hi - self.lo).length_squared() * (4.0 - 3.0 * mean2.min(1.0))
    }
}

fn cost_of(items: &[Item]) -> f32 {
    items.iter().fold(Sums::NONE, Sums::with).cost()
}

/// Orders items so that the two sides of the returned index are best apart.
fn split(items: &mut [Item]) -> usize {
    let best = if items.len() <= SWEPT {
        sweep(items)
    } else {
        split_by_bins(items)
    };
    best.unwrap_or_else(|| halve(items))
}

/// Halves by number, along the longest axis.
fn halve(items: &mut [Item]) -> usize {
    let all = items.iter().fold(Sums::NONE, Sums::with);
    let axis = (all.hi - all.lo).max_position();
    let middle = items.len() / 2;
    items.select_nth_unstable_by(middle, |a, b| order(a, b, axis));
    middle
}

fn order(a: &Item, b: &Item, axis: usize) -> std::cmp::Ordering {
    a.center[axis].total_cmp(&b.center[axis]).then(a.index.cmp(&b.index))
}

/// The best of all splits along all axes. Full nodes are cheaper: counted in eights.
fn sweep(items: &mut [Item]) -> Option<usize> {
    let nodes = |count: usize| count.div_ceil(WIDTH) as f32;
    let mut best: Option<(f32, usize, usize)> = None;
    let mut after = [0.0; SWEPT + 1];
    for axis in 0..3 {
        items.sort_unstable_by(|a, b| order(a, b, axis));
        let mut sums = Sums::NONE;
        for (k, item) in items.iter().enumerate().rev() {
            sums = sums.with(item);
            after[k] = sums.cost();
        }
        let mut sums = Sums::NONE;
        for k in 1..items.len() {
            sums = sums.with(&items[k - 1]);
            let cost = (sums.cost() + after[k]) * (nodes(k) + nodes(items.len() - k));
            if best.is_none_or(|(least, ..)| cost < least) {
                best = Some((cost, axis, k));
            }
        }
    }
    let (_, axis, k) = best?;
    items.sort_unstable_by(|a, b| order(a, b, axis));
    Some(k)
}

/// The best split between bins of equal width; `None` if all items are in one place.
fn split_by_bins(items: &mut [Item]) -> Option<usize> {
    let lo = items.iter().fold(Vec3::INFINITY, |lo, item| lo.min(item.center));
    let hi = items.iter().fold(Vec3::NEG_INFINITY, |hi, item| hi.max(item.center));
    let scale = (hi - lo).map(|extent| if extent > 0.0 { BINS as f32 / extent } else { 0.0 });
    let bin = |item: &Item, axis: usize| (((item.center[axis] - lo[axis]) * scale[axis]) as usize).min(BINS - 1);
    let mut bins = [[Sums::NONE; BINS]; 3];
    for item in &*items {
        for (axis, bins) in bins.iter_mut().enumerate() {
            let sums = &mut bins[bin(item, axis)];
            *sums = sums.with(item);
        }
    }
    let mut best: Option<(f32, usize, usize)> = None;
    for (axis, bins) in bins.iter().enumerate() {
        let mut after = [Sums::NONE; BINS];
        let mut sums = Sums::NONE;
        for k in (1..BINS).rev() {
            sums = sums.plus(&bins[k]);
            after[k] = sums;
        }
        let mut before = Sums::NONE;
        for k in 1..BINS {
            before = before.plus(&bins[k - 1]);
            let cost = before.cost() + after[k].cost();
            if before.count > 0 && after[k].count > 0 && best.is_none_or(|(least, ..)| cost < least) {
                best = Some((cost, axis, k));
            }
        }
    }
    let (_, axis, k) = best?;
    Some(partition(items, |item| bin(item, axis) < k))
}

/// Brings the items that `first` holds for to the front, and returns their number.
fn partition(items: &mut [Item], first: impl Fn(&Item) -> bool) -> usize {
    let mut count = 0;
    for i in 0..items.len() {
        if first(&items[i]) {
            items.swap(i, count);
            count += 1;
        }
    }
    count
}
