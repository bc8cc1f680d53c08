//! Materials: parameters and textures that give a [`Bsdf`] at a point.

use crate::bsdf::{Bsdf, Conductor, Dielectric, Diffuse, Plastic};
use crate::math::{Rgb, Vec2};
use crate::texture::{Texture, TextureMap};

/// A colour that may vary over the surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Spectrum {
    /// The same everywhere.
    Constant(Rgb),
    /// From a bitmap, times a tint.
    Bitmap(TextureMap, Rgb),
}

impl Spectrum {
    #[inline(always)]
    fn at<const TEXTURES: bool>(&self, textures: &[Texture], uv: impl Fn() -> Vec2) -> Rgb {
        match self {
            Spectrum::Constant(rgb) => *rgb,
            // Without the feature the scene has no bitmap: the branch is compiled out.
            Spectrum::Bitmap(map, tint) if TEXTURES => {
                textures[map.texture as usize].lookup(uv() * map.scale + map.offset) * *tint
            }
            Spectrum::Bitmap(..) => Rgb::BLACK,
        }
    }

    /// The bitmap, if there is one.
    pub fn texture(&self) -> Option<u32> {
        match self {
            Spectrum::Constant(_) => None,
            Spectrum::Bitmap(map, _) => Some(map.texture),
        }
    }
}

/// How a surface scatters light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Scattering {
    /// Lambertian reflection, on both sides.
    Diffuse {
        /// Albedo in [0, 1].
        reflectance: Spectrum,
    },
    /// A metal, on both sides.
    Conductor {
        /// Real part of the index.
        eta: Rgb,
        /// Absorption.
        k: Rgb,
        /// GGX width; 0 is a perfect mirror.
        alpha: f32,
    },
    /// Glass. The side that the triangles are counter-clockwise from is outside.
    Dielectric {
        /// Index inside over index outside.
        ior: f32,
        /// GGX width; 0 is smooth.
        alpha: f32,
    },
    /// A perfect mirror of constant reflectance, on both sides.
    Mirror {
        /// Reflectance in [0, 1].
        reflectance: Rgb,
    },
    /// A diffuse base under a clear rough coat, on both sides.
    Plastic {
        /// Albedo of the base.
        reflectance: Spectrum,
        /// Reflectance of the coat at normal incidence.
        specular: Rgb,
        /// GGX width of the coat.
        alpha: f32,
    },
}

/// A material: scattering, and how much of the surface is there at all.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Material {
    /// What happens to light that meets the surface.
    pub scattering: Scattering,
    /// Probability of meeting it, in [0, 1] (the mean of the channels); `None` is 1 everywhere, at no cost.
    pub opacity: Option<Spectrum>,
}

impl Material {
    /// The scattering function at texture coordinates, seen from the front or the back.
    #[inline(always)]
    pub fn bsdf<const TEXTURES: bool, const SPECULAR: bool>(
        &self,
        textures: &[Texture],
        uv: impl Fn() -> Vec2,
        front: bool,
    ) -> Bsdf {
        let diffuse = |reflectance: &Spectrum| {
            Bsdf::Diffuse(Diffuse {
                reflectance: reflectance.at::<TEXTURES>(textures, &uv),
            })
        };
        if !SPECULAR {
            // Only diffuse materials are left: no choice to make per hit.
            return match &self.scattering {
                Scattering::Diffuse { reflectance } => diffuse(reflectance),
                _ => Bsdf::Mirror(Rgb::BLACK),
            };
        }
        match &self.scattering {
            Scattering::Diffuse { reflectance } => diffuse(reflectance),
            &Scattering::Conductor { eta, k, alpha } => Bsdf::Conductor(Conductor { eta, k, alpha }),
            &Scattering::Dielectric { ior, alpha } => Bsdf::Dielectric(Dielectric {
                eta: if front { ior } else { 1.0 / ior },
                alpha,
            }),
            &Scattering::Mirror { reflectance } => Bsdf::Mirror(reflectance),
            Scattering::Plastic {
                reflectance,
                specular,
                alpha,
            } => Bsdf::Plastic(Plastic {
                reflectance: reflectance.at::<TEXTURES>(textures, &uv),
                specular: *specular,
                alpha: *alpha,
            }),
        }
    }

    /// The probability in [0, 1] that light meets the surface at these texture coordinates.
    #[inline(always)]
    pub fn opacity(&self, textures: &[Texture], uv: Vec2) -> f32 {
        match &self.opacity {
            None => 1.0,
            Some(spectrum) => {
                let Rgb { r, g, b } = spectrum.at::<true>(textures, || uv);
                ((r + g + b) * (1.0 / 3.0)).clamp(0.0, 1.0)
            }
        }
    }

    /// The bitmaps in use.
    pub fn textures(&self) -> impl Iterator<Item = u32> {
        let base = match &self.scattering {
            Scattering::Diffuse { reflectance } | Scattering::Plastic { reflectance, .. } => reflectance.texture(),
            _ => None,
        };
        base.into_iter()
            .chain(self.opacity.as_ref().and_then(Spectrum::texture))
    }

    /// Whether it is plain diffuse.
    pub fn is_diffuse(&self) -> bool {
        matches!(self.scattering, Scattering::Diffuse { .. })
    }

    /// Whether light can pass to the other side.
    pub fn transmits(&self) -> bool {
        matches!(self.scattering, Scattering::Dielectric { .. })
    }

    /// Whether it scatters into single directions only, at every point and on both sides.
    pub fn is_delta(&self) -> bool {
        match self.scattering {
            Scattering::Diffuse { .. } | Scattering::Plastic { .. } => false,
            Scattering::Conductor { eta, k, alpha } => Bsdf::Conductor(Conductor { eta, k, alpha }).is_delta(),
            Scattering::Dielectric { ior, alpha } => [ior, 1.0 / ior]
                .iter()
                .all(|&eta| Bsdf::Dielectric(Dielectric { eta, alpha }).is_delta()),
            Scattering::Mirror { .. } => true,
        }
    }
}
