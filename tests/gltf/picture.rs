//! Pictures against those of the same scene in the native format.

use super::file::*;
use super::support::Prepared;
use embrace::accel::brute::Brute;
use embrace::image::Image;
use embrace::integrator::Settings;
use embrace::material::{General, Material, Scattering};
use embrace::math::Rgb;
use embrace::scene::{SceneDesc, SceneOptions};
use serde_json::json;

const SCENE: &str = "[camera]\nposition = [0.25, 0.5, 3]\nlook_at = [0.25, 0.5, 2]\nvfov = 45\nresolution = [24, 16]\n\
    [environment]\nradiance = [1, 1, 1]\n[materials.m]\ntype = \"diffuse\"\ntexture = \"texture.png\"\n\
    [[meshes]]\nfile = \"square.obj\"\nmaterial = \"m\"\n";
const SQUARE: &str = "v -1 1 0\nv 1 1 0\nv 1 -1 0\nv -1 -1 0\nvn 0 0 1\nvt 0 1\nvt 1 1\nvt 1 0\nvt 0 0\n\
    f 1/1/1 3/3/1 2/2/1\nf 1/1/1 4/4/1 3/3/1\n";

fn render(desc: SceneDesc) -> Image<Rgb> {
    Prepared::<Brute>::new(desc, SceneOptions::default()).image(&Settings::default(), 4)
}

/// The same picture of a square whose corners differ, so that nothing is turned or mirrored; with plain diffuse surfaces
/// in both, as the two formats' own differ.
#[test]
fn a_textured_square_looks_as_in_the_native_format() {
    let texture = png([
        [250, 20, 20, 255],
        [20, 200, 30, 255],
        [30, 30, 220, 255],
        [240, 240, 90, 255],
    ]);
    let native = in_folder(
        &[
            ("scene.toml", SCENE.as_bytes()),
            ("square.obj", SQUARE.as_bytes()),
            ("texture.png", &texture),
        ],
        "scene.toml",
        None,
    );
    let mut file = File::square(Some(
        json!({ "pbrMetallicRoughness": { "baseColorTexture": { "index": 0 } } }),
    ));
    file.texture(&texture);
    let camera = json!({ "yfov": std::f64::consts::FRAC_PI_4, "aspectRatio": 1.5, "znear": 0.01 });
    file.add("cameras", json!({ "type": "perspective", "perspective": camera }));
    file.add("nodes", json!({ "camera": 0, "translation": [0.25, 0.5, 3] }));
    for bytes in [file.text(), file.glb()] {
        let mut desc = in_folder(&[("scene.glb", &bytes)], "scene.glb", None).expect("a scene");
        assert_eq!(desc.camera.resolution, [900, 600]);
        desc.camera.resolution = [24, 16];
        // The angle is a number of 32 bits in the file.
        desc.camera.vfov_degrees = desc.camera.vfov_degrees.round();
        for (_, material) in &mut desc.materials {
            let Scattering::General(General::Principled(p)) = &material.scattering else {
                panic!("{material:?}");
            };
            *material = Material::new(Scattering::Diffuse {
                reflectance: p.base_color,
            });
        }
        let expected = render(native.as_ref().expect("a scene").clone());
        // All four corners of the texture are in the picture, and the background.
        assert!(expected.pixels.iter().any(|p| p.r > 0.9) && expected.pixels.iter().any(|p| p.b < 0.05));
        assert!(render(desc) == expected);
    }
}
