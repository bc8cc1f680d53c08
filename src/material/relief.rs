//! Relief that is shaded but not modelled: normal maps and bump maps.

use crate::math::{Vec2, Vec3};
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
