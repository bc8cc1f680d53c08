//! Scenes of Mitsuba in XML: what each element becomes, and what is said of those that cannot be read.

use embrace::bsdf::Distribution;
use embrace::camera::Camera;
use embrace::material::{Back, Channel, General, Material, Relief, Scalar, Scattering, Spectrum};
use embrace::math::{DVec3, Rgb, Vec2, Vec3};
use embrace::scene::{EnvironmentDesc, Falloff, LightDesc, LoadOptions, SceneDesc, load};
use embrace::texture::{Filter, Texture, TextureMap, Wrap};
use std::fs;
use std::io::{Cursor, Write};
use std::time::{Duration, Instant};
use tempfile::TempDir;

/// No text may keep the loader busy for longer.
const LIMIT: Duration = Duration::from_secs(20);

struct Folder(TempDir);

impl Folder {
    fn new() -> Folder {
        let folder = Folder(tempfile::tempdir().unwrap());
        let mut png = Cursor::new(Vec::new());
        image::RgbImage::from_fn(2, 2, |x, y| image::Rgb([255 * x as u8, 255 * y as u8, 0]))
            .write_to(&mut png, image::ImageFormat::Png)
            .unwrap();
        folder.write("tiles.png", png.get_ref());
        folder.write(
            "quad.obj",
            b"v -1 -1 0\nv 1 -1 0\nv 1 1 0\nv -1 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nf 1/1 2/2 3/3 4/4\n",
        );
        folder
    }

    fn write(&self, name: &str, bytes: &[u8]) {
        let path = self.0.path().join(name);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, bytes).unwrap();
    }

    fn try_load(&self, content: &str, defines: &[(&str, &str)]) -> Result<SceneDesc, String> {
        self.write(
            "scene.xml",
            format!("<scene version=\"3.0.0\">\n{content}\n</scene>").as_bytes(),
        );
        self.try_load_file("scene.xml", defines)
    }

    fn try_load_file(&self, name: &str, defines: &[(&str, &str)]) -> Result<SceneDesc, String> {
        let own = |(name, value): &(&str, &str)| (name.to_string(), value.to_string());
        let options = LoadOptions {
            defines: defines.iter().map(own).collect(),
            ..LoadOptions::default()
        };
        let start = Instant::now();
        let result = load(&self.0.path().join(name), options).map_err(|e| e.to_string());
        assert!(start.elapsed() < LIMIT, "took {:?}", start.elapsed());
        result
    }
}

fn loaded(content: &str) -> SceneDesc {
    Folder::new().try_load(content, &[]).unwrap_or_else(|e| panic!("{e}"))
}

/// The message of a text that is refused: it names the file, and holds all of `parts`.
fn refused(content: &str, parts: &[&str]) {
    let message = Folder::new().try_load(content, &[]).expect_err(content);
    for part in [&["scene.xml"], parts].concat() {
        assert!(message.contains(part), "`{part}` is not in: {message}");
    }
}

fn material(bsdf: &str) -> Material {
    let desc = loaded(&format!("<shape type=\"rectangle\">{bsdf}</shape>"));
    desc.materials[desc.objects[0].material].1.clone()
}

fn general(bsdf: &str) -> General {
    match material(bsdf).scattering {
        Scattering::General(general) => general,
        other => panic!("{other:?}"),
    }
}

fn near(a: f32, b: f64) -> bool {
    (f64::from(a) - b).abs() < 2e-5 * b.abs().max(1.0)
}

fn assert_rgb(found: Rgb, expected: [f64; 3]) {
    let is_near = found.to_array().iter().zip(expected).all(|(a, b)| near(*a, b));
    assert!(is_near, "{found:?} instead of {expected:?}");
}

fn constant(spectrum: &Spectrum) -> Rgb {
    match spectrum {
        Spectrum::Constant(rgb) => *rgb,
        other => panic!("{other:?}"),
    }
}

// ---- Views

fn camera(sensor: &str) -> Camera {
    Camera::new(&loaded(sensor).camera).unwrap()
}

fn assert_direction(found: Vec3, expected: [f32; 3]) {
    let expected = Vec3::from(expected).normalize();
    assert!((found - expected).length() < 1e-5, "{found} instead of {expected}");
}

#[test]
fn a_camera_looks_along_z_with_x_to_the_left() {
    let film =
        "<film type=\"hdrfilm\"><integer name=\"width\" value=\"4\"/><integer name=\"height\" value=\"2\"/></film>";
    let sensor = |rest: &str| camera(&format!("<sensor type=\"perspective\">{film}{rest}</sensor>"));
    let fov = "<float name=\"fov\" value=\"90\"/>";
    let corner = |camera: &Camera| camera.ray(0, 0, [0.0; 2], [0.0; 2]).direction;
    assert_direction(corner(&sensor(fov)), [1.0, 0.5, 1.0]);
    let with_axis = |axis: &str| sensor(&format!("{fov}<string name=\"fov_axis\" value=\"{axis}\"/>"));
    assert_direction(corner(&with_axis("y")), [2.0, 1.0, 1.0]);
    assert_direction(corner(&with_axis("smaller")), [2.0, 1.0, 1.0]);
    assert_direction(corner(&with_axis("larger")), [1.0, 0.5, 1.0]);
    let half = 0.2f32.sqrt();
    assert_direction(corner(&with_axis("diagonal")), [2.0 * half, half, 1.0]);
    // 50 mm, along the diagonal of 36 x 24 mm.
    let half = 43.266_617 / 100.0 * 0.2f32.sqrt();
    assert_direction(corner(&sensor("")), [2.0 * half, half, 1.0]);
    let length = "<string name=\"focal_length\" value=\"25mm\"/>";
    assert_direction(corner(&sensor(length)), [4.0 * half, 2.0 * half, 1.0]);
    let mirror = format!("{fov}<transform name=\"to_world\"><scale x=\"-1\"/></transform>");
    assert_direction(corner(&sensor(&mirror)), [-1.0, 0.5, 1.0]);
    let turned = format!(
        "{fov}<transform name=\"to_world\"><lookat origin=\"1 2 3\" target=\"1,2,-5\" up=\"0 1 0\"/></transform>"
    );
    let camera = sensor(&turned);
    assert_direction(corner(&camera), [-1.0, 0.5, -1.0]);
    assert_eq!(camera.ray(0, 0, [0.0; 2], [0.0; 2]).origin, Vec3::new(1.0, 2.0, 3.0));
}

#[test]
fn lenses_crops_and_depths_are_converted() {
    let desc = loaded(
        "<integrator type=\"moment\"><integrator type=\"path\"><integer name=\"max_depth\" value=\"3\"/></integrator></integrator>
        <sensor type=\"thinlens\">
            <float name=\"aperture_radius\" value=\"0.25\"/><float name=\"focus_distance\" value=\"7\"/>
            <film type=\"hdrfilm\"><rfilter type=\"box\"/>
                <integer name=\"width\" value=\"40\"/><integer name=\"height\" value=\"30\"/>
                <integer name=\"crop_offset_x\" value=\"5\"/><integer name=\"crop_offset_y\" value=\"6\"/>
                <integer name=\"crop_width\" value=\"10\"/><integer name=\"crop_height\" value=\"20\"/>
            </film>
        </sensor>",
    );
    assert_eq!(desc.max_depth, Some(2));
    assert_eq!(desc.camera.aperture_radius, 0.25);
    assert_eq!(desc.camera.focus_distance, Some(7.0));
    assert_eq!(desc.camera.resolution, [40, 30]);
    assert_eq!(desc.crop, Some([5, 6, 15, 26]));
    assert!(desc.warnings.is_empty(), "{:?}", desc.warnings);
    assert_eq!(loaded("<integrator type=\"direct\"/>").max_depth, Some(1));
    assert_eq!(loaded("<integrator type=\"path\"/>").max_depth, None);
    let text = "<integrator type=\"path\"><integer name=\"max_depth\" value=\"-1\"/></integrator>";
    assert_eq!(loaded(text).max_depth, None);
}

#[test]
fn what_is_approximated_is_said() {
    let desc = loaded(
        "<sensor type=\"perspective\"><float name=\"near_clip\" value=\"1\"/>
            <film type=\"hdrfilm\"><rfilter type=\"gaussian\"/></film>
            <sampler type=\"independent\"><integer name=\"sample_count\" value=\"77\"/></sampler></sensor>",
    );
    let all = desc.warnings.join("\n");
    for part in ["near_clip", "gaussian", "77", "scene.xml:2"] {
        assert!(all.contains(part), "{part}: {all}");
    }
    assert!(
        loaded("<shape type=\"rectangle\"/>")
            .warnings
            .join("\n")
            .contains("no sensor")
    );
}

// ---- Materials

#[test]
fn surfaces_are_one_sided_unless_they_transmit_or_twosided_stands_around_them() {
    let diffuse = "<bsdf type=\"diffuse\"><rgb name=\"reflectance\" value=\"0.1 0.2 0.3\"/></bsdf>";
    let one = material(diffuse);
    assert_eq!(one.back, Back::Black);
    let Scattering::Diffuse { reflectance } = one.scattering else {
        panic!("{one:?}");
    };
    assert_rgb(constant(&reflectance), [0.1, 0.2, 0.3]);
    let two = |inner: &str| material(&format!("<bsdf type=\"twosided\">{inner}</bsdf>"));
    assert_eq!(two(diffuse).back, Back::Same);
    assert_eq!(material("<bsdf type=\"dielectric\"/>").back, Back::Same);
    let principled = "<bsdf type=\"principled\"/>";
    assert_eq!(
        (material(principled).back, two(principled).back),
        (Back::Black, Back::Same)
    );
    let glass = "<bsdf type=\"principled\"><float name=\"spec_trans\" value=\"0.5\"/></bsdf>";
    assert_eq!(material(glass).back, Back::Same);
    let allowed = format!("<boolean name=\"allow_transmission\" value=\"true\"/>{glass}");
    assert!(matches!(two(&allowed).back, Back::Material(_)));
    assert!(matches!(
        two(&format!("{diffuse}<bsdf type=\"conductor\"/>")).back,
        Back::Material(_)
    ));
    // Without a BSDF: grey, and black for lamps.
    for (emitter, albedo) in [("", 0.5), ("<emitter type=\"area\"/>", 0.0)] {
        let plain = material(emitter);
        assert_eq!(plain.back, Back::Black);
        assert_eq!(
            plain.scattering,
            Scattering::Diffuse {
                reflectance: Spectrum::Constant(Rgb::splat(albedo))
            }
        );
    }
}

#[test]
fn metals_are_known_by_name_and_by_index() {
    let General::Metal {
        eta,
        k,
        alpha,
        distribution,
        ..
    } = general(
        "<bsdf type=\"roughconductor\"><string name=\"material\" value=\"Au\"/>
        <float name=\"alpha_u\" value=\"0.2\"/><float name=\"alpha_v\" value=\"0.3\"/></bsdf>",
    )
    else {
        panic!()
    };
    assert_rgb(eta, [0.143036, 0.375307, 1.44205]);
    assert_rgb(k, [3.983, 2.38556, 1.60336]);
    assert_eq!(alpha, [Scalar::Constant(0.2), Scalar::Constant(0.3)]);
    assert_eq!(distribution, Distribution::Beckmann);
    let smooth =
        "<bsdf type=\"conductor\"><spectrum name=\"eta\" value=\"0.5\"/><spectrum name=\"k\" value=\"6\"/></bsdf>";
    assert_eq!(
        material(smooth).scattering,
        Scattering::Conductor {
            eta: Rgb::splat(0.5),
            k: Rgb::splat(6.0),
            alpha: 0.0
        }
    );
    // What no metal is given for reflects everything.
    assert_eq!(
        material("<bsdf type=\"conductor\"/>").scattering,
        Scattering::Mirror {
            reflectance: Rgb::WHITE
        }
    );
    refused(
        "<shape type=\"cube\"><bsdf type=\"conductor\"><string name=\"material\" value=\"Xx\"/></bsdf></shape>",
        &["Xx", "Au"],
    );
}

#[test]
fn glass_takes_the_quotient_of_indices() {
    let Scattering::Dielectric { ior, alpha } = material(
        "<bsdf type=\"dielectric\"><string name=\"int_ior\" value=\"diamond\"/><float name=\"ext_ior\" value=\"1.3\"/></bsdf>",
    )
    .scattering
    else {
        panic!()
    };
    assert!(near(ior, 2.419 / 1.3) && alpha == 0.0);
    let rough = general(
        "<bsdf type=\"roughdielectric\"><string name=\"distribution\" value=\"ggx\"/><float name=\"alpha\" value=\"0.4\"/></bsdf>",
    );
    let General::Glass {
        ior,
        alpha,
        distribution,
        ..
    } = rough
    else {
        panic!("{rough:?}")
    };
    assert!(near(ior, 1.5046 / 1.000277));
    assert_eq!((alpha, distribution), ([Scalar::Constant(0.4); 2], Distribution::Ggx));
    assert!(matches!(
        general("<bsdf type=\"thindielectric\"/>"),
        General::ThinGlass { .. }
    ));
    let plastic = general("<bsdf type=\"plastic\"><boolean name=\"nonlinear\" value=\"true\"/></bsdf>");
    let General::CoatedDiffuse { coat, nonlinear, .. } = plastic else {
        panic!("{plastic:?}")
    };
    assert!(near(coat.ior, 1.49 / 1.000277) && coat.alpha == 0.0 && nonlinear);
}

#[test]
fn specular_of_the_principled_bsdf_becomes_an_index() {
    let principled = |text: &str| match general(&format!("<bsdf type=\"principled\">{text}</bsdf>")) {
        General::Principled(p) => *p,
        other => panic!("{other:?}"),
    };
    assert!(near(principled("").ior, 1.5));
    assert!(near(principled("<float name=\"eta\" value=\"1.7\"/>").ior, 1.7));
    let specular = principled("<float name=\"specular\" value=\"0.8\"/><float name=\"metallic\" value=\"0.25\"/>");
    assert!(near(specular.ior, 2.0 / (1.0 - 0.064f64.sqrt()) - 1.0));
    assert_eq!(specular.metallic, Scalar::Constant(0.25));
}

#[test]
fn wrappers_add_what_they_are_for() {
    let png = "<texture type=\"bitmap\" name=\"NAME\"><string name=\"filename\" value=\"tiles.png\"/></texture>";
    let masked = material(&format!(
        "<bsdf type=\"mask\">{}<bsdf type=\"diffuse\"/></bsdf>",
        png.replace("NAME", "opacity")
    ));
    assert!(matches!(masked.opacity, Some(Spectrum::Bitmap(..))));
    assert_eq!(masked.back, Back::Black);
    let mapped = material(&format!(
        "<bsdf type=\"normalmap\">{}<bsdf type=\"diffuse\"/></bsdf>",
        png.replace("NAME", "normalmap")
    ));
    assert!(matches!(mapped.relief, Some(Relief::NormalMap { .. })));
    let bumpy = material(&format!(
        "<bsdf type=\"bumpmap\"><float name=\"scale\" value=\"3\"/>{}<bsdf type=\"diffuse\"/></bsdf>",
        png.replace("NAME", "anything")
    ));
    assert!(matches!(bumpy.relief, Some(Relief::BumpMap { scale: 3.0, .. })));
    let blend = general(
        "<bsdf type=\"blendbsdf\"><float name=\"weight\" value=\"0.2\"/><bsdf type=\"diffuse\"/><bsdf type=\"conductor\"/></bsdf>",
    );
    let General::Blend { weight, materials } = blend else {
        panic!("{blend:?}")
    };
    assert_eq!(weight, Scalar::Constant(0.2));
    assert_ne!(materials[0], materials[1]);
}

// ---- Textures and spectra

fn diffuse_texture(texture: &str) -> (SceneDesc, Spectrum) {
    let desc = loaded(&format!(
        "<shape type=\"rectangle\"><bsdf type=\"diffuse\"><texture name=\"reflectance\" {texture}</texture></bsdf></shape>"
    ));
    let Scattering::Diffuse { reflectance } = desc.materials[0].1.scattering.clone() else {
        panic!()
    };
    (desc, reflectance)
}

#[test]
fn bitmaps_have_their_top_row_at_v_zero() {
    let file = "<string name=\"filename\" value=\"tiles.png\"/>";
    let (desc, spectrum) = diffuse_texture(&format!(
        "type=\"bitmap\">{file}<string name=\"wrap_mode\" value=\"mirror\"/><string name=\"filter_type\" value=\"nearest\"/>
        <transform name=\"to_uv\"><scale x=\"2\"/><translate y=\"0.5\"/></transform>"
    ));
    let Spectrum::Bitmap(map, tint) = spectrum else {
        panic!("{spectrum:?}")
    };
    assert_eq!(
        (map.wrap, map.filter, tint),
        ([Wrap::Mirror; 2], Filter::Nearest, Rgb::WHITE)
    );
    // Top row: black, red. Bottom row: green, yellow.
    let plain = TextureMap {
        to_uv: map.to_uv,
        ..map
    };
    assert_eq!(plain.lookup(&desc.textures, Vec2::new(0.1, -0.4)), Rgb::BLACK);
    assert_eq!(
        plain.lookup(&desc.textures, Vec2::new(0.4, -0.4)),
        Rgb::new(1.0, 0.0, 0.0)
    );
    assert_eq!(
        plain.lookup(&desc.textures, Vec2::new(0.1, 0.3)),
        Rgb::new(0.0, 1.0, 0.0)
    );
    // Sixteen-bit and eight-bit files are sRGB unless raw.
    assert!(matches!(
        &desc.textures[0],
        Texture::Rgb8(_, embrace::texture::Encoding::Srgb)
    ));
    let (desc, _) = diffuse_texture(&format!("type=\"bitmap\">{file}<boolean name=\"raw\" value=\"true\"/>"));
    assert!(matches!(
        &desc.textures[0],
        Texture::Rgb8(_, embrace::texture::Encoding::Linear)
    ));
}

#[test]
fn checkerboards_exchange_their_colours_where_a_number_is_asked_for() {
    let colors =
        "type=\"checkerboard\"><float name=\"color0\" value=\"0.125\"/><float name=\"color1\" value=\"0.75\"/>";
    let (_, spectrum) = diffuse_texture(colors);
    let Spectrum::Checkerboard(pattern) = spectrum else {
        panic!("{spectrum:?}")
    };
    assert_eq!(pattern.colors, [Rgb::splat(0.125), Rgb::splat(0.75)]);
    let General::Metal { alpha, .. } = general(&format!(
        "<bsdf type=\"roughconductor\"><texture name=\"alpha\" {colors}</texture></bsdf>"
    )) else {
        panic!()
    };
    let Scalar::Varying(Spectrum::Checkerboard(pattern), Channel::R) = alpha[0] else {
        panic!("{alpha:?}")
    };
    assert_eq!(pattern.colors, [Rgb::splat(0.75), Rgb::splat(0.125)]);
}

#[test]
fn spectra_become_the_colours_that_mitsuba_makes_of_them() {
    // From Mitsuba 3.9.1, variant scalar_rgb.
    let intensity = |spectrum: &str| {
        let desc = loaded(&format!(
            "<emitter type=\"point\"><spectrum name=\"intensity\" value=\"{spectrum}\"/></emitter>"
        ));
        match desc.lights[0] {
            LightDesc::Point { intensity, .. } => intensity,
            ref other => panic!("{other:?}"),
        }
    };
    assert_rgb(intensity("1"), [1.20479, 0.948291, 0.908916]);
    assert_rgb(
        intensity("400:0, 500:8, 600:15.6, 700:18.4"),
        [20.7108, 10.8546, 2.77115],
    );
    let reflectance = |spectrum: &str| match material(&format!(
        "<bsdf type=\"diffuse\"><spectrum name=\"reflectance\" value=\"{spectrum}\"/></bsdf>"
    ))
    .scattering
    {
        Scattering::Diffuse { reflectance } => constant(&reflectance),
        other => panic!("{other:?}"),
    };
    assert_rgb(reflectance("0.5"), [0.5; 3]);
    assert_rgb(
        reflectance("400:0.1, 500:0.3, 600:0.6, 700:0.2"),
        [0.579776, 0.436028, 0.175562],
    );
}

// ---- Lights

#[test]
fn lights_stand_and_look_where_their_transform_says() {
    let desc = loaded(
        "<emitter type=\"point\"><point name=\"position\" x=\"1\" y=\"2\" z=\"3\"/><rgb name=\"intensity\" value=\"4\"/></emitter>
        <emitter type=\"spot\"><float name=\"cutoff_angle\" value=\"40\"/>
            <transform name=\"to_world\"><lookat origin=\"0 5 0\" target=\"0 0 0\" up=\"0 0 1\"/></transform></emitter>
        <emitter type=\"directional\"><vector name=\"direction\" value=\"0 0 -2\"/></emitter>
        <emitter type=\"constant\"><rgb name=\"radiance\" value=\"0.5\"/></emitter>",
    );
    assert_eq!(
        desc.lights[0],
        LightDesc::Point {
            position: DVec3::new(1.0, 2.0, 3.0),
            intensity: Rgb::splat(4.0)
        }
    );
    let LightDesc::Spot {
        position,
        direction,
        angles,
        falloff,
        ..
    } = desc.lights[1]
    else {
        panic!()
    };
    assert_eq!((position, falloff), (DVec3::new(0.0, 5.0, 0.0), Falloff::Angle));
    assert!((direction.normalize() - DVec3::NEG_Y).length() < 1e-12);
    assert!((angles[0].to_degrees() - 30.0).abs() < 1e-9 && (angles[1].to_degrees() - 40.0).abs() < 1e-9);
    assert!(matches!(desc.lights[2], LightDesc::Distant { radius: 0.0, .. }));
    assert!(matches!(desc.environment, Some(EnvironmentDesc::Constant(rgb)) if rgb == Rgb::splat(0.5)));
}

#[test]
fn a_spot_casts_its_texture_along_the_axes_of_its_transform() {
    let spot = |texture: &str| {
        let desc = loaded(&format!(
            "<emitter type=\"spot\"><rgb name=\"intensity\" value=\"3\"/>{texture}
            <transform name=\"to_world\"><scale value=\"2\"/><rotate y=\"1\" angle=\"90\"/></transform></emitter>"
        ));
        let LightDesc::Spot { intensity, slide, .. } = desc.lights[0].clone() else {
            panic!("{:?}", desc.lights);
        };
        (intensity, slide)
    };
    assert_eq!(spot(""), (Rgb::splat(3.0), None));
    let (intensity, slide) = spot("<rgb name=\"texture\" value=\"0.5\"/>");
    assert_eq!((intensity, slide), (Rgb::splat(1.5), None));
    let (intensity, slide) = spot("<texture name=\"texture\" type=\"checkerboard\"/>");
    let slide = slide.expect("a slide");
    assert_eq!(intensity, Rgb::splat(3.0));
    assert!(matches!(slide.factor, Spectrum::Checkerboard(_)));
    let close = |a: DVec3, b: DVec3| (a.normalize() - b).length() < 1e-12;
    assert!(close(slide.axes[0], DVec3::NEG_Z) && close(slide.axes[1], DVec3::Y));
}

#[test]
fn environment_maps_keep_their_values_at_the_poles() {
    // Four rows from 0 to 3: at the poles Mitsuba has the first and the last row, and in the middle 1.5.
    let folder = Folder::new();
    let mut hdr = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 4 +X 1\n".to_vec();
    for value in [0u8, 64, 128, 192] {
        hdr.extend([value, value, value, 128 + 2]);
    }
    folder.write("sky.hdr", &hdr);
    let desc = folder
        .try_load(
            "<emitter type=\"envmap\"><string name=\"filename\" value=\"sky.hdr\"/><float name=\"scale\" value=\"2\"/></emitter>",
            &[],
        )
        .unwrap();
    let Some(EnvironmentDesc::Map { image, scale, .. }) = &desc.environment else {
        panic!()
    };
    assert_eq!((*scale, image.width, image.height), (2.0, 1, 16));
    let rows: Vec<f32> = image.pixels.iter().map(|p| p.r).collect();
    for (row, value) in rows.iter().enumerate() {
        let v = (row as f32 + 0.5) / 16.0;
        assert!((value - 3.0 * v).abs() < 0.05, "row {row}: {value}");
    }
}

#[test]
fn area_lights_emit_from_the_front_constants_or_textures() {
    let desc = loaded(
        "<shape type=\"rectangle\"><emitter type=\"area\"><rgb name=\"radiance\" value=\"1 2 3\"/></emitter></shape>
        <shape type=\"rectangle\"><emitter type=\"area\"><texture type=\"bitmap\" name=\"radiance\">
            <string name=\"filename\" value=\"tiles.png\"/></texture></emitter></shape>",
    );
    let emission = desc.objects[0].emission.unwrap();
    assert_eq!(
        (emission.radiance, emission.both_sides),
        (Rgb::new(1.0, 2.0, 3.0), false)
    );
    assert_eq!(desc.objects[0].emission_map, None);
    assert_eq!(desc.objects[1].emission.unwrap().radiance, Rgb::WHITE);
    assert!(matches!(desc.objects[1].emission_map, Some(Spectrum::Bitmap(..))));
}

// ---- Shapes

/// Largest distance of corners and centres of triangles from a surface, relative area, and the least cosine between
/// triangles and `outwards`.
fn measure(shape: &str, distance: impl Fn(DVec3) -> f64, outwards: impl Fn(DVec3) -> DVec3, area: f64) -> f64 {
    let desc = loaded(&format!("<shape type=\"{shape}\"/>"));
    let mesh = &desc.meshes[0];
    let (mut largest, mut sum) = (0f64, 0.0);
    for corners in &mesh.indices {
        let p = corners.map(|i| mesh.positions[i as usize]);
        let middle = (p[0] + p[1] + p[2]) / 3.0;
        largest = [p[0], p[1], p[2], middle]
            .map(&distance)
            .into_iter()
            .fold(largest, f64::max);
        let cross = (p[1] - p[0]).cross(p[2] - p[0]);
        sum += 0.5 * cross.length();
        assert!(
            cross.normalize().dot(outwards(middle)) > 0.99,
            "{shape}: a triangle faces inwards"
        );
        for &i in corners {
            assert!(
                mesh.normals[i as usize]
                    .as_dvec3()
                    .dot(outwards(mesh.positions[i as usize]))
                    > 0.999_9
            );
        }
    }
    assert!(
        (sum / area - 1.0).abs() < 1e-9,
        "{shape}: an area of {sum} instead of {area}"
    );
    largest
}

#[test]
fn curved_shapes_lie_within_the_stated_distance_of_the_true_ones() {
    use std::f64::consts::PI;
    let flat = |p: DVec3| DVec3::new(p.x, p.y, 0.0);
    let of_sphere = measure("sphere", |p| (p.length() - 1.0).abs(), |p| p.normalize(), 4.0 * PI);
    assert!(of_sphere < 1.1e-4, "{of_sphere}");
    let of_cylinder = measure(
        "cylinder",
        |p| (flat(p).length() - 1.0).abs(),
        |p| flat(p).normalize(),
        2.0 * PI,
    );
    assert!(of_cylinder < 2e-5, "{of_cylinder}");
    // Beyond the edge, not inside.
    let of_disk = measure("disk", |p| p.z.abs() + (p.length() - 1.0).max(0.0), |_| DVec3::Z, PI);
    assert!(of_disk < 2e-5, "{of_disk}");
    assert_eq!(measure("rectangle", |p| p.z.abs(), |_| DVec3::Z, 4.0), 0.0);
    let cube_normal = |p: DVec3| {
        let largest = p.abs().max_element();
        DVec3::select(p.abs().cmpge(DVec3::splat(largest)), p.signum(), DVec3::ZERO)
    };
    let desc = loaded("<shape type=\"cube\"/>");
    for corners in &desc.meshes[0].indices {
        let p = corners.map(|i| desc.meshes[0].positions[i as usize]);
        let normal = (p[1] - p[0]).cross(p[2] - p[0]).normalize();
        assert_eq!(normal, cube_normal((p[0] + p[1] + p[2]) / 3.0));
    }
}

#[test]
fn shapes_of_a_kind_share_their_mesh_and_groups_are_instanced() {
    let desc = loaded(
        "<shape type=\"shapegroup\" id=\"group\"><shape type=\"sphere\"/><shape type=\"cube\"/></shape>
        <shape type=\"instance\"><ref id=\"group\"/></shape>
        <shape type=\"instance\"><ref id=\"group\"/><transform name=\"to_world\"><translate x=\"5\"/></transform></shape>
        <shape type=\"sphere\"><point name=\"center\" value=\"0 3 0\"/><float name=\"radius\" value=\"2\"/></shape>",
    );
    assert_eq!((desc.meshes.len(), desc.objects.len()), (2, 5));
    assert_eq!(desc.objects[2].to_world.translation, DVec3::new(5.0, 0.0, 0.0));
    assert_eq!(desc.objects[4].mesh, desc.objects[0].mesh);
    assert_eq!(
        desc.objects[4].to_world.transform_point3(DVec3::Y),
        DVec3::new(0.0, 5.0, 0.0)
    );
}

#[test]
fn normals_flip_and_texture_coordinates_of_obj_files_turn_over() {
    let shape = |rest: &str| {
        let text = format!("<shape type=\"obj\"><string name=\"filename\" value=\"quad.obj\"/>{rest}</shape>");
        (*loaded(&text).meshes[0]).clone()
    };
    let plain = shape("");
    assert_eq!(plain.uvs[0], Vec2::new(0.0, 1.0));
    assert!(plain.normals.iter().all(|n| *n == Vec3::Z), "{:?}", plain.normals);
    let kept = shape("<boolean name=\"flip_tex_coords\" value=\"false\"/>");
    assert_eq!(kept.uvs[0], Vec2::ZERO);
    let flipped = shape("<boolean name=\"flip_normals\" value=\"true\"/>");
    assert!(flipped.normals.iter().all(|n| *n == Vec3::NEG_Z));
    let [a, b, c] = flipped.indices[0].map(|i| flipped.positions[i as usize]);
    assert!((b - a).cross(c - a).z < 0.0);
    assert!(
        shape("<boolean name=\"face_normals\" value=\"true\"/>")
            .normals
            .is_empty()
    );
}

#[test]
fn mesh_attributes_become_colours_of_vertices_and_faces() {
    let folder = Folder::new();
    folder.write(
        "mesh.ply",
        b"ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n\
        property float color_0\nproperty float color_1\nproperty float color_2\n\
        element face 2\nproperty list uchar int vertex_indices\nproperty float weight_0\nend_header\n\
        0 0 0 1 0 0\n1 0 0 0 1 0\n1 1 0 0 0 1\n0 1 0 1 1 1\n3 0 1 2 0.25\n3 0 2 3 0.75\n",
    );
    let with = |name: &str| {
        folder.try_load(
            &format!(
                "<shape type=\"ply\"><string name=\"filename\" value=\"mesh.ply\"/><bsdf type=\"diffuse\">
                <texture type=\"mesh_attribute\" name=\"reflectance\"><string name=\"name\" value=\"{name}\"/></texture></bsdf></shape>"
            ),
            &[],
        )
    };
    let desc = with("vertex_color").unwrap();
    assert_eq!(desc.meshes[0].colors[1], Rgb::new(0.0, 1.0, 0.0));
    assert!(matches!(
        desc.materials[0].1.scattering,
        Scattering::Diffuse {
            reflectance: Spectrum::VertexColor(None, Rgb::WHITE)
        }
    ));
    let desc = with("face_weight").unwrap();
    let colors: Vec<f32> = desc.meshes[0].colors.iter().map(|c| c.r).collect();
    assert_eq!(colors, [0.25, 0.25, 0.25, 0.75, 0.75, 0.75]);
    let message = with("vertex_heat").unwrap_err();
    assert!(
        message.contains("vertex_heat") && message.contains("vertex_color"),
        "{message}"
    );
}

/// A serialized mesh of one triangle, single precision, version 4, after `count`s.
fn serialized(vertices: u64, triangles: u64) -> Vec<u8> {
    let mut content = Vec::new();
    content.extend(0x1003u32.to_le_bytes());
    content.extend(b"name\0");
    content.extend(vertices.to_le_bytes());
    content.extend(triangles.to_le_bytes());
    let floats: [f32; 24] = [
        0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, // positions
        0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0, // normals
        0.0, 0.0, 1.0, 0.0, 0.0, 1.0, // texture coordinates
    ];
    content.extend(floats.iter().flat_map(|f| f.to_le_bytes()));
    content.extend([0u32, 1, 2].iter().flat_map(|i| i.to_le_bytes()));
    let mut file = vec![0x1c, 0x04, 0x04, 0x00];
    let mut encoder = flate2::write::ZlibEncoder::new(Vec::new(), flate2::Compression::fast());
    encoder.write_all(&content).unwrap();
    file.extend(encoder.finish().unwrap());
    file
}

#[test]
fn serialized_meshes_are_read_and_absurd_counts_refused() {
    let folder = Folder::new();
    let shape = |index: i64| {
        folder.try_load(
            &format!(
                "<shape type=\"serialized\"><string name=\"filename\" value=\"mesh.serialized\"/>
                <integer name=\"shape_index\" value=\"{index}\"/></shape>"
            ),
            &[],
        )
    };
    // Two meshes and the table of where they begin.
    let one = serialized(3, 1);
    let mut two = [one.clone(), one.clone()].concat();
    two.extend(0u64.to_le_bytes());
    two.extend((one.len() as u64).to_le_bytes());
    two.extend(2u32.to_le_bytes());
    folder.write("mesh.serialized", &two);
    for index in [0, 1] {
        let mesh = &shape(index).unwrap().meshes[0];
        assert_eq!(mesh.positions[1], DVec3::X);
        assert_eq!(
            (mesh.uvs[2], mesh.normals[0], mesh.indices[0]),
            (Vec2::Y, Vec3::Z, [0, 1, 2])
        );
    }
    let message = shape(2).unwrap_err();
    assert!(
        message.contains("mesh 2") && message.contains("has 2 meshes"),
        "{message}"
    );
    for (what, bytes) in [
        ("more than the file can hold", serialized(1 << 40, 1)),
        ("more than the file can hold", serialized(3, u64::MAX)),
        ("uses vertex", serialized(2, 1)),
        ("begin", b"PK\x03\x04".to_vec()),
        ("damaged", one[..one.len() / 2].to_vec()),
    ] {
        folder.write("mesh.serialized", &bytes);
        let message = shape(0).unwrap_err();
        assert!(
            message.contains("mesh.serialized") && message.contains(what),
            "{what}: {message}"
        );
    }
}

// ---- The text itself

#[test]
fn parameters_have_defaults_and_the_command_line_goes_before_them() {
    let folder = Folder::new();
    let text = "<default name=\"s\" value=\"1\"/><default name=\"size\" value=\"2\"/>
        <shape type=\"sphere\"><float name=\"radius\" value=\"$size\"/></shape>
        <emitter type=\"constant\"><float name=\"radiance\" value=\"$s\"/></emitter>";
    let radius = |defines: &[(&str, &str)]| {
        let desc = folder.try_load(text, defines).unwrap();
        desc.objects[0].to_world.matrix3.x_axis.x
    };
    assert_eq!(radius(&[]), 2.0);
    assert_eq!(radius(&[("size", "7")]), 7.0);
    let hashes = [folder.try_load(text, &[]), folder.try_load(text, &[("size", "7")])].map(|desc| desc.unwrap().hash);
    assert_ne!(hashes[0], hashes[1]);
    let message = folder.try_load(text, &[("sise", "7")]).unwrap_err();
    assert!(message.contains("-D sise=7"), "{message}");
    refused(
        "<shape type=\"sphere\"><float name=\"radius\" value=\"$r\"/></shape>",
        &["line 2", "$r"],
    );
}

#[test]
fn includes_references_and_paths_are_followed() {
    let folder = Folder::new();
    folder.write(
        "parts/lamp.xml",
        b"<scene version=\"3.0.0\"><include filename=\"inner.xml\"/><shape type=\"cube\"><ref id=\"paint\"/></shape></scene>",
    );
    folder.write(
        "parts/inner.xml",
        b"<bsdf version=\"3.0.0\" type=\"diffuse\" id=\"paint\"><rgb name=\"reflectance\" value=\"0.9\"/></bsdf>",
    );
    folder.write("meshes/quad2.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n");
    let desc = folder
        .try_load(
            "<path value=\"meshes\"/><include filename=\"parts/lamp.xml\"/>
            <shape type=\"obj\"><string name=\"filename\" value=\"quad2.obj\"/><ref id=\"paint\"/></shape>",
            &[],
        )
        .unwrap();
    assert_eq!((desc.objects.len(), desc.materials.len()), (2, 1));
    assert_eq!(desc.objects[0].material, desc.objects[1].material);
}

#[test]
fn old_scenes_may_write_names_in_camel_case() {
    let folder = Folder::new();
    folder.write(
        "scene.xml",
        b"<scene version=\"0.6.0\"><integrator type=\"path\"><integer name=\"maxDepth\" value=\"4\"/></integrator></scene>",
    );
    assert_eq!(folder.try_load_file("scene.xml", &[]).unwrap().max_depth, Some(3));
}

#[test]
fn what_is_not_supported_is_named_with_its_line() {
    let in_shape = |bsdf: &str| format!("\n\n<shape type=\"sphere\">\n{bsdf}</shape>");
    for (text, parts) in [
        ("<integrator type=\"bdpt\"/>".to_owned(), ["line 2", "bdpt", "path"]),
        ("\n<sensor type=\"fisheye\"/>".to_owned(), ["line 3", "fisheye", "perspective"]),
        ("<emitter type=\"sunsky\"/>".to_owned(), ["line 2", "sunsky", "envmap"]),
        ("<shape type=\"hair\"/>".to_owned(), ["line 2", "hair", "sphere"]),
        (in_shape("<bsdf type=\"measured\"/>"), ["line 5", "measured", "principled"]),
        (in_shape("<bsdf type=\"diffuse\"><float name=\"reflectence\" value=\"1\"/></bsdf>"), ["line 5", "reflectence", "did you mean \"reflectance\"?"]),
        (in_shape("<float name=\"radios\" value=\"1\"/>"), ["line 5", "radios", "radius"]),
        (in_shape("<ref id=\"nobody\"/>"), ["line 5", "nobody", "no object has that id"]),
        (in_shape("<integer name=\"radius\" value=\"two\"/>"), ["line 5", "radius", "two"]),
        (in_shape("<float name=\"radius\" value=\"nan\"/>"), ["line 5", "radius", "not a finite number"]),
        (in_shape("<string name=\"radius\" value=\"2\"/>"), ["line 5", "radius", "is not a float"]),
        (in_shape("<float name=\"radius\" value=\"0\"/>"), ["line 5", "radius", "0 is not in"]),
        (in_shape("<transform name=\"to_world\"><scale value=\"0\"/></transform>"), ["line 4", "to_world", "not invertible"]),
        (in_shape("<transform name=\"to_world\"><matrix value=\"1 2 3\"/></transform>"), ["line 5", "<matrix>", "9 or 16"]),
        (in_shape("<bsdf type=\"diffuse\"><rgb name=\"reflectance\" value=\"2\"/></bsdf>"), ["line 5", "reflectance", "in [0, 1]"]),
        (in_shape("<bsdf type=\"mask\"/>"), ["line 5", "mask", "no child BSDF"]),
        (in_shape("<bsdf type=\"twosided\"><bsdf type=\"dielectric\"/></bsdf>"), ["line 5", "twosided", "transmits"]),
        (in_shape("<bsdf type=\"diffuse\"/><bsdf type=\"diffuse\"/>"), ["line 5", "diffuse", "the second"]),
        (in_shape("<colour name=\"x\"/>"), ["line 5", "<colour>", "expected one of"]),
        (in_shape("<float name=\"radius\" size=\"2\"/>"), ["line 5", "size", "value"]),
        (in_shape("<float name=\"radius\"/>"), ["line 5", "<float>", "`value`"]),
        (in_shape("<medium type=\"homogeneous\"/>"), ["line 5", "<medium>", "not supported"]),
        ("<emitter type=\"constant\"/>\n<emitter type=\"constant\"/>".to_owned(), ["line 3", "constant", "second environment"]),
        ("<emitter type=\"spot\"><float name=\"cutoff_angle\" value=\"90\"/><texture name=\"texture\" type=\"checkerboard\"/></emitter>".to_owned(), ["line 2", "spot", "below 90"]),
        ("<emitter type=\"spot\"><texture name=\"texture\" type=\"checkerboard\"/><transform name=\"to_world\"><scale x=\"2\"/></transform></emitter>".to_owned(), ["line 2", "spot", "no rotation and scale"]),
        ("<emitter type=\"envmap\"><string name=\"filename\" value=\"gone.exr\"/></emitter>".to_owned(), ["gone.exr", "cannot be read", ""]),
        ("<integrator type=\"path\"><boolean name=\"hide_emitters\" value=\"true\"/></integrator>".to_owned(), ["line 2", "hide_emitters", ""]),
        ("<sensor type=\"perspective\"><float name=\"principal_point_offset_x\" value=\"0.1\"/></sensor>".to_owned(), ["line 2", "principal_point_offset_x", "0.1"]),
        ("<sensor type=\"perspective\"><film type=\"hdrfilm\"><integer name=\"width\" value=\"1000000000\"/></film></sensor>".to_owned(), ["line 2", "width", "1000000000"]),
        ("<shape id=\"a\" type=\"cube\"/><shape id=\"a\" type=\"cube\"/>".to_owned(), ["line 2", "\"a\"", "same id"]),
        ("<sphere/>".to_owned(), ["line 2", "<sphere>", "shape"]),
    ] {
        let message = Folder::new().try_load(&text, &[]).expect_err(&text);
        for part in parts {
            assert!(message.contains(part), "`{part}` is not in: {message}");
        }
    }
}

#[test]
fn text_that_would_expand_without_end_is_refused() {
    let folder = Folder::new();
    // Entities.
    let bomb =
        "<!DOCTYPE scene [<!ENTITY a \"aaaaaaaaaa\"><!ENTITY b \"&a;&a;&a;&a;\">]><scene version=\"3.0.0\">&b;</scene>";
    folder.write("bomb.xml", bomb.as_bytes());
    let message = folder.try_load_file("bomb.xml", &[]).unwrap_err();
    assert!(
        message.contains("bomb.xml") && message.contains("document type"),
        "{message}"
    );
    // Parameters that double.
    let mut text = String::from("<default name=\"p0\" value=\"xxxxxxxxxxxxxxxx\"/>\n");
    for i in 1..60 {
        text += &format!("<default name=\"p{i}\" value=\"$p{}$p{}\"/>\n", i - 1, i - 1);
    }
    let message = folder.try_load(&text, &[]).unwrap_err();
    assert!(message.contains("expand"), "{message}");
    // Files that include themselves, or each other twice.
    let message = folder.try_load("<include filename=\"scene.xml\"/>", &[]).unwrap_err();
    assert!(
        message.contains("<include>") && message.contains("include itself"),
        "{message}"
    );
    for i in 0..12 {
        let next = format!("<include filename=\"bomb{}.xml\"/>", i + 1);
        folder.write(
            &format!("bomb{i}.xml"),
            format!("<scene version=\"3.0.0\">{next}{next}{next}</scene>").as_bytes(),
        );
    }
    folder.write("bomb12.xml", b"<scene version=\"3.0.0\"/>");
    let message = folder.try_load("<include filename=\"bomb0.xml\"/>", &[]).unwrap_err();
    assert!(message.contains("<include>"), "{message}");
    // References that go around.
    let ring = "<bsdf type=\"twosided\" id=\"a\"><ref id=\"b\"/></bsdf><bsdf type=\"twosided\" id=\"b\"><ref id=\"a\"/></bsdf>";
    let message = folder.try_load(ring, &[]).unwrap_err();
    assert!(message.contains("contains it"), "{message}");
    // Elements within elements, and a chain of references, without end.
    let deep = format!("{}{}", "<bsdf type=\"mask\">".repeat(20_000), "</bsdf>".repeat(20_000));
    let message = folder
        .try_load(&format!("<shape type=\"cube\">{deep}</shape>"), &[])
        .unwrap_err();
    assert!(
        message.contains("nested") || message.contains("well-formed"),
        "{message}"
    );
    let mut chain = String::from("<shape type=\"cube\"><ref id=\"b0\"/></shape>");
    for i in 0..50_000 {
        chain += &format!("<bsdf type=\"mask\" id=\"b{i}\"><ref id=\"b{}\"/></bsdf>\n", i + 1);
    }
    chain += "<bsdf type=\"diffuse\" id=\"b50000\"/>";
    let message = folder.try_load(&chain, &[]).unwrap_err();
    assert!(
        message.contains("nested") || message.contains("another mask"),
        "{message}"
    );
}

#[test]
fn damaged_files_are_named() {
    let folder = Folder::new();
    for (bytes, part) in [
        (&b"<scene version=\"3.0.0\"><shape></scene>"[..], "well-formed"),
        (b"<scene version=\"3.0.0\">\xff</scene>", "UTF-8"),
        (b"<scene/>", "version"),
        (b"<scene version=\"three\"/>", "three"),
        (b"<bsdf version=\"3.0.0\" type=\"diffuse\"/>", "not a scene"),
        (b"", "well-formed"),
    ] {
        folder.write("scene.xml", bytes);
        let message = folder.try_load_file("scene.xml", &[]).unwrap_err();
        assert!(
            message.contains("scene.xml") && message.contains(part),
            "{part}: {message}"
        );
    }
    let message = folder.try_load_file("gone.xml", &[]).unwrap_err();
    assert!(message.contains("gone.xml"), "{message}");
}
