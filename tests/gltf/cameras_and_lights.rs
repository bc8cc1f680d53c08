//! Views and lights.

use super::file::*;
use super::support::program::Folder;
use embrace::camera::CameraDesc;
use embrace::math::{DVec3, Rgb};
use embrace::scene::{EnvironmentDesc, Falloff, LightDesc};
use serde_json::{Value, json};

/// A square, and two cameras: the second looks along +x from the left.
fn two_cameras() -> File {
    let mut file = File::square(None);
    let perspective = json!({ "yfov": 0.5, "znear": 0.1 });
    file.json["cameras"] = json!([
        { "type": "perspective", "name": "wide", "perspective": { "yfov": 1.0, "znear": 0.1, "aspectRatio": 2.0 } },
        { "type": "perspective", "perspective": perspective },
        { "type": "orthographic", "name": "plan", "orthographic": { "xmag": 1, "ymag": 1, "znear": 0, "zfar": 9 } },
    ]);
    let turned = [0.0, -(0.5f64.sqrt()), 0.0, 0.5f64.sqrt()];
    file.add("nodes", json!({ "camera": 0, "translation": [1, 2, 3] }));
    file.add(
        "nodes",
        json!({ "name": "left", "camera": 1, "translation": [-4, 0, 0], "rotation": turned }),
    );
    file.add("nodes", json!({ "camera": 2 }));
    file
}

fn camera(file: &File, name: Option<&str>) -> CameraDesc {
    let files = [("scene.gltf", &file.text()[..])];
    in_folder(&files, "scene.gltf", name)
        .unwrap_or_else(|e| panic!("{e}"))
        .camera
}

#[test]
fn a_camera_looks_along_its_minus_z_and_has_its_own_shape() {
    let first = camera(&two_cameras(), None);
    assert_eq!(first.position, DVec3::new(1.0, 2.0, 3.0));
    assert_eq!((first.look_at - first.position).normalize(), -DVec3::Z);
    assert_eq!(first.up, DVec3::Y);
    assert!((first.vfov_degrees - 1f64.to_degrees()).abs() < 1e-6);
    assert_eq!((first.resolution, first.mirrored), ([1200, 600], false));
    let second = camera(&two_cameras(), Some("left"));
    assert!(((second.look_at - second.position).normalize() - DVec3::X).length() < 1e-12);
    assert_eq!(second.resolution, [800, 600]);
    // A node that mirrors mirrors the image.
    let mut mirrored = two_cameras();
    mirrored.json["nodes"][1]["scale"] = json!([-1, 1, 1]);
    assert!(camera(&mirrored, Some("wide")).mirrored);
}

#[test]
fn cameras_are_chosen_by_their_names_or_those_of_their_nodes() {
    let file = two_cameras();
    assert_eq!(camera(&file, Some("wide")), camera(&file, None));
    assert!(
        file.load()
            .warnings
            .iter()
            .any(|w| w.contains("has 3 cameras; cameras[0] (wide) is used"))
    );
    let text = file.text();
    let error = |name: &str| {
        let files = [("scene.gltf", &text[..])];
        in_folder(&files, "scene.gltf", Some(name))
            .expect_err("no camera")
            .to_string()
    };
    assert!(
        error("right").contains("--camera: no camera is called \"right\"; there are wide, left, plan"),
        "{}",
        error("right")
    );
    assert!(
        error("plan").contains("cameras[2] (plan): is orthographic, which is not supported"),
        "{}",
        error("plan")
    );
    let none = File::square(None).text();
    let error = in_folder(&[("scene.gltf", &none)], "scene.gltf", Some("x")).expect_err("no camera");
    assert!(
        error.to_string().contains("the scene has no camera with a name"),
        "{error}"
    );
}

#[test]
fn the_program_takes_the_name_of_a_camera() {
    let folder = Folder::with_scene();
    folder.write("cameras.gltf", two_cameras().text());
    let size = |name: &str| {
        let ran = folder.done(&format!("info cameras.gltf --json --camera {name}"));
        let info: Value = serde_json::from_str(&ran.stdout).expect("JSON");
        info["width"].as_u64()
    };
    assert_eq!((size("wide"), size("left")), (Some(1200), Some(800)));
    folder.refused(
        "info cameras.gltf --camera up",
        3,
        &["cameras.gltf", "--camera", "wide, left, plan"],
    );
    folder.refused("render scene.toml -o a.png --camera up", 3, &["--camera", "glTF"]);
}

#[test]
fn without_camera_and_light_the_scene_is_framed_and_lit_and_said_so() {
    let desc = File::square(None).load();
    assert!(matches!(desc.environment, Some(EnvironmentDesc::Constant(Rgb::WHITE))));
    assert_eq!((desc.camera.look_at, desc.camera.resolution), (DVec3::ZERO, [800, 600]));
    let [light, camera] = &desc.warnings[..] else {
        panic!("{:?}", desc.warnings);
    };
    assert!(light.contains("scene.gltf: has no light") && camera.contains("scene.gltf: has no camera"));
}

/// Lights, each in a node that puts it at (1, 0, 0) and turns its -z to -y.
fn lit(lights: &Value) -> File {
    let mut file = File::square(None);
    for light in 0..lights.as_array().expect("lights").len() {
        file.add(
            "nodes",
            json!({
                "translation": [1, 0, 0],
                "rotation": [-(0.5f64.sqrt()), 0, 0, 0.5f64.sqrt()],
                // Of no effect on lights.
                "scale": [3, 3, 3],
                "extensions": { "KHR_lights_punctual": { "light": light } },
            }),
        );
    }
    file.json["extensions"] = json!({ "KHR_lights_punctual": { "lights": lights } });
    file
}

#[test]
fn lights_are_in_watts_of_683_lumens() {
    let file = lit(&json!([
        { "type": "point", "color": [1, 0.5, 0], "intensity": 683 },
        { "type": "directional", "intensity": 1366 },
        { "type": "spot", "intensity": 683, "spot": { "innerConeAngle": 0.25, "outerConeAngle": 0.5 } },
    ]));
    let desc = file.load();
    assert!(desc.environment.is_none());
    let [point, sun, spot] = &desc.lights[..] else {
        panic!("{:?}", desc.lights);
    };
    let expected = LightDesc::Point {
        position: DVec3::X,
        intensity: Rgb::new(1.0, 0.5, 0.0),
    };
    assert_eq!(*point, expected);
    let down = |d: DVec3| assert!((d + DVec3::Y).length() < 1e-12, "{d}");
    match *sun {
        LightDesc::Distant {
            direction,
            irradiance,
            radius,
        } => {
            down(direction);
            assert_eq!((irradiance, radius), (Rgb::splat(2.0), 0.0));
        }
        ref other => panic!("{other:?}"),
    }
    match *spot {
        LightDesc::Spot {
            position,
            direction,
            intensity,
            angles,
            falloff,
            slide: None,
        } => {
            down(direction);
            assert_eq!((position, intensity), (DVec3::X, Rgb::WHITE));
            assert_eq!((angles, falloff), ([0.25, 0.5], Falloff::Cosine));
        }
        ref other => panic!("{other:?}"),
    }
}

#[test]
fn lights_that_cannot_be_are_errors_and_ranges_are_ignored() {
    let spot = |inner: f64, outer: f64| {
        lit(&json!([{ "type": "spot", "spot": { "innerConeAngle": inner, "outerConeAngle": outer } }]))
    };
    // Half a turn, rounded up in 32 bits.
    assert_eq!(spot(0.0, 1.570_796_37).load().lights.len(), 1);
    for (inner, outer) in [(0.5, 0.5), (-0.1, 0.5), (0.0, 2.0)] {
        let error = spot(inner, outer).error();
        assert!(error.contains("lights[0].spot: the cone"), "{error}");
    }
    let error = lit(&json!([{ "type": "point", "intensity": -1 }])).error();
    assert!(
        error.contains("lights[0]: color times intensity is negative"),
        "{error}"
    );
    // A light that is off does not count as one.
    let off = lit(&json!([{ "type": "point", "intensity": 0 }])).load();
    assert!(off.lights.is_empty() && off.environment.is_some());
    let near = lit(&json!([{ "type": "point", "range": 3 }]));
    assert!(near.warning().contains("the range is ignored"));
}
