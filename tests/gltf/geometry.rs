//! Nodes, meshes and the numbers that they are made of.

use super::file::*;
use embrace::math::{DVec3, Rgb, Vec2, Vec3};
use embrace::scene::SceneDesc;
use serde_json::{Value, json};

/// The corners of the triangles of a mesh, where they are.
fn corners(desc: &SceneDesc, mesh: usize) -> Vec<[DVec3; 3]> {
    let mesh = &desc.meshes[mesh];
    let corners = |t: &[u32; 3]| t.map(|i| mesh.positions[i as usize]);
    mesh.indices.iter().map(corners).collect()
}

/// One triangle, numbered by the bytes of `indices`.
fn triangle(indices: &[u8], component: u32) -> File {
    let mut file = File::new();
    let positions = file.floats("VEC3", &[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0]);
    let indices = file.accessor(indices, component, "SCALAR", 3);
    file.add(
        "meshes",
        json!({ "primitives": [{ "attributes": { "POSITION": positions }, "indices": indices }] }),
    );
    file.add("nodes", json!({ "mesh": 0 }));
    file
}

#[test]
fn a_mesh_in_several_nodes_is_read_once_and_stands_where_its_nodes_put_it() {
    let mut file = File::square(None);
    file.json["nodes"] = json!([
        { "name": "top", "mesh": 0, "children": [1, 2], "translation": [10, 0, 0], "scale": [2, 2, 2] },
        // A quarter turn about z: x becomes y.
        { "mesh": 0, "rotation": [0, 0, 0.5f64.sqrt(), 0.5f64.sqrt()], "translation": [0, 1, 0] },
        { "mesh": 0, "matrix": [0, 0, -1, 0, 0, 1, 0, 0, 1, 0, 0, 0, 0, 0, 7, 1] },
    ]);
    let desc = file.load_without_warnings();
    assert_eq!((desc.meshes.len(), desc.objects.len()), (1, 3));
    let place = |object: usize, p: DVec3| desc.objects[object].to_world.transform_point3(p);
    let near = |a: DVec3, b: [f64; 3]| assert!((a - DVec3::from(b)).length() < 1e-12, "{a} for {b:?}");
    near(place(0, DVec3::X), [12.0, 0.0, 0.0]);
    near(place(1, DVec3::X), [10.0, 4.0, 0.0]);
    near(place(2, DVec3::X), [10.0, 0.0, 12.0]);
    assert!(desc.objects.iter().all(|o| o.mesh == 0));
    assert!(
        desc.objects[0].name.contains("nodes[0] (top), meshes[0].primitives[0]"),
        "{}",
        desc.objects[0].name
    );
}

#[test]
fn transforms_are_kept_and_multiplied_in_64_bits() {
    let mut file = File::square(None);
    // Neither is a number of 32 bits.
    file.json["nodes"] = json!([
        { "children": [1], "translation": [123456789.25, 0, 0] },
        { "mesh": 0, "translation": [0.001, 0, 0] },
    ]);
    let desc = file.load_without_warnings();
    assert_eq!(desc.objects[0].to_world.translation.x, 123_456_789.25 + 0.001);
}

#[test]
fn the_scene_that_the_file_names_is_shown() {
    let mut file = File::square(None);
    file.add("nodes", json!({ "mesh": 0, "translation": [5, 0, 0] }));
    file.json["scenes"] = json!([{ "nodes": [0] }, { "nodes": [1], "name": "second" }]);
    file.json["scene"] = json!(1);
    let desc = file.load();
    assert_eq!(desc.objects.len(), 1);
    assert_eq!(desc.objects[0].to_world.translation.x, 5.0);
    assert!(file.warning().contains("has 2 scenes; scenes[1] (second) is shown"));
}

#[test]
fn long_chains_of_nodes_are_followed() {
    let mut file = File::square(None);
    let last = 50_000;
    let chain = (1..=last).map(|i| {
        let below = if i == last { json!([0]) } else { json!([i + 1]) };
        json!({ "children": below, "translation": [0.5, 0, 0] })
    });
    let nodes: Vec<Value> = std::iter::once(json!({ "mesh": 0 })).chain(chain).collect();
    file.json["nodes"] = json!(nodes);
    let desc = file.load();
    assert_eq!(desc.objects[0].to_world.translation.x, 0.5 * f64::from(last));
}

#[test]
fn indices_of_every_width_and_none_number_the_same_triangles() {
    let bytes = |indices: [u32; 3], width: usize| -> Vec<u8> {
        indices.iter().flat_map(|i| i.to_le_bytes()[..width].to_vec()).collect()
    };
    let expected = [[DVec3::X, DVec3::Y, DVec3::ZERO]];
    for (component, width) in [(U8, 1), (U16, 2), (U32, 4)] {
        let desc = triangle(&bytes([1, 2, 0], width), component).load_without_warnings();
        assert_eq!(corners(&desc, 0), expected);
    }
    let mut none = triangle(&[0; 3], U8);
    let primitive = &mut none.json["meshes"][0]["primitives"][0];
    primitive.as_object_mut().unwrap().remove("indices");
    assert_eq!(
        corners(&none.load_without_warnings(), 0),
        [[DVec3::ZERO, DVec3::X, DVec3::Y]]
    );
}

/// Corners 0 to 4 on a zigzag to the right.
fn zigzag(mode: u32) -> File {
    let mut file = File::new();
    let positions: Vec<f32> = (0..5).flat_map(|i| [i as f32, (i % 2) as f32, 0.0]).collect();
    let positions = file.floats("VEC3", &positions);
    file.add(
        "meshes",
        json!({ "primitives": [{ "attributes": { "POSITION": positions }, "mode": mode }] }),
    );
    file.add("nodes", json!({ "mesh": 0 }));
    file
}

#[test]
fn strips_and_fans_become_triangles_with_one_front() {
    let side = |[a, b, c]: [DVec3; 3]| (b - a).cross(c - a).z;
    let strip = corners(&zigzag(5).load_without_warnings(), 0);
    assert_eq!(strip.len(), 3);
    assert!(strip.iter().all(|t| side(*t) < 0.0), "{strip:?}");
    let fan = corners(&zigzag(6).load_without_warnings(), 0);
    assert_eq!(fan.len(), 3);
    assert!(fan.iter().all(|t| t[2] == DVec3::ZERO));
}

#[test]
fn points_and_lines_are_left_out_with_a_warning() {
    for mode in 0..4 {
        let desc = zigzag(mode).load();
        assert!(desc.objects.is_empty() && desc.meshes.is_empty());
        assert!(
            zigzag(mode)
                .warning()
                .contains("meshes[0].primitives[0]: points and lines")
        );
    }
    assert!(zigzag(4).warning().contains("corners that make no whole triangle"));
    assert_eq!(corners(&zigzag(4).load(), 0).len(), 1);
}

#[test]
fn texture_coordinates_are_turned_over_and_normals_kept() {
    let material = json!({ "normalTexture": { "index": 0 } });
    let mut file = File::square(Some(material));
    file.texture(&png([[128, 128, 255, 255]; 4]));
    let mesh = &file.load_without_warnings().meshes[0];
    assert_eq!(
        mesh.uvs,
        [[0.0, 1.0], [1.0, 1.0], [1.0, 0.0], [0.0, 0.0]].map(Vec2::from)
    );
    assert_eq!(mesh.normals, [Vec3::Z; 4]);
    // Without a texture they are not read at all.
    assert!(File::square(None).load_without_warnings().meshes[0].uvs.is_empty());
}

#[test]
fn integers_are_scaled_where_they_are_normalised() {
    let mut file = File::square(Some(json!({ "emissiveTexture": { "index": 0 } })));
    file.texture(&png([[255; 4]; 4]));
    file.json["extensionsUsed"] = json!(["KHR_mesh_quantization"]);
    file.json["extensionsRequired"] = json!(["KHR_mesh_quantization"]);
    let shorts: Vec<u8> = [
        -32768i16, 32767, 0, 32767, 32767, 0, 32767, -16384, 0, -32768, -16384, 0,
    ]
    .iter()
    .flat_map(|v| v.to_le_bytes())
    .collect();
    // Bytes are padded to four an element.
    let bytes: Vec<u8> = [[0i8, 0, 127, 0]; 4].concat().iter().map(|v| *v as u8).collect();
    let uvs: Vec<u8> = [0u16, 0, 65535, 0, 65535, 65535, 0, 65535]
        .iter()
        .flat_map(|v| v.to_le_bytes())
        .collect();
    let [positions, normals, uvs] = [
        file.accessor(&shorts, I16, "VEC3", 4),
        file.accessor(&bytes, I8, "VEC3", 4),
        file.accessor(&uvs, U16, "VEC2", 4),
    ];
    let stride = file.json["accessors"][normals]["bufferView"].as_u64().unwrap() as usize;
    file.json["bufferViews"][stride]["byteStride"] = json!(4);
    for accessor in [positions, normals, uvs] {
        file.json["accessors"][accessor]["normalized"] = json!(true);
    }
    let attributes = json!({ "POSITION": positions, "NORMAL": normals, "TEXCOORD_0": uvs });
    file.json["meshes"][0]["primitives"][0]["attributes"] = attributes;
    let mesh = file.load_without_warnings().meshes[0].clone();
    let half = f64::from(-16384.0f32 / 32767.0);
    assert_eq!(mesh.positions[0], DVec3::new(-1.0, 1.0, 0.0));
    assert_eq!(mesh.positions[3], DVec3::new(-1.0, half, 0.0));
    assert_eq!(mesh.normals, [Vec3::Z; 4]);
    assert_eq!(mesh.uvs[2], Vec2::new(1.0, 0.0));
    // The same numbers as they are.
    file.json["accessors"][positions]["normalized"] = json!(false);
    let mesh = file.load_without_warnings().meshes[0].clone();
    assert_eq!(mesh.positions[0], DVec3::new(-32768.0, 32767.0, 0.0));
}

#[test]
fn interleaved_attributes_are_told_apart_by_stride_and_offset() {
    let mut file = triangle(&[0, 1, 2], U8);
    let vertex = |p: [f32; 3], n: [f32; 3]| [p, n].concat();
    let values: Vec<f32> = [
        vertex([0.0; 3], [0.0, 0.0, 1.0]),
        vertex([3.0, 0.0, 0.0], [1.0, 0.0, 0.0]),
        vertex([0.0, 3.0, 0.0], [0.0, 1.0, 0.0]),
    ]
    .concat();
    let view = file.view(&values.iter().flat_map(|v| v.to_le_bytes()).collect::<Vec<u8>>());
    file.json["bufferViews"][view]["byteStride"] = json!(24);
    let at = |offset: usize| json!({ "bufferView": view, "byteOffset": offset, "componentType": F32, "type": "VEC3", "count": 3 });
    let [positions, normals] = [0, 12].map(|offset| file.add("accessors", at(offset)));
    file.json["meshes"][0]["primitives"][0]["attributes"] = json!({ "POSITION": positions, "NORMAL": normals });
    let mesh = file.load_without_warnings().meshes[0].clone();
    assert_eq!(mesh.positions, [DVec3::ZERO, 3.0 * DVec3::X, 3.0 * DVec3::Y]);
    assert_eq!(mesh.normals, [Vec3::Z, Vec3::X, Vec3::Y]);
}

#[test]
fn sparse_accessors_replace_elements_of_others_or_of_zeros() {
    for has_base in [true, false] {
        let mut file = triangle(&[0, 1, 2], U8);
        let indices = file.view(&[1, 0, 2, 0]);
        let values: Vec<u8> = [9.0f32, 0.0, 0.0, 0.0, 9.0, 0.0]
            .iter()
            .flat_map(|v| v.to_le_bytes())
            .collect();
        let values = file.view(&values);
        let accessor = &mut file.json["accessors"][0];
        accessor["sparse"] = json!({
            "count": 2,
            "indices": { "bufferView": indices, "componentType": U16 },
            "values": { "bufferView": values },
        });
        if !has_base {
            accessor.as_object_mut().unwrap().remove("bufferView");
        }
        let mesh = file.load_without_warnings().meshes[0].clone();
        assert_eq!(mesh.positions, [DVec3::ZERO, 9.0 * DVec3::X, 9.0 * DVec3::Y]);
    }
}

#[test]
fn primitives_that_share_a_large_array_take_what_they_use_of_it() {
    let mut file = File::new();
    let count = 3000;
    let positions: Vec<f32> = (0..count).flat_map(|i| [i as f32, (i * i % 7) as f32, 0.0]).collect();
    let positions = file.floats("VEC3", &positions);
    let primitives: Vec<Value> = [[7u16, 2999, 40], [1, 2, 0]]
        .iter()
        .map(|indices| {
            let bytes: Vec<u8> = indices.iter().flat_map(|i| i.to_le_bytes()).collect();
            let indices = file.accessor(&bytes, U16, "SCALAR", 3);
            json!({ "attributes": { "POSITION": positions }, "indices": indices })
        })
        .collect();
    file.add("meshes", json!({ "primitives": primitives }));
    file.add("nodes", json!({ "mesh": 0 }));
    let desc = file.load_without_warnings();
    assert!(desc.meshes.iter().all(|mesh| mesh.positions.len() == 3));
    let x = |mesh: usize| corners(&desc, mesh)[0].map(|p| p.x);
    assert_eq!((x(0), x(1)), ([7.0, 2999.0, 40.0], [1.0, 2.0, 0.0]));
}

#[test]
fn equal_primitives_with_other_materials_share_their_triangles() {
    let mut file = File::square(None);
    let mut primitive = file.json["meshes"][0]["primitives"][0].clone();
    primitive["material"] = json!(0);
    file.add("materials", json!({ "name": "other" }));
    file.add("meshes", json!({ "primitives": [primitive] }));
    file.add("nodes", json!({ "mesh": 1, "translation": [3, 0, 0] }));
    let desc = file.load_without_warnings();
    assert_eq!(desc.meshes.len(), 1);
    let names: Vec<&str> = desc.objects.iter().map(|o| &*desc.materials[o.material].0).collect();
    assert_eq!(names, ["default", "materials[0] (other)"]);
}

#[test]
fn vertex_colours_of_every_kind_are_linear_and_clamped() {
    let mut file = File::square(None);
    let shorts: Vec<u8> = [65535u16, 0, 13107, 0]
        .repeat(4)
        .iter()
        .flat_map(|v| v.to_le_bytes())
        .collect();
    let kinds = [
        file.floats("VEC3", &[1.0, -3.0, 0.2].repeat(4)),
        file.floats("VEC4", &[7.0, f32::NAN, 0.2, 1.0].repeat(4)),
        file.accessor(&[255u8, 0, 51, 255].repeat(4), U8, "VEC4", 4),
        file.accessor(&shorts, U16, "VEC4", 4),
    ];
    for kind in kinds {
        file.json["accessors"][kind]["normalized"] = json!(true);
        file.json["meshes"][0]["primitives"][0]["attributes"]["COLOR_0"] = json!(kind);
        let desc = file.load_without_warnings();
        assert_eq!(desc.meshes[0].colors, [Rgb::new(1.0, 0.0, 0.2); 4], "kind {kind}");
    }
}

#[test]
fn what_moves_is_shown_at_rest_with_a_warning() {
    let mut morph = File::square(None);
    morph.json["meshes"][0]["primitives"][0]["targets"] = json!([{ "POSITION": 0 }]);
    assert!(morph.warning().contains("morph targets are ignored"));
    let mut skin = File::square(None);
    skin.add("nodes", json!({}));
    skin.add("skins", json!({ "joints": [1] }));
    skin.json["nodes"][0]["skin"] = json!(0);
    assert!(skin.warning().contains("the skin is ignored"));
    let mut flat = File::square(None);
    flat.json["nodes"][0]["scale"] = json!([1, 0, 1]);
    assert!(flat.load().objects.is_empty());
    assert!(flat.warning().contains("flattens the mesh"));
    let mut animated = File::square(None);
    let times = animated.floats("SCALAR", &[0.0, 1.0]);
    let values = animated.floats("VEC3", &[0.0; 6]);
    animated.json["animations"] = json!([{
        "channels": [{ "sampler": 0, "target": { "node": 0, "path": "translation" } }],
        "samplers": [{ "input": times, "output": values }],
    }]);
    assert!(animated.warning().contains("animations are ignored"));
}
