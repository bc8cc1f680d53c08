//! Mesh files as people have them: what a scene is made of that consists of one, or uses several.

use embrace::material::{Channel, General, Material, Relief, Scalar, Scattering, Spectrum};
use embrace::math::{DVec3, Rgb};
use embrace::mesh::TriangleMesh;
use embrace::scene::ply::write_ply;
use embrace::scene::{LoadError, LoadOptions, Scene, SceneDesc, SceneOptions, load};
use embrace::texture::Wrap;
use std::fs;
use std::path::{Path, PathBuf};
use tempfile::TempDir;

struct Folder(TempDir);

impl Folder {
    fn new() -> Folder {
        Folder(tempfile::tempdir().unwrap())
    }

    fn write(&self, name: &str, bytes: impl AsRef<[u8]>) -> PathBuf {
        let path = self.0.path().join(name);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(&path, bytes).unwrap();
        path
    }

    /// Two texels beside each other.
    fn bitmap(&self, name: &str, texels: [[u8; 3]; 2]) {
        let picture = image::RgbImage::from_fn(2, 1, |x, _| image::Rgb(texels[x as usize]));
        let mut bytes = Vec::new();
        let writer = &mut std::io::Cursor::new(&mut bytes);
        picture.write_to(writer, image::ImageFormat::Png).unwrap();
        self.write(name, bytes);
    }
}

fn read(path: &Path) -> SceneDesc {
    let desc = load(path, LoadOptions::default()).unwrap_or_else(|e| panic!("{e}"));
    Scene::build(desc.clone(), SceneOptions::default()).expect("what is read can be built");
    desc
}

/// A roof of two triangles that meet at a right angle.
fn roof() -> TriangleMesh<DVec3> {
    TriangleMesh {
        positions: [[0, 0, 0], [0, 0, 1], [1, -1, 0], [-1, -1, 0]]
            .map(|p| DVec3::from(p.map(f64::from)))
            .to_vec(),
        indices: vec![[0, 1, 2], [1, 0, 3]],
        ..TriangleMesh::default()
    }
}

fn ply(mesh: &TriangleMesh<DVec3>) -> Vec<u8> {
    let mut bytes = Vec::new();
    write_ply(mesh, &mut bytes).unwrap();
    bytes
}

fn of_first_object(desc: &SceneDesc) -> &Material {
    &desc.materials[desc.objects[0].material].1
}

const WHITE: Spectrum = Spectrum::VertexColor(None, Rgb::WHITE);

#[test]
fn a_ply_file_is_a_scene_and_shows_its_colours() {
    let folder = Folder::new();
    let plain = read(&folder.write("plain.PLY", ply(&roof())));
    assert_eq!(*plain.meshes[0], roof());
    let grey = Spectrum::Constant(Rgb::splat(0.5));
    assert_eq!(
        of_first_object(&plain).scattering,
        Scattering::Diffuse { reflectance: grey }
    );
    assert!(plain.warnings.is_empty() && plain.environment.is_some());

    let mut mesh = roof();
    mesh.colors = [[1.0, 0.5, 0.0], [0.0; 3], [1.0, 2.0, 0.5], [1.0; 3]]
        .map(Rgb::from)
        .to_vec();
    let path = folder.write("colours.ply", ply(&mesh));
    let colored = read(&path);
    assert_eq!(
        of_first_object(&colored).scattering,
        Scattering::Diffuse { reflectance: WHITE }
    );
    assert_eq!(colored.meshes[0].colors[2], Rgb::new(1.0, 1.0, 0.5));
    assert!(colored.warnings.len() == 1 && colored.warnings[0].contains("1 vertex colours are above 1"));
    let options = LoadOptions {
        strict: true,
        ..LoadOptions::default()
    };
    assert!(matches!(load(&path, options), Err(LoadError::Strict(_))));
    // A scene that gives a material may do with the colours what it likes.
    let scene = "[camera]\nposition = [0, 0, 5]\nlook_at = [0, 0, 0]\nvfov = 40\nresolution = [4, 4]\n\
        [materials.m]\ntype = \"mirror\"\n[[meshes]]\nfile = \"colours.ply\"\nmaterial = \"m\"\n";
    let scene = read(&folder.write("scene.toml", scene));
    assert_eq!(scene.meshes[0].colors, mesh.colors);
    assert_eq!(scene.warnings, [""; 0]);
    assert!(plain.hash != colored.hash && colored.hash != scene.hash);
}

#[test]
fn meshes_without_normals_are_smoothed_below_the_angle_and_others_left_alone() {
    let folder = Folder::new();
    let obj = "v 0 0 0\nv 0 0 1\nv 1 -1 0\nv -1 -1 0\nf 1 2 3\nf 2 1 4\n";
    let with_normals = obj.replace("f 1 2 3\nf 2 1 4", "vn 1 0 0\nf 1//1 2//1 3//1\nf 2//1 1//1 4//1");
    let paths = [folder.write("roof.ply", ply(&roof())), folder.write("roof.obj", obj)];
    for path in &paths {
        let smoothed = |angle: Option<f64>| {
            let options = LoadOptions {
                smooth_angle: angle,
                ..LoadOptions::default()
            };
            load(path, options).unwrap()
        };
        let [flat, sharp, smooth] = [None, Some(80.0), Some(100.0)].map(smoothed);
        assert!(flat.meshes[0].normals.is_empty());
        assert_eq!((sharp.meshes[0].normals.len(), smooth.meshes[0].normals.len()), (6, 4));
        // The ridge looks up.
        assert!((smooth.meshes[0].normals[0].as_dvec3() - DVec3::Y).length() < 1e-6);
        assert!(flat.hash != sharp.hash && sharp.hash != smooth.hash);
    }
    let path = folder.write("normals.obj", with_normals);
    let options = LoadOptions {
        smooth_angle: Some(100.0),
        ..LoadOptions::default()
    };
    let (with, without) = (load(&path, options).unwrap(), read(&path));
    assert_eq!(with.meshes, without.meshes);
}

const SQUARE: &str = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nf 1/1 2/2 3/3 4/4\n";

/// A square whose material has the statements, with maps in a folder whose name has a space.
fn with_material(statements: &str) -> SceneDesc {
    let folder = Folder::new();
    folder.bitmap("my maps/grey.png", [[40; 3], [200; 3]]);
    folder.bitmap("my maps/colour.png", [[255, 0, 0], [0, 100, 0]]);
    folder.bitmap("my maps/normals.png", [[128, 128, 255], [180, 128, 245]]);
    folder.write("my maps/m.mtl", format!("newmtl m\n{statements}\n"));
    read(&folder.write("square.obj", format!("mtllib my maps\\m.mtl\nusemtl m\n{SQUARE}")))
}

#[test]
fn maps_of_roughness_and_metal_make_a_principled_material() {
    let desc =
        with_material("Kd 1 0 0\nmap_Pr -imfchan g grey.png\nmap_Pm -clamp on colour.png\nmap_Kd -s 2 2 colour.png");
    assert_eq!(desc.warnings, [""; 0]);
    let Scattering::General(General::Principled(principled)) = &of_first_object(&desc).scattering else {
        panic!("{:?}", of_first_object(&desc));
    };
    let Scalar::Varying(Spectrum::Bitmap(roughness, _), Channel::G) = principled.roughness else {
        panic!("{principled:?}");
    };
    let Scalar::Varying(Spectrum::Bitmap(metallic, _), Channel::Mean) = principled.metallic else {
        panic!("{principled:?}");
    };
    assert_eq!((roughness.wrap, metallic.wrap), ([Wrap::Repeat; 2], [Wrap::Clamp; 2]));
    let Spectrum::Bitmap(base, Rgb::WHITE) = principled.base_color else {
        panic!("{principled:?}");
    };
    assert_eq!(base.to_uv.matrix2.x_axis.x, 2.0);
    // The same file as a colour and as numbers is two textures.
    assert_ne!(base.texture, metallic.texture);

    let half = with_material("Kd 1 0 0\nPm 0.5\nPr 0.2");
    let Scattering::General(General::Principled(principled)) = &of_first_object(&half).scattering else {
        panic!("{:?}", of_first_object(&half));
    };
    assert_eq!(principled.metallic, Scalar::Constant(0.5));
    assert!(matches!(principled.roughness, Scalar::Constant(r) if (r - 0.2).abs() < 1e-6));
}

#[test]
fn bump_maps_are_heights_unless_they_hold_normals() {
    let relief = |statements: &str| {
        let desc = with_material(statements);
        (of_first_object(&desc).relief, desc.warnings)
    };
    let (bump, warnings) = relief("map_Bump -bm 0.02 grey.png");
    assert!(
        matches!(bump, Some(Relief::BumpMap { scale, .. }) if scale == 0.02),
        "{bump:?}"
    );
    assert_eq!(warnings, [""; 0]);
    let (bump, warnings) = relief("bump colour.png");
    assert!(
        matches!(bump, Some(Relief::BumpMap { scale: 1.0, .. })) && warnings.is_empty(),
        "{bump:?}"
    );
    let (normals, warnings) = relief("norm -bm 0.5 grey.png");
    assert!(
        matches!(normals, Some(Relief::NormalMap { scale: 0.5, .. })),
        "{normals:?}"
    );
    assert_eq!(warnings, [""; 0]);
    let (normals, warnings) = relief("map_bump normals.png");
    assert!(
        matches!(normals, Some(Relief::NormalMap { scale: 1.0, .. })),
        "{normals:?}"
    );
    assert!(
        warnings.len() == 1 && warnings[0].contains("holds normals"),
        "{warnings:?}"
    );
    let (none, warnings) = relief("map_bump missing.png");
    assert!(
        none.is_none() && warnings.len() == 1 && warnings[0].contains("missing.png"),
        "{warnings:?}"
    );
}

#[test]
fn maps_of_emission_and_opacity_are_used() {
    let desc = with_material("Ke 0 0 0\nmap_Ke colour.png\nmap_d -imfchan r colour.png");
    let object = &desc.objects[0];
    assert_eq!(object.emission.unwrap().radiance, Rgb::WHITE);
    assert!(matches!(object.emission_map, Some(Spectrum::Bitmap(_, Rgb::WHITE))));
    let opacity = of_first_object(&desc).opacity;
    assert!(
        matches!(opacity, Some(Spectrum::Bitmap(_, tint)) if tint == Rgb::new(3.0, 0.0, 0.0)),
        "{opacity:?}"
    );
    let desc = with_material("Ke 2 1 0\nmap_Ke colour.png");
    assert_eq!(desc.objects[0].emission.unwrap().radiance, Rgb::new(2.0, 1.0, 0.0));
}

#[test]
fn vertex_colours_of_an_obj_are_a_factor_on_its_material() {
    let folder = Folder::new();
    let colored = SQUARE.replace("v 0 1 0\n", "v 0 1 0 1 0 0\n");
    folder.write("m.mtl", "newmtl m\nKd 0.5 0.5 0.5\n");
    let desc = read(&folder.write("a.obj", format!("mtllib m.mtl\nusemtl m\n{colored}")));
    let half = Spectrum::VertexColor(None, Rgb::splat(0.5));
    assert_eq!(
        of_first_object(&desc).scattering,
        Scattering::Diffuse { reflectance: half }
    );
    let alone = read(&folder.write("b.obj", &colored));
    assert_eq!(
        of_first_object(&alone).scattering,
        Scattering::Diffuse { reflectance: WHITE }
    );
    // Nobody has the material.
    let without = read(&folder.write("c.obj", format!("usemtl gone\n{SQUARE}")));
    assert_eq!(without.materials[0].0, "default");
    assert!(
        without.warnings.len() == 1 && without.warnings[0].contains("`gone`"),
        "{:?}",
        without.warnings
    );
}
