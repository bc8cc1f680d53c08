use super::*;
use crate::material::{Back, Channel, General, Relief, Scalar, Scattering};
use crate::math::{Affine2, Rgb, Vec2};
use crate::scene::desc::Falloff;
use crate::texture::{Encoding, Filter, TextureMap, Wrap};

const CAMERA: &str = "[camera]\nposition = [0, 1, 4]\nlook_at = [0, 0, 0]\nvfov = 40\nresolution = [16, 12]\n";
const MESH: &str = "[[meshes]]\nfile = \"a.obj\"\nmaterial = \"m\"\n";

fn parse_text(text: &str) -> Result<SceneFile> {
    parse(&toml::from_str(text).unwrap(), Path::new("dir"))
}

/// The material `m` of a scene whose only mesh it is on, and the scene.
fn material(keys: &str) -> (Material, SceneFile) {
    let file =
        parse_text(&format!("{CAMERA}[materials.m]\n{keys}\n{MESH}")).unwrap_or_else(|e| panic!("{keys}: {e:?}"));
    (file.materials[0].1.clone(), file)
}

fn is_refused(text: &str, words: &[&str]) {
    let error = parse_text(&format!("{CAMERA}{text}")).expect_err(text);
    let message = format!("{}: {}", error.key, error.problem);
    for word in words {
        assert!(message.contains(word), "{text}: no `{word}` in {message}");
    }
}

fn material_is_refused(keys: &str, words: &[&str]) {
    is_refused(&format!("[materials.m]\n{keys}\n"), words);
}

#[test]
fn the_examples_of_the_documentation_are_read() {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/docs/scene-format.md");
    let text = std::fs::read_to_string(path).unwrap();
    let examples: Vec<&str> = text
        .split("```toml\n")
        .skip(1)
        .map(|example| &example[..example.find("```").unwrap()])
        .collect();
    assert!(examples.len() > 1);
    for example in examples {
        let whole = if example.contains("[camera]") {
            example.to_owned()
        } else {
            format!("{CAMERA}{example}")
        };
        parse_text(&whole).unwrap_or_else(|e| panic!("{e:?} in\n{example}"));
    }
}

#[test]
fn a_bitmap_has_a_placement_and_the_encoding_of_what_it_is_for() {
    let (m, file) = material(
        "type = \"principled\"\ntexture = \"c.png\"\nto_uv = [[2, 0.5, 1], [0, 3, -1]]\nwrap = [\"clamp\", \"mirror\"]\n\
         filter = \"nearest\"\ntint = [1, 0.5, 0]\nroughness = { texture = \"r.png\", channel = \"g\" }\n\
         metallic = { texture = \"m.png\", encoding = \"srgb\" }\nopacity = { texture = \"o.png\" }\n\
         bump_map = { texture = \"h.exr\", scale = -2 }",
    );
    let Scattering::General(General::Principled(p)) = &m.scattering else {
        panic!("{m:?}");
    };
    let map = TextureMap {
        to_uv: Affine2::from_cols(Vec2::new(2.0, 0.0), Vec2::new(0.5, 3.0), Vec2::new(1.0, -1.0)),
        wrap: [Wrap::Clamp, Wrap::Mirror],
        filter: Filter::Nearest,
        ..TextureMap::new(0)
    };
    assert_eq!(p.base_color, Spectrum::Bitmap(map, Rgb::new(1.0, 0.5, 0.0)));
    let plain = |index| Spectrum::Bitmap(TextureMap::new(index), Rgb::WHITE);
    assert_eq!(p.roughness, Scalar::Varying(plain(1), Channel::G));
    assert_eq!(p.metallic, Scalar::Varying(plain(2), Channel::Mean));
    assert_eq!(p.clearcoat, Scalar::Constant(0.0));
    assert_eq!(m.opacity, Some(plain(3)));
    let relief = Relief::BumpMap {
        map: TextureMap::new(4),
        scale: -2.0,
    };
    assert_eq!(m.relief, Some(relief));
    let wanted: Vec<_> = ["c.png", "r.png", "m.png", "o.png", "h.exr"]
        .iter()
        .map(|file| Path::new("dir").join(file))
        .zip([
            Role::Colour(None),
            Role::Colour(Some(Encoding::Linear)),
            Role::Colour(Some(Encoding::Srgb)),
            Role::Coverage,
            Role::Height(None),
        ])
        .collect();
    assert_eq!(file.bitmaps.wanted, wanted);
}

#[test]
fn only_materials_in_use_are_kept_and_refer_to_each_other_by_their_new_places() {
    let file = parse_text(&format!(
        "{CAMERA}[materials.a]\ntype = \"diffuse\"\ntexture = \"unused.png\"\n\
         [materials.b]\ntype = \"mirror\"\n[materials.c]\ntype = \"dielectric\"\nior = 1.5\n\
         [materials.m]\ntype = \"blend\"\nmaterials = [\"b\", \"d\"]\nweight = 0.25\n\
         [materials.d]\ntype = \"diffuse\"\ntexture = \"d.png\"\nback = \"c\"\n{MESH}"
    ))
    .unwrap();
    let names: Vec<&str> = file.materials.iter().map(|(name, _)| name.as_str()).collect();
    assert_eq!(names, ["m", "b", "d", "c"]);
    let blend = General::Blend {
        weight: Scalar::Constant(0.25),
        materials: [1, 2],
    };
    assert_eq!(file.materials[0].1.scattering, Scattering::General(blend));
    assert_eq!(file.materials[2].1.back, Back::Material(3));
    assert_eq!(file.bitmaps.wanted.len(), 1);
    assert_eq!(file.meshes[0].material, Some(0));
}

#[test]
fn angles_may_be_in_degrees_or_radians() {
    let light = |keys: &str| {
        let text = format!("{CAMERA}[[lights]]\ndirection = [0, -1, 0]\n{keys}\n");
        parse_text(&text).unwrap().lights.remove(0)
    };
    let spot = |keys: &str| {
        light(&format!(
            "type = \"spot\"\nposition = [1, 2, 3]\nintensity = [1, 1, 1]\n{keys}"
        ))
    };
    let expected = |angles| LightDesc::Spot {
        slide: None,
        position: DVec3::new(1.0, 2.0, 3.0),
        direction: DVec3::NEG_Y,
        intensity: Rgb::WHITE,
        angles,
        falloff: Falloff::Angle,
    };
    let degrees = [10f64.to_radians(), 180f64.to_radians()];
    assert_eq!(spot("angles_deg = [10, 180]"), expected(degrees));
    assert_eq!(spot("angles_rad = [0, 0.1]"), expected([0.0, 0.1]));
    assert!(matches!(
        light("type = \"distant\"\nirradiance = [1, 1, 1]\nradius_rad = 0.01"),
        LightDesc::Distant { radius: 0.01, .. }
    ));
}

#[test]
fn a_wrong_light_is_named_with_what_is_right() {
    let spot = "[[lights]]\ntype = \"spot\"\nposition = [1, 2, 3]\nintensity = [1, 1, 1]\n";
    let sun = "[[lights]]\ntype = \"distant\"\ndirection = [0, -1, 0]\n";
    for (text, words) in [
        (
            "[[lights]]\ntype = \"sun\"\n".to_owned(),
            ["lights[0].type", "\"distant\""],
        ),
        (spot.to_owned(), ["lights[0].direction", "missing"]),
        (
            format!("{spot}direction = [0, 0, 0]\n"),
            ["lights[0].direction", "no length"],
        ),
        (
            format!("{spot}direction = [0, 1, 0]\n"),
            ["lights[0].angles_deg", "missing"],
        ),
        (
            format!("{spot}direction = [0, 1, 0]\nangles_deg = [20, 20]\n"),
            ["lights[0].angles_deg", "the second above the first"],
        ),
        (
            format!("{spot}direction = [0, 1, 0]\nangles_rad = [0, 3.2]\n"),
            ["lights[0].angles_rad", "180 degrees"],
        ),
        (
            format!("{spot}direction = [0, 1, 0]\nangles_deg = [1, 2]\nangles_rad = [0, 1]\n"),
            ["lights[0].angles_rad", "beside `angles_deg`"],
        ),
        (
            format!(
                "{spot}direction = [0, 1, 0]\nangles_deg = [1, 90]\nslide = {{ checkerboard = [[0, 0, 0], [1, 1, 1]] }}\n"
            ),
            ["lights[0].slide", "below 90"],
        ),
        (
            format!(
                "{spot}direction = [0, 1, 0]\nangles_deg = [1, 2]\nslide = {{ texture = \"a.png\", v_axis = [1, 0, 0] }}\n"
            ),
            ["lights[0].slide.u_axis", "missing"],
        ),
        (
            format!(
                "{spot}direction = [0, 1, 0]\nangles_deg = [1, 2]\n\
                 slide = {{ rgb = [1, 1, 1], u_axis = [1, 0, 0], v_axis = [0, 0, 1] }}\n"
            ),
            ["lights[0].slide", "needs `texture` or `checkerboard`"],
        ),
        (
            format!("{sun}irradiance = [1, 1, 1]\nradius_deg = 90\n"),
            ["lights[0].radius_deg", "below 90"],
        ),
        (
            format!("{sun}irradiance = [1, 1, -1]\n"),
            ["lights[0].irradiance[2]", "-1 is not within"],
        ),
        (
            format!("{sun}irradiance = [1, 1, 1]\nfalloff = \"angle\"\n"),
            ["lights[0].falloff", "not a known key"],
        ),
        (
            "[environment]\nfile = \"a.exr\"\ntransform = [[1, 0, 0], [0, 2, 0], [0, 0, 1]]\n".to_owned(),
            ["environment.transform", "no rotation"],
        ),
        (
            "[environment]\nfile = \"a.exr\"\ntransform = [[1, 0, 0]]\n".to_owned(),
            ["environment.transform", "3 rows"],
        ),
    ] {
        is_refused(&text, &words);
    }
    parse_text(&format!(
        "{CAMERA}[environment]\nfile = \"a.exr\"\ntransform = [[0, 1, 0], [1, 0, 0], [0, 0, 1]]\n"
    ))
    .unwrap();
}

#[test]
fn a_wrong_material_is_named_with_what_is_right() {
    for (keys, words) in [
        (
            "type = \"rough-conductr\"",
            ["materials.m.type", "did you mean \"rough-conductor\"?"],
        ),
        (
            "type = \"rough-conductor\"\neta = [0, 1, 1]\nk = [0, 1, 1]",
            ["materials.m.eta", "without absorption"],
        ),
        (
            "type = \"principled\"\nrgb = [1, 1, 1]\nior = 1",
            ["materials.m.ior", "above 1"],
        ),
        (
            "type = \"principled\"\nrgb = [1, 1, 1]\nroughness = 1.5",
            ["materials.m.roughness", "1.5 is not within 0 to 1"],
        ),
        (
            "type = \"principled\"\nrgb = [1, 1, 1]\nroughness = \"r.png\"",
            ["materials.m.roughness", "found a string"],
        ),
        (
            "type = \"principled\"\nrgb = [1, 1, 1]\nroughness = { channel = \"r\" }",
            ["materials.m.roughness", "has neither `rgb`, `texture`"],
        ),
        (
            "type = \"principled\"\nrgb = [1, 1, 1]\nroughness = { texture = \"a.png\", chanel = \"r\" }",
            ["materials.m.roughness.chanel", "did you mean `channel`?"],
        ),
        (
            "type = \"principled\"\nrgb = [1, 1, 1]\nrougness = 0.1",
            ["materials.m.rougness", "did you mean `roughness`?"],
        ),
        (
            "type = \"rough-dielectric\"\nalpha = [0.1, 0.2, 0.3]",
            ["materials.m.alpha", "one width, or two"],
        ),
        (
            "type = \"diffuse\"\nrgb = [1, 1, 1]\ncheckerboard = [[0, 0, 0], [1, 1, 1]]",
            ["materials.m.rgb", "beside `checkerboard`"],
        ),
        (
            "type = \"diffuse\"\ntexture = \"a.png\"\ncheckerboard = [[0, 0, 0], [1, 1, 1]]",
            ["materials.m.checkerboard", "beside `texture`"],
        ),
        (
            "type = \"diffuse\"\ncheckerboard = [[0, 0, 0]]",
            ["materials.m.checkerboard", "two colours"],
        ),
        (
            "type = \"diffuse\"\nrgb = [1, 1, 1]\ntint = [1, 1, 1]",
            ["materials.m.tint", "`texture`"],
        ),
        (
            "type = \"diffuse\"\nrgb = [1, 1, 1]\nwrap = \"clamp\"",
            ["materials.m.wrap", "`texture`"],
        ),
        (
            "type = \"diffuse\"\nrgb = [1, 1, 1]\nto_uv = [[1, 0, 0], [0, 1, 0]]",
            ["materials.m.to_uv", "`checkerboard`"],
        ),
        (
            "type = \"diffuse\"\nvertex_colors = 1",
            ["materials.m.vertex_colors", "true or false"],
        ),
        (
            "type = \"diffuse\"\ntexture = \"a.png\"\nwrap = [\"clamp\"]",
            ["materials.m.wrap", "one word, or two"],
        ),
        (
            "type = \"diffuse\"\ntexture = \"a.png\"\nto_uv = [[1, 0], [0, 1]]",
            ["materials.m.to_uv[0]", "3 numbers"],
        ),
        (
            "type = \"diffuse\"\nrgb = [1, 1, 1]\nnormal_map = { scale = 1 }",
            ["materials.m.normal_map.texture", "missing"],
        ),
        (
            "type = \"mirror\"\nnormal_map = { texture = \"a.png\" }\nbump_map = { texture = \"a.png\" }",
            ["materials.m.bump_map", "beside `normal_map`"],
        ),
        (
            "type = \"mirror\"\nback = \"n\"",
            ["materials.m.back", "there is no material \"n\""],
        ),
        (
            "type = \"blend\"\nmaterials = [\"m\"]\nweight = 0.5",
            ["materials.m.materials", "names of two"],
        ),
        (
            "type = \"mirror\"\nback = \"m\"",
            ["materials.m", "refers to itself: m -> m"],
        ),
        (
            "type = \"blend\"\nmaterials = [\"n\", \"n\"]\nweight = 0.5\n[materials.n]\ntype = \"mirror\"\nback = \"m\"",
            ["materials.m", "m -> n -> m"],
        ),
        (
            "type = \"principled\"\nrgb = [1, 1, 1]\nclearcoat_gloss = 1",
            ["materials.m.clearcoat_gloss", "give `clearcoat_roughness`"],
        ),
        (
            "type = \"principled\"\nrgb = [1, 1, 1]\nconserves = false\nclearcoat_roughness = 1",
            ["materials.m.clearcoat_roughness", "give `clearcoat_gloss`"],
        ),
        (
            "type = \"principled\"\nrgb = [1, 1, 1]\nthin = true",
            ["materials.m.thin", "give `spec_trans`"],
        ),
        (
            "type = \"mirror\"\nback = \"n\"\n[materials.n]\ntype = \"mirror\"\nopacity = { rgb = [0.5, 0.5, 0.5] }",
            ["materials.m", "refers to \"n\", which has `opacity`"],
        ),
    ] {
        material_is_refused(keys, &words);
    }
}

#[test]
fn materials_may_nest_to_a_limit() {
    let chain = |levels: usize| {
        let mut text = CAMERA.to_owned();
        for i in 0..levels {
            text += &format!("[materials.m{i}]\ntype = \"mirror\"\n");
            if i + 1 < levels {
                text += &format!("back = \"m{}\"\n", i + 1);
            }
        }
        parse_text(&text)
    };
    assert!(chain(crate::material::MAX_NESTING).is_ok());
    for levels in [crate::material::MAX_NESTING + 1, 5000] {
        let error = chain(levels).unwrap_err();
        assert!(error.problem.contains("more than 32"), "{error:?}");
    }
    // Many ways through few materials take no time.
    let mut text = CAMERA.to_owned();
    for i in 0..30 {
        text += &format!(
            "[materials.m{i}]\ntype = \"blend\"\nweight = 0.5\nmaterials = [\"m{next}\", \"m{next}\"]\nback = \"m{next}\"\n",
            next = i + 1
        );
    }
    text += "[materials.m30]\ntype = \"mirror\"\n";
    parse_text(&text).unwrap();
}

#[test]
fn emission_may_vary_but_has_one_constant() {
    let lamp = |keys: &str| {
        format!("{CAMERA}[materials.m]\ntype = \"mirror\"\n{MESH}emission = {{ radiance = [3, 2, 1]{keys} }}\n")
    };
    let file = parse_text(&lamp(", texture = \"glow.exr\", tint = [7, 7, 7]")).unwrap();
    let (emission, map) = file.meshes[0].emission.unwrap();
    assert_eq!(emission.radiance, Rgb::new(3.0, 2.0, 1.0));
    assert_eq!(map, Some(Spectrum::Bitmap(TextureMap::new(0), Rgb::splat(7.0))));
    assert_eq!(file.bitmaps.wanted[0].1, Role::Radiance(None));
    assert_eq!(parse_text(&lamp("")).unwrap().meshes[0].emission.unwrap().1, None);
    let error = parse_text(&lamp(", rgb = [1, 1, 1]")).unwrap_err();
    assert_eq!(error.key, "meshes[0].emission.rgb");
    let error = parse_text(&lamp(", tint = [1, 1, 1]")).unwrap_err();
    assert_eq!(error.key, "meshes[0].emission.tint");
}
