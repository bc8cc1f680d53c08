//! `embrace info`

use super::{Failure, InfoArgs, print, with_backend};
use crate::accel::{Accel, BuildOptions};
use crate::integrator::{KernelChoice, kernel_for};
use crate::light::Environment;
use crate::material::{Back, General, Material, Relief, Scattering};
use crate::scene::{self, LightDesc, ObjectDesc, Scene, SceneDesc, SceneOptions};
use crate::texture::{Encoding, Texture};
use serde::Serialize;
use std::path::Path;

#[derive(Serialize)]
struct Info {
    scene: String,
    format: &'static str,
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
    /// The same in the same order, with more of each.
    material_details: Vec<MaterialInfo>,
    textures: usize,
    texture_details: Vec<TextureInfo>,
    environment: Option<String>,
    lights: usize,
    lights_by_kind: LightsInfo,
    requires: Vec<&'static str>,
    kernel: String,
    backend: String,
    memory_bytes: serde_json::Map<String, serde_json::Value>,
    warnings: Vec<String>,
}

#[derive(Serialize)]
struct MaterialInfo {
    name: String,
    /// As in scene files.
    #[serde(rename = "type")]
    kind: &'static str,
    /// Indices of its bitmaps.
    textures: Vec<u32>,
    /// Names of the materials that it mixes.
    blended: Vec<String>,
    /// What else is not plain about it.
    with: Vec<String>,
}

#[derive(Serialize)]
struct TextureInfo {
    width: u32,
    height: u32,
    texels: &'static str,
}

/// How many there are.
#[derive(Default, Serialize)]
struct LightsInfo {
    emitting_triangles: u64,
    point: u64,
    spot: u64,
    distant: u64,
    environment: u64,
}

pub(super) fn run(args: &InfoArgs) -> Result<(), Failure> {
    with_backend!(args.backend, run_on(args))
}

fn run_on<A: Accel>(args: &InfoArgs) -> Result<(), Failure> {
    let mut desc = scene::load(&args.scene, args.load.options(false)).map_err(Failure::input)?;
    let warnings = std::mem::take(&mut desc.warnings);
    let materials = desc.materials.iter().map(|(name, _)| name.clone()).collect();
    let material_details = desc
        .materials
        .iter()
        .map(|(name, m)| describe_material(name, m, &desc))
        .collect();
    let texture_details = desc.textures.iter().map(describe_texture).collect();
    let lights_by_kind = count_lights(&desc);
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
        format: format_of(&args.scene),
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
        material_details,
        textures: scene.textures.len(),
        texture_details,
        environment: scene.lights.environment().map(describe_environment),
        lights: scene.lights.len(),
        lights_by_kind,
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

/// The format of a scene that has been read, which is told by its name.
fn format_of(path: &Path) -> &'static str {
    let extension = path.extension().and_then(|e| e.to_str()).unwrap_or("");
    match extension.to_ascii_lowercase().as_str() {
        "toml" => "scene file (TOML)",
        "json" => "scene file (JSON)",
        "obj" => "Wavefront OBJ",
        "ply" => "PLY",
        "gltf" => "glTF 2.0",
        "glb" => "glTF 2.0 (binary)",
        "xml" => "Mitsuba 3 XML",
        _ => "unknown",
    }
}

fn describe_material(name: &str, material: &Material, desc: &SceneDesc) -> MaterialInfo {
    let mut textures: Vec<u32> = material.textures().collect();
    textures.sort_unstable();
    textures.dedup();
    let name_of = |index: u32| desc.materials[index as usize].0.clone();
    let mut with = Vec::new();
    with.extend(material.opacity.map(|_| "opacity".to_owned()));
    with.extend(material.relief.map(|relief| match relief {
        Relief::NormalMap { .. } => "normal map".to_owned(),
        Relief::BumpMap { .. } => "bump map".to_owned(),
    }));
    with.extend(match material.back {
        Back::Same => None,
        Back::Black => Some("black back".to_owned()),
        Back::Material(other) => Some(format!("back of {}", name_of(other))),
    });
    let blended = match &material.scattering {
        Scattering::General(General::Blend { materials, .. }) => materials.map(name_of).into(),
        _ => Vec::new(),
    };
    MaterialInfo {
        name: name.to_owned(),
        kind: scene::material_type(material),
        textures,
        blended,
        with,
    }
}

fn describe_texture(texture: &Texture) -> TextureInfo {
    let (width, height) = texture.size();
    TextureInfo {
        width,
        height,
        texels: match texture {
            Texture::Rgb8(_, Encoding::Srgb) => "8-bit sRGB",
            Texture::Rgb8(_, Encoding::Linear) => "8-bit linear",
            Texture::Rgb32(_) => "32-bit float",
        },
    }
}

fn count_lights(desc: &SceneDesc) -> LightsInfo {
    let mut lights = LightsInfo {
        environment: desc.environment.is_some().into(),
        ..LightsInfo::default()
    };
    for light in &desc.lights {
        *match light {
            LightDesc::Point { .. } => &mut lights.point,
            LightDesc::Spot { .. } => &mut lights.spot,
            LightDesc::Distant { .. } => &mut lights.distant,
        } += 1;
    }
    let emits = |object: &&ObjectDesc| object.emission.is_some_and(|e| !e.radiance.is_black());
    for object in desc.objects.iter().filter(emits) {
        lights.emitting_triangles += desc.meshes[object.mesh].indices.len() as u64;
    }
    lights
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
    row("format", info.format.into());
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
    row("materials", info.materials.len().to_string());
    for material in &info.material_details {
        row("", material_line(material));
    }
    row("textures", info.textures.to_string());
    for (i, texture) in info.texture_details.iter().enumerate() {
        row(
            "",
            format!("{i}: {} x {}, {}", texture.width, texture.height, texture.texels),
        );
    }
    row("environment", info.environment.clone().unwrap_or("none".into()));
    row("lights", lights_line(&info.lights_by_kind));
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

fn material_line(material: &MaterialInfo) -> String {
    let mut line = format!("{}: {}", material.name, material.kind);
    if !material.blended.is_empty() {
        line += &format!(" of {}", material.blended.join(" and "));
    }
    for what in &material.with {
        line += &format!(", {what}");
    }
    for texture in &material.textures {
        line += &format!(", texture {texture}");
    }
    line
}

fn lights_line(lights: &LightsInfo) -> String {
    let kinds = [
        (lights.emitting_triangles, "emitting triangles"),
        (lights.point, "point"),
        (lights.spot, "spot"),
        (lights.distant, "distant"),
        (lights.environment, "environment"),
    ];
    let there: Vec<String> = kinds
        .iter()
        .filter(|(count, _)| *count > 0)
        .map(|(count, kind)| format!("{count} {kind}"))
        .collect();
    if there.is_empty() {
        "none".into()
    } else {
        there.join(", ")
    }
}
