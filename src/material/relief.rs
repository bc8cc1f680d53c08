//! Relief that is shaded but not modelled: normal maps and bump maps.

use crate::math::{Frame, Vec2, Vec3};
use crate::texture::{Texture, TextureMap};

/// What turns the shading normal.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Relief {
    /// A map of normals in the frame of the texture coordinates, each component from 0 to 1 for -1 to 1.
    NormalMap {
        /// The map.
        map: TextureMap,
        /// Factor on the first two components.
        scale: f32,
    },
    /// A map of heights.
    BumpMap {
        /// The map; the mean of its channels is the height.
        map: TextureMap,
        /// Height of white in the unit of the scene.
        scale: f32,
    },
}

impl Relief {
    /// The map.
    pub fn map(&self) -> TextureMap {
        let (Relief::NormalMap { map, .. } | Relief::BumpMap { map, .. }) = self;
        *map
    }

    /// The unit normal in place of `n`, the one on the front side, at a point of which the texture coordinates are `uv` and
    /// grow along `dp_du` and `dp_dv`.
    pub fn normal(&self, textures: &[Texture], uv: Vec2, n: Vec3, [dp_du, dp_dv]: [Vec3; 2]) -> Vec3 {
        let turned = match self {
            Relief::NormalMap { map, scale } => {
                let Some(s) = (dp_du - n * n.dot(dp_du)).try_normalize() else {
                    return n;
                };
                // Texture coordinates that are mirrored on the surface turn the other way.
                let t = n.cross(s) * n.cross(s).dot(dp_dv).signum();
                let local = map.lookup(textures, uv).map(|c| 2.0 * c - 1.0);
                s * (local.r * scale) + t * (local.g * scale) + n * local.b
            }
            Relief::BumpMap { map, scale } => {
                let slope = map.gradient(textures, uv) * *scale;
                let raised = |along: Vec3, slope: f32| along + n * (slope - n.dot(along));
                let normal = raised(dp_du, slope.x).cross(raised(dp_dv, slope.y));
                normal * normal.dot(n).signum()
            }
        };
        // A map may hold anything: what points below the surface, or nowhere, turns nothing.
        match turned.try_normalize() {
            Some(turned) if turned.dot(n) > 0.0 => turned,
            _ => n,
        }
    }
}

/// The share of light that reaches a surface whose normal is turned, past the relief that is not there: as microfacets shade
/// each other (Estevez, Lecocq and Stein 2019, "A Microfacet-Based Shadowing Function to Solve the Bump Terminator Problem").
/// Without it, light ends at once where the surface itself turns away.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ReliefShadow {
    /// The normal before it was turned, in the local frame of the one after.
    plain: Vec3,
    /// Square of the width of the microfacets.
    alpha_squared: f32,
}

impl ReliefShadow {
    /// For the unit normal `plain` that was turned to that of `frame`.
    pub fn new(plain: Vec3, frame: &Frame) -> ReliefShadow {
        let plain = frame.to_local(plain);
        ReliefShadow {
            plain,
            alpha_squared: (0.125 * tan_squared(plain.z)).min(1.0),
        }
    }

    /// For light from the local direction `wi`; 0 if it is on different sides of the two normals.
    pub fn factor(&self, wi: Vec3) -> f32 {
        let cos = self.plain.dot(wi);
        if (cos > 0.0) == (wi.z > 0.0) {
            2.0 / (1.0 + (1.0 + self.alpha_squared * tan_squared(cos)).sqrt())
        } else {
            0.0
        }
    }
}

fn tan_squared(cos: f32) -> f32 {
    let cos_squared = cos * cos;
    (1.0 - cos_squared).max(0.0) / cos_squared.max(f32::MIN_POSITIVE.sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::Image;
    use crate::math::Rgb;

    #[test]
    fn straight_normals_shade_nothing_and_tilted_ones_what_comes_in_low() {
        let shadow = ReliefShadow::new(Vec3::Z, &Frame::from_normal(Vec3::Z));
        for wi in [
            Vec3::Z,
            Vec3::new(0.8, 0.0, 0.6),
            Vec3::new(1.0, 0.0, 1e-20),
            Vec3::NEG_Z,
        ] {
            assert_eq!(shadow.factor(wi), 1.0, "{wi}");
        }
        // By 45 degrees: alpha is the root of 1/8.
        let frame = Frame::from_normal(Vec3::new(1.0, 0.0, 1.0).normalize());
        let shadow = ReliefShadow::new(Vec3::Z, &frame);
        let factor = |x: f32, z: f32| shadow.factor(frame.to_local(Vec3::new(x, 0.0, z).normalize()));
        assert!((factor(0.0, 1.0) - 1.0).abs() < 1e-6);
        assert!((factor(2.0, 1.0) - 2.0 / (1.0 + 1.5f32.sqrt())).abs() < 1e-5);
        assert_eq!(factor(1.0, -0.1), 0.0);
        assert_eq!(factor(-1.0, 0.1), 0.0);
    }

    /// A bitmap of `columns` greys that grow by `step` each, in both rows.
    fn ramp(columns: u32, step: f32) -> [Texture; 1] {
        [Texture::Rgb32(Image {
            width: columns,
            height: 2,
            pixels: (0..2 * columns)
                .map(|i| Rgb::splat((i % columns) as f32 * step))
                .collect(),
        })]
    }

    #[test]
    fn a_ramp_of_heights_tilts_the_normal_by_its_slope() {
        let relief = Relief::BumpMap {
            map: TextureMap::new(0),
            scale: 3.0,
        };
        // Height grows by 3 * 10 * 0.05 for each unit of u, which is 2 long: the slope is 3/4.
        let directions = [Vec3::X * 2.0, Vec3::Y * 5.0];
        let n = relief.normal(&ramp(10, 0.05), Vec2::new(0.5, 0.5), Vec3::Z, directions);
        assert!((n - Vec3::new(-0.6, 0.0, 0.8)).length() < 1e-5, "{n}");
        // The same on a surface whose texture coordinates are mirrored.
        let n = relief.normal(
            &ramp(10, 0.05),
            Vec2::new(0.5, 0.5),
            Vec3::Z,
            [Vec3::X * -2.0, Vec3::Y * 5.0],
        );
        assert!((n - Vec3::new(0.6, 0.0, 0.8)).length() < 1e-5, "{n}");
    }

    #[test]
    fn a_map_of_normals_is_in_the_frame_of_the_texture_coordinates() {
        let texture = [Texture::Rgb32(Image {
            width: 1,
            height: 1,
            pixels: vec![Rgb::new(0.8, 0.5, 0.9)],
        })];
        let relief = |scale| Relief::NormalMap {
            map: TextureMap::new(0),
            scale,
        };
        let normal = |scale, n, directions| relief(scale).normal(&texture, Vec2::ZERO, n, directions);
        let n = normal(1.0, Vec3::Z, [Vec3::Y, Vec3::NEG_X]);
        assert!((n - Vec3::new(0.0, 0.6, 0.8)).length() < 1e-6, "{n}");
        let n = normal(0.0, Vec3::Z, [Vec3::Y, Vec3::NEG_X]);
        assert!((n - Vec3::Z).length() < 1e-6, "{n}");
        let n = normal(-1.0, Vec3::X, [Vec3::Z, Vec3::Y]);
        assert!((n - Vec3::new(0.8, 0.0, -0.6)).length() < 1e-6, "{n}");
    }

    #[test]
    fn a_map_that_points_nowhere_or_below_turns_nothing() {
        for texel in [Rgb::splat(0.5), Rgb::new(0.5, 0.5, 0.0), Rgb::splat(f32::NAN)] {
            let texture = [Texture::Rgb32(Image {
                width: 1,
                height: 1,
                pixels: vec![texel],
            })];
            let relief = Relief::NormalMap {
                map: TextureMap::new(0),
                scale: 1.0,
            };
            assert_eq!(
                relief.normal(&texture, Vec2::ZERO, Vec3::Z, [Vec3::X, Vec3::Y]),
                Vec3::Z
            );
        }
    }
}
