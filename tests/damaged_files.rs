//! Files that are cut, changed or absurd: loading returns, names the file, and never panics or asks for all memory.

mod support;

use embrace::image::exr::ExrMetadata;
use embrace::image::{Image, exr};
use embrace::math::{DVec3, Rgb, Vec2};
use embrace::mesh::TriangleMesh;
use embrace::scene::ply::write_ply;
use embrace::scene::{LoadOptions, Scene, SceneOptions, load};
use std::fs;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};
use support::Random;
use tempfile::TempDir;

/// No single file here may take longer to be read or refused.
const LIMIT: Duration = Duration::from_secs(2);

const SCENE: &str = r#"
[camera]
position = [0, 1, 4]
look_at = [0, 0.5, 0]
vfov = 40
resolution = [16, 12]

[integrator]
max_depth = 5

[environment]
file = "sky.exr"
rotation_deg = 20

[materials.tiles]
type = "diffuse"
texture = "tiles.png"

[materials.gold]
type = "conductor"
eta = [0.2, 0.4, 1.4]
k = [3.4, 2.3, 1.8]
alpha = 0.1

[[meshes]]
file = "mesh.obj"
material = "tiles"

[[meshes]]
file = "mesh.obj"
transform = [[1, 0, 0, 0], [0, 1, 0, 1], [0, 0, 1, 0], [0, 0, 0, 1]]
emission = { radiance = [1, 2, 3], sides = "both" }
"#;

const MESH: &str = "mtllib mesh.mtl\no square\nv -1 0 1\nv 1 0 1\nv 1 0 -1\nv -1 0 -1\nvt 0 0\nvt 1 0\nvt 1 1\n\
    vn 0 1 0\nusemtl paint\nf 1/1/1 2/2/1 3/3/1\nf 1//1 3//1 4//1\ng rest\nusemtl glass\nf -4 -3 -2 -1\n";

const LIBRARY: &str = "# materials\nnewmtl paint\nKd 0.5 0.4 0.3\nKs 0.1 0.1 0.1\nNs 50\nmap_Kd -s 2 2 1 -o 0.5 0 0 tiles.png\n\
    d 0.5\nTr 0.5\nnewmtl glass\nillum 7\nNi 1.5\nPr 0.1\nPm 0.2\nKe 1 1 1\n";

/// A scene that uses every kind of file, in a folder of its own.
struct Folder(TempDir);

impl Folder {
    fn new() -> Folder {
        let folder = Folder(tempfile::tempdir().unwrap());
        folder.write("scene.toml", SCENE.as_bytes());
        folder.write("scene.json", json().as_bytes());
        folder.write("mesh.obj", MESH.as_bytes());
        folder.write("mesh.mtl", LIBRARY.as_bytes());
        folder.write("mesh.ply", &ply());
        folder.write("ascii.ply", PLY.as_bytes());
        folder.write("tiles.png", &tiles(image::ImageFormat::Png));
        folder.write("sky.exr", &sky_exr());
        folder
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn write(&self, name: &str, bytes: &[u8]) {
        fs::write(self.path(name), bytes).unwrap();
    }

    /// Loads and builds, which must end soon, and any error must name `file`.
    fn load(&self, scene: &str, file: &str, what: &str) -> Result<(), String> {
        let start = Instant::now();
        let path = self.path(scene);
        let result = match load(&path, LoadOptions::default()) {
            Ok(desc) => {
                for warning in &desc.warnings {
                    assert!(!warning.trim().is_empty());
                }
                let built = Scene::build(desc, SceneOptions::default());
                // The command line puts the name before these.
                built.map(drop).map_err(|e| format!("{}: {e}", path.display()))
            }
            Err(error) => Err(error.to_string()),
        };
        assert!(start.elapsed() < LIMIT, "{file}, {what}: took {:?}", start.elapsed());
        if let Err(message) = &result {
            assert!(message.contains(file), "{file}, {what}: {message}");
        }
        result
    }
}

const PLY: &str = "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n\
    property uchar red\nproperty uchar green\nproperty uchar blue\nelement face 2\n\
    property list uchar int vertex_indices\nend_header\n0 0 0 255 0 0\n1 0 0 0 255 0\n1 1 0 0 0 255\n0 1 0 9 9 9\n\
    4 0 1 2 3\n3 0 1 2\n";

/// The same as binary, with texture coordinates.
fn ply() -> Vec<u8> {
    let mesh = TriangleMesh {
        positions: vec![DVec3::ZERO, DVec3::X, DVec3::X + DVec3::Y, DVec3::Y],
        uvs: vec![Vec2::ZERO, Vec2::X, Vec2::ONE, Vec2::Y],
        indices: vec![[0, 1, 2], [0, 2, 3], [0, 1, 2]],
        ..TriangleMesh::default()
    };
    let mut bytes = Vec::new();
    write_ply(&mesh, &mut bytes).unwrap();
    bytes
}

fn json() -> String {
    let value: serde_json::Value = toml::from_str(SCENE).unwrap();
    serde_json::to_string_pretty(&value).unwrap()
}

fn tiles(format: image::ImageFormat) -> Vec<u8> {
    let picture = image::RgbImage::from_fn(24, 16, |x, y| {
        image::Rgb([(x * 10) as u8, (y * 15) as u8, (x * y) as u8])
    });
    let mut bytes = Vec::new();
    let writer = &mut std::io::Cursor::new(&mut bytes);
    picture.write_to(writer, format).unwrap();
    bytes
}

fn sky() -> Image<Rgb> {
    let texel = |i: usize| Rgb::new(i as f32, 0.5, 1.0 / (1.0 + i as f32));
    Image {
        width: 24,
        height: 40,
        pixels: (0..24 * 40).map(texel).collect(),
    }
}

fn sky_exr() -> Vec<u8> {
    let mut bytes = Vec::new();
    exr::write(&mut bytes, &sky(), &ExrMetadata::default(), Path::new("sky.exr")).unwrap();
    bytes
}

fn sky_hdr() -> Vec<u8> {
    let pixels: Vec<image::Rgb<f32>> = sky().pixels.iter().map(|p| image::Rgb(p.to_array())).collect();
    let mut bytes = Vec::new();
    image::codecs::hdr::HdrEncoder::new(&mut bytes)
        .encode(&pixels, 24, 40)
        .unwrap();
    bytes
}

/// The file cut at about `cuts` places, and with some of its bits flipped `flips` times.
fn damaged(bytes: &[u8], cuts: usize, flips: usize) -> Vec<(String, Vec<u8>)> {
    let mut random = Random(bytes.len() as u64);
    let mut all: Vec<(String, Vec<u8>)> = (0..bytes.len())
        .step_by(1 + bytes.len() / cuts)
        .map(|cut| (format!("cut at {cut}"), bytes[..cut].to_vec()))
        .collect();
    for flip in 0..flips {
        let mut copy = bytes.to_vec();
        // Headers are short: half of the damage goes there.
        let range = if flip % 2 == 0 { copy.len() } else { copy.len().min(300) };
        for _ in 0..1 + flip % 4 {
            copy[random.below(range)] ^= 1 << random.below(8);
        }
        all.push((format!("flip {flip}"), copy));
    }
    all
}

/// Replaces `file` by each form and loads `scene`, which must be refused every time.
fn all_are_refused(scene: &str, file: &str, forms: &[(String, Vec<u8>)]) {
    for form in forms {
        assert_eq!(
            refused(scene, file, std::slice::from_ref(form)),
            1,
            "{file}: {}",
            form.0
        );
    }
}

/// Replaces `file` by each form and loads `scene`. Returns how many were refused.
fn refused(scene: &str, file: &str, forms: &[(String, Vec<u8>)]) -> usize {
    let folder = Folder::new();
    let refused = |(what, bytes): &&(String, Vec<u8>)| {
        folder.write(file, bytes);
        folder.load(scene, file, what).is_err()
    };
    forms.iter().filter(refused).count()
}

#[test]
fn the_whole_scene_is_good() {
    let folder = Folder::new();
    folder.load("scene.toml", "", "whole").unwrap();
    folder.load("scene.json", "", "whole").unwrap();
}

#[test]
fn damaged_scene_files_are_refused_or_read() {
    for (name, text) in [("scene.toml", SCENE.to_owned()), ("scene.json", json())] {
        let folder = Folder::new();
        for (what, bytes) in damaged(text.as_bytes(), 300, 600) {
            folder.write(name, &bytes);
            // A flip may turn the name of another file, which is then the one to be named.
            let message = folder.load(name, "", &what).err().unwrap_or_default();
            let names_a_file = message.contains(folder.0.path().to_str().unwrap());
            assert!(message.is_empty() || names_a_file, "{name}, {what}: {message}");
        }
    }
}

#[test]
fn absurd_scene_files_are_refused_by_name() {
    let with = |from: &str, to: &str| (format!("with {to}"), SCENE.replace(from, to).into_bytes());
    let absurd = [
        with("vfov = 40\n", "vfov = 1e308\n"),
        with("vfov = 40", "vfov = inf"),
        with("[0, 1, 4]", "[1e308, -1e308, 1e308]"),
        with("[0, 1, 4]", "[1e39, 0, 0]"),
        with("[0, 0.5, 0]", "[1e300, 0, 0]"),
        with("[16, 12]", "[4294967295, 4294967295]"),
        with("[16, 12]", "[18446744073709551616, 1]"),
        with("[16, 12]", "[[16, 12], []]"),
        with("vfov = 40\n", "vfov = 40\naperture_radius = 1e300"),
        with("vfov = 40\n", "vfov = 40\nfocus_distance = 1e300"),
        with("max_depth = 5", "max_depth = 4294967296"),
        with("rotation_deg = 20", "scale = 1e300"),
        with("[1, 2, 3]", "[1e39, 0, 0]"),
        with("[[1, 0, 0, 0]", "[[1e300, 0, 0, 0]"),
        with("[[1, 0, 0, 0]", "[[1, 0, 0, 1e300]"),
        with("[[1, 0, 0, 0]", "[[1e-300, 0, 0, 0]"),
        with("[3.4, 2.3, 1.8]", "[1e39, 0, 0]"),
        ("a bracket".into(), vec![b'['; 1 << 20]),
        ("nothing but tables".into(), "a.".repeat(1 << 14).into_bytes()),
        ("null bytes".into(), vec![0; 1 << 16]),
    ];
    all_are_refused("scene.toml", "scene.toml", &absurd);
    let deep = |open: &str| ("depth".to_owned(), open.repeat(1 << 18).into_bytes());
    let absurd = [deep("["), deep("{\"camera\":"), deep("[{\"a\":")];
    all_are_refused("scene.json", "scene.json", &absurd);
}

#[test]
fn damaged_meshes_are_refused_by_name_or_read() {
    let forms = damaged(MESH.as_bytes(), 300, 1500);
    assert!(refused("scene.toml", "mesh.obj", &forms) > forms.len() / 4);
    refused("mesh.obj", "mesh.obj", &forms);
}

#[test]
fn damaged_ply_meshes_are_refused_by_name_or_read() {
    for (file, bytes) in [("mesh.ply", ply()), ("ascii.ply", PLY.as_bytes().to_vec())] {
        let folder = Folder::new();
        folder.load(file, "", "whole").unwrap();
        folder.write("scene.toml", SCENE.replace("mesh.obj", file).as_bytes());
        folder.load("scene.toml", "", "whole").unwrap();
        let forms = damaged(&bytes, 300, 1500);
        assert!(refused(file, file, &forms) > forms.len() / 4, "{file}");
    }
}

#[test]
fn absurd_ply_meshes_are_refused_by_name() {
    let with = |from: &str, to: &str| {
        assert!(PLY.contains(from), "{from}");
        (format!("with {to}"), PLY.replace(from, to).into_bytes())
    };
    let binary = |counts: &str, list: &str, data: &[u8]| {
        let header = format!(
            "ply\nformat binary_big_endian 1.0\nelement vertex {counts}\nproperty uchar x\nproperty uchar y\n\
             property uchar z\nelement face {counts}\nproperty list {list} vertex_indices\nend_header\n"
        );
        let name = format!("binary with {counts} and {list}");
        (name, [header.as_bytes(), data].concat())
    };
    let absurd = [
        with("vertex 4", "vertex 0"),
        with("vertex 4", "vertex 4294967295"),
        with("vertex 4", "vertex 18446744073709551615"),
        with("vertex 4", "vertex 99999999999999999999"),
        with("vertex 4", "vertex -4"),
        with("face 2", "face 18446744073709551615"),
        with("face 2", "face 0"),
        with("1 0 0 0 255 0", "1 nan 0 0 255 0"),
        with("1 0 0 0 255 0", "1 1e39 0 0 255 0"),
        with("1 0 0 0 255 0", "1 0 0 0 255"),
        with("3 0 1 2", "3 0 1 4"),
        with("3 0 1 2", "3 0 1 -1"),
        with("3 0 1 2", "3 0 1 4294967296"),
        with("3 0 1 2", "4294967295 0 1 2"),
        with("3 0 1 2", "1e300 0 1 2"),
        with("3 0 1 2", "inf"),
        with("ascii", "binary_little_endian"),
        with("ascii", "binary_big_endian"),
        with("ascii", "morse"),
        with("float x", "quad x"),
        with("end_header", "end"),
        ("empty".into(), Vec::new()),
        ("null bytes".into(), vec![0; 1 << 16]),
        ("one long line".into(), vec![b'p'; 1 << 20]),
        (
            "nothing but properties".into(),
            [
                b"ply\nformat ascii 1.0\nelement face 1\n".as_slice(),
                &b"property float a_0\n".repeat(1 << 14),
            ]
            .concat(),
        ),
        binary("1", "uint uchar", b"\0\0\0\xff\xff\xff\xff\0\0\0"),
        binary("1", "double double", &[0x7f; 64]),
        binary("1", "double double", &[0xff; 64]),
        binary("1000000000000000000", "uchar uchar", &[0; 64]),
    ];
    all_are_refused("mesh.ply", "mesh.ply", &absurd);
    // A polygon of many corners, most of them the same.
    let corners = 1 << 18;
    let mut fan = binary("1", "uint uchar", b"\0\0\0\0\x04\0\0");
    fan.1.extend(vec![0; corners]);
    assert_eq!(refused("mesh.ply", "mesh.ply", &[fan]), 0);
}

#[test]
fn absurd_meshes_are_refused_by_name() {
    let with = |from: &str, to: &str| (format!("with {to}"), MESH.replace(from, to).into_bytes());
    let absurd = [
        with("v 1 0 1", "v 1e39 0 1"),
        with("v 1 0 1", "v inf 0 1"),
        with("v 1 0 1", "v"),
        with("f -4 -3 -2 -1", "f 0 1 2"),
        with("f -4 -3 -2 -1", "f 1 2 9223372036854775807"),
        with("f -4 -3 -2 -1", "f 1 2 -9223372036854775808"),
        with("f -4 -3 -2 -1", "f 1 2 99999999999999999999999"),
        with("f -4 -3 -2 -1", "f 1/// 2 3"),
        with("f -4 -3 -2 -1", "f 4294967295 4294967296 4294967297"),
        ("empty".into(), Vec::new()),
        ("null bytes".into(), vec![0; 1 << 16]),
        (
            "nothing but continued lines".into(),
            "\\\n".repeat(1 << 18).into_bytes(),
        ),
    ];
    all_are_refused("scene.toml", "mesh.obj", &absurd);
}

#[test]
fn a_face_of_very_many_corners_is_read_in_time() {
    let mesh = format!(
        "{}f{}\n",
        &MESH[..MESH.find("usemtl").unwrap()],
        " 1 2 3 4".repeat(1 << 16)
    );
    assert_eq!(
        refused("scene.toml", "mesh.obj", &[("fan".into(), mesh.into_bytes())]),
        0
    );
}

/// Libraries are hints about looks: whatever they are, the scene loads.
#[test]
fn damaged_material_libraries_never_refuse_a_scene() {
    let mut forms = damaged(LIBRARY.as_bytes(), 300, 1500);
    for (from, to) in [
        ("Kd 0.5 0.4 0.3", "Kd inf nan -1"),
        ("Kd 0.5 0.4 0.3", "Kd 1e38 1e38 1e38"),
        ("Ns 50", "Ns -5"),
        ("Ns 50", "Ns 3e38"),
        ("Ni 1.5", "Ni 0"),
        ("illum 7", "illum 99999999999999999999"),
        ("Ke 1 1 1", "Ke 3e38 3e38 3e38"),
        ("Pr 0.1", "Pr 1e30"),
        ("-s 2 2 1", "-s 1e38 nan inf"),
        ("tiles.png", "/"),
        ("tiles.png", ".."),
        ("tiles.png", "mesh.mtl"),
    ] {
        forms.push((to.into(), LIBRARY.replace(from, to).into_bytes()));
    }
    forms.push(("null bytes".into(), vec![0; 1 << 16]));
    forms.push(("one long line".into(), vec![b'K'; 1 << 20]));
    assert_eq!(refused("scene.toml", "mesh.mtl", &forms), 0);
    assert_eq!(refused("mesh.obj", "mesh.mtl", &forms), 0);
}

#[test]
fn damaged_textures_are_refused_by_name_or_read() {
    for (name, format) in [
        ("tiles.png", image::ImageFormat::Png),
        ("tiles.jpg", image::ImageFormat::Jpeg),
        ("tiles.tga", image::ImageFormat::Tga),
    ] {
        let folder = Folder::new();
        folder.write("scene.toml", SCENE.replace("tiles.png", name).as_bytes());
        let bytes = tiles(format);
        folder.write(name, &bytes);
        folder.load("scene.toml", name, "whole").unwrap();
        let mut errors = 0;
        for (what, bytes) in damaged(&bytes, 200, 400) {
            folder.write(name, &bytes);
            errors += usize::from(folder.load("scene.toml", name, &what).is_err());
        }
        assert!(errors > 50, "{name}: {errors}");
    }
}

#[test]
fn damaged_environments_are_refused_by_name_or_read() {
    for (name, bytes) in [("sky.exr", sky_exr()), ("sky.hdr", sky_hdr())] {
        let folder = Folder::new();
        folder.write("scene.toml", SCENE.replace("sky.exr", name).as_bytes());
        folder.write(name, &bytes);
        folder.load("scene.toml", name, "whole").unwrap();
        let mut errors = 0;
        for (what, bytes) in damaged(&bytes, 200, 400) {
            folder.write(name, &bytes);
            errors += usize::from(folder.load("scene.toml", name, &what).is_err());
        }
        assert!(errors > 100, "{name}: {errors}");
    }
}

#[test]
fn headers_that_ask_for_all_memory_are_refused_by_name() {
    let mut png = tiles(image::ImageFormat::Png);
    png[16..24].copy_from_slice(&[0x7f, 0xff, 0xff, 0xff, 0x7f, 0xff, 0xff, 0xff]);
    let mut tga = tiles(image::ImageFormat::Tga);
    tga[12..16].copy_from_slice(&[0xff; 4]);
    let mut jpeg = tiles(image::ImageFormat::Jpeg);
    // The frame header: marker, length, precision, height, width.
    let frame = jpeg.windows(2).position(|w| w == [0xff, 0xc0]).unwrap();
    jpeg[frame + 5..frame + 9].copy_from_slice(&[0xff; 4]);
    for (name, bytes) in [("tiles.png", png), ("tiles.tga", tga), ("tiles.jpg", jpeg)] {
        let folder = Folder::new();
        folder.write("scene.toml", SCENE.replace("tiles.png", name).as_bytes());
        folder.write(name, &bytes);
        folder.load("scene.toml", name, "huge").unwrap_err();
    }

    let mut exr = sky_exr();
    // Attributes: name, type, four bytes of length, then the window's four corners.
    let window = exr.windows(17).position(|w| w == b"dataWindow\0box2i\0").unwrap() + 17 + 4;
    exr[window + 8..window + 16].copy_from_slice(&[0xff, 0xff, 0xff, 0x3f, 0xff, 0xff, 0xff, 0x3f]);
    let hdr = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 2000000000 +X 2000000000\n".to_vec();
    let large_hdr = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 16384 +X 16384\n".to_vec();
    for (name, bytes) in [("sky.exr", exr), ("sky.hdr", hdr), ("sky.hdr", large_hdr)] {
        let folder = Folder::new();
        folder.write("scene.toml", SCENE.replace("sky.exr", name).as_bytes());
        folder.write(name, &bytes);
        folder.load("scene.toml", name, "huge").unwrap_err();
    }
}

#[test]
fn a_folder_in_the_place_of_a_file_is_refused_by_name() {
    for file in ["scene.toml", "mesh.obj", "tiles.png", "sky.exr", "mesh.ply"] {
        let folder = Folder::new();
        fs::remove_file(folder.path(file)).unwrap();
        fs::create_dir(folder.path(file)).unwrap();
        let scene = if file == "mesh.ply" { file } else { "scene.toml" };
        folder.load(scene, file, "a folder").unwrap_err();
    }
}
