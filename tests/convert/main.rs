//! Writing scenes: `embrace convert`, and what is read back of a description with everything that there is.

mod everything;
#[path = "../support/mod.rs"]
mod support;

use embrace::accel::brute::Brute;
use embrace::image::Image;
use embrace::integrator::Settings;
use embrace::material::{Back, General, Material, Scattering};
use embrace::math::{Rgb, Vec3};
use embrace::mesh::TriangleMesh;
use embrace::scene::ply::write_ply;
use embrace::scene::{EnvironmentDesc, LoadOptions, ObjectDesc, SceneDesc, SceneOptions, load, save};
use embrace::texture::Texture;
use everything::everything;
use std::fs;
use std::path::Path;
use support::Prepared;
use support::program::{CAMERA, FLOOR, Folder, LAMP, RED, SKY, SQUARE};

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
    let mut textures = Vec::new();
    let mut lights = |desc: &SceneDesc| with_textures(&format!("{:?}", desc.lights), desc, &mut textures);
    assert_eq!(lights(a), lights(b));
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
