//! Polygons cut into triangles.

use crate::math::DVec3;
use earcut::Earcut;
use rayon::prelude::*;

/// A polygon of more than three corners among triangles: those of the fan around its first corner, one after the other.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Polygon {
    /// Its first triangle.
    pub(crate) start: u32,
    /// How many corners it has: two more than triangles.
    pub(crate) corners: u32,
}

/// How a polygon is cut where its fan does not cover it: the corners of its triangles, numbered within the polygon.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Cut {
    polygon: Polygon,
    triangles: Vec<[u32; 3]>,
}

/// Larger polygons are fans: ear clipping may take a time that grows with the cube of the corners.
const MAX_CORNERS: usize = 4096;

/// A fan may cover so much more than its polygon, relative to the area of that: rounded corners on a straight side.
const TOLERANCE: f64 = 1e-6;

impl Cut {
    /// The polygons that their fans do not cover, most of all concave ones.
    pub(crate) fn all(positions: &[DVec3], indices: &[[u32; 3]], polygons: &[Polygon]) -> Vec<Cut> {
        let cut = |polygon: &Polygon| {
            let corners = polygon.corners(indices).map(|i| positions[i as usize]);
            Some(Cut {
                polygon: *polygon,
                triangles: cut(&corners.collect::<Vec<_>>())?,
            })
        };
        polygons.par_iter().filter_map(cut).collect()
    }

    /// The first triangle of the polygon.
    pub(crate) fn start(&self) -> usize {
        self.polygon.start as usize
    }

    /// Cuts the polygon, which is a fan so far, at `start` in indices of any kind.
    pub(crate) fn apply(&self, indices: &mut [[u32; 3]], start: usize) {
        let polygon = Polygon {
            start: start as u32,
            ..self.polygon
        };
        let corners: Vec<u32> = polygon.corners(indices).collect();
        for (triangle, cut) in indices[start..].iter_mut().zip(&self.triangles) {
            *triangle = cut.map(|corner| corners[corner as usize]);
        }
    }
}

impl Polygon {
    pub(crate) fn triangles(self) -> usize {
        self.corners as usize - 2
    }

    /// What the corners of the fan are.
    fn corners(self, indices: &[[u32; 3]]) -> impl Iterator<Item = u32> {
        let fan = &indices[self.start as usize..][..self.triangles()];
        let last = fan.last().map(|triangle| triangle[2]);
        let first = fan.first().map(|triangle| triangle[0]);
        first
            .into_iter()
            .chain(fan.iter().map(|triangle| triangle[1]))
            .chain(last)
    }
}

/// Triangles of a polygon, all turning as it does, unless the fan around its first corner is as good.
///
/// The polygon is seen along its normal, the sum of the cross products of its sides (Newell's method).
fn cut(corners: &[DVec3]) -> Option<Vec<[u32; 3]>> {
    let &[origin, ref others @ ..] = corners else {
        return None;
    };
    let extent = others
        .iter()
        .fold(0.0, |extent: f64, p| extent.max((*p - origin).abs().max_element()));
    // Neither the squares of tiny nor those of huge coordinates are numbers.
    let local = |p: DVec3| (p - origin) / extent;
    let doubled_area = |pair: &[DVec3]| local(pair[0]).cross(local(pair[1]));
    let normal: DVec3 = others.windows(2).map(doubled_area).sum();
    let area = normal.length();
    let least = others
        .windows(2)
        .map(|pair| doubled_area(pair).dot(normal))
        .fold(f64::INFINITY, f64::min);
    // False where there is no area, or no number.
    let leaves_polygon = least < -TOLERANCE * area * area;
    if !leaves_polygon || corners.len() > MAX_CORNERS {
        return None;
    }
    let x = (normal / area).any_orthonormal_vector();
    let y = (normal / area).cross(x);
    let flat: Vec<[f64; 2]> = corners.iter().map(|&p| [local(p).dot(x), local(p).dot(y)]).collect();
    let mut cut: Vec<u32> = Vec::new();
    Earcut::new().earcut(flat.iter().copied(), &[], &mut cut);
    let (triangles, _) = cut.as_chunks::<3>();
    let mut triangles = triangles.to_vec();
    let doubled_area = |&[a, b, c]: &[u32; 3]| {
        let [a, b, c] = [a, b, c].map(|i| flat[i as usize]);
        (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
    };
    if triangles.iter().map(doubled_area).sum::<f64>() < 0.0 {
        triangles.iter_mut().for_each(|triangle| triangle.swap(1, 2));
    }
    // Less for a polygon that crosses itself or touches itself, which is left as it is.
    (triangles.len() == corners.len() - 2).then_some(triangles)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::DMat3;

    /// The sum of the areas, those of triangles that turn the other way counted as negative, and the sum of all.
    fn areas(corners: &[DVec3], triangles: &[[u32; 3]], normal: DVec3) -> (f64, f64) {
        let areas = triangles.iter().map(|t| {
            let [a, b, c] = t.map(|i| corners[i as usize]);
            0.5 * (b - a).cross(c - a).dot(normal)
        });
        (areas.clone().sum(), areas.map(f64::abs).sum())
    }

    fn corners_of(points: &[[f64; 2]], turn: DMat3) -> Vec<DVec3> {
        points.iter().map(|p| turn * DVec3::new(p[0], p[1], 0.0)).collect()
    }

    #[test]
    fn a_polygon_that_its_fan_covers_stays_a_fan() {
        for polygon in [
            [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]].as_slice(),
            &[[0.0, 0.0], [2.0, 0.0], [3.0, 1.0], [1.0, 3.0], [-1.0, 1.0]],
            // Corners on straight sides, off by rounding.
            &[
                [0.0, 0.0],
                [0.5, 1e-9],
                [1.0, 0.0],
                [1.0, 1.0],
                [0.5, 1.0 - 1e-9],
                [0.0, 1.0],
            ],
            // Concave, but the first corner sees all of it.
            &[[0.0, 0.0], [2.0, 0.0], [0.5, 0.5], [0.0, 2.0]],
            // No area.
            &[[0.0, 0.0], [1.0, 0.0], [2.0, 0.0], [1.0, 0.0]],
            &[[1.0, 1.0]; 5],
        ] {
            assert_eq!(cut(&corners_of(polygon, DMat3::IDENTITY)), None, "{polygon:?}");
        }
        // A saddle.
        let saddle = [[0.0, 0.0, 0.0], [1.0, 0.0, 1.0], [1.0, 1.0, 0.0], [0.0, 1.0, 1.0]];
        assert_eq!(cut(&saddle.map(DVec3::from)), None);
    }

    #[test]
    fn a_concave_polygon_is_covered_once_from_any_corner_in_any_plane() {
        let comb: Vec<[f64; 2]> = (0..40)
            .map(|i| [f64::from(i / 2), if (i / 2 + i) % 2 == 0 { 5.0 } else { 0.5 }])
            .chain([[20.0, 5.0], [20.0, 0.0], [-1.0, 0.0], [-1.0, 5.0]])
            .collect();
        let arrow = vec![[0.0, 0.0], [2.0, 1.0], [0.0, 2.0], [0.7, 1.0]];
        let mut cuts = 0;
        for points in [arrow, comb] {
            let area = 0.5
                * (0..points.len())
                    .map(|i| (points[i], points[(i + 1) % points.len()]))
                    .map(|(a, b)| a[0] * b[1] - a[1] * b[0])
                    .sum::<f64>();
            for scale in [1.0, 1e-30, 1e30] {
                for angle in [0.0, 0.4, 2.0, 3.0] {
                    let turn = DMat3::from_rotation_x(angle) * DMat3::from_rotation_y(2.0 * angle);
                    for first in 0..points.len() {
                        let mut points = points.clone();
                        points.rotate_left(first);
                        let corners = corners_of(&points, turn * scale);
                        let fan = (1..points.len() as u32 - 1).map(|i| [0, i, i + 1]).collect();
                        let cut = cut(&corners);
                        cuts += usize::from(cut.is_some());
                        let triangles: Vec<[u32; 3]> = cut.unwrap_or(fan);
                        assert_eq!(triangles.len(), points.len() - 2);
                        let normal = turn * DVec3::Z * area.signum();
                        let (sum, total) = areas(&corners, &triangles, normal);
                        let expected = area.abs() * scale * scale;
                        assert!((sum / expected - 1.0).abs() < 1e-9, "{sum} {expected}");
                        assert!((total / expected - 1.0).abs() < 1e-9, "{total} {expected}");
                    }
                }
            }
        }
        assert!(cuts > 400, "{cuts}");
    }

    #[test]
    fn a_cut_changes_the_triangles_of_its_polygon_only() {
        let arrow = [[0.0, 0.0], [2.0, 1.0], [0.0, 2.0], [0.7, 1.0]];
        let mut positions = vec![DVec3::ZERO; 2];
        positions.extend(corners_of(&arrow, DMat3::IDENTITY));
        let mut indices = vec![[0, 1, 2], [2, 3, 4], [2, 4, 5], [5, 4, 3]];
        let polygons = [Polygon { start: 1, corners: 4 }];
        let cuts = Cut::all(&positions, &indices, &polygons);
        assert_eq!(cuts.len(), 1);
        cuts[0].apply(&mut indices, cuts[0].start());
        assert_eq!((indices[0], indices[3]), ([0, 1, 2], [5, 4, 3]));
        let (sum, total) = areas(&positions, &indices[1..3], DVec3::Z);
        assert!(sum > 0.0 && (sum - total).abs() < 1e-12, "{sum} {total}");
    }

    #[test]
    fn polygons_that_cross_themselves_end_soon_and_keep_their_number_of_triangles() {
        let mut state = 1u64;
        let mut random = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            (state >> 40) as f64 / f64::from(1 << 24)
        };
        for corners in [4, 5, 7, 12, 100, MAX_CORNERS] {
            for _ in 0..1 + 1000 / corners {
                let polygon: Vec<DVec3> = (0..corners).map(|_| DVec3::new(random(), random(), random())).collect();
                if let Some(triangles) = cut(&polygon) {
                    assert_eq!(triangles.len(), corners - 2);
                }
            }
        }
    }
}
