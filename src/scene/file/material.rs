//! Materials. They refer to bitmaps and to each other by index as soon as they are read.

use super::colour::{COLOUR, COVERAGE, NUMBERS, RoleOf, colour, scalar, spectrum, texture_map};
use super::{Context, Result};
use crate::bsdf::{CoatTable, Distribution, PLASTIC_MIN_ALPHA};
use crate::material::{Back, General, MAX_NESTING, Material, Principled, Relief, Scalar, Scattering, Spectrum};
use crate::math::Rgb;
use crate::scene::bitmap::Role;
use crate::scene::value::{Field, KeyError, Table, decimal};
use crate::texture::TextureMap;

/// Largest part of a complex index; its fourth power is still within f32.
const MAX_INDEX: f64 = 1e6;

/// Indices of refraction that are allowed.
const IOR: [f64; 2] = [0.01, 100.0];

/// Largest channel of coverage, which is the mean of the three: a single one can then be all of it.
const MAX_COVERAGE: f64 = 3.0;

/// Largest factor on relief, either way.
const MAX_RELIEF: f64 = f32::MAX as f64;

/// Words of `back` that name no material.
pub(in crate::scene) const BACKS: [(&str, Back); 2] = [("same", Back::Same), ("black", Back::Black)];

#[derive(Clone, Copy)]
enum Kind {
    Diffuse,
    Conductor,
    Dielectric,
    Mirror,
    Plastic,
    RoughConductor,
    RoughDielectric,
    ThinDielectric,
    CoatedDiffuse,
    Principled,
    Blend,
}

pub(super) fn material(table: &Table<'_>, context: &mut Context<'_>) -> Result<Material> {
    let kind = table.require("type")?.word(&[
        ("diffuse", Kind::Diffuse),
        ("conductor", Kind::Conductor),
        ("dielectric", Kind::Dielectric),
        ("mirror", Kind::Mirror),
        ("plastic", Kind::Plastic),
        ("rough-conductor", Kind::RoughConductor),
        ("rough-dielectric", Kind::RoughDielectric),
        ("thin-dielectric", Kind::ThinDielectric),
        ("coated-diffuse", Kind::CoatedDiffuse),
        ("principled", Kind::Principled),
        ("blend", Kind::Blend),
    ])?;
    let material = Material {
        scattering: scattering(kind, table, context)?,
        opacity: table
            .get("opacity")
            .map(|f| spectrum(&f, MAX_COVERAGE, COVERAGE, context))
            .transpose()?,
        relief: relief(table, context)?,
        back: table.get("back").map_or(Ok(Back::Same), |f| back(&f, context))?,
    };
    table.finish()?;
    Ok(material)
}

fn scattering(kind: Kind, table: &Table<'_>, context: &mut Context<'_>) -> Result<Scattering> {
    let number = |key, default: f64, low: f64, high: f64| -> Result<f32> {
        Ok(table.get(key).map_or(Ok(default), |f| f.number_in(low, high))? as f32)
    };
    let alpha = |default: f64, low: f64| number("alpha", default, low, 1.0);
    Ok(match kind {
        Kind::Diffuse => Scattering::Diffuse {
            reflectance: main_colour(table, context)?,
        },
        Kind::Conductor => {
            let eta = table.require("eta")?;
            let index = eta.rgb_in(0.0, MAX_INDEX)?;
            if index.to_array().contains(&0.0) {
                return Err(eta.error("an index of 0 reflects nothing that is defined; give values above 0"));
            }
            Scattering::Conductor {
                eta: index,
                k: table.require("k")?.rgb_in(0.0, MAX_INDEX)?,
                alpha: alpha(0.0, 0.0)?,
            }
        }
        Kind::Dielectric => Scattering::Dielectric {
            ior: table.require("ior")?.number_in(IOR[0], IOR[1])? as f32,
            alpha: alpha(0.0, 0.0)?,
        },
        Kind::Mirror => Scattering::Mirror {
            reflectance: table.get("rgb").map_or(Ok(Rgb::WHITE), |f| f.rgb_in(0.0, 1.0))?,
        },
        Kind::Plastic => Scattering::Plastic {
            reflectance: main_colour(table, context)?,
            specular: table
                .get("specular")
                .map_or(Ok(Rgb::splat(0.04)), |f| f.rgb_in(0.0, 1.0))?,
            alpha: alpha(0.1, decimal(PLASTIC_MIN_ALPHA))?,
        },
        Kind::RoughConductor => {
            let (eta, k) = complex_index(table)?;
            Scattering::General(General::Metal {
                eta,
                k,
                reflectance: factor("reflectance", table, context)?,
                alpha: widths(table, context)?,
                distribution: distribution(table)?,
            })
        }
        Kind::RoughDielectric => Scattering::General(General::Glass {
            ior: number("ior", 1.5, IOR[0], IOR[1])?,
            reflectance: factor("reflectance", table, context)?,
            transmittance: factor("transmittance", table, context)?,
            alpha: widths(table, context)?,
            distribution: distribution(table)?,
        }),
        Kind::ThinDielectric => Scattering::General(General::ThinGlass {
            ior: number("ior", 1.5, IOR[0], IOR[1])?,
            reflectance: factor("reflectance", table, context)?,
            transmittance: factor("transmittance", table, context)?,
        }),
        Kind::CoatedDiffuse => Scattering::General(General::CoatedDiffuse {
            reflectance: main_colour(table, context)?,
            specular: factor("specular", table, context)?,
            coat: CoatTable::of(ior_above_one(table)?, alpha(0.0, 0.0)?, distribution(table)?),
            nonlinear: table.get("nonlinear").map_or(Ok(false), |f| f.flag())?,
        }),
        Kind::Principled => Scattering::General(General::Principled(Box::new(principled(table, context)?))),
        Kind::Blend => blend(table, context)?,
    })
}

fn principled(table: &Table<'_>, context: &mut Context<'_>) -> Result<Principled> {
    let default = Principled::new(main_colour(table, context)?);
    let conserves = table.get("conserves").map_or(Ok(default.conserves), |f| f.flag())?;
    let thin = table.get("thin").map_or(Ok(default.thin), |f| f.flag())?;
    let (without, why) = if conserves {
        (
            "clearcoat_gloss",
            "is for `conserves = false`; give `clearcoat_roughness`",
        )
    } else {
        (
            "clearcoat_roughness",
            "is not for `conserves = false`; give `clearcoat_gloss`",
        )
    };
    if let Some(field) = table.get(without) {
        return Err(field.error(why));
    }
    if let (Some(field), true, None) = (table.get("thin"), thin, table.get("spec_trans")) {
        return Err(field.error("says what transmits light is a thin wall; give `spec_trans` as well"));
    }
    let specular_color = factor("specular_color", table, context)?;
    let mut parameter = |key, default: Scalar| table.get(key).map_or(Ok(default), |f| scalar(&f, context));
    Ok(Principled {
        roughness: parameter("roughness", default.roughness)?,
        anisotropic: parameter("anisotropic", default.anisotropic)?,
        metallic: parameter("metallic", default.metallic)?,
        spec_trans: parameter("spec_trans", default.spec_trans)?,
        ior: ior_above_one(table)?,
        spec_tint: parameter("spec_tint", default.spec_tint)?,
        sheen: parameter("sheen", default.sheen)?,
        sheen_tint: parameter("sheen_tint", default.sheen_tint)?,
        flatness: parameter("flatness", default.flatness)?,
        clearcoat: parameter("clearcoat", default.clearcoat)?,
        clearcoat_gloss: parameter("clearcoat_gloss", default.clearcoat_gloss)?,
        clearcoat_roughness: parameter("clearcoat_roughness", default.clearcoat_roughness)?,
        specular: parameter("specular", default.specular)?,
        specular_color,
        conserves,
        thin,
        base_color: default.base_color,
    })
}

fn blend(table: &Table<'_>, context: &mut Context<'_>) -> Result<Scattering> {
    let field = table.require("materials")?;
    let names = field.array()?;
    let [first, second] = names.as_slice() else {
        return Err(field.error("expected the names of two materials"));
    };
    Ok(Scattering::General(General::Blend {
        weight: scalar(&table.require("weight")?, context)?,
        materials: [context.material(first)?, context.material(second)?],
    }))
}

/// The colour that is most of a material's look.
fn main_colour(table: &Table<'_>, context: &mut Context<'_>) -> Result<Spectrum> {
    colour(table, 1.0, COLOUR, context)?.ok_or_else(|| KeyError {
        problem: "is missing; give `rgb` = [r, g, b] or `texture` = \"file\"".into(),
        ..table.missing("rgb")
    })
}

/// A factor that is 1 if nobody gives it.
fn factor(key: &'static str, table: &Table<'_>, context: &mut Context<'_>) -> Result<Spectrum> {
    table.get(key).map_or(Ok(Spectrum::Constant(Rgb::WHITE)), |f| {
        spectrum(&f, 1.0, COLOUR, context)
    })
}

/// One width, or one along each of the texture coordinates.
fn widths(table: &Table<'_>, context: &mut Context<'_>) -> Result<[Scalar; 2]> {
    let Some(field) = table.get("alpha") else {
        return Ok([Scalar::Constant(0.1); 2]);
    };
    match field.array().as_deref() {
        Ok([along, across]) => Ok([scalar(along, context)?, scalar(across, context)?]),
        Ok(_) => Err(field.error("expected one width, or two: along and across the first texture coordinate")),
        Err(_) => scalar(&field, context).map(|width| [width; 2]),
    }
}

fn distribution(table: &Table<'_>) -> Result<Distribution> {
    table.get("distribution").map_or(Ok(Distribution::Ggx), |f| {
        f.word(&[("ggx", Distribution::Ggx), ("beckmann", Distribution::Beckmann)])
    })
}

fn complex_index(table: &Table<'_>) -> Result<(Rgb, Rgb)> {
    let field = table.require("eta")?;
    let eta = field.rgb_in(0.0, MAX_INDEX)?;
    let k = table.require("k")?.rgb_in(0.0, MAX_INDEX)?;
    let is_nothing = |(eta, k): (f32, f32)| eta == 0.0 && k == 0.0;
    if eta.to_array().into_iter().zip(k.to_array()).any(is_nothing) {
        return Err(field.error("an index of 0 without absorption reflects nothing that is defined"));
    }
    Ok((eta, k))
}

fn ior_above_one(table: &Table<'_>) -> Result<f32> {
    let Some(field) = table.get("ior") else {
        return Ok(1.5);
    };
    let ior = field.number_in(1.0, IOR[1])? as f32;
    if ior > 1.0 {
        Ok(ior)
    } else {
        Err(field.error("must be above 1"))
    }
}

fn relief(table: &Table<'_>, context: &mut Context<'_>) -> Result<Option<Relief>> {
    let (normals, heights) = (table.get("normal_map"), table.get("bump_map"));
    if let (Some(_), Some(heights)) = (&normals, &heights) {
        return Err(heights.error("stands beside `normal_map`; keep one"));
    }
    let mut map = |field: Field<'_>, role: RoleOf| -> Result<(TextureMap, f32)> {
        let table = field.table()?;
        let map = texture_map(&table, role, context)?.ok_or_else(|| table.missing("texture"))?;
        let scale = table
            .get("scale")
            .map_or(Ok(1.0), |f| f.number_in(-MAX_RELIEF, MAX_RELIEF))? as f32;
        table.finish()?;
        Ok((map, scale))
    };
    Ok(match (normals, heights) {
        (Some(field), _) => {
            let (map, scale) = map(field, NUMBERS)?;
            Some(Relief::NormalMap { map, scale })
        }
        (None, Some(field)) => {
            let (map, scale) = map(field, Role::Height)?;
            Some(Relief::BumpMap { map, scale })
        }
        (None, None) => None,
    })
}

fn back(field: &Field<'_>, context: &mut Context<'_>) -> Result<Back> {
    let name = field.string()?;
    match BACKS.iter().find(|(word, _)| *word == name) {
        Some((_, back)) => Ok(*back),
        None => context.material(field).map(Back::Material),
    }
}

/// Fails for materials that contain themselves, or others to more than [`MAX_NESTING`] levels.
pub(super) fn check_nesting(materials: &[(String, Material)]) -> Result<()> {
    // Levels below each material that is known to have an end.
    let mut depths = vec![None; materials.len()];
    for first in 0..materials.len() {
        depth(first, materials, &mut depths, &mut Vec::new())?;
    }
    Ok(())
}

fn depth(
    index: usize,
    materials: &[(String, Material)],
    depths: &mut [Option<usize>],
    above: &mut Vec<usize>,
) -> Result<usize> {
    let error = |problem: String| KeyError {
        key: format!("materials.{}", materials[index].0),
        problem,
    };
    if above.contains(&index) {
        let chain: Vec<&str> = above.iter().chain([&index]).map(|i| materials[*i].0.as_str()).collect();
        return Err(error(format!("refers to itself: {}", chain.join(" -> "))));
    }
    let levels = match depths[index] {
        Some(levels) => levels,
        None if above.len() < MAX_NESTING => {
            above.push(index);
            let mut levels = 0;
            for part in materials[index].1.parts() {
                levels = levels.max(1 + depth(part as usize, materials, depths, above)?);
                let (name, material) = &materials[part as usize];
                if material.opacity.is_some() {
                    return Err(error(format!(
                        "refers to \"{name}\", which has `opacity`: only that of a mesh's own material counts; give it that"
                    )));
                }
            }
            above.pop();
            depths[index] = Some(levels);
            levels
        }
        None => MAX_NESTING,
    };
    if above.len() + levels >= MAX_NESTING {
        return Err(error(format!(
            "stands within more than {MAX_NESTING} other materials, or holds them"
        )));
    }
    Ok(levels)
}
