//! Materials: parameters and textures that give a [`Bsdf`] at a point.

use crate::bsdf::{Bsdf, Conductor, Dielectric, Diffuse, Plastic};
use crate::math::Rgb;
use crate::texture::{Texture, TextureMap};

mod general;
mod relief;
mod spectrum;

pub use general::{General, Principled};
pub use relief::{Relief, ReliefShadow};
pub use spectrum::{Channel, Checkerboard, Scalar, Spectrum, SurfacePoint};

/// Materials within materials, at most.
pub const MAX_NESTING: usize = 32;

/// How a surface scatters light.
#[derive(Clone, Debug, PartialEq)]
#[allow(
    clippy::large_enum_variant,
    reason = "scenes have few materials, and a box would be another load for each hit"
)]
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
    /// Anything else.
    General(General),
}

/// What the side of a surface that its triangles are clockwise from looks like.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Back {
    /// Like the front.
    #[default]
    Same,
    /// It absorbs all light.
    Black,
    /// Like the front of another material of the scene.
    Material(u32),
}

/// A material: scattering, and how much of the surface is there at all.
#[derive(Clone, Debug, PartialEq)]
pub struct Material {
    /// What happens to light that meets the surface.
    pub scattering: Scattering,
    /// Probability of meeting it, in [0, 1] (the mean of the channels); `None` is 1 everywhere, at no cost.
    pub opacity: Option<Spectrum>,
    /// What turns the shading normal, if anything.
    pub relief: Option<Relief>,
    /// What is seen from behind.
    pub back: Back,
}

/// What [`Material::resolve`] finds.
#[derive(Clone, Copy, Debug)]
pub struct Resolved<'a> {
    /// The material that scatters.
    pub material: &'a Material,
    /// Its relief, or that of the mixture it is a part of.
    pub relief: Option<&'a Relief>,
    /// Whether its front is seen.
    pub front: bool,
}

impl Material {
    /// A surface that scatters so and is there everywhere.
    pub const fn new(scattering: Scattering) -> Material {
        Material {
            scattering,
            opacity: None,
            relief: None,
            back: Back::Same,
        }
    }

    /// The material that is met from the front or the back: [`Back`] and [`General::Blend`] are looked through, the latter by
    /// chance, by a number in [0, 1) that `choice` gives. `None` where all light is absorbed.
    pub fn resolve<'a>(
        &'a self,
        materials: &'a [Material],
        textures: &[Texture],
        point: impl Fn() -> SurfacePoint + Copy,
        front: bool,
        choice: impl Fn() -> f32,
    ) -> Option<Resolved<'a>> {
        let mut resolved = Resolved {
            material: self,
            relief: None,
            front,
        };
        let mut number = None;
        // Descriptions have no cycles; the limit bounds damage.
        for _ in 0..MAX_NESTING {
            match (resolved.front, resolved.material.back) {
                (false, Back::Black) => return None,
                (false, Back::Material(other)) => {
                    resolved = Resolved {
                        material: &materials[other as usize],
                        relief: None,
                        front: true,
                    };
                }
                _ => {}
            }
            let material = resolved.material;
            resolved.relief = material.relief.as_ref().or(resolved.relief);
            let Scattering::General(General::Blend {
                weight,
                materials: parts,
            }) = &material.scattering
            else {
                return Some(resolved);
            };
            let weight = weight.at(textures, point).clamp(0.0, 1.0);
            let left = number.get_or_insert_with(&choice);
            let is_second = *left < weight;
            // What is left of the number is as uniform as it was.
            *left = if is_second {
                *left / weight
            } else {
                (*left - weight) / (1.0 - weight)
            };
            resolved.material = &materials[parts[usize::from(is_second)] as usize];
        }
        None
    }

    /// The scattering function at a point of the surface, seen from the front or the back, once [`Material::resolve`]d.
    /// `tangent`: the direction of growing u in the local frame (cosine and sine of its angle around the normal).
    #[inline(always)]
    pub fn bsdf<const TEXTURES: bool, const SPECULAR: bool, const GENERAL: bool>(
        &self,
        textures: &[Texture],
        point: impl Fn() -> SurfacePoint + Copy,
        front: bool,
        tangent: impl Fn() -> [f32; 2],
    ) -> Bsdf {
        let diffuse = |reflectance: &Spectrum| {
            Bsdf::Diffuse(Diffuse {
                reflectance: reflectance.at::<TEXTURES>(textures, point),
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
                reflectance: reflectance.at::<TEXTURES>(textures, point),
                specular: *specular,
                alpha: *alpha,
            }),
            Scattering::General(general) if GENERAL => general.bsdf(textures, point, front, tangent),
            Scattering::General(_) => Bsdf::Mirror(Rgb::BLACK),
        }
    }

    /// The bitmap of a diffuse surface that varies by nothing else, and its tint.
    #[inline(always)]
    pub fn diffuse_bitmap(&self) -> Option<(&TextureMap, Rgb)> {
        match &self.scattering {
            Scattering::Diffuse {
                reflectance: Spectrum::Bitmap(map, tint),
            } => Some((map, *tint)),
            _ => None,
        }
    }

    /// The probability in [0, 1] that light meets the surface at a point.
    #[inline(always)]
    pub fn opacity(&self, textures: &[Texture], point: impl Fn() -> SurfacePoint) -> f32 {
        match &self.opacity {
            None => 1.0,
            Some(spectrum) => {
                let Rgb { r, g, b } = spectrum.at::<true>(textures, point);
                ((r + g + b) * (1.0 / 3.0)).clamp(0.0, 1.0)
            }
        }
    }

    /// The bitmaps in use, those of other materials that it names left out.
    pub fn textures(&self) -> impl Iterator<Item = u32> {
        let mut used = Vec::new();
        self.visit_spectra(&mut |spectrum| used.extend(spectrum.texture()));
        used.extend(self.relief.map(|relief| relief.map().texture));
        used.into_iter()
    }

    /// Whether anything is not the same everywhere.
    pub fn varies(&self) -> bool {
        let mut varies = self.relief.is_some();
        self.visit_spectra(&mut |spectrum| varies |= spectrum.varies());
        varies
    }

    /// Calls `visit` for each colour, and for those that numbers are taken of.
    pub fn visit_spectra(&self, visit: &mut dyn FnMut(&Spectrum)) {
        match &self.scattering {
            Scattering::Diffuse { reflectance } | Scattering::Plastic { reflectance, .. } => visit(reflectance),
            Scattering::General(general) => general.visit_spectra(visit),
            Scattering::Conductor { .. } | Scattering::Dielectric { .. } | Scattering::Mirror { .. } => {}
        }
        self.opacity.iter().for_each(visit);
    }

    /// Other materials of the scene that it refers to.
    pub fn parts(&self) -> impl Iterator<Item = u32> {
        let blend = match &self.scattering {
            Scattering::General(General::Blend { materials, .. }) => materials.as_slice(),
            _ => &[],
        };
        let back = match self.back {
            Back::Material(other) => Some(other),
            Back::Same | Back::Black => None,
        };
        blend.iter().copied().chain(back)
    }

    /// Whether it is plain diffuse.
    pub fn is_diffuse(&self) -> bool {
        matches!(self.scattering, Scattering::Diffuse { .. })
    }

    /// Whether it takes the general way through the kernel.
    pub fn is_general(&self) -> bool {
        matches!(self.scattering, Scattering::General(_)) || self.relief.is_some() || self.back != Back::Same
    }

    /// Whether light can pass to the other side, not counting [`Material::parts`].
    pub fn transmits(&self) -> bool {
        match &self.scattering {
            Scattering::Dielectric { .. } => true,
            Scattering::General(general) => general.transmits(),
            _ => false,
        }
    }

    /// Whether it scatters into single directions only, at every point and on both sides, not counting
    /// [`Material::parts`].
    pub fn is_delta(&self) -> bool {
        match &self.scattering {
            Scattering::Diffuse { .. } | Scattering::Plastic { .. } => false,
            &Scattering::Conductor { eta, k, alpha } => Bsdf::Conductor(Conductor { eta, k, alpha }).is_delta(),
            &Scattering::Dielectric { ior, alpha } => [ior, 1.0 / ior]
                .iter()
                .all(|&eta| Bsdf::Dielectric(Dielectric { eta, alpha }).is_delta()),
            Scattering::Mirror { .. } => true,
            Scattering::General(general) => general.is_delta(),
        }
    }
}
