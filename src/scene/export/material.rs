//! Materials as tables of a scene file.

use super::Names;
use super::text::{Item, Keys};
use crate::bsdf::Distribution;
use crate::material::{Back, Channel, General, Material, Principled, Relief, Scalar, Scattering, Spectrum};
use crate::math::{Affine2, Rgb};
use crate::texture::{Encoding, Filter, TextureMap, Wrap};

/// What a scene file calls the type of a material.
pub fn material_type(material: &Material) -> &'static str {
    match &material.scattering {
        Scattering::Diffuse { .. } => "diffuse",
        Scattering::Conductor { .. } => "conductor",
        Scattering::Dielectric { .. } => "dielectric",
        Scattering::Mirror { .. } => "mirror",
        Scattering::Plastic { .. } => "plastic",
        Scattering::General(General::Metal { .. }) => "rough-conductor",
        Scattering::General(General::Glass { .. }) => "rough-dielectric",
        Scattering::General(General::ThinGlass { .. }) => "thin-dielectric",
        Scattering::General(General::CoatedDiffuse { .. }) => "coated-diffuse",
        Scattering::General(General::Principled(_)) => "principled",
        Scattering::General(General::Blend { .. }) => "blend",
    }
}

/// All keys of a material.
pub(super) fn material(material: &Material, names: &Names) -> Keys {
    let mut keys = vec![("type", material_type(material).into())];
    let mut add = |key, item| keys.push((key, item));
    match &material.scattering {
        Scattering::Diffuse { reflectance } => add_colour(&mut add, reflectance, names),
        Scattering::Conductor { eta, k, alpha } => {
            add("eta", (*eta).into());
            add("k", (*k).into());
            add("alpha", (*alpha).into());
        }
        Scattering::Dielectric { ior, alpha } => {
            add("ior", (*ior).into());
            add("alpha", (*alpha).into());
        }
        Scattering::Mirror { reflectance } => add("rgb", (*reflectance).into()),
        Scattering::Plastic {
            reflectance,
            specular,
            alpha,
        } => {
            add_colour(&mut add, reflectance, names);
            add("specular", (*specular).into());
            add("alpha", (*alpha).into());
        }
        Scattering::General(general) => add_general(&mut add, general, names),
    }
    if let Some(opacity) = &material.opacity {
        keys.push(("opacity", spectrum(opacity, names)));
    }
    if let Some(relief) = &material.relief {
        let (key, scale) = match relief {
            Relief::NormalMap { scale, .. } => ("normal_map", *scale),
            Relief::BumpMap { scale, .. } => ("bump_map", *scale),
        };
        let mut table = texture_map(&relief.map(), names);
        table.push(("scale", scale.into()));
        keys.push((key, Item::Table(table)));
    }
    match material.back {
        Back::Same => {}
        Back::Black => keys.push(("back", "black".into())),
        Back::Material(other) => keys.push(("back", names.material(other).into())),
    }
    keys
}

fn add_general(add: &mut impl FnMut(&'static str, Item), general: &General, names: &Names) {
    match general {
        General::Metal {
            eta,
            k,
            reflectance,
            alpha,
            distribution,
        } => {
            add("eta", (*eta).into());
            add("k", (*k).into());
            add_factor(add, "reflectance", reflectance, names);
            add("alpha", widths(alpha, names));
            add_distribution(add, *distribution);
        }
        General::Glass {
            ior,
            reflectance,
            transmittance,
            alpha,
            distribution,
        } => {
            add("ior", (*ior).into());
            add_factor(add, "reflectance", reflectance, names);
            add_factor(add, "transmittance", transmittance, names);
            add("alpha", widths(alpha, names));
            add_distribution(add, *distribution);
        }
        General::ThinGlass {
            ior,
            reflectance,
            transmittance,
        } => {
            add("ior", (*ior).into());
            add_factor(add, "reflectance", reflectance, names);
            add_factor(add, "transmittance", transmittance, names);
        }
        General::CoatedDiffuse {
            reflectance,
            specular,
            coat,
            nonlinear,
        } => {
            add_colour(add, reflectance, names);
            add_factor(add, "specular", specular, names);
            add("ior", coat.ior.into());
            add("alpha", coat.alpha.into());
            add_distribution(add, coat.distribution);
            add("nonlinear", (*nonlinear).into());
        }
        General::Principled(principled) => add_principled(add, principled, names),
        General::Blend { weight, materials } => {
            add("weight", scalar(weight, names));
            add("materials", materials.map(|m| names.material(m)).into());
        }
    }
}

fn add_principled(add: &mut impl FnMut(&'static str, Item), principled: &Principled, names: &Names) {
    add_colour(add, &principled.base_color, names);
    add("ior", principled.ior.into());
    let default = Principled::new(principled.base_color);
    // Each coat has its own.
    let coat = if principled.conserves {
        (
            "clearcoat_roughness",
            principled.clearcoat_roughness,
            Some(default.clearcoat_roughness),
        )
    } else {
        (
            "clearcoat_gloss",
            principled.clearcoat_gloss,
            Some(default.clearcoat_gloss),
        )
    };
    for (key, parameter, default) in [
        ("roughness", principled.roughness, None),
        ("anisotropic", principled.anisotropic, Some(default.anisotropic)),
        ("metallic", principled.metallic, Some(default.metallic)),
        ("spec_trans", principled.spec_trans, Some(default.spec_trans)),
        ("spec_tint", principled.spec_tint, Some(default.spec_tint)),
        ("sheen", principled.sheen, Some(default.sheen)),
        ("sheen_tint", principled.sheen_tint, Some(default.sheen_tint)),
        ("flatness", principled.flatness, Some(default.flatness)),
        ("clearcoat", principled.clearcoat, Some(default.clearcoat)),
        coat,
        ("specular", principled.specular, Some(default.specular)),
    ] {
        if default != Some(parameter) {
            add(key, scalar(&parameter, names));
        }
    }
    add_factor(add, "specular_color", &principled.specular_color, names);
    if !principled.conserves {
        add("conserves", false.into());
    }
    if principled.thin && principled.spec_trans != default.spec_trans {
        add("thin", true.into());
    }
}

fn add_colour(add: &mut impl FnMut(&'static str, Item), spectrum: &Spectrum, names: &Names) {
    colour(spectrum, names)
        .into_iter()
        .for_each(|(key, item)| add(key, item));
}

fn add_factor(add: &mut impl FnMut(&'static str, Item), key: &'static str, factor: &Spectrum, names: &Names) {
    if *factor != Spectrum::Constant(Rgb::WHITE) {
        add(key, spectrum(factor, names));
    }
}

fn add_distribution(add: &mut impl FnMut(&'static str, Item), distribution: Distribution) {
    match distribution {
        Distribution::Ggx => {}
        Distribution::Beckmann => add("distribution", "beckmann".into()),
    }
}

fn widths([along, across]: &[Scalar; 2], names: &Names) -> Item {
    if along == across {
        scalar(along, names)
    } else {
        Item::List([along, across].map(|width| scalar(width, names)).into())
    }
}

/// A colour as keys of a table.
pub(super) fn colour(spectrum: &Spectrum, names: &Names) -> Keys {
    let tinted = |mut keys: Keys, tint: &Rgb| {
        if *tint != Rgb::WHITE {
            keys.push(("tint", (*tint).into()));
        }
        keys
    };
    match spectrum {
        Spectrum::Constant(rgb) => vec![("rgb", (*rgb).into())],
        Spectrum::Bitmap(map, tint) => tinted(texture_map(map, names), tint),
        Spectrum::Checkerboard(pattern) => {
            let mut keys = vec![("checkerboard", pattern.colors.into())];
            keys.extend(placement(&pattern.to_uv));
            keys
        }
        Spectrum::VertexColor(map, tint) => {
            let mut keys = vec![("vertex_colors", true.into())];
            keys.extend(map.iter().flat_map(|map| texture_map(map, names)));
            tinted(keys, tint)
        }
    }
}

/// A colour as a value.
fn spectrum(spectrum: &Spectrum, names: &Names) -> Item {
    match spectrum {
        Spectrum::Constant(rgb) if rgb.r == rgb.g && rgb.g == rgb.b => rgb.r.into(),
        Spectrum::Constant(rgb) => (*rgb).into(),
        _ => Item::Table(colour(spectrum, names)),
    }
}

fn scalar(scalar: &Scalar, names: &Names) -> Item {
    match scalar {
        Scalar::Constant(value) => (*value).into(),
        Scalar::Varying(spectrum, channel) => {
            let mut keys = colour(spectrum, names);
            let channel = match channel {
                Channel::R => "r",
                Channel::G => "g",
                Channel::B => "b",
                Channel::Mean => "mean",
                Channel::Luminance => "luminance",
            };
            keys.push(("channel", channel.into()));
            Item::Table(keys)
        }
    }
}

fn texture_map(map: &TextureMap, names: &Names) -> Keys {
    let (file, encoding) = names.texture(map.texture);
    let mut keys = vec![("texture", file.as_str().into())];
    // The default depends on what a bitmap is for.
    keys.extend(encoding.map(|encoding| {
        let word = match encoding {
            Encoding::Srgb => "srgb",
            Encoding::Linear => "linear",
        };
        ("encoding", word.into())
    }));
    keys.extend(placement(&map.to_uv));
    let word = |wrap| match wrap {
        Wrap::Repeat => "repeat",
        Wrap::Mirror => "mirror",
        Wrap::Clamp => "clamp",
    };
    match map.wrap {
        [Wrap::Repeat, Wrap::Repeat] => {}
        [across, up] if across == up => keys.push(("wrap", word(up).into())),
        wraps => keys.push(("wrap", wraps.map(word).into())),
    }
    match map.filter {
        Filter::Bilinear => {}
        Filter::Nearest => keys.push(("filter", "nearest".into())),
    }
    keys
}

fn placement(to_uv: &Affine2) -> Option<(&'static str, Item)> {
    let [x, y, at] = [to_uv.matrix2.x_axis, to_uv.matrix2.y_axis, to_uv.translation];
    let rows = [[x.x, y.x, at.x], [x.y, y.y, at.y]];
    (*to_uv != Affine2::IDENTITY).then(|| ("to_uv", rows.into()))
}
