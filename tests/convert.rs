//! Writing scenes: `embrace convert`, and what is read back of a description with everything that there is.

mod support;

use embrace::accel::brute::Brute;
use embrace::bsdf::{CoatTable, Distribution};
use embrace::camera::CameraDesc;
use embrace::image::Image;
use embrace::integrator::Settings;
use embrace::light::Emission;
use embrace::material::{
    Back, Channel, Checkerboard, General, Material, Principled, Relief, Scalar, Scattering, Spectrum,
};
use embrace::math::{Affine2, DAffine3, DMat3, DVec3, Rgb, Vec2, Vec3};
use embrace::mesh::TriangleMesh;
use embrace::scene::ply::write_ply;
use embrace::scene::{
    EnvironmentDesc, Falloff, LightDesc, LoadOptions, ObjectDesc, SceneDesc, SceneOptions, load, save,
};
use embrace::texture::{Encoding, Filter, Texture, TextureMap, Wrap};
use std::fs;
use std::path::Path;
use std::sync::Arc;
use support::program::{CAMERA, FLOOR, Folder, LAMP, RED, SKY, SQUARE};
use support::{Prepared, Random};

// Descriptions.

/// Panics unless rendering both gives the same: everything is the same but the names of objects, the hash, the warnings, and
/// the order of bitmaps and meshes.
fn assert_same(a: &SceneDesc, b: &SceneDesc) {
    assert_eq!((&a.camera, a.crop), (&b.camera, b.crop));
    assert_eq!(a.max_depth, b.max_depth);
    match (&a.environment, &b.environment) {
        (Some(EnvironmentDesc::Map { image, .. }), Some(EnvironmentDesc::Map { image: other, .. })) => {
            assert_eq!(bits(image), bits(other));
            let rest = |desc: &SceneDesc| match desc.environment {
                Some(EnvironmentDesc::Map {
                    scale,
                    rotation_degrees,
                    to_world,
                    ..
                }) => format!("{scale:?} {rotation_degrees:?} {to_world:?}"),
                _ => String::new(),
            };
            assert_eq!(rest(a), rest(b));
        }
        (a, b) => assert_eq!(format!("{a:?}"), format!("{b:?}")),
    }
    assert_eq!(a.lights, b.lights);
    assert_eq!(a.objects.len(), b.objects.len());
    for (x, y) in a.objects.iter().zip(&b.objects) {
        assert_eq!((x.to_world, x.emission), (y.to_world, y.emission), "{}", x.name);
        assert_eq!(a.meshes[x.mesh], b.meshes[y.mesh], "{}", x.name);
        let others = |desc: &SceneDesc, mesh| desc.objects.iter().map(|o| o.mesh == mesh).collect::<Vec<_>>();
        assert_eq!(
            others(a, x.mesh),
            others(b, y.mesh),
            "{}: other meshes are shared",
            x.name
        );
        let mut textures = Vec::new();
        let looks = |desc: &SceneDesc, o: &ObjectDesc, textures: &mut Vec<Texture>| {
            let mut looks = vec![with_textures(&format!("{:?}", o.emission_map), desc, textures)];
            let mut materials = vec![o.material as u32];
            // Everything that the material refers to, in its order.
            let mut next = 0;
            while let Some(&material) = materials.get(next) {
                let (name, material) = &desc.materials[material as usize];
                materials.extend(material.parts());
                looks.push(with_textures(&without_parts(name, material), desc, textures));
                next += 1;
            }
            looks
        };
        let expected = looks(a, x, &mut textures);
        let count = textures.len();
        assert_eq!(expected, looks(b, y, &mut textures), "{}", x.name);
        assert_eq!(textures.len(), count, "{}: another bitmap", x.name);
    }
}

fn bits(image: &Image<Rgb>) -> (u32, Vec<[u32; 3]>) {
    let pixels = image.pixels.iter().map(|p| p.to_array().map(f32::to_bits));
    (image.width, pixels.collect())
}

/// A material as text, which shows every bit, less the indices of others.
fn without_parts(name: &str, material: &Material) -> String {
    let mut material = material.clone();
    if let Scattering::General(General::Blend { materials, .. }) = &mut material.scattering {
        *materials = [0; 2];
    }
    if let Back::Material(other) = &mut material.back {
        *other = 0;
    }
    format!("{name}: {material:?}")
}

/// The text with 0 for -0, as which a placement that is none is read back, and with the place of each bitmap in `known`, where its like is looked for, instead of its index.
fn with_textures(text: &str, desc: &SceneDesc, known: &mut Vec<Texture>) -> String {
    let text = text.replace("-0.0,", "0.0,").replace("-0.0)", "0.0)");
    let mut parts = text.split("texture: ");
    let mut result = parts.next().unwrap_or_default().to_owned();
    for part in parts {
        let end = part.find(|c: char| !c.is_ascii_digit()).unwrap_or(part.len());
        let texture = &desc.textures[part[..end].parse::<usize>().unwrap()];
        let place = known.iter().position(|k| k == texture).unwrap_or_else(|| {
            known.push(texture.clone());
            known.len() - 1
        });
        result += &format!("texture: {place}{}", &part[end..]);
    }
    result
}

/// The first samples of a small image.
fn rendered(desc: &SceneDesc) -> (u32, Vec<[u32; 3]>) {
    let options = SceneOptions {
        mis: true,
        ..SceneOptions::default()
    };
    bits(&Prepared::<Brute>::new(desc.clone(), options).image(&Settings::default(), 4))
}

// Everything that there is, with numbers of many digits.

fn rgb(random: &mut Random) -> Rgb {
    Rgb::new(random.unit(), random.unit(), random.unit())
}

fn double(random: &mut Random) -> f64 {
    (random.bits() >> 11) as f64 / 9_007_199_254_740_992.0
}

/// A map of one of the bitmaps, in one of the ways there are.
fn texture_map(random: &mut Random, texture: u32) -> TextureMap {
    let wraps = [Wrap::Repeat, Wrap::Mirror, Wrap::Clamp];
    TextureMap {
        to_uv: Affine2::from_scale_angle_translation(
            Vec2::new(0.5 + random.unit(), 1.0 + random.unit()),
            random.unit(),
            Vec2::new(random.unit(), -random.unit()),
        ),
        wrap: [wraps[random.below(3)], wraps[random.below(3)]],
        filter: [Filter::Bilinear, Filter::Nearest][random.below(2)],
        ..TextureMap::new(texture)
    }
}

fn spectra(random: &mut Random) -> Vec<Spectrum> {
    let mut spectra = vec![
        Spectrum::Constant(rgb(random)),
        Spectrum::Constant(Rgb::splat(random.unit())),
        Spectrum::Checkerboard(Checkerboard {
            to_uv: Affine2::from_scale(Vec2::new(3.0, 1.0 / 3.0)),
            colors: [rgb(random), rgb(random)],
        }),
        Spectrum::VertexColor(None, Rgb::WHITE),
        Spectrum::VertexColor(Some(texture_map(random, 1)), rgb(random)),
        Spectrum::Bitmap(TextureMap::new(0), Rgb::WHITE),
    ];
    for texture in 0..TEXTURES {
        spectra.push(Spectrum::Bitmap(texture_map(random, texture), rgb(random)));
    }
    spectra
}

const TEXTURES: u32 = 3;

fn textures(random: &mut Random) -> Vec<Texture> {
    let mut bytes = |width: u32, height: u32| Image {
        width,
        height,
        pixels: (0..width * height)
            .map(|_| [0; 3].map(|_: u8| random.bits() as u8))
            .collect(),
    };
    let (srgb, linear) = (bytes(3, 2), bytes(5, 4));
    vec![
        Texture::Rgb8(srgb, Encoding::Srgb),
        Texture::Rgb8(linear, Encoding::Linear),
        Texture::Rgb32(Image {
            width: 2,
            height: 3,
            pixels: (0..6).map(|_| rgb(random)).collect(),
        }),
        // Heights, and factors on emission.
        Texture::Rgb32(Image {
            width: 2,
            height: 2,
            pixels: (0..4).map(|i| rgb(random) * 1.7 - Rgb::splat(i as f32 / 3.0)).collect(),
        }),
        Texture::Rgb32(Image {
            width: 2,
            height: 2,
            pixels: (0..4).map(|_| rgb(random) * 31.7).collect(),
        }),
    ]
}

/// Every kind of scattering, most of them with every kind of colour.
fn scatterings(random: &mut Random) -> Vec<Scattering> {
    let mut all = vec![
        Scattering::Conductor {
            eta: rgb(random) + Rgb::splat(0.1),
            k: rgb(random) * 3.0,
            alpha: random.unit(),
        },
        Scattering::Dielectric {
            ior: 1.0 + random.unit(),
            alpha: 0.0,
        },
        Scattering::Dielectric {
            ior: 0.01,
            alpha: random.unit(),
        },
        Scattering::Mirror {
            reflectance: rgb(random),
        },
        Scattering::General(General::Metal {
            eta: Rgb::BLACK,
            k: Rgb::WHITE,
            reflectance: Spectrum::Constant(Rgb::WHITE),
            alpha: [Scalar::Constant(0.0); 2],
            distribution: Distribution::Ggx,
        }),
    ];
    let channels = [Channel::R, Channel::G, Channel::B, Channel::Mean, Channel::Luminance];
    for (i, spectrum) in spectra(random).into_iter().enumerate() {
        let varying = Scalar::Varying(spectrum, channels[i % 5]);
        let other = [Scalar::Constant(random.unit()), varying][i % 2];
        let distribution = [Distribution::Ggx, Distribution::Beckmann][i % 2];
        let coat = CoatTable::of(1.5, [0.0, 0.1][i % 2], distribution);
        all.extend([
            Scattering::Diffuse { reflectance: spectrum },
            Scattering::Plastic {
                reflectance: spectrum,
                specular: rgb(random),
                alpha: [1e-3, random.unit()][i % 2],
            },
            Scattering::General(General::Metal {
                eta: rgb(random),
                k: rgb(random),
                reflectance: spectrum,
                alpha: [other, varying],
                distribution,
            }),
            Scattering::General(General::Glass {
                ior: 1.0 + random.unit(),
                reflectance: Spectrum::Constant(Rgb::WHITE),
                transmittance: spectrum,
                alpha: [other; 2],
                distribution,
            }),
            Scattering::General(General::ThinGlass {
                ior: 1.0 + random.unit(),
                reflectance: spectrum,
                transmittance: Spectrum::Constant(rgb(random)),
            }),
            Scattering::General(General::CoatedDiffuse {
                reflectance: spectrum,
                specular: Spectrum::Constant(Rgb::splat(random.unit())),
                coat,
                nonlinear: i % 2 == 0,
            }),
            Scattering::General(General::Principled(Box::new(Principled {
                roughness: varying,
                anisotropic: other,
                metallic: Scalar::Constant(random.unit()),
                spec_trans: Scalar::Constant([0.0, random.unit()][i % 2]),
                ior: 1.1 + random.unit(),
                spec_tint: other,
                sheen: varying,
                sheen_tint: Scalar::Constant(random.unit()),
                flatness: other,
                clearcoat: Scalar::Constant(random.unit()),
                clearcoat_gloss: varying,
                conserves: i % 2 == 0,
                ..Principled::new(spectrum)
            }))),
            Scattering::General(General::Blend {
                weight: varying,
                materials: [0, 1 + i as u32 % 4],
            }),
        ]);
    }
    all
}

fn materials(random: &mut Random) -> Vec<(String, Material)> {
    let names = [
        "plain",
        "",
        "with space",
        "black",
        "same",
        "plain",
        "quo\"te\\",
        "ä.b",
        "plain-2",
    ];
    let opacities = spectra(random);
    let materials = scatterings(random).into_iter().enumerate().map(|(i, scattering)| {
        let relief = match i % 4 {
            1 => Some(Relief::NormalMap {
                map: texture_map(random, 1),
                scale: random.unit(),
            }),
            2 => Some(Relief::BumpMap {
                map: texture_map(random, 3),
                scale: -0.1 * random.unit(),
            }),
            _ => None,
        };
        let back = match i % 7 {
            3 => Back::Black,
            // None of the first, which blends refer to, refers to others.
            5 if i > 5 => Back::Material(i as u32 % 5),
            _ => Back::Same,
        };
        let material = Material {
            scattering,
            opacity: (i % 3 == 2).then(|| opacities[i / 3 % opacities.len()]),
            relief,
            back,
        };
        (names[i % names.len()].to_owned(), material)
    });
    materials.collect()
}

fn lights(random: &mut Random) -> Vec<LightDesc> {
    let mut lights = vec![
        LightDesc::Distant {
            direction: DVec3::NEG_Y,
            irradiance: Rgb::WHITE,
            radius: 0.0,
        },
        LightDesc::Distant {
            direction: DVec3::new(0.3, -1.0, 0.1),
            irradiance: rgb(random),
            radius: 0.265f64.to_radians(),
        },
    ];
    for falloff in [Falloff::Angle, Falloff::Cosine] {
        for _ in 0..4 {
            let position = DVec3::new(double(random), 2.0 + double(random), double(random));
            lights.push(LightDesc::Point {
                position,
                intensity: rgb(random) * 3.0,
            });
            let beam = double(random);
            lights.push(LightDesc::Spot {
                position,
                direction: DVec3::new(double(random), -3.0 * double(random), double(random)),
                intensity: rgb(random),
                angles: [beam, beam + 0.5 * double(random)],
                falloff,
            });
        }
    }
    lights
}

/// A patch of the floor with everything that a mesh can have.
fn patch(random: &mut Random, everything: bool) -> TriangleMesh<DVec3> {
    let mesh = support::quad(Vec3::ZERO, Vec3::Z, Vec3::X).into_f64();
    let vertices = mesh.positions.len();
    let mesh = TriangleMesh {
        positions: mesh
            .positions
            .iter()
            .map(|p| *p + DVec3::Y * (0.1 * double(random)))
            .collect(),
        ..mesh
    };
    if !everything {
        return mesh;
    }
    let mut mesh = TriangleMesh {
        normals: (0..vertices)
            .map(|_| Vec3::new(random.unit() - 0.5, 1.0, random.unit() - 0.5))
            .collect(),
        colors: (0..vertices).map(|_| rgb(random)).collect(),
        ..mesh
    };
    mesh.repair_normals();
    mesh
}

/// A floor with one patch for each material, under lights of every kind.
fn everything() -> SceneDesc {
    let random = &mut Random(7);
    let materials = materials(random);
    let meshes: Vec<_> = (0..8).map(|i| Arc::new(patch(random, i % 2 == 0))).collect();
    let emission_maps = [
        None,
        Some(Spectrum::Bitmap(texture_map(random, 4), Rgb::splat(2.5))),
        Some(Spectrum::VertexColor(None, Rgb::WHITE)),
        Some(Spectrum::Bitmap(texture_map(random, 0), Rgb::WHITE)),
    ];
    let columns = 12;
    let objects = (0..materials.len()).map(|i| {
        let is_lamp = i % 9 == 4;
        ObjectDesc {
            name: format!("patch \"{i}\"\nof the floor"),
            mesh: (i * 5) % 8,
            material: i,
            to_world: DAffine3::from_translation(DVec3::new((i % columns) as f64, 0.0, (i / columns) as f64))
                * DAffine3::from_rotation_y(0.1 * double(random))
                * DAffine3::from_scale(DVec3::new(0.9, 1.0, [0.9, -0.8][i % 2])),
            emission: is_lamp.then(|| Emission {
                radiance: rgb(random) * 7.0,
                both_sides: i % 2 == 0,
            }),
            emission_map: emission_maps[i / 9 % 4].filter(|_| is_lamp),
        }
    });
    let objects = objects.collect();
    let rows = materials.len() as f64 / columns as f64;
    SceneDesc {
        crop: Some([1, 2, 7, 5]),
        camera: CameraDesc {
            position: DVec3::new(6.0 + double(random), 12.0, rows + 4.0),
            look_at: DVec3::new(6.0, 0.0, 0.5 * rows),
            up: DVec3::new(0.01 * double(random), 1.0, 0.0),
            vfov_degrees: 50.0 + double(random),
            resolution: [48, 36],
            aperture_radius: 0.01 * double(random),
            focus_distance: Some(11.0 + double(random)),
            mirrored: true,
        },
        max_depth: Some(5),
        environment: Some(EnvironmentDesc::Map {
            image: Arc::new(Image {
                width: 8,
                height: 4,
                pixels: (0..32).map(|_| rgb(random) * 3.0).collect(),
            }),
            scale: 0.3,
            rotation_degrees: 31.0 + double(random),
            to_world: DMat3::from_rotation_x(double(random)) * DMat3::from_diagonal(DVec3::new(-1.0, 1.0, 1.0)),
        }),
        objects,
        materials,
        textures: textures(random),
        meshes,
        lights: lights(random),
        hash: String::new(),
        warnings: vec!["something was left out".into()],
    }
}

/// The description with names as they are read back.
fn with_distinct_names(mut desc: SceneDesc, read: &SceneDesc) -> SceneDesc {
    for ((name, _), (unique, _)) in desc.materials.iter_mut().zip(&read.materials) {
        assert!(unique.starts_with(name.as_str()), "{name:?} became {unique:?}");
        name.clone_from(unique);
    }
    desc
}

#[test]
fn a_description_with_everything_is_read_back_as_it_was_written_and_looks_the_same() {
    let folder = Folder::empty();
    let desc = everything();
    assert!(desc.materials.len() > 70 && desc.lights.len() > 10);
    save(&desc, &folder.path("all.toml")).unwrap();
    let read = load(
        &folder.path("all.toml"),
        LoadOptions {
            strict: true,
            ..LoadOptions::default()
        },
    )
    .unwrap();
    let desc = with_distinct_names(desc, &read);
    assert_same(&desc, &read);
    assert_eq!(rendered(&desc), rendered(&read));
    let text = String::from_utf8(folder.read("all.toml")).unwrap();
    assert!(text.starts_with("# something was left out\n"), "{text}");
    // What was read from a written scene is written as the same file.
    save(&read, &folder.path("again.toml")).unwrap();
    let again = load(
        &folder.path("again.toml"),
        LoadOptions {
            strict: true,
            ..LoadOptions::default()
        },
    )
    .unwrap();
    assert_same(&read, &again);
}

#[test]
fn every_mesh_and_bitmap_is_written_once_and_only_if_something_uses_it() {
    let folder = Folder::empty();
    let mut desc = everything();
    desc.meshes.push(desc.meshes[0].clone());
    desc.textures.push(desc.textures[0].clone());
    save(&desc, &folder.path("all.toml")).unwrap();
    let mut names: Vec<String> = fs::read_dir(folder.path("all_files"))
        .unwrap()
        .map(|entry| entry.unwrap().file_name().into_string().unwrap())
        .collect();
    names.sort();
    let expected = [
        "environment.exr",
        "mesh-0.ply",
        "mesh-1.ply",
        "mesh-2.ply",
        "mesh-3.ply",
        "mesh-4.ply",
        "mesh-5.ply",
        "mesh-6.ply",
        "mesh-7.ply",
        "texture-0.png",
        "texture-1.png",
        "texture-2.exr",
        "texture-3.exr",
        "texture-4.exr",
    ];
    assert_eq!(names, expected);
}

#[test]
fn what_no_scene_file_may_hold_is_an_error_that_names_the_key() {
    let folder = Folder::empty();
    let mut desc = everything();
    desc.materials[3].1.scattering = Scattering::Mirror {
        reflectance: Rgb::splat(1.5),
    };
    let error = save(&desc, &folder.path("all.toml")).unwrap_err().to_string();
    assert!(
        error.contains("materials.black-2.rgb") && error.contains("1.5"),
        "{error}"
    );
    desc.materials[3].1.scattering = Scattering::Mirror {
        reflectance: Rgb::splat(f32::NAN),
    };
    save(&desc, &folder.path("all.toml")).unwrap_err();
    assert!(folder.names().is_empty());
}

// The program.

/// Pixels of a small image that the program renders.
fn rendered_by_program(folder: &Folder, scene: &str) -> (u32, Vec<[u32; 3]>) {
    folder.done(&format!("render {scene} -o out.exr --spp 2 --resolution 40x30 -q"));
    bits(&folder.exr("out.exr"))
}

#[test]
fn scenes_of_the_repository_look_the_same_once_converted() {
    for name in ["cornell", "furnace", "glass", "many-lights", "spheres", "veach-mis"] {
        let folder = Folder::empty();
        let original = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("scenes/{name}/{name}.toml"));
        let original = original.to_str().unwrap();
        folder.done(&format!("convert {original} {name}.toml"));
        assert_same(
            &load(Path::new(original), LoadOptions::default()).unwrap(),
            &load(&folder.path(&format!("{name}.toml")), LoadOptions::default()).unwrap(),
        );
        assert_eq!(
            rendered_by_program(&folder, original),
            rendered_by_program(&folder, &format!("{name}.toml")),
            "{name}"
        );
    }
}

const MTL: &str = "newmtl tiles\nmap_Kd -s 2 3 1 -o 0.1 0.2 0 tiles.png\nmap_d tiles.png\nnewmtl gem\nillum 7\nNi 1.7\n\
    newmtl metal\nPm 1\nPr 0.3\nKd 0.9 0.6 0.3\nnewmtl lamp\nKe 3 2 1\nKd 0.1 0.1 0.1\nnewmtl coat\nKs 0.1 0.2 0.3\nNs 300\n\
    map_d -imfchan g tiles.png\nnorm tiles.png\n";

/// A square of each of the materials, and one without any.
fn obj() -> String {
    let mut obj = "mtllib parts.mtl\nvn 0 1 0.3\n".to_owned();
    for (i, name) in ["", "tiles", "gem", "metal", "lamp", "coat"].iter().enumerate() {
        if !name.is_empty() {
            obj += &format!("usemtl {name}\n");
        }
        let x = 1.1 * i as f64;
        for (u, v) in [(0, 0), (0, 1), (1, 1), (1, 0)] {
            obj += &format!(
                "v {} {} {}\nvt {u} {v}\n",
                x + f64::from(u),
                0.3 * f64::from(v) / 0.7,
                v
            );
        }
        obj += &format!("f -4/-4{n} -3/-3{n} -2/-2{n} -1/-1{n}\n", n = ["", "/1"][i % 2]);
    }
    obj
}

fn tiles() -> Vec<u8> {
    let mut tiles = std::io::Cursor::new(Vec::new());
    image::RgbaImage::from_fn(3, 2, |x, y| {
        image::Rgba([80 * x as u8, 200 * y as u8, 90, 100 + 70 * x as u8])
    })
    .write_to(&mut tiles, image::ImageFormat::Png)
    .unwrap();
    tiles.into_inner()
}

#[test]
fn a_mesh_with_its_materials_looks_the_same_once_converted() {
    let folder = Folder::empty();
    folder.write("parts.obj", obj());
    folder.write("parts.mtl", MTL);
    folder.write("tiles.png", tiles());
    folder.done("convert parts.obj parts.toml --strict");
    let desc = load(&folder.path("parts.obj"), LoadOptions::default()).unwrap();
    assert_eq!(desc.objects.len(), 6);
    assert_same(
        &desc,
        &load(
            &folder.path("parts.toml"),
            LoadOptions {
                strict: true,
                ..LoadOptions::default()
            },
        )
        .unwrap(),
    );
    assert_eq!(
        rendered_by_program(&folder, "parts.obj"),
        rendered_by_program(&folder, "parts.toml")
    );
}

/// A square with normals, texture coordinates and colours, in two places, and what of glTF becomes something else here.
const GLTF: &str = r#"{
    "asset": {"version": "2.0"},
    "extensionsUsed": ["KHR_lights_punctual", "KHR_materials_emissive_strength", "KHR_materials_transmission",
        "KHR_materials_clearcoat", "KHR_texture_transform"],
    "extensions": {"KHR_lights_punctual": {"lights": [
        {"type": "point", "intensity": 20.3, "color": [1, 0.8, 0.6]},
        {"type": "spot", "intensity": 70.1, "spot": {"innerConeAngle": 0.3, "outerConeAngle": 0.7123}},
        {"type": "directional", "intensity": 1.7}
    ]}},
    "scene": 0, "scenes": [{"nodes": [0, 1, 2, 3, 4, 5, 6]}],
    "nodes": [
        {"mesh": 0, "rotation": [0.1, 0.2, 0.3, 0.9273618495495703]},
        {"mesh": 0, "translation": [1.3, 0.1, -0.7], "scale": [1.1, 0.7, -0.9]},
        {"mesh": 1, "translation": [-1.3, 0.2, 0.1]},
        {"camera": 0, "name": "near", "translation": [0, 0.3, 4]},
        {"camera": 1, "name": "far", "translation": [0.5, 1, 7], "rotation": [-0.07, 0, 0, 0.9975469913743412]},
        {"translation": [0.3, 2, 1], "extensions": {"KHR_lights_punctual": {"light": 0}},
            "children": [7]},
        {"rotation": [-0.5, 0.1, 0, 0.8602325267042626], "translation": [0, 3, 2],
            "extensions": {"KHR_lights_punctual": {"light": 1}}},
        {"rotation": [-0.6, 0, 0, 0.8], "extensions": {"KHR_lights_punctual": {"light": 2}}}
    ],
    "cameras": [
        {"type": "perspective", "perspective": {"yfov": 0.7, "znear": 0.1, "aspectRatio": 1.333}},
        {"type": "perspective", "perspective": {"yfov": 0.4, "znear": 0.1}}
    ],
    "images": [{"uri": "tiles.png"}],
    "samplers": [{"wrapS": 33071, "wrapT": 33648, "magFilter": 9728}],
    "textures": [{"source": 0, "sampler": 0}, {"source": 0}],
    "materials": [
        {"name": "cut", "alphaMode": "MASK", "alphaCutoff": 0.6, "doubleSided": true,
            "pbrMetallicRoughness": {"baseColorTexture": {"index": 0, "extensions":
                {"KHR_texture_transform": {"offset": [0.1, 0.2], "rotation": 0.3, "scale": [2, 1.5]}}},
                "metallicRoughnessTexture": {"index": 1}, "roughnessFactor": 0.7},
            "normalTexture": {"index": 1, "scale": 0.8}},
        {"alphaMode": "BLEND", "emissiveFactor": [0.9, 0.5, 0.1], "emissiveTexture": {"index": 1},
            "pbrMetallicRoughness": {"baseColorFactor": [0.5, 0.6, 0.7, 0.8], "metallicFactor": 0.1},
            "extensions": {"KHR_materials_emissive_strength": {"emissiveStrength": 3.3},
                "KHR_materials_transmission": {"transmissionFactor": 0.4},
                "KHR_materials_clearcoat": {"clearcoatFactor": 0.5}}}
    ],
    "meshes": [
        {"primitives": [
            {"attributes": {"POSITION": 0, "NORMAL": 1, "TEXCOORD_0": 2, "COLOR_0": 3}, "indices": 4, "material": 0}]},
        {"primitives": [
            {"attributes": {"POSITION": 0, "TEXCOORD_0": 2}, "indices": 4, "material": 1},
            {"attributes": {"POSITION": 0}, "indices": 4}]}
    ],
    "buffers": [{"uri": "square.bin", "byteLength": 188}],
    "bufferViews": [{"buffer": 0, "byteLength": 176}, {"buffer": 0, "byteOffset": 176, "byteLength": 12}],
    "accessors": [
        {"bufferView": 0, "byteOffset": 0, "componentType": 5126, "count": 4, "type": "VEC3",
            "min": [-0.5, -0.5, 0], "max": [0.5, 0.5, 0.1]},
        {"bufferView": 0, "byteOffset": 48, "componentType": 5126, "count": 4, "type": "VEC3"},
        {"bufferView": 0, "byteOffset": 96, "componentType": 5126, "count": 4, "type": "VEC2"},
        {"bufferView": 0, "byteOffset": 128, "componentType": 5126, "count": 4, "type": "VEC3"},
        {"bufferView": 1, "byteOffset": 0, "componentType": 5123, "count": 6, "type": "SCALAR"}
    ]
}"#;

fn square() -> Vec<u8> {
    let positions = [-0.5, -0.5, 0.0, 0.5, -0.5, 0.0, 0.5, 0.5, 0.1, -0.5, 0.5, 0.0f32];
    let normals = [0.0, 0.0, 1.0, 0.1, 0.2, 0.9, 0.0, 0.6, 0.8, -0.3, 0.0, 1.0f32];
    let uvs = [0.0, 1.0, 1.0, 1.0, 1.0, 0.0, 0.0, 0.1f32];
    let colors = [1.0, 0.9, 0.8, 0.3, 1.0, 0.7, 0.5, 0.4, 1.0, 0.9, 0.9, 0.1f32];
    let numbers = positions.iter().chain(&normals).chain(&uvs).chain(&colors);
    let indices = [0, 1, 2, 0, 2, 3u16];
    numbers
        .flat_map(|c| c.to_le_bytes())
        .chain(indices.iter().flat_map(|i| i.to_le_bytes()))
        .collect()
}

#[test]
fn a_scene_of_another_format_looks_the_same_once_converted_from_each_of_its_cameras() {
    let folder = Folder::empty();
    folder.write("scene.gltf", GLTF);
    folder.write("square.bin", square());
    folder.write("tiles.png", tiles());
    let mut views = Vec::new();
    for camera in ["near", "far"] {
        folder.done(&format!("convert scene.gltf {camera}.toml --camera {camera} -q"));
        let view = rendered_by_program(&folder, &format!("scene.gltf --camera {camera}"));
        assert_eq!(
            view,
            rendered_by_program(&folder, &format!("{camera}.toml")),
            "{camera}"
        );
        views.push(view);
    }
    assert_ne!(views[0], views[1]);
    let desc = load(&folder.path("near.toml"), LoadOptions::default()).unwrap();
    assert_eq!(desc.lights.len(), 3);
    assert!(
        desc.materials
            .iter()
            .any(|(_, m)| m.opacity.is_some() && m.relief.is_some())
    );
    assert!(desc.objects.iter().any(|o| o.emission_map.is_some()));
    let info = folder.done("info near.toml").stdout;
    assert!(info.contains("1 point, 1 spot, 1 distant"), "{info}");
}

#[test]
fn a_mesh_with_colours_looks_the_same_once_converted() {
    let folder = Folder::empty();
    let colors = |scale: f32| (0..4).map(|i| Rgb::new(i as f32 / 3.0, 0.4, 1.0) * scale).collect();
    let square = support::quad(Vec3::ZERO, Vec3::X, Vec3::Y).into_f64();
    for (name, scale) in [("unit", 1.0), ("bright", 1.7)] {
        let mut bytes = Vec::new();
        let mesh = TriangleMesh {
            colors: colors(scale),
            ..square.clone()
        };
        write_ply(&mesh, &mut bytes).unwrap();
        folder.write(&format!("{name}.ply"), bytes);
        folder.done(&format!("convert {name}.ply {name}.toml -q"));
        let view = rendered_by_program(&folder, &format!("{name}.ply"));
        assert_eq!(view, rendered_by_program(&folder, &format!("{name}.toml")), "{name}");
        let (_, pixels) = view;
        assert_ne!(pixels[20 + 15 * 40], pixels[12 + 15 * 40], "no colour can be seen");
    }
    // Nor do surfaces of scene files reflect more than there is.
    let painted = "[materials.red]\ntype = \"diffuse\"\nvertex_colors = true\n";
    folder.write(
        "scene.toml",
        [CAMERA, SKY, painted, &FLOOR.replace("floor.obj", "bright.ply")].concat(),
    );
    let desc = load(&folder.path("scene.toml"), LoadOptions::default()).unwrap();
    assert!(desc.meshes[0].colors.iter().all(|c| c.max_component() <= 1.0));
    assert!(desc.warnings[0].contains("bright.ply"), "{:?}", desc.warnings);
}

#[test]
fn a_scene_may_be_converted_onto_itself_and_is_replaced_whole() {
    let folder = Folder::with(&[CAMERA, SKY, RED, FLOOR, LAMP].concat());
    let before = rendered_by_program(&folder, "scene.toml");
    folder.done("convert scene.toml scene.toml -q");
    assert_eq!(rendered_by_program(&folder, "scene.toml"), before);
    let written = (folder.read("scene.toml"), folder.read("scene_files/mesh-0.ply"));
    folder.write("scene_files/notes.txt", "mine");
    folder.done("convert scene.toml scene.toml -q");
    // Names of objects say what they were read from.
    let lines = |bytes: &[u8]| {
        let text = String::from_utf8(bytes.to_vec()).unwrap();
        text.lines()
            .filter(|line| !line.starts_with("name"))
            .map(str::to_owned)
            .collect::<Vec<_>>()
    };
    assert_eq!(lines(&folder.read("scene.toml")), lines(&written.0));
    assert_eq!(folder.read("scene_files/mesh-0.ply"), written.1);
    assert_eq!(folder.read("scene_files/notes.txt"), b"mine");
}

#[test]
fn converting_fails_with_the_code_of_what_is_at_fault_and_leaves_no_files() {
    let folder = Folder::with_scene();
    folder.refused("convert scene.toml out.json", 2, &["out.json", ".toml"]);
    folder.refused("convert none.toml out.toml", 3, &["none.toml", "cannot be read"]);
    folder.refused("convert scene.toml none/out.toml", 4, &["none", "cannot be written"]);
    folder.write("out_files", "in the way");
    folder.refused("convert scene.toml out.toml", 4, &["out_files", "cannot be written"]);
    fs::create_dir(folder.path("dir.toml")).unwrap();
    folder.refused("convert scene.toml dir.toml", 4, &["dir.toml", "a directory"]);
    // Whatever fails, files of before are as they were.
    fs::remove_file(folder.path("out_files")).unwrap();
    folder.done("convert scene.toml out.toml");
    let scene = folder.read("out.toml");
    fs::remove_file(folder.path("out_files/mesh-0.ply")).unwrap();
    fs::create_dir(folder.path("out_files/mesh-0.ply")).unwrap();
    folder.refused("convert scene.toml out.toml", 4, &["mesh-0.ply", "cannot be written"]);
    assert_eq!(folder.read("out.toml"), scene);
    fs::remove_dir(folder.path("out_files/mesh-0.ply")).unwrap();
    let warned = [CAMERA, SKY, "[[meshes]]\nfile = \"floor.obj\"\n"].concat();
    folder.write("warned.toml", warned);
    folder.write("floor.obj", format!("mtllib none.mtl\n{SQUARE}"));
    folder.refused("convert warned.toml out.toml --strict", 3, &["none.mtl", "--strict"]);
    let ran = folder.done("convert warned.toml out.toml");
    assert!(ran.stderr.starts_with("warning: ") && ran.stderr.contains("none.mtl"));
    assert!(String::from_utf8(folder.read("out.toml")).unwrap().starts_with("# "));
    assert_eq!(folder.done("convert warned.toml out.toml -q").stderr, "");
}
