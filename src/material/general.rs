//! Scattering that other renderers' scenes ask for: more parameters than [`super::Scattering`]'s own, most of which may vary
//! over the surface. Scenes without any of it do not carry its code.

use super::{Scalar, Spectrum, SurfacePoint};
use crate::bsdf::{Bsdf, CoatTable, CoatedDiffuse, Distribution, PrincipledBsdf, RoughGlass, RoughMetal, ThinGlass};
use crate::math::Rgb;
use crate::texture::Texture;

/// How a surface scatters light, with all parameters there are.
#[derive(Clone, Debug, PartialEq)]
pub enum General {
    /// A metal of any width.
    Metal {
        /// Real part of the index.
        eta: Rgb,
        /// Absorption.
        k: Rgb,
        /// Factor on what is reflected.
        reflectance: Spectrum,
        /// Widths along the two directions of the texture coordinates; both 0 is a perfect mirror.
        alpha: [Scalar; 2],
        /// Which microfacets.
        distribution: Distribution,
    },
    /// Glass of any width. The side that the triangles are counter-clockwise from is outside.
    Glass {
        /// Index inside over index outside.
        ior: f32,
        /// Factor on what is reflected.
        reflectance: Spectrum,
        /// Factor on what is transmitted.
        transmittance: Spectrum,
        /// Widths as for metals.
        alpha: [Scalar; 2],
        /// Which microfacets.
        distribution: Distribution,
    },
    /// A smooth sheet of glass without thickness: all orders of reflection between its two sides.
    ThinGlass {
        /// Index of the sheet over that of its surroundings.
        ior: f32,
        /// Factor on what is reflected.
        reflectance: Spectrum,
        /// Factor on what is transmitted.
        transmittance: Spectrum,
    },
    /// A diffuse base under a coat of glass, light going back and forth between them.
    CoatedDiffuse {
        /// Albedo of the base.
        reflectance: Spectrum,
        /// Factor on what the coat reflects.
        specular: Spectrum,
        /// Index and width of the coat, and what passes it.
        coat: &'static CoatTable,
        /// Whether light that goes back and forth takes the colour of the base each time.
        nonlinear: bool,
    },
    /// Metal, plastic, glass and cloth in one.
    Principled(Box<Principled>),
    /// Two other materials of the scene, mixed.
    Blend {
        /// Share of the second one, in [0, 1].
        weight: Scalar,
        /// Indices of materials.
        materials: [u32; 2],
    },
}

/// Parameters of the principled BSDF ([`crate::bsdf::PrincipledBsdf`]). All numbers are in [0, 1] unless stated.
#[derive(Clone, Debug, PartialEq)]
pub struct Principled {
    /// Albedo of the diffuse part, reflectance of metal, tint of glass.
    pub base_color: Spectrum,
    /// Square root of the GGX width.
    pub roughness: Scalar,
    /// How much longer highlights are along than across the first direction of the texture coordinates.
    pub anisotropic: Scalar,
    /// Share of metal.
    pub metallic: Scalar,
    /// Share of glass in what is not metal.
    pub spec_trans: Scalar,
    /// Index of refraction inside over outside, above 1.
    pub ior: f32,
    /// How much of the base's hue reflections of what is not metal take.
    pub spec_tint: Scalar,
    /// Factor on those.
    pub specular: Scalar,
    /// Factor on their reflectance along the normal; at least 0, and more than 1 where that is left below 1.
    pub specular_color: Spectrum,
    /// Retro-reflection of cloth at grazing angles.
    pub sheen: Scalar,
    /// How much of the base's hue that takes.
    pub sheen_tint: Scalar,
    /// Between Lambert-like diffuse and an approximation of subsurface scattering.
    pub flatness: Scalar,
    /// A second, colourless coat.
    pub clearcoat: Scalar,
    /// Gloss of that coat where energy is not conserved: from satin to shiny.
    pub clearcoat_gloss: Scalar,
    /// Square root of that coat's GGX width where energy is conserved.
    pub clearcoat_roughness: Scalar,
    /// Whether what facets reflect is taken from the diffuse part, and what the coat reflects from all below. Without, a white
    /// surface sends on more than it gets.
    pub conserves: bool,
    /// Whether what is glass is a thin wall, which does not refract, and not a solid.
    pub thin: bool,
}

impl Principled {
    /// White plastic of medium roughness: what is not said otherwise.
    pub fn new(base_color: Spectrum) -> Principled {
        let zero = Scalar::Constant(0.0);
        Principled {
            base_color,
            roughness: Scalar::Constant(0.5),
            anisotropic: zero,
            metallic: zero,
            spec_trans: zero,
            ior: 1.5,
            spec_tint: zero,
            specular: Scalar::Constant(1.0),
            specular_color: Spectrum::Constant(Rgb::WHITE),
            sheen: zero,
            sheen_tint: zero,
            flatness: zero,
            clearcoat: zero,
            clearcoat_gloss: zero,
            clearcoat_roughness: zero,
            conserves: true,
            thin: false,
        }
    }
}

impl General {
    /// See [`super::Material::bsdf`].
    pub(super) fn bsdf(
        &self,
        textures: &[Texture],
        point: impl Fn() -> SurfacePoint + Copy,
        front: bool,
        tangent: impl Fn() -> [f32; 2],
    ) -> Bsdf {
        let color = |spectrum: &Spectrum| spectrum.at::<true>(textures, point).map(|c| c.clamp(0.0, 1.0));
        let number = |scalar: &Scalar| scalar.at(textures, point).clamp(0.0, 1.0);
        match self {
            General::Metal {
                eta,
                k,
                reflectance,
                alpha,
                distribution,
            } => Bsdf::RoughMetal(RoughMetal {
                eta: *eta,
                k: *k,
                reflectance: color(reflectance),
                alpha: [number(&alpha[0]), number(&alpha[1])],
                distribution: *distribution,
                tangent: tangent(),
            }),
            General::Glass {
                ior,
                reflectance,
                transmittance,
                alpha,
                distribution,
            } => Bsdf::RoughGlass(RoughGlass {
                eta: if front { *ior } else { 1.0 / ior },
                reflectance: color(reflectance),
                transmittance: color(transmittance),
                alpha: [number(&alpha[0]), number(&alpha[1])],
                distribution: *distribution,
                tangent: tangent(),
            }),
            General::ThinGlass {
                ior,
                reflectance,
                transmittance,
            } => Bsdf::ThinGlass(ThinGlass {
                ior: *ior,
                reflectance: color(reflectance),
                transmittance: color(transmittance),
            }),
            General::CoatedDiffuse {
                reflectance,
                specular,
                coat,
                nonlinear,
            } => Bsdf::CoatedDiffuse(CoatedDiffuse {
                reflectance: color(reflectance),
                specular: color(specular),
                coat,
                nonlinear: *nonlinear,
            }),
            General::Principled(p) => {
                // Without solid glass there is no inside.
                let front = front || p.thin || !self.transmits();
                Bsdf::Principled(PrincipledBsdf {
                    base_color: color(&p.base_color),
                    roughness: number(&p.roughness),
                    anisotropic: number(&p.anisotropic),
                    metallic: number(&p.metallic),
                    spec_trans: number(&p.spec_trans),
                    eta: if front { p.ior } else { 1.0 / p.ior },
                    spec_tint: number(&p.spec_tint),
                    specular: number(&p.specular),
                    specular_color: p.specular_color.at::<true>(textures, point).map(|c| c.max(0.0)),
                    sheen: number(&p.sheen),
                    sheen_tint: number(&p.sheen_tint),
                    flatness: number(&p.flatness),
                    clearcoat: number(&p.clearcoat),
                    coat_alpha: if p.conserves {
                        number(&p.clearcoat_roughness).powi(2)
                    } else {
                        PrincipledBsdf::burley_coat_alpha(number(&p.clearcoat_gloss))
                    },
                    conserves: p.conserves,
                    thin: p.thin,
                    front,
                    tangent: tangent(),
                })
            }
            // Looked through before.
            General::Blend { .. } => Bsdf::Mirror(Rgb::BLACK),
        }
    }

    pub(super) fn visit_spectra(&self, visit: &mut dyn FnMut(&Spectrum)) {
        let mut scalar = |scalar: &Scalar| {
            if let Scalar::Varying(spectrum, _) = scalar {
                visit(spectrum);
            }
        };
        match self {
            General::Metal { reflectance, alpha, .. } => {
                alpha.iter().for_each(&mut scalar);
                visit(reflectance);
            }
            General::Glass {
                reflectance,
                transmittance,
                alpha,
                ..
            } => {
                alpha.iter().for_each(&mut scalar);
                [reflectance, transmittance].into_iter().for_each(visit);
            }
            General::ThinGlass {
                reflectance,
                transmittance,
                ..
            } => [reflectance, transmittance].into_iter().for_each(visit),
            General::CoatedDiffuse {
                reflectance, specular, ..
            } => [reflectance, specular].into_iter().for_each(visit),
            General::Principled(p) => {
                [
                    &p.roughness,
                    &p.anisotropic,
                    &p.metallic,
                    &p.spec_trans,
                    &p.spec_tint,
                    &p.specular,
                    &p.sheen,
                    &p.sheen_tint,
                    &p.flatness,
                    &p.clearcoat,
                    &p.clearcoat_gloss,
                    &p.clearcoat_roughness,
                ]
                .into_iter()
                .for_each(&mut scalar);
                [&p.base_color, &p.specular_color].into_iter().for_each(visit);
            }
            General::Blend { weight, .. } => scalar(weight),
        }
    }

    pub(super) fn transmits(&self) -> bool {
        match self {
            General::Glass { .. } | General::ThinGlass { .. } => true,
            General::Principled(p) => p.spec_trans != Scalar::Constant(0.0),
            General::Metal { .. } | General::CoatedDiffuse { .. } | General::Blend { .. } => false,
        }
    }

    pub(super) fn is_delta(&self) -> bool {
        let smooth = |alpha: &[Scalar; 2]| {
            alpha
                .iter()
                .all(|a| matches!(a, Scalar::Constant(a) if *a < crate::bsdf::SMOOTH_ALPHA))
        };
        match self {
            General::Metal { alpha, .. } | General::Glass { alpha, .. } => smooth(alpha),
            General::ThinGlass { .. } => true,
            // Nothing of its own: its parts decide.
            General::Blend { .. } => true,
            General::CoatedDiffuse { .. } | General::Principled(_) => false,
        }
    }
}
