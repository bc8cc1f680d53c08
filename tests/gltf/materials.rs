//! Materials.

use super::file::*;
use embrace::material::{Back, Channel, General, Material, Principled, Relief, Scalar, Scattering, Spectrum};
use embrace::math::Rgb;
use embrace::scene::SceneDesc;
use embrace::texture::Texture;
use serde_json::{Value, json};

fn principled(material: &Material) -> &Principled {
    match &material.scattering {
        Scattering::General(General::Principled(p)) => p,
        other => panic!("{other:?}"),
    }
}

/// A square with the material, which is the first one.
fn load(material: Value) -> SceneDesc {
    let desc = with_texture(material).load();
    assert_eq!(desc.objects[0].material, 0);
    desc
}

fn with_texture(material: Value) -> File {
    let mut file = File::square(Some(material));
    file.texture(&png([[255, 0, 0, 0], [0, 255, 0, 100], [0, 0, 255, 128], [255; 4]]));
    file
}

fn extended(name: &str, content: Value) -> Value {
    json!({ "extensions": { name: content } })
}

#[test]
fn the_default_is_rough_white_metal_and_factors_are_taken_as_they_are() {
    let desc = File::square(None).load_without_warnings();
    let default = principled(&desc.materials[0].1);
    assert_eq!(default.base_color, Spectrum::Constant(Rgb::WHITE));
    assert_eq!(
        (default.metallic, default.roughness),
        (Scalar::Constant(1.0), Scalar::Constant(1.0))
    );
    assert_eq!(desc.materials[0].1.opacity, None);

    let desc = load(json!({
        "name": "paint",
        "pbrMetallicRoughness": { "baseColorFactor": [0.1, 0.2, 0.3, 0.4], "metallicFactor": 0.25, "roughnessFactor": 0.5 },
    }));
    let (name, material) = &desc.materials[0];
    assert_eq!(name, "materials[0] (paint)");
    let paint = principled(material);
    assert_eq!(paint.base_color, Spectrum::Constant(Rgb::new(0.1, 0.2, 0.3)));
    assert_eq!(
        (paint.metallic, paint.roughness),
        (Scalar::Constant(0.25), Scalar::Constant(0.5))
    );
    assert_eq!((paint.ior, paint.spec_trans), (1.5, Scalar::Constant(0.0)));
    // Alpha says nothing unless its mode does.
    assert_eq!(material.opacity, None);
}

#[test]
fn surfaces_look_alike_from_both_sides_and_glass_has_an_inside() {
    for double_sided in [true, false] {
        let desc = load(json!({ "doubleSided": double_sided, "normalTexture": { "index": 0 } }));
        assert_eq!((desc.materials.len(), desc.materials[0].1.back), (1, Back::Same));
    }
    let glass = load(extended(
        "KHR_materials_transmission",
        json!({ "transmissionFactor": 1 }),
    ));
    assert_eq!((glass.materials.len(), glass.materials[0].1.back), (1, Back::Same));
}

#[test]
fn metal_is_blue_and_roughness_green_times_their_factors() {
    let desc = load(json!({
        "pbrMetallicRoughness": {
            "metallicRoughnessTexture": { "index": 0 }, "metallicFactor": 0.5, "roughnessFactor": 0.75,
        },
    }));
    let p = principled(&desc.materials[0].1);
    let number = |scalar: &Scalar| match scalar {
        Scalar::Varying(Spectrum::Bitmap(_, tint), channel) => (tint.g, *channel),
        other => panic!("{other:?}"),
    };
    assert_eq!(number(&p.metallic), (0.5, Channel::B));
    assert_eq!(number(&p.roughness), (0.75, Channel::G));
}

#[test]
fn normal_maps_keep_their_scale_and_occlusion_is_ignored_with_a_warning() {
    let desc = load(json!({ "normalTexture": { "index": 0, "scale": 0.5 } }));
    assert!(matches!(
        desc.materials[0].1.relief,
        Some(Relief::NormalMap { scale: 0.5, .. })
    ));
    let file = with_texture(json!({ "name": "wall", "occlusionTexture": { "index": 0 } }));
    assert!(
        file.warning()
            .contains("materials[0] (wall): the occlusion texture is ignored")
    );
}

#[test]
fn emission_is_factor_times_strength_times_texture_on_the_sides_that_there_are() {
    let desc = load(json!({
        "emissiveFactor": [1, 0.5, 0],
        "emissiveTexture": { "index": 0 },
        "extensions": { "KHR_materials_emissive_strength": { "emissiveStrength": 8 } },
    }));
    let object = &desc.objects[0];
    let emission = object.emission.expect("a lamp");
    assert_eq!(
        (emission.radiance, emission.both_sides),
        (Rgb::new(8.0, 4.0, 0.0), false)
    );
    assert!(matches!(object.emission_map, Some(Spectrum::Bitmap(_, Rgb::WHITE))));
    // It is a lamp: nothing else needs to light the scene.
    assert!(desc.environment.is_none());

    let desc = load(json!({ "emissiveFactor": [1, 1, 1], "doubleSided": true }));
    assert!(desc.objects[0].emission.expect("a lamp").both_sides);
    assert_eq!(desc.objects[0].emission_map, None);
    assert!(desc.environment.is_none());
    // A glow that is painted on does not make a lamp.
    let desc = load(json!({ "emissiveFactor": [1, 1, 1], "emissiveTexture": { "index": 0 } }));
    assert!(desc.objects[0].emission.is_some() && desc.environment.is_some());
    let desc = load(json!({ "emissiveTexture": { "index": 0 } }));
    assert_eq!((desc.objects[0].emission, desc.objects[0].emission_map), (None, None));
}

fn coverage(desc: &SceneDesc) -> Vec<u8> {
    match desc.materials[0].1.opacity {
        Some(Spectrum::Bitmap(map, Rgb::WHITE)) => match &desc.textures[map.texture as usize] {
            Texture::Rgb8(image, _) => image.pixels.iter().map(|p| p[0]).collect(),
            other => panic!("{other:?}"),
        },
        other => panic!("{other:?}"),
    }
}

#[test]
fn a_mask_is_there_or_not_by_its_cutoff() {
    let masked = |alpha: f32, more: Value| {
        let mut material = json!({
            "alphaMode": "MASK",
            "pbrMetallicRoughness": { "baseColorTexture": { "index": 0 }, "baseColorFactor": [1, 1, 1, alpha] },
        });
        material
            .as_object_mut()
            .unwrap()
            .extend(more.as_object().unwrap().clone());
        load(material)
    };
    // The alphas are 0, 100, 128 and 255, and the cutoff is a half.
    assert_eq!(coverage(&masked(1.0, json!({}))), [0, 0, 255, 255]);
    assert_eq!(
        coverage(&masked(1.0, json!({ "alphaCutoff": 0.3 }))),
        [0, 255, 255, 255]
    );
    // The factor counts.
    assert_eq!(coverage(&masked(0.75, json!({}))), [0, 0, 0, 255]);
    assert_eq!(coverage(&masked(1.0, json!({ "alphaCutoff": 1.5 }))), [0; 4]);
    // What is there everywhere costs nothing.
    let all = masked(1.0, json!({ "alphaCutoff": 0 }));
    assert_eq!(all.materials[0].1.opacity, None);
    let plain = |alpha: f32| {
        let desc =
            load(json!({ "alphaMode": "MASK", "pbrMetallicRoughness": { "baseColorFactor": [1, 1, 1, alpha] } }));
        desc.materials[0].1.opacity
    };
    assert_eq!(plain(0.5), None);
    assert_eq!(plain(0.25), Some(Spectrum::Constant(Rgb::BLACK)));
}

#[test]
fn a_blend_is_there_as_often_as_its_alpha_says() {
    let blended = |pbr: Value| load(json!({ "alphaMode": "BLEND", "pbrMetallicRoughness": pbr }));
    let desc = blended(json!({ "baseColorTexture": { "index": 0 } }));
    assert_eq!(coverage(&desc), [0, 100, 128, 255]);
    let desc = blended(json!({ "baseColorTexture": { "index": 0 }, "baseColorFactor": [1, 1, 1, 0.5] }));
    assert!(
        matches!(desc.materials[0].1.opacity, Some(Spectrum::Bitmap(_, tint)) if tint == Rgb::splat(0.5)),
        "{:?}",
        desc.materials[0].1.opacity
    );
    let desc = blended(json!({ "baseColorFactor": [1, 1, 1, 0.5] }));
    assert_eq!(desc.materials[0].1.opacity, Some(Spectrum::Constant(Rgb::splat(0.5))));
    // An image without alpha is opaque.
    let mut file = File::square(Some(
        json!({ "alphaMode": "BLEND", "pbrMetallicRoughness": { "baseColorTexture": { "index": 0 } } }),
    ));
    let image = image::DynamicImage::from(image::RgbImage::from_pixel(2, 2, image::Rgb([9; 3])));
    file.texture(&encode(&image, image::ImageFormat::Png));
    assert_eq!(file.load_without_warnings().materials[0].1.opacity, None);
}

#[test]
fn vertex_colours_multiply_the_base_colour_and_the_opacity() {
    let pbr = json!({ "baseColorFactor": [0.5, 1, 1, 0.5], "baseColorTexture": { "index": 0 } });
    let mut file = with_texture(json!({ "alphaMode": "BLEND", "pbrMetallicRoughness": pbr }));
    // The same material on a square with colours and on one without.
    let plain = file.square_mesh(Some(0));
    file.add("nodes", json!({ "mesh": plain }));
    let colors = file.floats("VEC4", &[1.0, 0.5, 0.0, 0.5].repeat(4));
    file.json["meshes"][0]["primitives"][0]["attributes"]["COLOR_0"] = json!(colors);
    let desc = file.load_without_warnings();
    let of = |object: usize| &desc.materials[desc.objects[object].material].1;
    let tint = Rgb::new(0.5, 1.0, 1.0);
    assert!(matches!(principled(of(0)).base_color, Spectrum::VertexColor(Some(_), t) if t == tint));
    assert!(matches!(principled(of(1)).base_color, Spectrum::Bitmap(_, t) if t == tint));
    let opacity = |object: usize| match of(object).opacity {
        Some(Spectrum::Bitmap(_, tint)) => tint.r,
        other => panic!("{other:?}"),
    };
    assert_eq!((opacity(0), opacity(1)), (0.25, 0.5));
    // Alpha that varies from vertex to vertex has no place in a mesh.
    let colors: Vec<f32> = [0.0f32, 0.5, 0.5, 1.0]
        .iter()
        .flat_map(|a| [1.0, 1.0, 1.0, *a])
        .collect();
    let colors = file.floats("VEC4", &colors);
    file.json["meshes"][0]["primitives"][0]["attributes"]["COLOR_0"] = json!(colors);
    assert!(file.warning().contains("its mean is used"));
}

#[test]
fn transmission_and_index_make_glass() {
    let desc = load(json!({
        "pbrMetallicRoughness": { "metallicFactor": 0, "roughnessFactor": 0 },
        "extensions": {
            "KHR_materials_transmission": { "transmissionFactor": 0.75, "transmissionTexture": { "index": 0 } },
            "KHR_materials_ior": { "ior": 1.25 },
            "KHR_materials_volume": { "thicknessFactor": 1 },
        },
    }));
    let glass = principled(&desc.materials[0].1);
    assert_eq!(glass.ior, 1.25);
    assert!(
        matches!(glass.spec_trans, Scalar::Varying(Spectrum::Bitmap(_, tint), Channel::R) if tint == Rgb::splat(0.75))
    );
    assert!(!glass.thin);
    for volume in [None, Some(json!({})), Some(json!({ "thicknessFactor": 0 }))] {
        let mut extensions = json!({ "KHR_materials_transmission": { "transmissionFactor": 1 } });
        if let Some(volume) = volume {
            extensions["KHR_materials_volume"] = volume;
        }
        let desc = with_texture(json!({ "extensions": extensions })).load_without_warnings();
        assert!(principled(&desc.materials[0].1).thin);
    }
    let absorbing = with_texture(json!({ "extensions": {
        "KHR_materials_transmission": { "transmissionFactor": 1 },
        "KHR_materials_volume": { "thicknessFactor": 1, "attenuationDistance": 2 },
    }}));
    assert!(
        absorbing
            .warning()
            .contains("absorption within KHR_materials_volume is ignored")
    );
    let odd = with_texture(extended("KHR_materials_ior", json!({ "ior": 0 })));
    assert!(odd.warning().contains("not within 1 and 100"));
    let none = load(extended("KHR_materials_ior", json!({ "ior": 1 })));
    assert!(principled(&none.materials[0].1).ior > 1.0);
}

#[test]
fn specular_scales_and_colours_what_is_reflected_and_factors_above_one_raise_the_index() {
    let specular = |content: Value| {
        let desc = with_texture(extended("KHR_materials_specular", content)).load_without_warnings();
        let p = principled(&desc.materials[0].1);
        (p.specular, p.specular_color, ((p.ior - 1.0) / (p.ior + 1.0)).powi(2))
    };
    let (strength, color, reflectance) = specular(json!({}));
    assert_eq!(
        (strength, color),
        (Scalar::Constant(1.0), Spectrum::Constant(Rgb::WHITE))
    );
    assert!((reflectance - 0.04).abs() < 1e-6);
    let (strength, color, _) = specular(json!({ "specularFactor": 0.25, "specularColorFactor": [1, 0.5, 0] }));
    assert_eq!(
        (strength, color),
        (Scalar::Constant(0.25), Spectrum::Constant(Rgb::new(1.0, 0.5, 0.0)))
    );
    let (_, color, reflectance) = specular(json!({ "specularColorFactor": [2, 1, 2] }));
    assert_eq!(color, Spectrum::Constant(Rgb::new(1.0, 0.5, 1.0)));
    assert!((reflectance - 0.08).abs() < 1e-6);
    let textures = json!({ "specularTexture": { "index": 0 }, "specularColorTexture": { "index": 0 } });
    let (strength, color, _) = specular(textures);
    assert!(matches!(strength, Scalar::Varying(Spectrum::Bitmap(..), Channel::Mean)));
    assert!(matches!(color, Spectrum::Bitmap(_, Rgb::WHITE)));
    let glass = with_texture(json!({ "extensions": {
        "KHR_materials_transmission": { "transmissionFactor": 1 },
        "KHR_materials_specular": { "specularColorFactor": [2, 2, 2] },
    }}));
    assert!(glass.warning().contains("limited to factors of 1"));
}

#[test]
fn a_clear_coat_is_a_layer_with_a_roughness() {
    let coat = |content: Value| with_texture(extended("KHR_materials_clearcoat", content));
    let desc = coat(json!({ "clearcoatFactor": 0.5, "clearcoatRoughnessFactor": 0.25 })).load_without_warnings();
    let p = principled(&desc.materials[0].1);
    assert_eq!(
        (p.clearcoat, p.clearcoat_roughness, p.conserves),
        (Scalar::Constant(0.5), Scalar::Constant(0.25), true)
    );
    let desc = coat(json!({
        "clearcoatFactor": 1, "clearcoatTexture": { "index": 0 },
        "clearcoatRoughnessFactor": 1, "clearcoatRoughnessTexture": { "index": 0 },
    }))
    .load_without_warnings();
    let p = principled(&desc.materials[0].1);
    assert!(matches!(p.clearcoat, Scalar::Varying(_, Channel::R)));
    assert!(matches!(p.clearcoat_roughness, Scalar::Varying(_, Channel::G)));
    let none = coat(json!({})).load_without_warnings();
    assert_eq!(principled(&none.materials[0].1).clearcoat, Scalar::Constant(0.0));
    let bent = coat(json!({ "clearcoatFactor": 1, "clearcoatNormalTexture": { "index": 0 } }));
    assert!(bent.warning().contains("the clear coat follows the normal map"));
    for (content, problem) in [
        (json!({ "clearcoatFactor": "1" }), "invalid type"),
        (
            json!({ "clearcoatFactor": 1, "clearcoatTexture": { "index": 9 } }),
            "no texture of that index",
        ),
    ] {
        let error = coat(content).error();
        assert!(
            error.contains("KHR_materials_clearcoat") && error.contains(problem),
            "{error}"
        );
    }
}

#[test]
fn what_is_unlit_emits_its_colour() {
    let file = with_texture(json!({
        "pbrMetallicRoughness": { "baseColorTexture": { "index": 0 }, "baseColorFactor": [0.5, 1, 1, 1] },
        "extensions": { "KHR_materials_unlit": {} },
    }));
    assert!(file.warning().contains("is unlit"));
    let desc = file.load();
    let object = &desc.objects[0];
    assert_eq!(object.emission.expect("emission").radiance, Rgb::new(0.5, 1.0, 1.0));
    assert!(object.emission.expect("emission").both_sides);
    assert!(matches!(object.emission_map, Some(Spectrum::Bitmap(_, Rgb::WHITE))));
    let black = Spectrum::Constant(Rgb::BLACK);
    assert_eq!(
        desc.materials[0].1.scattering,
        Scattering::Diffuse { reflectance: black }
    );
}

#[test]
fn extensions_that_are_used_are_ignored_and_those_required_are_not() {
    let mut file = File::square(None);
    file.json["extensionsUsed"] = json!(["KHR_materials_sheen", "KHR_materials_ior"]);
    assert!(
        file.warning()
            .contains("KHR_materials_sheen is not supported and is ignored")
    );
    for name in ["KHR_draco_mesh_compression", "KHR_materials_volume"] {
        file.json["extensionsRequired"] = json!(["KHR_materials_ior", name]);
        let error = file.error();
        let expected = format!("scene.gltf: extensionsRequired[1]: {name} is not supported");
        assert!(error.contains(&expected), "{error}");
    }
}
