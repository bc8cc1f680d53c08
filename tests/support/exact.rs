//! Closed forms and quadratures in f64 that share no code with the renderer.

use super::integrate;
use embrace::image::Image;
use embrace::math::{DVec3, Rgb, Vec3};
use std::f64::consts::{PI, TAU};

/// Form factor of a polygon, from a point of a surface with this normal that has all of it above its horizon: the share
/// of the light that a whole sky as bright would send. Lambert 1760: a sum over the edges as seen from the point.
pub(crate) fn form_factor(p: DVec3, normal: DVec3, polygon: &[Vec3]) -> f64 {
    let corners: Vec<DVec3> = polygon.iter().map(|c| c.as_dvec3() - p).collect();
    let next = |i: usize| corners[(i + 1) % corners.len()];
    let size = (0..corners.len())
        .map(|i| next(i).distance(corners[i]))
        .fold(0.0, f64::max);
    let centre = corners.iter().sum::<DVec3>() / corners.len() as f64;
    if size < 1e-4 * centre.length() {
        // Where the sum would cancel, distance and angles are the same for all of it, to the square of the limit.
        let area: DVec3 = (1..corners.len() - 1)
            .map(|i| 0.5 * (corners[i] - corners[0]).cross(corners[i + 1] - corners[0]))
            .sum();
        return (area.dot(centre) * normal.dot(centre)).abs() / (PI * centre.length_squared().powi(2));
    }
    let edge = |i: usize| {
        let (a, b) = (corners[i].normalize(), next(i).normalize());
        let cross = a.cross(b);
        cross.normalize_or_zero().dot(normal) * cross.length().atan2(a.dot(b)) / TAU
    };
    (0..corners.len()).map(edge).sum::<f64>().abs()
}

/// A map whose texel in column `x`, row `y` is `f(x, y)` in grey.
pub(crate) fn grey_map(width: u32, height: u32, f: impl Fn(u32, u32) -> f32) -> Image<Rgb> {
    Image {
        width,
        height,
        pixels: (0..width * height)
            .map(|k| Rgb::splat(f(k % width, k / width)))
            .collect(),
    }
}

/// The direction at image coordinates of an environment map, by the documented orientation.
pub(crate) fn map_direction(u: f64, v: f64) -> DVec3 {
    let ((sin_phi, cos_phi), (sin_theta, cos_theta)) = ((TAU * u).sin_cos(), (PI * v).sin_cos());
    DVec3::new(sin_phi * sin_theta, cos_theta, -cos_phi * sin_theta)
}

/// The integral of radiance times `weight` over the sphere, for the bilinear interpolation of a grey map: to 1e-7 where
/// `weight` is smooth.
pub(crate) fn integrate_map(texels: &Image<Rgb>, weight: impl Fn(DVec3) -> f64) -> f64 {
    let (w, h) = (texels.width as i32, texels.height as i32);
    let texel = |x: i32, y: i32| f64::from(texels.at(x.rem_euclid(w) as u32, y.clamp(0, h - 1) as u32).r);
    // Half texels: neither a texel centre nor a border is inside a cell.
    let half_texels = |tolerance: f64| {
        let mut sum = 0.0;
        for (i, j) in (0..2 * h).flat_map(|j| (0..2 * w).map(move |i| (i, j))) {
            let (x, y) = ((i - 1).div_euclid(2), (j - 1).div_euclid(2));
            let [a, b, c, d] = [(x, y), (x + 1, y), (x, y + 1), (x + 1, y + 1)].map(|(x, y)| texel(x, y));
            if [a, b, c, d] == [0.0; 4] {
                continue;
            }
            let contribution = |u: f64, v: f64| {
                let (fx, fy) = (
                    u * f64::from(w) - 0.5 - f64::from(x),
                    v * f64::from(h) - 0.5 - f64::from(y),
                );
                let radiance = (a * (1.0 - fx) + b * fx) * (1.0 - fy) + (c * (1.0 - fx) + d * fx) * fy;
                radiance * weight(map_direction(u, v)) * (PI * v).sin() * TAU * PI
            };
            let u = [f64::from(i), f64::from(i + 1)].map(|i| i / f64::from(2 * w));
            let v = [f64::from(j), f64::from(j + 1)].map(|j| j / f64::from(2 * h));
            sum += integrate(&contribution, u, v, tolerance);
        }
        sum
    };
    // Errors of cells are of either sign: their share may be larger than one of all.
    half_texels(1e-8 * half_texels(f64::INFINITY))
}

/// The weight that makes [`integrate_map`] the irradiance on a surface of this normal.
pub(crate) fn facing(normal: Vec3) -> impl Fn(DVec3) -> f64 {
    move |d| d.dot(normal.as_dvec3()).max(0.0)
}
