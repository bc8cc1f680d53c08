//! `embrace info`

use super::{Failure, InfoArgs, print, with_backend};
use crate::accel::{Accel, BuildOptions};
use crate::integrator::{KernelChoice, kernel_for};
use crate::light::Environment;
use crate::scene::{self, LoadOptions, Scene, SceneOptions};
use serde::Serialize;

#[derive(Serialize)]
struct Info {
    scene: String,
    scene_hash: String,
    width: u32,
    height: u32,
    max_depth: Option<u32>,
    meshes: usize,
    placements: usize,
    instances: usize,
    triangles: u64,
    /// Smallest and largest corner of the box around all geometry, in the scene's coordinates.
    bounds: Option<[[f64; 3]; 2]>,
    /// The point of the scene that rendering takes as its origin.
    origin: [f64; 3],
    materials: Vec<String>,
    textures: usize,
    environment: Option<String>,
    lights: usize,
    requires: Vec<&'static str>,
    kernel: String,
    backend: String,
    memory_bytes: serde_json::Map<String, serde_json::Value>,
    warnings: Vec<String>,
}

pub(super) fn run(args: &InfoArgs) -> Result<(), Failure> {
    with_backend!(args.backend, run_on(args))
}

fn run_on<A: Accel>(args: &InfoArgs) -> Result<(), Failure> {
    let options = LoadOptions {
        smooth_angle: args.smooth.smooth_angle,
        ..LoadOptions::default()
    };
    let mut desc = scene::load(&args.scene, options).map_err(Failure::input)?;
    let warnings = std::mem::take(&mut desc.warnings);
    let materials = desc.materials.iter().map(|(name, _)| name.clone()).collect();
    let scene = Scene::build(desc, SceneOptions::default())
        .map_err(|e| Failure::input(format!("{}: {e}", args.scene.display())))?;
    let accel = A::build(&scene.geometry, BuildOptions::default()).map_err(Failure::internal)?;
    let [width, height] = scene.camera.resolution();
    let memory = scene
        .memory_by_part()
        .into_iter()
        .chain([("acceleration", accel.memory_bytes())]);
    let info = Info {
        scene: args.scene.display().to_string(),
        scene_hash: scene.hash.clone(),
        width,
        height,
        max_depth: scene.max_depth,
        meshes: scene.geometry.meshes.len(),
        placements: scene.geometry.placements.len(),
        instances: scene.instances(),
        triangles: scene.triangles(),
        bounds: scene
            .geometry
            .bounds()
            .map(|(lo, hi)| [lo, hi].map(|p| (p.as_dvec3() + scene.origin).to_array())),
        origin: scene.origin.to_array(),
        materials,
        textures: scene.textures.len(),
        environment: scene.lights.environment().map(describe_environment),
        lights: scene.lights.len(),
        requires: scene.features.names(),
        kernel: kernel_for(&scene, KernelChoice::Auto).features.to_string(),
        backend: format!("{} {}", A::NAME, A::version()),
        memory_bytes: memory.map(|(part, bytes)| (part.to_owned(), bytes.into())).collect(),
        warnings,
    };
    if args.json {
        print(&(serde_json::to_string_pretty(&info).map_err(Failure::internal)? + "\n"))
    } else {
        print(&table(&info))
    }
}

fn describe_environment(environment: &Environment) -> String {
    match environment {
        Environment::Constant(radiance) => format!("constant {:?}", radiance.to_array()),
        Environment::Map(map) => {
            let [width, height] = map.resolution();
            format!("map of {width} x {height}")
        }
    }
}

fn table(info: &Info) -> String {
    let mut table = String::new();
    let mut row = |name: &str, value: String| table += &format!("{name:<14}{value}\n");
    let list = |names: &[&str]| {
        if names.is_empty() {
            "nothing special".to_owned()
        } else {
            names.join(", ")
        }
    };
    row("scene", info.scene.clone());
    row("hash", info.scene_hash.clone());
    row("image", format!("{} x {}", info.width, info.height));
    row("max depth", info.max_depth.map_or("none".into(), |d| d.to_string()));
    row(
        "geometry",
        format!(
            "{} triangles in {} placements of {} meshes, {} of them instances",
            info.triangles, info.placements, info.meshes, info.instances
        ),
    );
    if let Some([lo, hi]) = info.bounds {
        row("bounds", format!("{lo:?} to {hi:?}"));
    }
    if info.origin != [0.0; 3] {
        row("origin", format!("moved to {:?} for rendering", info.origin));
    }
    row("materials", info.materials.join(", "));
    row("textures", info.textures.to_string());
    row("environment", info.environment.clone().unwrap_or("none".into()));
    row("lights", info.lights.to_string());
    row("requires", list(&info.requires));
    row("kernel", info.kernel.clone());
    row("backend", info.backend.clone());
    for (part, bytes) in &info.memory_bytes {
        let mebibytes = bytes.as_u64().unwrap_or(0) as f64 / f64::from(1 << 20);
        row("memory", format!("{mebibytes:>10.2} MiB  {part}"));
    }
    for warning in &info.warnings {
        row("warning", warning.clone());
    }
    table
}
