//! What spots cast through their cones.

use super::desc::SlideDesc;
use crate::material::{Spectrum, SurfacePoint};
use crate::math::{DVec3, Rgb, Vec2, Vec3};
use crate::texture::Texture;

/// A spot's pattern, in the coordinates of rendering.
#[derive(Debug)]
struct Slide {
    /// Index among the lights from points.
    light: u32,
    factor: Spectrum,
    position: Vec3,
    axis: Vec3,
    /// What texture coordinates grow by at a distance of 1 along the axis.
    growth: [Vec3; 2],
}

/// All of them.
#[derive(Debug, Default)]
pub(super) struct Slides {
    /// Ascending by the light.
    slides: Vec<Slide>,
}

impl Slides {
    pub(super) fn is_empty(&self) -> bool {
        self.slides.is_empty()
    }

    /// Adds that of a light after those that have been added. `edge`: half angle of its cone in radians, below a quarter turn.
    pub(super) fn push(&mut self, light: u32, desc: &SlideDesc, position: Vec3, direction: DVec3, edge: f64) {
        let growth = desc
            .axes
            .map(|axis| (axis.normalize_or_zero() * (0.5 / edge.tan())).as_vec3());
        self.slides.push(Slide {
            light,
            factor: desc.factor,
            position,
            axis: direction.normalize().as_vec3(),
            growth,
        });
    }

    /// What the intensity of a light is multiplied by towards `p`, a point in its cone; `None` if it has no slide.
    pub(super) fn at(&self, textures: &[Texture], light: u32, p: Vec3) -> Option<Rgb> {
        let index = self.slides.binary_search_by_key(&light, |slide| slide.light).ok()?;
        let slide = &self.slides[index];
        let d = p - slide.position;
        let [u, v] = slide.growth.map(|growth| 0.5 + growth.dot(d) / slide.axis.dot(d));
        let point = || SurfacePoint {
            uv: Vec2::new(u, v),
            color: Rgb::WHITE,
        };
        Some(slide.factor.at::<true>(textures, point).map(|c| c.max(0.0)))
    }
}
