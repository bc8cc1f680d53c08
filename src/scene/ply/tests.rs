use super::*;
use crate::math::Vec3;

const SQUARE: [[f32; 3]; 4] = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]];

fn read_bytes(bytes: &[u8]) -> Result<PlyMesh, PlyError> {
    read(Path::new("dir/mesh.ply"), bytes)
}

/// An ASCII file of a square's four vertices, which have more properties and numbers, and of faces.
fn square(vertex: &str, more: &str, face: &str, faces: &[&str]) -> String {
    let properties = |names: &str| -> String {
        let all = names.split(',').filter(|name| !name.is_empty());
        all.map(|name| format!("property {name}\n")).collect()
    };
    let vertices: String = SQUARE
        .map(|[x, y, z]| format!("{x} {y} {z} {}\n", more.replace('#', &format!("{}", x + 2.0 * y))))
        .concat();
    format!(
        "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n{}element face {}\n\
         property list uchar int vertex_indices\n{}end_header\n{vertices}{}\n",
        properties(vertex),
        faces.len(),
        properties(face),
        faces.join("\n")
    )
}

fn read_square(vertex: &str, more: &str, face: &str, faces: &[&str]) -> PlyMesh {
    let text = square(vertex, more, face, faces);
    read_bytes(text.as_bytes()).unwrap_or_else(|e| panic!("{text}: {e}"))
}

fn error_of(bytes: &[u8]) -> String {
    match read_bytes(bytes) {
        Ok(mesh) => panic!("{mesh:?}"),
        Err(error) => error.to_string(),
    }
}

#[test]
fn what_is_written_is_read_again_to_the_bit() {
    let mut state = 1u64;
    let mut random = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
        (state >> 11) as f64 / (1u64 << 53) as f64 - 0.5
    };
    let vertices = 5000;
    let full = TriangleMesh {
        positions: (0..vertices)
            .map(|i| DVec3::from([0; 3].map(|_| random())) * 10f64.powi(i % 70 - 35))
            .collect(),
        normals: (0..vertices)
            .map(|i| {
                let direction = DVec3::from([0; 3].map(|_| random()));
                if i == 7 {
                    Vec3::ZERO
                } else {
                    direction.normalize().as_vec3()
                }
            })
            .collect(),
        uvs: (0..vertices).map(|_| Vec2::new(random() as f32 * 9.0, -0.0)).collect(),
        colors: (0..vertices)
            .map(|_| Rgb::from([0; 3].map(|_| random().abs() as f32 * 3.0)))
            .collect(),
        indices: (0..9000u32)
            .map(|i| [i * 7 % 5000, i * 11 % 5000, i * 13 % 5000])
            .collect(),
    };
    let bare = TriangleMesh {
        positions: full.positions.clone(),
        indices: full.indices.clone(),
        ..TriangleMesh::default()
    };
    for mesh in [full, bare] {
        let mut bytes = Vec::new();
        write_ply(&mesh, &mut bytes).unwrap();
        let read = read_bytes(&bytes).unwrap();
        let again = match read.color() {
            Some(name) => read.into_mesh_colored_by(name).unwrap(),
            None => read.mesh,
        };
        let bits = |mesh: &TriangleMesh<DVec3>| -> Vec<u64> {
            let positions = mesh.positions.iter().flat_map(|p| p.to_array()).map(f64::to_bits);
            let normals = mesh.normals.iter().flat_map(|n| n.to_array());
            let uvs = mesh.uvs.iter().flat_map(|uv| uv.to_array());
            let colors = mesh.colors.iter().flat_map(|c| c.to_array());
            let others = normals.chain(uvs).chain(colors).map(|c| u64::from(c.to_bits()));
            positions.chain(others).collect()
        };
        assert_eq!(again.indices, mesh.indices);
        assert!(bits(&again) == bits(&mesh));
    }
}

/// The same mesh in all three forms and with all types of numbers.
#[test]
fn the_form_and_the_types_of_the_numbers_change_nothing() {
    let expected = read_square("", "", "", &["3 0 1 2", "4 0 1 2 3"]);
    assert_eq!(expected.mesh.indices, [[0, 1, 2], [0, 1, 2], [0, 2, 3]]);
    assert_eq!(expected.warnings, [""; 0]);
    let number = |kind: &str, value: f64, big: bool| -> Vec<u8> {
        macro_rules! bytes {
            ($t:ty) => {
                if big {
                    (value as $t).to_be_bytes().to_vec()
                } else {
                    (value as $t).to_le_bytes().to_vec()
                }
            };
        }
        match kind {
            "char" | "int8" => bytes!(i8),
            "uchar" | "uint8" => bytes!(u8),
            "short" | "int16" => bytes!(i16),
            "ushort" | "uint16" => bytes!(u16),
            "int" | "int32" => bytes!(i32),
            "uint" | "uint32" => bytes!(u32),
            "long" | "int64" => bytes!(i64),
            "ulong" | "uint64" => bytes!(u64),
            "float" | "float32" => bytes!(f32),
            "double" | "float64" => bytes!(f64),
            _ => panic!("{kind}"),
        }
    };
    let types = [
        "char", "uchar", "short", "ushort", "int", "uint", "long", "ulong", "float", "double", "int8", "uint8",
        "int16", "uint16", "int32", "uint32", "int64", "uint64", "float32", "float64",
    ];
    for position in types {
        for index in types {
            for (format, big) in [("binary_little_endian", false), ("binary_big_endian", true)] {
                let count = types[(position.len() + index.len()) % 8];
                let mut bytes = format!(
                    "ply\nformat {format} 1.0\ncomment made by a test\nelement vertex 4\nproperty {position} x\nproperty {position} y\n\
                     property list uchar short skipped\nproperty {position} z\nproperty {index} quality\nelement edge 1\n\
                     property int vertex1\nelement face 2\nproperty list {count} {index} vertex_index\nend_header\n"
                )
                .into_bytes();
                for [x, y, z] in SQUARE.map(|p| p.map(f64::from)) {
                    bytes.extend([number(position, x, big), number(position, y, big)].concat());
                    bytes.extend([2, 10, 10, 13, 13]);
                    bytes.extend([number(position, z, big), number(index, 7.0, big)].concat());
                }
                bytes.extend([9; 4]);
                for face in [[0.0, 1.0, 2.0].as_slice(), &[0.0, 1.0, 2.0, 3.0]] {
                    bytes.extend(number(count, face.len() as f64, big));
                    bytes.extend(face.iter().flat_map(|&i| number(index, i, big)));
                }
                let read = read_bytes(&bytes).unwrap_or_else(|e| panic!("{position} {index} {format}: {e}"));
                assert_eq!(read.mesh, expected.mesh, "{position} {index} {format}");
                assert_eq!(read.warnings.len(), 1, "{:?}", read.warnings);
                assert!(read.warnings[0].contains("`edge`"));
            }
        }
    }
}

#[test]
fn normals_and_texture_coordinates_have_several_names() {
    let read = read_square("float nx,float ny,float nz", "0 0 4", "", &["3 0 1 2"]);
    assert_eq!(read.mesh.normals, [Vec3::Z; 4]);
    for names in ["u v", "s t", "texture_u texture_v"] {
        let (u, v) = names.split_once(' ').unwrap();
        let read = read_square(&format!("float {u},float {v}"), "# 0.25", "", &["3 0 1 2"]);
        assert_eq!(
            read.mesh.uvs,
            [0.0, 1.0, 3.0, 2.0].map(|u| Vec2::new(u, 0.25)),
            "{names}"
        );
        assert_eq!(read.attributes, []);
    }
}

#[test]
fn attributes_are_named_as_other_renderers_do() {
    let names = |vertex: &str, more: &str| -> Vec<(String, usize, f32)> {
        let read = read_square(vertex, more, "", &["3 0 1 2"]);
        let of = |a: &PlyAttribute| {
            assert_eq!(a.values.len(), 4 * a.channels);
            (a.name.clone(), a.channels, a.values[1.min(a.channels - 1)])
        };
        read.attributes.iter().map(of).collect()
    };
    let color = |middle: f32| vec![("vertex_color".to_owned(), 3, middle)];
    // Whole numbers are sRGB: 188 of 255 is half of the light.
    for bytes in [
        "uchar red,uchar green,uchar blue",
        "uchar r,uchar g,uchar b",
        "int red,int green,int blue",
    ] {
        let [(name, channels, middle)] = names(bytes, "255 188 0").try_into().unwrap();
        assert_eq!((name.as_str(), channels), ("vertex_color", 3));
        assert!((middle - 0.5).abs() < 0.005, "{middle}");
    }
    assert_eq!(names("float red,float green,float blue", "1 0.5 2"), color(0.5));
    assert_eq!(names("float r,float g,float b,float a", "1 0.5 2 0.1"), color(0.5));
    assert_eq!(
        names("uchar diffuse_red,uchar diffuse_green,uchar diffuse_blue", "0 255 0"),
        color(1.0)
    );
    for ending in ["0 1 2", "1 2 3", "x y z", "r g b"] {
        let [a, b, c] = ending.split(' ').collect::<Vec<_>>().try_into().unwrap();
        let vertex = format!("float color_{a},float color_{b},float color_{c},uchar weight_0,float quality,float x_");
        let expected = [color(0.5), vec![("vertex_weight".to_owned(), 1, 7.0)]].concat();
        assert_eq!(names(&vertex, "1 0.5 2 7 9 9"), expected, "{ending}");
    }
}

#[test]
fn colours_of_faces_give_each_triangle_its_own_vertices() {
    let face = "float color_0,float color_1,float color_2,float weight_0";
    let faces = [
        "3 0 1 2 1 0 0 0.5",
        "2 0 1 9 9 9 9",
        "4 0 1 2 3 0 1 0 0.25",
        "3 2 3 0 0 0 1 0.75",
    ];
    let read = read_square("float s,float t", "# 0", face, &faces);
    assert_eq!(read.color(), Some("face_color"));
    assert_eq!(read.mesh.positions.len(), 4);
    assert!(
        read.warnings.len() == 1 && read.warnings[0].contains("1 faces"),
        "{:?}",
        read.warnings
    );
    let plain = read.mesh.clone();
    let mesh = read.clone().into_mesh_colored_by("face_color").unwrap();
    assert_eq!(mesh.validate(), Ok(()));
    for (corner, &i) in plain.indices.as_flattened().iter().enumerate() {
        let own = mesh.indices.as_flattened()[corner] as usize;
        assert_eq!(mesh.positions[own], plain.positions[i as usize]);
        assert_eq!(mesh.uvs[own], plain.uvs[i as usize]);
    }
    let of_triangles = |mesh: &TriangleMesh<DVec3>| -> Vec<Rgb> {
        mesh.indices
            .iter()
            .map(|t| {
                assert_eq!(t.map(|i| mesh.colors[i as usize]), [mesh.colors[t[0] as usize]; 3]);
                mesh.colors[t[0] as usize]
            })
            .collect()
    };
    let [red, green, blue] = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]].map(Rgb::from);
    assert_eq!(of_triangles(&mesh), [red, green, green, blue]);
    let grey = read.clone().into_mesh_colored_by("face_weight").unwrap();
    assert_eq!(of_triangles(&grey), [0.5, 0.25, 0.25, 0.75].map(Rgb::splat));
    assert_eq!(read.into_mesh_colored_by("vertex_color"), None);
}

#[test]
fn concave_polygons_are_covered() {
    // The first corner of the arrow does not see the last but one.
    let text = "ply\nformat ascii 1.0\nelement face 1\nproperty list uint uint vertex_indices\nelement vertex 4\n\
        property double x\nproperty double y\nproperty double z\nend_header\n4 0 1 2 3\n0 0 5\n2 1 5\n0 2 5\n0.5 1 5\n";
    let mesh = read_bytes(text.as_bytes()).unwrap().mesh;
    let area = |t: &[u32; 3]| {
        let [a, b, c] = t.map(|i| mesh.positions[i as usize]);
        0.5 * (b - a).cross(c - a).z
    };
    let areas: Vec<f64> = mesh.indices.iter().map(area).collect();
    assert!(
        areas.iter().all(|a| *a > 0.0) && areas.iter().sum::<f64>() == 1.5,
        "{areas:?}"
    );
}

#[test]
fn normals_and_texture_coordinates_that_are_not_usable_are_mended_and_counted() {
    let read = read_square(
        "float nx,float ny,float nz,float u,float v",
        "0 nan 0 inf 0",
        "",
        &["3 0 1 2"],
    );
    assert_eq!(
        (read.mesh.normals, read.mesh.uvs),
        (vec![Vec3::ZERO; 4], vec![Vec2::ZERO; 4])
    );
    let warnings = read.warnings.join("\n");
    assert!(
        warnings.contains("4 vertex normals") && warnings.contains("4 texture"),
        "{warnings}"
    );
}

#[test]
fn errors_name_the_file_and_the_place() {
    let face = |face: &str| square("", "", "", &["3 0 1 2", face]);
    for (text, expected) in [
        (face("3 0 1 4"), "uses vertex 4"),
        (face("3 0 1 -1"), "line 15, face 1: the face uses vertex -1"),
        (face("3 0 1 0.5"), "line 15, face 1: the face uses vertex 0.5"),
        (face("3 0 1"), "line 15, face 1: a list of 3 numbers, where 2 would fit"),
        (face("-3 0 1 2"), "line 15, face 1: a list of -3"),
        (face("nan 0 1 2"), "line 15, face 1: a list of NaN"),
        (face("3 0 1 2 3"), "line 15, face 1: the line has more numbers"),
        (face("3 0 one 2"), "line 15, face 1: `one` is not a number"),
        (face(""), "the file ends before the row"),
        (
            square("float w", "", "", &["3 0 1 2"]),
            "line 11, vertex 0: the line has fewer numbers",
        ),
        (square("", "", "", &[]), "has no faces"),
        (square("", "", "", &["2 0 1"]), "has no faces"),
        (
            face("3 0 1 2").replace("\n1 0 0", "\n1 nan 0"),
            "line 11, vertex 1: expected a position",
        ),
        (
            face("3 0 1 2").replace("\n1 0 0", "\n1 1e39 0"),
            "line 11, vertex 1: expected a position",
        ),
        (
            face("3 0 1 2").replace(" x\n", " w\n"),
            "vertices without the numbers `x`",
        ),
        (
            face("3 0 1 2").replace("vertex_indices", "corners"),
            "faces without the list",
        ),
        (face("3 0 1 2").replace("vertex 4", "vertex 0"), "line 10, face 0"),
        (
            face("3 0 1 2").replace("vertex 4", "vertex 4000000000"),
            "the header says 4000000000 of `vertex`, but only",
        ),
        (
            face("3 0 1 2").replace("face 2", "face 18446744073709551615"),
            "18446744073709551615 of `face`",
        ),
    ] {
        let message = error_of(text.as_bytes());
        assert!(
            message.starts_with("dir/mesh.ply: ") && message.contains(expected),
            "{text}: {message}"
        );
    }
    for (list, data, expected) in [
        (
            "uint uchar",
            b"\0\0\0\xff\xff\xff\xff".as_slice(),
            "face 0: a list of 4294967295 numbers, where 0",
        ),
        ("double uchar", b"\0\0\0\0\0\0\0\0\0\xf0\x7f", "face 0: a list of inf"),
        (
            "uchar float",
            b"\0\0\0\x03\0\0\0\0\0\0\0\0\0\0\xc0\x7f",
            "face 0: the face uses vertex NaN",
        ),
        (
            "uchar int",
            b"\0\0\0\x03\0\0\0\0\0\0\0\0\0\0",
            "face 0: a list of 3 numbers, where 2 would fit",
        ),
        ("uint int", b"\0\0\0\0\0\0", "face 0: the file ends before"),
        (
            "uint int",
            b"\0\0\0",
            "the header says 1 of `face`, but only 0 bytes follow",
        ),
        (
            "uchar int",
            b"\0",
            "the header says 1 of `vertex`, but only 1 bytes follow",
        ),
    ] {
        let header = format!(
            "ply\nformat binary_little_endian 1.0\nelement vertex 1\nproperty uchar x\nproperty uchar y\nproperty uchar z\n\
             element face 1\nproperty list {list} vertex_indices\nend_header\n"
        );
        let message = error_of(&[header.as_bytes(), data].concat());
        let place = format!("byte {}, ", header.len() + 3);
        assert!(message.contains(expected), "{list}: {message}");
        assert!(
            message.contains(&place) || message.contains("the header says"),
            "{list}: {message}"
        );
    }
}

#[test]
fn an_element_without_properties_takes_no_time_however_often_it_is_there() {
    let text = square("", "", "", &["3 0 1 2"]);
    let text = text.replace("element face", "element nothing 18446744073709551615\nelement face");
    assert_eq!(read_bytes(text.as_bytes()).unwrap().mesh.indices, [[0, 1, 2]]);
}

#[test]
fn damaged_bytes_never_panic() {
    let mut files = vec![
        square(
            "uchar red,uchar green,uchar blue",
            "1 2 3",
            "float w_0",
            &["4 0 1 2 3 0.5"],
        )
        .into_bytes(),
    ];
    let mut bytes = Vec::new();
    let mesh = TriangleMesh {
        positions: SQUARE.map(|p| DVec3::from(p.map(f64::from))).to_vec(),
        uvs: vec![Vec2::ZERO; 4],
        indices: vec![[0, 1, 2], [0, 2, 3]],
        ..TriangleMesh::default()
    };
    write_ply(&mesh, &mut bytes).unwrap();
    files.push(bytes);
    let mut state = 1u64;
    let (mut good, mut bad) = (0, 0);
    for round in 0..40_000 {
        let mut damaged = files[round % 2].clone();
        for _ in 0..1 + round % 4 {
            state = state
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1_442_695_040_888_963_407);
            let at = (state >> 33) as usize % damaged.len();
            match state >> 60 & 3 {
                0 => damaged.truncate(at.max(1)),
                1 => damaged[at] = (state >> 20) as u8,
                2 => damaged.insert(at, b" 9-.\n\r\0\xff"[(state >> 20) as usize % 8]),
                _ if damaged.len() > 1 => drop(damaged.remove(at)),
                _ => {}
            }
        }
        match read_bytes(&damaged) {
            Ok(read) => {
                good += 1;
                assert_eq!(read.mesh.validate(), Ok(()));
                for name in read.attributes.iter().map(|a| a.name.clone()) {
                    let mesh = read.clone().into_mesh_colored_by(&name).unwrap();
                    assert_eq!(mesh.validate(), Ok(()));
                }
            }
            Err(error) => {
                bad += 1;
                assert!(error.to_string().starts_with("dir/mesh.ply"), "{error}");
            }
        }
    }
    assert!(good > 1000 && bad > 1000, "{good} {bad}");
}
