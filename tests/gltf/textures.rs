//! Images, samplers and how bitmaps lie on a surface.

use super::file::*;
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use embrace::image::Image;
use embrace::material::{General, Scattering, Spectrum};
use embrace::math::{Affine2, Rgb, Vec2};
use embrace::scene::SceneDesc;
use embrace::texture::{Encoding, Filter, Texture, TextureMap, Wrap};
use serde_json::{Value, json};

const RED: [u8; 4] = [255, 0, 0, 255];
const GREEN: [u8; 4] = [0, 255, 0, 255];
const BLUE: [u8; 4] = [0, 0, 255, 255];
const GREY: [u8; 4] = [128, 128, 128, 255];

fn textured() -> File {
    let mut file = File::square(Some(
        json!({ "pbrMetallicRoughness": { "baseColorTexture": { "index": 0 } } }),
    ));
    file.texture(&png([RED, GREEN, BLUE, GREY]));
    file
}

fn base_color(desc: &SceneDesc) -> Spectrum {
    match &desc.materials[0].1.scattering {
        Scattering::General(General::Principled(p)) => p.base_color,
        other => panic!("{other:?}"),
    }
}

fn base_map(desc: &SceneDesc) -> TextureMap {
    match base_color(desc) {
        Spectrum::Bitmap(map, _) => map,
        other => panic!("{other:?}"),
    }
}

/// What the surface shows at a place of the picture: 0, 0 is its upper left corner.
fn seen(desc: &SceneDesc, x: f32, y: f32) -> Rgb {
    base_map(desc).lookup(&desc.textures, Vec2::new(x, 1.0 - y))
}

#[test]
fn the_first_row_is_on_top() {
    let desc = textured().load_without_warnings();
    assert_eq!(seen(&desc, 0.25, 0.25), Rgb::new(1.0, 0.0, 0.0));
    assert_eq!(seen(&desc, 0.75, 0.25), Rgb::new(0.0, 1.0, 0.0));
    assert_eq!(seen(&desc, 0.25, 0.75), Rgb::new(0.0, 0.0, 1.0));
    // Colours are sRGB.
    assert!((seen(&desc, 0.75, 0.75).r - 0.2158).abs() < 1e-3);
}

#[test]
fn images_come_from_views_from_data_uris_and_from_files() {
    let bytes = png([RED, GREEN, BLUE, GREY]);
    let expected = textured().load_without_warnings().textures;
    let uri = format!("data:image/png;base64,{}", STANDARD.encode(&bytes));
    // Without its padding as well.
    for uri in [
        uri.trim_end_matches('=').to_owned(),
        uri,
        "a%20b.png".into(),
        "100%.png".into(),
    ] {
        let mut file = textured();
        file.json["images"] = json!([{ "uri": uri }]);
        let files = [
            ("scene.gltf", &file.text()[..]),
            ("a b.png", &bytes),
            ("100%.png", &bytes),
        ];
        let desc = in_folder(&files, "scene.gltf", None).unwrap_or_else(|e| panic!("{uri}: {e}"));
        assert_eq!(desc.textures, expected);
    }
}

#[test]
fn a_file_beside_the_scene_is_a_part_of_its_hash() {
    let mut file = textured();
    file.json["images"] = json!([{ "uri": "a.png" }]);
    let hash = |texels| {
        let image = png(texels);
        let desc = in_folder(&[("scene.gltf", &file.text()), ("a.png", &image)], "scene.gltf", None);
        desc.expect("a scene").hash
    };
    assert_eq!(hash([RED; 4]), hash([RED; 4]));
    assert_ne!(hash([RED; 4]), hash([BLUE; 4]));
}

#[test]
fn eight_bits_stay_eight_and_sixteen_are_decoded_by_their_use() {
    let pixel = |v: u16| image::Rgb([v; 3]);
    let deep = image::ImageBuffer::from_pixel(1, 1, pixel(32768));
    let deep = encode(&image::DynamicImage::ImageRgb16(deep), image::ImageFormat::Png);
    let mut file = File::square(Some(json!({
        "pbrMetallicRoughness": { "baseColorTexture": { "index": 0 }, "metallicRoughnessTexture": { "index": 0 } },
    })));
    file.texture(&deep);
    let desc = file.load_without_warnings();
    let value = |texture: &Texture| match texture {
        Texture::Rgb32(image) => image.pixels[0].r,
        other => panic!("{other:?}"),
    };
    let mut values: Vec<f32> = desc.textures.iter().map(value).collect();
    values.sort_by(f32::total_cmp);
    assert!(
        (values[0] - 0.2140).abs() < 1e-3 && (values[1] - 0.5).abs() < 1e-3,
        "{values:?}"
    );

    let jpeg = image::DynamicImage::from(image::RgbImage::from_pixel(8, 8, image::Rgb([200, 10, 30])));
    let mut file = textured();
    let view = file.view(&encode(&jpeg, image::ImageFormat::Jpeg));
    file.json["images"] = json!([{ "bufferView": view, "mimeType": "image/jpeg" }]);
    match &file.load_without_warnings().textures[..] {
        [Texture::Rgb8(Image { width: 8, .. }, Encoding::Srgb)] => {}
        other => panic!("{other:?}"),
    }
}

#[test]
fn an_image_is_decoded_once_for_each_use() {
    let all = json!({ "index": 0 });
    let mut file = File::square(Some(json!({
        "pbrMetallicRoughness": { "baseColorTexture": all, "metallicRoughnessTexture": all },
        "normalTexture": all,
        "emissiveTexture": all,
        "emissiveFactor": [1, 1, 1],
        "alphaMode": "BLEND",
    })));
    file.texture(&png([[128, 128, 255, 100]; 4]));
    let desc = file.load_without_warnings();
    // Colours, numbers and opacity.
    let encodings = |e: Encoding| {
        let of = |t: &&Texture| matches!(t, Texture::Rgb8(_, other) if *other == e);
        desc.textures.iter().filter(of).count()
    };
    assert_eq!((encodings(Encoding::Srgb), encodings(Encoding::Linear)), (1, 2));
}

#[test]
fn samplers_say_what_is_beyond_the_edges_and_between_texels() {
    let mut file = textured();
    let map = |file: &File| base_map(&file.load_without_warnings());
    assert_eq!(
        (map(&file).wrap, map(&file).filter),
        ([Wrap::Repeat; 2], Filter::Bilinear)
    );
    file.json["textures"][0]["sampler"] = json!(0);
    file.json["samplers"] = json!([{ "wrapS": 33071, "wrapT": 33648, "magFilter": 9728 }]);
    assert_eq!(
        (map(&file).wrap, map(&file).filter),
        ([Wrap::Clamp, Wrap::Mirror], Filter::Nearest)
    );
    file.json["samplers"] = json!([{ "wrapS": 10497, "magFilter": 9729, "minFilter": 9984 }]);
    assert_eq!(
        (map(&file).wrap, map(&file).filter),
        ([Wrap::Repeat; 2], Filter::Bilinear)
    );
}

fn transformed(transform: Value) -> SceneDesc {
    let mut file = textured();
    file.json["extensionsUsed"] = json!(["KHR_texture_transform"]);
    file.json["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"]["extensions"] =
        json!({ "KHR_texture_transform": transform });
    file.load_without_warnings()
}

#[test]
fn texture_transforms_scale_then_turn_then_move_with_v_going_down() {
    assert_eq!(base_map(&transformed(json!({}))).to_uv, Affine2::IDENTITY);
    // The left half of the picture has the whole of the bitmap.
    let desc = transformed(json!({ "scale": [2, 1] }));
    assert_eq!(seen(&desc, 0.125, 0.25), Rgb::new(1.0, 0.0, 0.0));
    assert_eq!(seen(&desc, 0.375, 0.25), Rgb::new(0.0, 1.0, 0.0));
    // A step to the right and half a step down in the bitmap.
    let desc = transformed(json!({ "offset": [1, 0.5] }));
    assert_eq!(seen(&desc, 0.25, 0.25), Rgb::new(0.0, 0.0, 1.0));
    // The example of the extension: the lower left quadrant of the bitmap, turned clockwise.
    let quarter = std::f32::consts::FRAC_PI_2;
    let desc = transformed(json!({ "offset": [0, 1], "rotation": quarter, "scale": [0.5, 0.5] }));
    let near = |a: Vec2, b: [f32; 2]| assert!((a - Vec2::from(b)).length() < 1e-6, "{a}");
    let bitmap = |x: f32, y: f32| {
        let uv = base_map(&desc).to_uv.transform_point2(Vec2::new(x, 1.0 - y));
        Vec2::new(uv.x, 1.0 - uv.y)
    };
    near(bitmap(0.0, 0.0), [0.0, 1.0]);
    near(bitmap(1.0, 0.0), [0.0, 0.5]);
    near(bitmap(1.0, 1.0), [0.5, 0.5]);
    near(bitmap(0.0, 1.0), [0.5, 1.0]);
}

#[test]
fn the_set_of_texture_coordinates_that_all_textures_use_is_read() {
    let mut file = textured();
    let other = file.floats("VEC2", &[0.5, 0.0, 0.5, 0.25, 0.5, 0.5, 0.5, 0.75]);
    file.json["meshes"][0]["primitives"][0]["attributes"]["TEXCOORD_1"] = json!(other);
    file.json["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"]["texCoord"] = json!(1);
    let second = [1.0, 0.75, 0.5, 0.25].map(|v| Vec2::new(0.5, v));
    assert_eq!(file.load_without_warnings().meshes[0].uvs, second);
    // Where they differ, that of the base colour is taken.
    let mut mixed = file.clone();
    mixed.json["materials"][0]["normalTexture"] = json!({ "index": 0, "texCoord": 0 });
    assert!(mixed.warning().contains("TEXCOORD_1 is used for all"));
    assert_eq!(mixed.load().meshes[0].uvs, second);
    // The transform may choose the set, also that of a normal map.
    let transform = json!({ "KHR_texture_transform": { "texCoord": 1, "scale": [3, 3] } });
    let mut chosen = file.clone();
    chosen.json["materials"] = json!([{ "normalTexture": { "index": 0, "extensions": transform } }]);
    let desc = chosen.load_without_warnings();
    assert_eq!(desc.meshes[0].uvs, second);
    assert_eq!(
        desc.materials[0]
            .1
            .relief
            .expect("a normal map")
            .map()
            .to_uv
            .matrix2
            .x_axis
            .x,
        3.0
    );
    // What has no such set looks up one texel.
    let mut missing = textured();
    missing.json["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"]["texCoord"] = json!(4);
    assert!(missing.warning().contains("no texture coordinates"));
}
