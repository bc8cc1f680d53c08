//! Materials.

use super::super::load::LoadError;
use super::Importer;
use super::document::{Property, Tag, Value};
use super::props::{Props, label};
use super::tables::{CONDUCTORS, DIELECTRICS};
use super::texture::Use;
use crate::bsdf::{CoatTable, Distribution};
use crate::material::{Back, General, MAX_NESTING, Material, Principled, Relief, Scalar, Scattering, Spectrum};
use crate::math::Rgb;

const SUPPORTED: &str = "diffuse, twosided, conductor, roughconductor, dielectric, roughdielectric, thindielectric, \
                         plastic, roughplastic, principled, mask, normalmap, bumpmap, blendbsdf";

const WHITE: Spectrum = Spectrum::Constant(Rgb::WHITE);

impl Importer<'_> {
    /// The index of the material of an object, which is converted once.
    pub(super) fn material(&mut self, node: usize, depth: usize) -> Result<u32, LoadError> {
        if let Some(&material) = self.materials_of_nodes.get(&node) {
            return Ok(material);
        }
        let material = self.bsdf(node, depth)?;
        let name = match &self.document.nodes[node].id {
            id if id.is_empty() => self.document.describe(self.document.nodes[node].place),
            id => id.clone(),
        };
        let index = self.add_material(name, material);
        self.materials_of_nodes.insert(node, index);
        Ok(index)
    }

    pub(super) fn add_material(&mut self, name: String, material: Material) -> u32 {
        self.materials.push((name, material));
        self.materials.len() as u32 - 1
    }

    fn bsdf(&mut self, node: usize, depth: usize) -> Result<Material, LoadError> {
        let mut props = Props::new(self.document, node);
        if depth > MAX_NESTING {
            return Err(props.error(format!("is nested deeper than {MAX_NESTING} materials")));
        }
        let material = match props.node.plugin.as_str() {
            "diffuse" => one_sided(Scattering::Diffuse {
                reflectance: self.color(&mut props, "reflectance", 0.5, Use::Reflectance)?,
            }),
            "conductor" => {
                let smooth = [Scalar::Constant(0.0); 2];
                self.conductor(&mut props, smooth, Distribution::Ggx)?
            }
            "roughconductor" => {
                let (alpha, distribution) = self.roughness(&mut props)?;
                self.conductor(&mut props, alpha, distribution)?
            }
            "dielectric" => {
                let smooth = [Scalar::Constant(0.0); 2];
                self.dielectric(&mut props, smooth, Distribution::Ggx)?
            }
            "roughdielectric" => {
                let (alpha, distribution) = self.roughness(&mut props)?;
                self.dielectric(&mut props, alpha, distribution)?
            }
            "thindielectric" => Material::new(Scattering::General(General::ThinGlass {
                ior: ior(&mut props, "bk7")?,
                reflectance: self.color(&mut props, "specular_reflectance", 1.0, Use::Reflectance)?,
                transmittance: self.color(&mut props, "specular_transmittance", 1.0, Use::Reflectance)?,
            })),
            "plastic" => self.plastic(&mut props, 0.0, Distribution::Ggx)?,
            "roughplastic" => {
                let distribution = distribution(&mut props)?;
                let alpha = props.float_in("alpha", 0.1, 0.0..=1.0)?;
                self.plastic(&mut props, alpha as f32, distribution)?
            }
            "principled" => self.principled(&mut props)?,
            "mask" => {
                let opacity = self.grey(&mut props, "opacity", 0.5)?;
                let inner = self.only_child(&mut props)?;
                let mut material = self.bsdf(inner, depth + 1)?;
                if material.opacity.is_some() {
                    return Err(props.error("stands around another mask; combine the two into one"));
                }
                material.opacity = (opacity != WHITE).then_some(opacity);
                material
            }
            "normalmap" => {
                let map = match props.take("normalmap") {
                    Some(Property {
                        value: Value::Object(map),
                        ..
                    }) => self.vectors(*map)?,
                    _ => return Err(props.error("has no <texture name=\"normalmap\">")),
                };
                self.with_relief(&mut props, Relief::NormalMap { map, scale: 1.0 }, depth)?
            }
            "bumpmap" => {
                let scale = props.float("scale")?.unwrap_or(1.0) as f32;
                let map = props.child(Tag::Texture)?;
                let map = map.ok_or_else(|| props.error("has no <texture>"))?;
                let map = self.heights(map)?;
                self.with_relief(&mut props, Relief::BumpMap { map, scale }, depth)?
            }
            "twosided" => self.two_sided(&mut props, depth)?,
            "blendbsdf" => {
                let weight = match props.take("weight") {
                    None => return Err(props.error("has no parameter \"weight\"")),
                    Some(_) => self.number(&mut props, "weight", 0.5)?,
                };
                let children = props.children(Tag::Bsdf);
                let [first, second] = children[..] else {
                    return Err(props.error(format!("has {} child BSDFs; expected 2", children.len())));
                };
                let parts = [self.material(first, depth + 1)?, self.material(second, depth + 1)?];
                for (part, child) in parts.iter().zip([first, second]) {
                    if self.materials[*part as usize].1.opacity.is_some() {
                        let child = &self.document.nodes[child];
                        let problem = "cannot stand within a blendbsdf; put the mask around the blendbsdf";
                        return Err(self.document.error(child.place, &label(child), problem));
                    }
                }
                Material::new(Scattering::General(General::Blend {
                    weight,
                    materials: parts,
                }))
            }
            "null" => {
                return Err(props.error("is the surface of a participating medium, which is not supported"));
            }
            _ => return Err(props.error(format!("is not supported; supported BSDFs: {SUPPORTED}"))),
        };
        props.finish()?;
        Ok(material)
    }

    fn only_child(&mut self, props: &mut Props) -> Result<usize, LoadError> {
        let child = props.child(Tag::Bsdf)?;
        child.ok_or_else(|| props.error("has no child BSDF; expected one"))
    }

    /// The widths of a rough surface.
    fn roughness(&mut self, props: &mut Props) -> Result<([Scalar; 2], Distribution), LoadError> {
        let distribution = distribution(props)?;
        let has = |name: &str| props.node.properties.iter().any(|property| property.name == name);
        let (u, v, both) = (has("alpha_u"), has("alpha_v"), has("alpha"));
        if u != v || u && both {
            return Err(props.error("expected either \"alpha\" or both of \"alpha_u\" and \"alpha_v\""));
        }
        let alpha = if u {
            [self.number(props, "alpha_u", 0.1)?, self.number(props, "alpha_v", 0.1)?]
        } else {
            [self.number(props, "alpha", 0.1)?; 2]
        };
        if alpha
            .iter()
            .any(|a| matches!(a, Scalar::Constant(a) if !(0.0..=1.0).contains(a)))
        {
            return Err(props.error("has an alpha outside [0, 1]"));
        }
        Ok((alpha, distribution))
    }

    fn conductor(
        &mut self,
        props: &mut Props,
        alpha: [Scalar; 2],
        distribution: Distribution,
    ) -> Result<Material, LoadError> {
        let reflectance = self.color(props, "specular_reflectance", 1.0, Use::Reflectance)?;
        let has_index = props.node.properties.iter().any(|property| property.name == "eta");
        let material = props.string("material")?;
        let named = material.filter(|name| *name != "none");
        let (eta, k) = match named {
            Some(_) if has_index => return Err(props.error("has both \"material\" and \"eta\"; expected one of them")),
            Some(name) => {
                props.ignore(&["eta", "k"]);
                conductor_by_name(name).ok_or_else(|| {
                    let names: Vec<&str> = CONDUCTORS.iter().map(|(name, ..)| *name).collect();
                    let names = names.join(", ");
                    props.error(format!(
                        "material \"{name}\" is not known; expected none, or one of {names}"
                    ))
                })?
            }
            None => (
                self.constant(props, "eta", 0.0, Use::Unbounded)?,
                self.constant(props, "k", 1.0, Use::Unbounded)?,
            ),
        };
        Ok(one_sided(match (alpha, &reflectance) {
            // The exact Fresnel equations with the index i reflect all light.
            ([Scalar::Constant(0.0), Scalar::Constant(0.0)], &Spectrum::Constant(reflectance))
                if eta.is_black() && k == Rgb::WHITE =>
            {
                Scattering::Mirror { reflectance }
            }
            ([Scalar::Constant(0.0), Scalar::Constant(0.0)], &WHITE) => Scattering::Conductor { eta, k, alpha: 0.0 },
            _ => Scattering::General(General::Metal {
                eta,
                k,
                reflectance,
                alpha,
                distribution,
            }),
        }))
    }

    fn dielectric(
        &mut self,
        props: &mut Props,
        alpha: [Scalar; 2],
        distribution: Distribution,
    ) -> Result<Material, LoadError> {
        let ior = ior(props, "bk7")?;
        let reflectance = self.color(props, "specular_reflectance", 1.0, Use::Reflectance)?;
        let transmittance = self.color(props, "specular_transmittance", 1.0, Use::Reflectance)?;
        let is_plain = alpha == [Scalar::Constant(0.0); 2] && reflectance == WHITE && transmittance == WHITE;
        Ok(Material::new(if is_plain {
            Scattering::Dielectric { ior, alpha: 0.0 }
        } else {
            Scattering::General(General::Glass {
                ior,
                reflectance,
                transmittance,
                alpha,
                distribution,
            })
        }))
    }

    fn plastic(&mut self, props: &mut Props, alpha: f32, distribution: Distribution) -> Result<Material, LoadError> {
        let ior = ior(props, "polypropylene")?;
        if ior <= 1.0 {
            return Err(props.error(format!(
                "has a coat of relative index {ior}; expected int_ior above ext_ior"
            )));
        }
        Ok(one_sided(Scattering::General(General::CoatedDiffuse {
            reflectance: self.color(props, "diffuse_reflectance", 0.5, Use::Reflectance)?,
            specular: self.color(props, "specular_reflectance", 1.0, Use::Reflectance)?,
            nonlinear: props.boolean("nonlinear", false)?,
            coat: CoatTable::of(ior, alpha, distribution),
        })))
    }

    fn principled(&mut self, props: &mut Props) -> Result<Material, LoadError> {
        // How often each part is sampled changes noise alone.
        props.ignore(&[
            "main_specular_sampling_rate",
            "clearcoat_sampling_rate",
            "diffuse_reflectance_sampling_rate",
        ]);
        let base_color = self.color(props, "base_color", 0.5, Use::Reflectance)?;
        let mut number = |name, default| self.number(props, name, default);
        let mut principled = Principled {
            base_color,
            roughness: number("roughness", 0.5)?,
            anisotropic: number("anisotropic", 0.0)?,
            metallic: number("metallic", 0.0)?,
            spec_trans: number("spec_trans", 0.0)?,
            ior: 0.0,
            spec_tint: number("spec_tint", 0.0)?,
            sheen: number("sheen", 0.0)?,
            sheen_tint: number("sheen_tint", 0.0)?,
            flatness: number("flatness", 0.0)?,
            clearcoat: number("clearcoat", 0.0)?,
            clearcoat_gloss: number("clearcoat_gloss", 0.0)?,
            // As Mitsuba has it.
            conserves: false,
            ..Principled::new(base_color)
        };
        let (eta, specular) = (props.float("eta")?, props.float("specular")?);
        let eta = match (eta, specular) {
            (Some(_), Some(_)) => return Err(props.error("has both \"eta\" and \"specular\"; expected one of them")),
            (Some(eta), None) => eta,
            // What reflects 8 % of that at normal incidence.
            (None, specular) => 2.0 / (1.0 - (0.08 * specular.unwrap_or(0.5)).sqrt()) - 1.0,
        };
        if !(1.0..=100.0).contains(&eta) {
            return Err(props.error(format!("has the index of refraction {eta}; expected 1 to 100")));
        }
        // As near to no interface at all as Mitsuba comes.
        principled.ior = eta.max(1.001) as f32;
        let general = General::Principled(Box::new(principled));
        let scattering = Scattering::General(general);
        let material = Material::new(scattering.clone());
        Ok(if material.transmits() {
            material
        } else {
            one_sided(scattering)
        })
    }

    fn with_relief(&mut self, props: &mut Props, relief: Relief, depth: usize) -> Result<Material, LoadError> {
        // Light from directions that are below one of the two surfaces is treated in one way only.
        props.boolean("flip_invalid_normals", true)?;
        if !props.boolean("use_shadowing_function", true)? {
            let note = format!(
                "{}: use_shadowing_function=false is ignored",
                self.document.describe(props.node.place)
            );
            self.warn(note);
        }
        let inner = self.only_child(props)?;
        let mut material = self.bsdf(inner, depth + 1)?;
        if material.relief.is_some() {
            return Err(props.error("stands around another normal or bump map, which is not supported"));
        }
        if material.parts().next().is_some() {
            return Err(props.error(
                "stands around a blendbsdf or a twosided BSDF, which is not supported; put the map around each of their children",
            ));
        }
        material.relief = Some(relief);
        Ok(material)
    }

    fn two_sided(&mut self, props: &mut Props, depth: usize) -> Result<Material, LoadError> {
        let may_transmit = props.boolean("allow_transmission", false)?;
        let children = props.children(Tag::Bsdf);
        let ([front] | [front, _]) = children[..] else {
            return Err(props.error(format!("has {} child BSDFs; expected 1 or 2", children.len())));
        };
        let front = self.material(front, depth + 1)?;
        let back = match children.get(1) {
            Some(&back) => self.material(back, depth + 1)?,
            None => front,
        };
        for side in [front, back] {
            let material = &self.materials[side as usize].1;
            if material.opacity.is_some() {
                return Err(props.error("stands around a mask; put the mask around the twosided BSDF"));
            }
            if material.transmits() && !may_transmit {
                return Err(props.error("stands around a BSDF that transmits light, which has two sides by itself"));
            }
        }
        let mut material = self.materials[front as usize].1.clone();
        // The parts of a mixture are black from behind; what transmits is seen from inside there.
        let is_blend = matches!(material.scattering, Scattering::General(General::Blend { .. }));
        let is_symmetric = !is_blend && !material.transmits();
        material.back = if front == back && is_symmetric {
            Back::Same
        } else {
            Back::Material(back)
        };
        Ok(material)
    }
}

/// What absorbs all light from behind, as opaque BSDFs do unless `twosided` stands around them.
pub(super) fn one_sided(scattering: Scattering) -> Material {
    Material {
        back: Back::Black,
        ..Material::new(scattering)
    }
}

fn distribution(props: &mut Props) -> Result<Distribution, LoadError> {
    // Both ways to sample have the same mean.
    props.boolean("sample_visible", true)?;
    let known = [("beckmann", Distribution::Beckmann), ("ggx", Distribution::Ggx)];
    props.word("distribution", &known, Distribution::Beckmann)
}

/// The index inside over that outside, each a number or a name.
fn ior(props: &mut Props, default: &str) -> Result<f32, LoadError> {
    let inside = one_ior(props, "int_ior", default)?;
    let outside = one_ior(props, "ext_ior", "air")?;
    Ok((inside / outside) as f32)
}

fn one_ior(props: &mut Props, name: &'static str, default: &str) -> Result<f64, LoadError> {
    let by_name = |text: &str| {
        DIELECTRICS
            .iter()
            .find(|(known, _)| known.eq_ignore_ascii_case(text))
            .map(|row| row.1)
    };
    let Some(property) = props.take(name) else {
        return Ok(by_name(default).unwrap_or(1.0));
    };
    let value = match &property.value {
        Value::Float(f) => *f,
        Value::Integer(i) => *i as f64,
        Value::String(text) => by_name(text).ok_or_else(|| {
            let names: Vec<&str> = DIELECTRICS.iter().map(|(name, _)| *name).collect();
            let problem = format!(
                "\"{text}\" is not known; expected a number or one of {}",
                names.join(", ")
            );
            props.error_at(property, problem)
        })?,
        _ => return Err(props.error_at(property, "is no index; expected <float> or <string>")),
    };
    if (0.01..=100.0).contains(&value) {
        Ok(value)
    } else {
        Err(props.error_at(
            property,
            format!("{value} is no index of refraction; expected 0.01 to 100"),
        ))
    }
}

fn conductor_by_name(name: &str) -> Option<(Rgb, Rgb)> {
    // The source of the spectrum, where it goes without saying.
    let plain = name.strip_suffix("_palik").unwrap_or(name);
    let row = |name: &str| CONDUCTORS.iter().find(|(known, ..)| *known == name);
    let &(_, eta, k) = row(name).or_else(|| row(plain))?;
    Some((Rgb::from(eta), Rgb::from(k)))
}
