//! Files that cannot be read: errors that name the file and the place.

use super::file::*;
use serde_json::{Value, json};

#[track_caller]
fn refused(file: &File, words: &str) {
    let error = file.error();
    assert!(error.contains("scene.gltf") && error.contains(words), "{error}");
}

/// The square after a change.
#[track_caller]
fn refused_with(change: impl Fn(&mut Value), words: &str) {
    let mut file = File::square(Some(
        json!({ "pbrMetallicRoughness": { "baseColorTexture": { "index": 0 } } }),
    ));
    file.texture(&png([[255; 4]; 4]));
    file.load();
    change(&mut file.json);
    refused(&file, words);
}

#[test]
fn nodes_that_are_no_forest_are_errors() {
    let nodes = |nodes: Value| {
        let mut file = File::new();
        file.json["nodes"] = nodes;
        file
    };
    refused(
        &nodes(json!([{ "children": [1] }, { "children": [0] }])),
        "nodes[0]: the node is among its own descendants",
    );
    refused(&nodes(json!([{ "children": [0] }])), "nodes[0]: the node is among");
    refused(
        &nodes(json!([{ "children": [2] }, { "children": [2] }, {}])),
        "nodes[1].children[0]: node 2 is a child of node 0 already",
    );
    refused(
        &nodes(json!([{ "children": [1, 1] }, {}])),
        "nodes[0].children[1]: node 1 is a child",
    );
    let mut child = nodes(json!([{ "children": [1] }, {}]));
    child.json["scenes"] = json!([{ "nodes": [1] }]);
    refused(&child, "scenes[0].nodes[0]: node 1 is a child of node 0");
    child.json["scenes"] = json!([{ "nodes": [0, 0] }]);
    refused(&child, "scenes[0].nodes[1]: node 0 is listed twice");
    refused(&nodes(json!([{ "children": [7] }])), "nodes[0].children[0]");
}

#[test]
fn transforms_that_are_none_are_errors() {
    refused_with(|f| f["nodes"][0]["rotation"] = json!([0, 0, 0, 0]), "nodes[0].rotation");
    refused_with(
        |f| f["nodes"][0]["matrix"] = json!([1, 0, 0, 1, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]),
        "nodes[0].matrix: the last row",
    );
    refused_with(|f| f["nodes"][0]["matrix"] = json!([1, 0, 0]), "line 1");
    refused_with(
        |f| {
            f["nodes"][0]["scale"] = json!([1e38, 1, 1]);
            for i in 0..9 {
                let up = json!({ "children": [i], "scale": [1e38, 1, 1] });
                f["nodes"].as_array_mut().unwrap().push(up);
            }
        },
        "nodes[1]: its place in the world is not finite",
    );
}

#[test]
fn what_refers_to_nothing_is_an_error() {
    for (pointer, words) in [
        ("/nodes/0/mesh", "nodes[0].mesh"),
        (
            "/meshes/0/primitives/0/attributes/POSITION",
            "attributes.POSITION: there is no accessor",
        ),
        ("/meshes/0/primitives/0/attributes/NORMAL", "attributes[\"NORMAL\"]"),
        ("/meshes/0/primitives/0/indices", "meshes[0].primitives[0].indices"),
        ("/meshes/0/primitives/0/material", "meshes[0].primitives[0].material"),
        ("/accessors/0/bufferView", "accessors[0].bufferView"),
        ("/bufferViews/0/buffer", "bufferViews[0].buffer"),
        ("/textures/0/source", "textures[0].source"),
        ("/images/0/bufferView", "images[0].bufferView"),
        (
            "/materials/0/pbrMetallicRoughness/baseColorTexture/index",
            "materials[0].pbrMetallicRoughness.baseColorTexture.index",
        ),
    ] {
        refused_with(|f| *f.pointer_mut(pointer).expect("a part") = json!(99), words);
        refused_with(|f| *f.pointer_mut(pointer).expect("a part") = json!(-1), "line 1");
    }
    refused_with(|f| f["scene"] = json!(0), "scene");
    refused_with(|f| f["textures"][0] = json!({}), "textures[0].source: is missing");
    refused_with(|f| f["images"][0] = json!({}), "images[0]: has neither");
}

#[test]
fn views_and_accessors_beyond_their_bytes_are_errors() {
    let huge = u64::MAX - 7;
    for length in [1000, huge] {
        refused_with(
            |f| f["bufferViews"][0]["byteLength"] = json!(length),
            "bufferViews[0]: ",
        );
        refused_with(
            |f| f["bufferViews"][0]["byteOffset"] = json!(length),
            "bufferViews[0]: ",
        );
        refused_with(
            |f| f["accessors"][0]["count"] = json!(length),
            "not within bufferViews[0]",
        );
        refused_with(
            |f| f["accessors"][0]["byteOffset"] = json!(length),
            "not within bufferViews[0]",
        );
    }
    refused_with(|f| f["accessors"][0]["count"] = json!(0), "accessors[0].count: is 0");
    refused_with(|f| f["accessors"][0]["count"] = json!(5), "not within bufferViews[0]");
    refused_with(
        |f| f["accessors"][1]["count"] = json!(3),
        "attributes.NORMAL: has 3 elements, but POSITION has 4",
    );
    refused_with(
        |f| f["bufferViews"][0]["byteStride"] = json!(8),
        "bufferViews[0].byteStride: 8 is less",
    );
    refused_with(
        |f| f["bufferViews"][0]["byteStride"] = json!(0),
        "bufferViews[0].byteStride",
    );
    refused_with(|f| f["accessors"][0]["type"] = json!("VEC2"), "accessors[0].type");
    refused_with(|f| f["accessors"][0]["type"] = json!("MAT4"), "accessors[0].type");
    refused_with(
        |f| f["accessors"][0]["componentType"] = json!(5124),
        "accessors[0].componentType",
    );
    refused_with(
        |f| f["accessors"][3]["componentType"] = json!(5120),
        "accessors[3].componentType",
    );
    let view = |f: &mut Value| drop(f["accessors"][0].as_object_mut().unwrap().remove("bufferView"));
    refused_with(
        |f| {
            view(f);
            f["accessors"][0]["count"] = json!(1u64 << 40);
        },
        "accessors[0].count: 1099511627776 elements without a buffer view",
    );
}

#[test]
fn indices_and_positions_that_are_none_are_errors() {
    let mut file = File::square(None);
    let far = file.accessor(&[0, 1, 4], U8, "SCALAR", 3);
    file.json["meshes"][0]["primitives"][0]["indices"] = json!(far);
    refused(
        &file,
        "meshes[0].primitives[0].indices: index 2 is 4, but there are 4 vertices",
    );
    let mut file = File::square(None);
    let nan = file.floats("VEC3", &[0.0, 1.0, 2.0, f32::NAN].repeat(3));
    file.json["meshes"][0]["primitives"][0]["attributes"]["POSITION"] = json!(nan);
    refused(
        &file,
        "meshes[0].primitives[0]: vertex 1 has a position that is not finite",
    );
}

#[test]
fn sparse_accessors_that_contradict_themselves_are_errors() {
    let sparse = |indices: [u16; 2], count: u64| {
        let mut file = File::square(None);
        let indices = file.view(&indices.map(u16::to_le_bytes).concat());
        let values = file.view(&[0; 24]);
        file.json["accessors"][0]["sparse"] = json!({
            "count": count,
            "indices": { "bufferView": indices, "componentType": U16 },
            "values": { "bufferView": values },
        });
        file
    };
    sparse([1, 2], 2).load();
    refused(
        &sparse([2, 2], 2),
        "accessors[0].sparse.indices: index 1 is 2, but they must grow",
    );
    refused(
        &sparse([2, 4], 2),
        "accessors[0].sparse.indices: 4 is beyond the 4 elements",
    );
    refused(&sparse([1, 2], 3), "accessors[0].sparse.indices: 3 elements");
    refused(&sparse([1, 2], 0), "accessors[0].sparse.count");
    refused(&sparse([1, 2], 5), "accessors[0].sparse.count: 5 is not within");
    refused(&sparse([1, 2], u64::MAX), "use more than");
}

#[test]
fn a_small_file_that_has_the_same_numbers_read_without_end_is_refused() {
    let many = |count: usize| {
        let mut file = File::new();
        let positions = file.floats("VEC3", &vec![0.5; 30_000]);
        // All different, so that none of them is another one's.
        let primitives: Vec<Value> = (0..count)
            .map(|i| {
                let mut accessor = file.json["accessors"][positions].clone();
                accessor["byteOffset"] = json!(4 * (i % 3));
                accessor["count"] = json!(9_990 - i);
                json!({ "attributes": { "POSITION": file.add("accessors", accessor) } })
            })
            .collect();
        file.add("meshes", json!({ "primitives": primitives }));
        file.add("nodes", json!({ "mesh": 0 }));
        file
    };
    many(30).load();
    refused(&many(2000), "primitives up to this one use more than");
}

#[test]
fn files_and_data_that_are_not_there_are_errors() {
    let buffer = |uri: &str| {
        let mut file = File::square(None);
        let length = file.bytes.len();
        file.bytes.clear();
        file.json["buffers"] = json!([{ "byteLength": length, "uri": uri }]);
        file
    };
    let error = buffer("gone.bin").error();
    assert!(error.contains("gone.bin: cannot be read"), "{error}");
    // A folder.
    assert!(buffer(".").error().contains("cannot be read"));
    refused(
        &buffer("https://example.com/a.bin"),
        "buffers[0].uri: https://example.com/a.bin is not read",
    );
    refused(&buffer("data:;base64,AAAA"), "buffers[0].byteLength: says");
    refused(
        &buffer("data:;base64,A?AA"),
        "buffers[0].uri: the data URI is not whole base64",
    );
    refused(&buffer("data:;base64"), "buffers[0].uri: the data URI has no comma");
    refused(
        &buffer("data:text/plain,abc"),
        "buffers[0].uri: the data URI is not base64",
    );
    refused(&buffer("%ff"), "buffers[0].uri: %ff is not a URI of UTF-8");
    let mut none = buffer("");
    none.json["buffers"][0].as_object_mut().unwrap().remove("uri");
    refused(&none, "buffers[0]: has neither a URI nor bytes");
    refused_with(
        |f| f["images"][0] = json!({ "uri": "data:image/png;base64,AAAA" }),
        "scene.gltf: images[0]: no known image format",
    );
}

#[test]
fn images_without_texels_are_errors() {
    let mut empty = png([[9; 4]; 4]);
    // The width, and the checksum of the header after it.
    empty[16..20].fill(0);
    let mut file = File::square(Some(
        json!({ "pbrMetallicRoughness": { "baseColorTexture": { "index": 0 } } }),
    ));
    file.texture(&empty);
    let error = file.error();
    assert!(error.contains("scene.gltf: images[0]"), "{error}");
}

#[test]
fn text_that_is_no_gltf_2_is_an_error() {
    let text = |text: &[u8]| {
        in_folder(&[("a.gltf", text)], "a.gltf", None)
            .expect_err("no scene")
            .to_string()
    };
    for (content, words) in [
        (&b"{"[..], "line 1"),
        (b"", "not the JSON of glTF"),
        (b"{}", "missing field `asset`"),
        (b"[1]", "not the JSON of glTF"),
        (b"\xff\xfe", "not the JSON of glTF"),
        (
            br#"{"asset":{"version":"1.0"},"meshes":{}}"#,
            "asset.version: \"1.0\" is not read",
        ),
        (
            br#"{"asset":{"version":"2.1","minVersion":"3.0"}}"#,
            "asset.version: \"3.0\" is not read",
        ),
        (br#"{"asset":{"version":"2.0"},"nodes":7}"#, "invalid type: integer `7`"),
    ] {
        let error = text(content);
        assert!(error.contains("a.gltf: ") && error.contains(words), "{error}");
    }
    let deep = format!(
        r#"{{"asset":{{"version":"2.0"}},"extensions":{{"E":{}1{}}}}}"#,
        "[".repeat(5000),
        "]".repeat(5000)
    );
    assert!(text(deep.as_bytes()).contains("recursion limit"));
    // What a person may put there is allowed.
    let any = br#"{"asset":{"version":"2.0","extras":null},"nodes":[{"extras":"text"}]}"#;
    assert!(in_folder(&[("a.gltf", any)], "a.gltf", None).is_ok());
}

#[test]
fn every_cut_of_a_binary_file_is_an_error() {
    let whole = File::square(None).glb();
    let load = |bytes: &[u8]| in_folder(&[("a.glb", bytes)], "a.glb", None);
    load(&whole).expect("a whole file");
    for cut in 0..whole.len() {
        let error = load(&whole[..cut])
            .map(|_| ())
            .expect_err("a part of a file")
            .to_string();
        assert!(error.contains("a.glb: "), "{error}");
    }
    let mut longer = whole.clone();
    longer.extend([0; 5]);
    load(&longer).expect("what follows the file does not matter");
}

#[test]
fn binary_files_in_disorder_are_errors() {
    let error = |bytes: &[u8]| {
        in_folder(&[("a.glb", bytes)], "a.glb", None)
            .expect_err("no scene")
            .to_string()
    };
    let json = br#"{"asset":{"version":"2.0"}}"#;
    let mut first = glb(&[(b"JSON", json)]);
    first[4] = 1;
    assert!(error(&first).contains("GLB version 1"));
    assert!(error(&glb(&[(b"BIN\0", b"")])).contains("the first chunk of the GLB is not JSON"));
    assert!(error(&glb(&[])).contains("the first chunk"));
    let mut short = glb(&[(b"JSON", json)]);
    short[8..12].copy_from_slice(&3u32.to_le_bytes());
    assert!(error(&short).contains("a.glb: "));
    let mut large = glb(&[(b"JSON", json)]);
    large[12..16].copy_from_slice(&u32::MAX.to_le_bytes());
    assert!(error(&large).contains("a chunk of the GLB says it has 4294967295 bytes"));
    // Chunks of other kinds are skipped.
    let more = glb(&[(b"JSON", json), (b"KIND", b"1234"), (b"BIN\0", b"5678")]);
    assert!(in_folder(&[("a.glb", &more)], "a.glb", None).is_ok());
}

#[test]
fn nothing_that_is_damaged_panics() {
    let mut file = File::square(Some(
        json!({ "pbrMetallicRoughness": { "baseColorTexture": { "index": 0 } }, "alphaMode": "MASK" }),
    ));
    file.texture(&png([[255; 4]; 4]));
    let whole = file.glb();
    let mut random = super::support::Random(7);
    let (mut read, mut refused) = (0, 0);
    for _ in 0..3000 {
        let mut bytes = whole.clone();
        for _ in 0..1 + random.below(4) {
            let at = random.below(bytes.len());
            bytes[at] = random.bits() as u8;
        }
        match in_folder(&[("a.glb", &bytes)], "a.glb", None) {
            Ok(_) => read += 1,
            Err(_) => refused += 1,
        }
    }
    assert!(read > 100 && refused > 100, "{read} read, {refused} refused");
}
