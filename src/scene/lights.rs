//! Lights of a description as emitters: those that are no surface, and emission that varies over one.

use super::build::SceneError;
use super::desc::LightDesc;
use super::slide::Slides;
use crate::accel::{Geometry, Hit};
use crate::interaction::surface_point;
use crate::light::{DistantLight, Emission, LightSamplerBuilder, PunctualLight};
use crate::material::Spectrum;
use crate::math::{DVec3, Rgb, Vec2};
use crate::sampling::warp;
use crate::texture::Texture;
use rayon::prelude::*;
use std::f64::consts::{FRAC_PI_2, PI};
use std::ops::Range;

/// Points per side of the grid that the mean of a map over a triangle is taken from: one for each texel, within these limits.
const GRID: [f32; 2] = [2.0, 32.0];

/// Least mean of a triangle over that of its mesh: the points may all have missed what emits.
const LEAST_MEAN: f64 = 0.01;

/// Mean of a map, all of whose points have missed what emits.
const MISSED_MEAN: f64 = 1e-3;

/// Adds the lights that are no surface, and gives the slides of those that have some. `origin`: what the origin of rendering is
/// in their coordinates.
pub(super) fn add(
    lights: &[LightDesc],
    origin: DVec3,
    builder: &mut LightSamplerBuilder,
) -> Result<Slides, SceneError> {
    let mut slides = Slides::default();
    let mut points = 0;
    for (index, light) in lights.iter().enumerate() {
        let error = |problem| Err(SceneError::Light { index, problem });
        let (strength, direction) = match light {
            LightDesc::Point { intensity, .. } => (*intensity, DVec3::Y),
            LightDesc::Spot {
                intensity, direction, ..
            } => (*intensity, *direction),
            LightDesc::Distant {
                irradiance, direction, ..
            } => (*irradiance, *direction),
        };
        if strength.to_array().iter().any(|c| !(c.is_finite() && *c >= 0.0)) {
            return error("its strength is negative or not finite");
        }
        if direction.try_normalize().is_none() {
            return error("its direction has no length, or is not finite");
        }
        if strength.is_black() {
            continue;
        }
        match *light {
            LightDesc::Point { position, intensity } => {
                let position = (position - origin).as_vec3();
                if !position.is_finite() {
                    return error("it stands beyond what 32-bit coordinates can hold");
                }
                builder.push_punctual(PunctualLight::point(position, intensity));
                points += 1;
            }
            LightDesc::Spot {
                position,
                direction,
                intensity,
                angles,
                falloff,
                slide,
            } => {
                let position = (position - origin).as_vec3();
                if !position.is_finite() {
                    return error("it stands beyond what 32-bit coordinates can hold");
                }
                if !(0.0 <= angles[0] && angles[0] < angles[1] && angles[1] <= PI) {
                    return error("its angles are not 0 or more, the second above the first, and at most half a turn");
                }
                builder.push_punctual(PunctualLight::spot(position, direction, intensity, angles, falloff));
                if let Some(slide) = &slide {
                    if angles[1] >= FRAC_PI_2 {
                        return error("it casts a slide, and its cone is not below a right angle from its axis");
                    }
                    slides.push(points, slide, position, direction, angles[1]);
                }
                points += 1;
            }
            LightDesc::Distant {
                direction,
                irradiance,
                radius,
            } => {
                if !(0.0..FRAC_PI_2).contains(&radius) {
                    return error("its radius is not 0 or more and below a quarter turn");
                }
                builder.push_distant(DistantLight::new(direction, irradiance, radius));
            }
        }
    }
    Ok(slides)
}

/// Emission that varies over surfaces.
#[derive(Debug, Default)]
pub struct EmissionMaps {
    /// By placement; shorter where no more of them vary.
    maps: Vec<Option<Spectrum>>,
    /// Triangles among the lights, ascending.
    lights: Vec<VaryingLights>,
}

/// Triangles of a placement among the lights.
#[derive(Debug)]
struct VaryingLights {
    lights: Range<u32>,
    placement: u32,
    /// Whether the second and the third corner are swapped.
    is_mirrored: bool,
}

impl EmissionMaps {
    /// Whether there is no emission that varies.
    pub(super) fn is_empty(&self) -> bool {
        self.lights.is_empty()
    }

    pub(super) fn insert(&mut self, placement: u32, map: Spectrum, lights: Range<u32>, is_mirrored: bool) {
        self.maps.resize(placement as usize + 1, None);
        self.maps[placement as usize] = Some(map);
        self.lights.push(VaryingLights {
            lights,
            placement,
            is_mirrored,
        });
    }

    /// What emission is multiplied by at a hit; `None` where it does not vary.
    #[inline]
    pub(super) fn at(&self, textures: &[Texture], geometry: &Geometry, hit: &Hit) -> Option<Rgb> {
        let map = self.maps.get(hit.placement as usize)?.as_ref()?;
        Some(factor(map, textures, geometry, hit))
    }

    /// Whether the emission of a triangle among the lights varies.
    #[inline]
    pub(super) fn vary(&self, light: u32) -> bool {
        self.find(light).is_some()
    }

    /// What emission is multiplied by where a place `u` of the unit square falls on a triangle among the lights.
    pub(super) fn at_sample(&self, textures: &[Texture], geometry: &Geometry, light: u32, u: [f32; 2]) -> Option<Rgb> {
        let varying = self.find(light)?;
        let [second, third] = warp::triangle(u);
        let (u, v) = if varying.is_mirrored {
            (third, second)
        } else {
            (second, third)
        };
        let hit = Hit {
            t: 0.0,
            placement: varying.placement,
            triangle: light - varying.lights.start,
            u,
            v,
        };
        self.at(textures, geometry, &hit)
    }

    fn find(&self, light: u32) -> Option<&VaryingLights> {
        let after = self.lights.partition_point(|varying| varying.lights.start <= light);
        let varying = &self.lights[after.checked_sub(1)?];
        varying.lights.contains(&light).then_some(varying)
    }
}

/// Never negative, whatever the map.
fn factor(map: &Spectrum, textures: &[Texture], geometry: &Geometry, hit: &Hit) -> Rgb {
    let factor = map.at::<true>(textures, || surface_point(geometry, hit));
    factor.map(|c| c.max(0.0))
}

/// The mean luminance of the emission of each triangle of a placement, relative to what the map multiplies: an estimate, and
/// positive. `None` if the map is black.
pub(super) fn mean_emission(
    map: &Spectrum,
    emission: &Emission,
    textures: &[Texture],
    geometry: &Geometry,
    placement: u32,
) -> Option<Vec<f32>> {
    if is_black(map, textures) {
        return None;
    }
    let triangles = geometry.meshes[geometry.placements[placement as usize].mesh as usize]
        .indices
        .len();
    let of_triangle = |triangle: u32| {
        let at = |[u, v]: [f32; 2]| Hit {
            t: 0.0,
            placement,
            triangle,
            u,
            v,
        };
        let corners = [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]].map(|place| surface_point(geometry, &at(place)).uv);
        let side = texels(map, textures, corners).sqrt().ceil().clamp(GRID[0], GRID[1]);
        let n = side as u32;
        let middle = |k: u32| (k as f32 + 0.5) / side;
        let luminances = (0..n * n).map(|k| {
            let hit = at(warp::triangle([middle(k % n), middle(k / n)]));
            let radiance = emission.radiance * factor(map, textures, geometry, &hit);
            f64::from(radiance.luminance())
        });
        let mean = luminances.sum::<f64>() / f64::from(n * n) / f64::from(emission.radiance.luminance());
        let [a, b, c] = geometry.world_triangle(placement, triangle).map(|p| p.as_dvec3());
        let area = (b - a).cross(c - a).length();
        (mean, area)
    };
    let means: Vec<(f64, f64)> = (0..triangles as u32).into_par_iter().map(of_triangle).collect();
    let area: f64 = means.iter().map(|(_, area)| area).sum();
    let mean = means.iter().map(|(mean, area)| mean * area).sum::<f64>() / area;
    let least = if mean > 0.0 { LEAST_MEAN * mean } else { MISSED_MEAN };
    Some(means.iter().map(|(mean, _)| mean.max(least) as f32).collect())
}

/// Texels of a map within the triangle of these texture coordinates; 0 where it has none.
fn texels(map: &Spectrum, textures: &[Texture], corners: [Vec2; 3]) -> f32 {
    let (to_uv, [width, height]) = match map {
        Spectrum::Bitmap(map, _) | Spectrum::VertexColor(Some(map), _) => {
            let (width, height) = textures[map.texture as usize].size();
            (map.to_uv, [width as f32, height as f32])
        }
        // Fields have edges that texels of a bitmap have not: eight points along each.
        Spectrum::Checkerboard(pattern) => (pattern.to_uv, [16.0; 2]),
        Spectrum::Constant(_) | Spectrum::VertexColor(None, _) => return 0.0,
    };
    let [a, b, c] = corners.map(|uv| to_uv.transform_point2(uv));
    let area = 0.5 * (b - a).perp_dot(c - a).abs() * width * height;
    if area.is_finite() { area } else { 0.0 }
}

/// Whether nothing emits wherever the map is looked up, vertex colours aside.
fn is_black(map: &Spectrum, textures: &[Texture]) -> bool {
    let is_black = |texture: u32| match &textures[texture as usize] {
        Texture::Rgb8(image, _) => image.pixels.par_iter().all(|texel| *texel == [0; 3]),
        Texture::Rgb32(image) => image.pixels.par_iter().all(|texel| texel.is_black()),
    };
    match map {
        Spectrum::Constant(rgb) => rgb.is_black(),
        Spectrum::Bitmap(map, tint) => tint.is_black() || is_black(map.texture),
        Spectrum::Checkerboard(pattern) => pattern.colors.iter().all(|color| color.is_black()),
        Spectrum::VertexColor(map, tint) => tint.is_black() || map.is_some_and(|map| is_black(map.texture)),
    }
}
