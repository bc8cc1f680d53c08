//! Writes every generated asset of the scenes in this repository: meshes, textures and sky maps.
//!
//! ```text
//! cargo run --release --example make_scenes -- scenes
//! ```
//!
//! The output depends on nothing but this file: running it again gives the same bytes. The scene files
//! (`scenes/NAME/NAME.toml`) are written by hand and place what is made here.

use std::collections::HashMap;
use std::error::Error;
use std::f64::consts::{FRAC_PI_2, PI, TAU};
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::{env, fs};

use embrace::math::srgb_encode;
use exr::prelude::WritableImage;
use glam::{DQuat, DVec2, DVec3, dvec2, dvec3};

type Outcome = Result<(), Box<dyn Error>>;

fn main() -> Outcome {
    let mut arguments = env::args_os().skip(1);
    let (Some(root), None) = (arguments.next(), arguments.next()) else {
        return Err("usage: make_scenes DIRECTORY (the repository's `scenes`)".into());
    };
    let root = PathBuf::from(root);
    shared_assets(&root.join("assets"))?;
    spheres_assets(&root.join("spheres"))?;
    cornell_assets(&root.join("cornell"))?;
    veach_mis_assets(&root.join("veach-mis"))?;
    glass_assets(&root.join("glass"))?;
    furnace_assets(&root.join("furnace"))?;
    many_lights_assets(&root.join("many-lights"))
}

/// Meshes that several scenes place: a sphere to look at, a coarser one for lamps, a box and a square.
fn shared_assets(dir: &Path) -> Outcome {
    icosphere(5).write(&dir.join("sphere.obj"))?;
    icosphere(3).write(&dir.join("sphere-lamp.obj"))?;
    cuboid(dvec3(-0.5, 0.0, -0.5), dvec3(0.5, 1.0, 0.5)).write(&dir.join("box.obj"))?;
    let mut square = Mesh::default();
    square.polygon(&[
        dvec3(-0.5, 0.0, 0.5),
        dvec3(0.5, 0.0, 0.5),
        dvec3(0.5, 0.0, -0.5),
        dvec3(-0.5, 0.0, -0.5),
    ]);
    square.write(&dir.join("square.obj"))
}

/// The ground and its paving, and the clear sky whose sun is a few texels.
fn spheres_assets(dir: &Path) -> Outcome {
    ground(300.0, 4.0).write(&dir.join("ground.obj"))?;
    paving(512).write(&dir.join("paving.png"))?;
    Sky {
        width: 1024,
        height: 512,
        sun_elevation: 36f64.to_radians(),
        sun_azimuth: 122f64.to_radians(),
        sun_irradiance: 5.2,
        haze: 0.05,
        sun_radius: Some(0.2666f64.to_radians()),
        ground: [0.20, 0.19, 0.17],
    }
    .render("spheres/sky.exr")
    .write(&dir.join("sky.exr"))
}

/// The Cornell box as published (Cornell University Program of Computer Graphics, "The Cornell Box", physical model
/// of 1998): vertices in millimetres, in the published order, which faces every polygon into the room.
fn cornell_assets(dir: &Path) -> Outcome {
    let polygons = |list: &[[[f64; 3]; 4]]| {
        let mut mesh = Mesh::default();
        for corners in list {
            mesh.polygon(&corners.map(DVec3::from_array));
        }
        mesh
    };
    #[rustfmt::skip]
    let floor = [[552.8, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 559.2], [549.6, 0.0, 559.2]];
    #[rustfmt::skip]
    let ceiling = [[556.0, 548.8, 0.0], [556.0, 548.8, 559.2], [0.0, 548.8, 559.2], [0.0, 548.8, 0.0]];
    #[rustfmt::skip]
    let lamp = [[343.0, 548.8, 227.0], [343.0, 548.8, 332.0], [213.0, 548.8, 332.0], [213.0, 548.8, 227.0]];
    #[rustfmt::skip]
    let back = [[549.6, 0.0, 559.2], [0.0, 0.0, 559.2], [0.0, 548.8, 559.2], [556.0, 548.8, 559.2]];
    #[rustfmt::skip]
    let right = [[0.0, 0.0, 559.2], [0.0, 0.0, 0.0], [0.0, 548.8, 0.0], [0.0, 548.8, 559.2]];
    #[rustfmt::skip]
    let left = [[552.8, 0.0, 0.0], [549.6, 0.0, 559.2], [556.0, 548.8, 559.2], [556.0, 548.8, 0.0]];
    #[rustfmt::skip]
    let short_block = [
        [[130.0, 165.0, 65.0], [82.0, 165.0, 225.0], [240.0, 165.0, 272.0], [290.0, 165.0, 114.0]],
        [[290.0, 0.0, 114.0], [290.0, 165.0, 114.0], [240.0, 165.0, 272.0], [240.0, 0.0, 272.0]],
        [[130.0, 0.0, 65.0], [130.0, 165.0, 65.0], [290.0, 165.0, 114.0], [290.0, 0.0, 114.0]],
        [[82.0, 0.0, 225.0], [82.0, 165.0, 225.0], [130.0, 165.0, 65.0], [130.0, 0.0, 65.0]],
        [[240.0, 0.0, 272.0], [240.0, 165.0, 272.0], [82.0, 165.0, 225.0], [82.0, 0.0, 225.0]],
    ];
    #[rustfmt::skip]
    let tall_block = [
        [[423.0, 330.0, 247.0], [265.0, 330.0, 296.0], [314.0, 330.0, 456.0], [472.0, 330.0, 406.0]],
        [[423.0, 0.0, 247.0], [423.0, 330.0, 247.0], [472.0, 330.0, 406.0], [472.0, 0.0, 406.0]],
        [[472.0, 0.0, 406.0], [472.0, 330.0, 406.0], [314.0, 330.0, 456.0], [314.0, 0.0, 456.0]],
        [[314.0, 0.0, 456.0], [314.0, 330.0, 456.0], [265.0, 330.0, 296.0], [265.0, 0.0, 296.0]],
        [[265.0, 0.0, 296.0], [265.0, 330.0, 296.0], [423.0, 330.0, 247.0], [423.0, 0.0, 247.0]],
    ];
    // The published ceiling has a hole that the lamp fills: a ring of four quads between the two outlines.
    let ring: Vec<[[f64; 3]; 4]> = (0..4)
        .map(|i| [ceiling[i], ceiling[(i + 1) % 4], lamp[(i + 1) % 4], lamp[i]])
        .collect();
    polygons(&[&[floor, back], &ring[..]].concat()).write(&dir.join("white-walls.obj"))?;
    polygons(&[right]).write(&dir.join("green-wall.obj"))?;
    polygons(&[left]).write(&dir.join("red-wall.obj"))?;
    polygons(&[short_block, tall_block].concat()).write(&dir.join("blocks.obj"))?;
    polygons(&[lamp]).write(&dir.join("lamp.obj"))
}

/// Four plates, each turned so that its centre line mirrors the row of lamps into the camera, before a floor that
/// bends up into a wall.
fn veach_mis_assets(dir: &Path) -> Outcome {
    // As in veach-mis.toml.
    let camera = dvec2(2.6, 12.0);
    let lamps = dvec2(3.3, -2.2);
    let (half_width, half_depth, thickness) = (3.4, 0.42, 0.05);
    let centres = [
        dvec2(1.88, -1.35),
        dvec2(1.36, -0.35),
        dvec2(0.86, 0.75),
        dvec2(0.40, 1.95),
    ];
    for (i, centre) in centres.into_iter().enumerate() {
        // In the plane x = 0, as (y, z).
        let normal = ((camera - centre).normalize() + (lamps - centre).normalize()).normalize();
        let angle = f64::atan2(normal.y, normal.x);
        let mut plate = cuboid(
            dvec3(-half_width, -thickness, -half_depth),
            dvec3(half_width, 0.0, half_depth),
        );
        for p in &mut plate.positions {
            *p = DQuat::from_rotation_x(angle) * *p + dvec3(0.0, centre.x, centre.y);
        }
        plate.write(&dir.join(format!("plate-{}.obj", i + 1)))?;
    }
    backdrop(dvec2(14.0, 14.0), -5.0, 2.0, 12.0).write(&dir.join("backdrop.obj"))
}

/// A rounded block for frosted glass, a cut gem resting on a facet, the patterned floor and a sky after sunset.
fn glass_assets(dir: &Path) -> Outcome {
    rounded_block(0.22, 10).write(&dir.join("rounded-block.obj"))?;
    gem().write(&dir.join("gem.obj"))?;
    ground(80.0, 2.0).write(&dir.join("floor.obj"))?;
    marquetry(512).write(&dir.join("floor.png"))?;
    Sky {
        width: 256,
        height: 128,
        sun_elevation: 9f64.to_radians(),
        sun_azimuth: 42f64.to_radians(),
        sun_irradiance: 6.5,
        haze: 0.05,
        sun_radius: None,
        ground: [0.30, 0.26, 0.24],
    }
    .render("glass/dusk.exr")
    .write(&dir.join("dusk.exr"))
}

/// A closed box seen from inside: every normal points in.
fn furnace_assets(dir: &Path) -> Outcome {
    let mut room = cuboid(dvec3(-1.0, -1.0, -1.0), dvec3(1.0, 1.0, 1.0));
    room.flip();
    room.write(&dir.join("room.obj"))
}

/// A room at night: a tree of stacked cones, its lights, garlands under the ceiling and a carpet of candles.
///
/// One thousand tetrahedra in ten files of a hundred. Their edges differ within a file and their radiance between
/// the files, so that the power of a lamp spans more than three decades.
fn many_lights_assets(dir: &Path) -> Outcome {
    const LAMPS: usize = 1000;
    const FILES: usize = 10;
    let mut room = cuboid(dvec3(-5.0, 0.0, -4.0), dvec3(5.0, 4.2, 9.0));
    room.flip();
    // The floor has a mesh, and so a material, of its own.
    room.triangles.retain(|t| t.iter().any(|&i| room.positions[i].y > 0.0));
    room.write(&dir.join("walls.obj"))?;
    ground(13.0, 2.5).write(&dir.join("floor.obj"))?;
    planks(512).write(&dir.join("planks.png"))?;
    tree(&TIERS).write(&dir.join("tree.obj"))?;

    let mut random = Random::new(1);
    let mut places = Vec::with_capacity(LAMPS);
    places.extend(tree_lights(400, &mut random));
    places.extend(garlands(12, 40, &mut random));
    places.extend(candles(LAMPS - places.len(), &mut random));
    // Deal the lamps to the files at random, so that every part of the room has all strengths and colours.
    for i in (1..places.len()).rev() {
        places.swap(i, (random.unit() * (i + 1) as f64) as usize);
    }
    for (i, lamps) in places.chunks(LAMPS / FILES).enumerate() {
        let mut mesh = Mesh::default();
        for &centre in lamps {
            let edge = 0.022 * 2.5f64.powf(random.unit());
            mesh.append(&tetrahedron(centre, edge, &mut random));
        }
        mesh.write(&dir.join(format!("lamps-{i}.obj")))?;
    }
    Ok(())
}

/// A triangle mesh on its way to an OBJ file. Normals and texture coordinates are per vertex or absent.
#[derive(Default)]
struct Mesh {
    positions: Vec<DVec3>,
    normals: Vec<DVec3>,
    uvs: Vec<DVec2>,
    triangles: Vec<[usize; 3]>,
}

impl Mesh {
    /// Adds a convex polygon, counter-clockwise seen from the front, as a fan with vertices of its own.
    fn polygon(&mut self, corners: &[DVec3]) {
        let first = self.positions.len();
        self.positions.extend_from_slice(corners);
        self.triangles
            .extend((1..corners.len() - 1).map(|i| [first, first + i, first + i + 1]));
    }

    /// Adds two triangles to each cell of a grid of `rows` x `columns` vertices that starts at vertex `first`.
    fn grid(&mut self, first: usize, rows: usize, columns: usize) {
        for row in 0..rows - 1 {
            for column in 0..columns - 1 {
                let a = first + row * columns + column;
                let (b, c, d) = (a + 1, a + columns + 1, a + columns);
                self.triangles.extend([[a, b, c], [a, c, d]]);
            }
        }
    }

    /// Adds all of a mesh that has the same attributes.
    fn append(&mut self, other: &Mesh) {
        let first = self.positions.len();
        self.positions.extend_from_slice(&other.positions);
        self.normals.extend_from_slice(&other.normals);
        self.uvs.extend_from_slice(&other.uvs);
        self.triangles
            .extend(other.triangles.iter().map(|t| t.map(|i| i + first)));
    }

    /// Turns the surface inside out.
    fn flip(&mut self) {
        self.triangles.iter_mut().for_each(|t| t.swap(1, 2));
        self.normals.iter_mut().for_each(|n| *n = -*n);
    }

    /// Writes the mesh as OBJ text with seven decimals, enough for a unit sphere in f32.
    fn write(&self, path: &Path) -> Outcome {
        let mut text = String::new();
        for p in &self.positions {
            write_numbers(&mut text, "v", &p.to_array())?;
        }
        for t in &self.uvs {
            write_numbers(&mut text, "vt", &t.to_array())?;
        }
        for n in &self.normals {
            write_numbers(&mut text, "vn", &n.to_array())?;
        }
        for triangle in &self.triangles {
            text.push('f');
            for i in triangle.map(|i| i + 1) {
                match (self.uvs.is_empty(), self.normals.is_empty()) {
                    (true, true) => write!(text, " {i}")?,
                    (false, true) => write!(text, " {i}/{i}")?,
                    (true, false) => write!(text, " {i}//{i}")?,
                    (false, false) => write!(text, " {i}/{i}/{i}")?,
                }
            }
            text.push('\n');
        }
        write_file(path, text.as_bytes())?;
        println!(
            "{}: {} triangles, {} vertices",
            path.display(),
            self.triangles.len(),
            self.positions.len()
        );
        Ok(())
    }
}

/// A line of an OBJ file, without trailing zeros.
fn write_numbers(text: &mut String, keyword: &str, values: &[f64]) -> Outcome {
    text.push_str(keyword);
    for v in values {
        let digits = format!("{v:.7}");
        let digits = digits.trim_end_matches('0').trim_end_matches('.');
        write!(text, " {}", if digits == "-0" { "0" } else { digits })?;
    }
    text.push('\n');
    Ok(())
}

fn write_file(path: &Path, bytes: &[u8]) -> Outcome {
    create_parent(path)?;
    Ok(fs::write(path, bytes)?)
}

fn create_parent(path: &Path) -> Outcome {
    if let Some(parent) = path.parent() {
        fs::create_dir_all(parent)?;
    }
    Ok(())
}

/// The unit sphere: an icosahedron with every triangle split in four `levels` times, vertices and normals on the
/// sphere.
fn icosphere(levels: u32) -> Mesh {
    let t = (1.0 + 5f64.sqrt()) / 2.0;
    let mut vertices: Vec<DVec3> = [
        [-1.0, t, 0.0],
        [1.0, t, 0.0],
        [-1.0, -t, 0.0],
        [1.0, -t, 0.0],
        [0.0, -1.0, t],
        [0.0, 1.0, t],
        [0.0, -1.0, -t],
        [0.0, 1.0, -t],
        [t, 0.0, -1.0],
        [t, 0.0, 1.0],
        [-t, 0.0, -1.0],
        [-t, 0.0, 1.0],
    ]
    .map(|v| DVec3::from_array(v).normalize())
    .to_vec();
    #[rustfmt::skip]
    let mut triangles = vec![
        [0, 11, 5], [0, 5, 1], [0, 1, 7], [0, 7, 10], [0, 10, 11], [1, 5, 9], [5, 11, 4], [11, 10, 2], [10, 7, 6],
        [7, 1, 8], [3, 9, 4], [3, 4, 2], [3, 2, 6], [3, 6, 8], [3, 8, 9], [4, 9, 5], [2, 4, 11], [6, 2, 10],
        [8, 6, 7], [9, 8, 1],
    ];
    for _ in 0..levels {
        let mut midpoints = HashMap::new();
        let mut finer = Vec::with_capacity(triangles.len() * 4);
        for [a, b, c] in triangles {
            let mut midpoint = |i: usize, j: usize| {
                *midpoints.entry((i.min(j), i.max(j))).or_insert_with(|| {
                    vertices.push((vertices[i] + vertices[j]).normalize());
                    vertices.len() - 1
                })
            };
            let (ab, bc, ca) = (midpoint(a, b), midpoint(b, c), midpoint(c, a));
            finer.extend([[a, ab, ca], [b, bc, ab], [c, ca, bc], [ab, bc, ca]]);
        }
        triangles = finer;
    }
    Mesh {
        normals: vertices.clone(),
        positions: vertices,
        triangles,
        ..Mesh::default()
    }
}

/// An axis-aligned box, flat shaded, normals outward.
fn cuboid(lo: DVec3, hi: DVec3) -> Mesh {
    let corner = |i: usize| {
        let pick = |bit: usize, axis: usize| if i >> bit & 1 == 0 { lo[axis] } else { hi[axis] };
        dvec3(pick(0, 0), pick(1, 1), pick(2, 2))
    };
    let faces = [
        [0, 4, 6, 2],
        [1, 3, 7, 5],
        [0, 1, 5, 4],
        [2, 6, 7, 3],
        [0, 2, 3, 1],
        [4, 5, 7, 6],
    ];
    Mesh {
        positions: (0..8).map(corner).collect(),
        triangles: faces.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect(),
        ..Mesh::default()
    }
}

/// A square of the given side in the plane y = 0 that faces up; its texture repeats every `period` along x and z.
fn ground(side: f64, period: f64) -> Mesh {
    let mut mesh = Mesh::default();
    let corners = [[-1.0, 1.0], [1.0, 1.0], [1.0, -1.0], [-1.0, -1.0]].map(|c| DVec2::from_array(c) * side / 2.0);
    mesh.polygon(&corners.map(|c| dvec3(c.x, 0.0, c.y)));
    mesh.uvs = corners.map(|c| dvec2(c.x, -c.y) / period).to_vec();
    mesh
}

/// A photographer's backdrop: a floor of the given half width in front of z = `back`, a quarter cylinder of `radius`
/// and a wall up to `top`; `size` is the half width and the z of the front edge.
fn backdrop(size: DVec2, back: f64, radius: f64, top: f64) -> Mesh {
    const SEGMENTS: usize = 32;
    let bend = (0..=SEGMENTS).map(|i| {
        let angle = FRAC_PI_2 * i as f64 / SEGMENTS as f64;
        let (s, c) = angle.sin_cos();
        (dvec2(radius * (1.0 - c), back + radius * (1.0 - s)), dvec2(c, s))
    });
    let mut profile = vec![(dvec2(0.0, size.y), dvec2(1.0, 0.0))];
    profile.extend(bend);
    profile.push((dvec2(top, back), dvec2(0.0, 1.0)));
    let mut mesh = Mesh::default();
    for (at, normal) in &profile {
        for x in [-size.x, size.x] {
            mesh.positions.push(dvec3(x, at.x, at.y));
            mesh.normals.push(dvec3(0.0, normal.x, normal.y));
        }
    }
    mesh.grid(0, profile.len(), 2);
    mesh
}

/// A cube of half side 1 whose edges are rounded with `radius`, each bend in `segments` steps.
fn rounded_block(radius: f64, segments: usize) -> Mesh {
    let inner = 1.0 - radius;
    // Grid lines of a cube face: the bends get even angles, the flat part one cell.
    let bend = |i: usize| inner + radius * (PI / 4.0 * i as f64 / segments as f64).tan();
    let mut lines: Vec<f64> = (0..=segments).rev().map(|i| -bend(i)).collect();
    lines.extend((0..=segments).map(bend));
    let last = lines.len() - 1;

    let mut mesh = Mesh::default();
    let mut known = HashMap::new();
    for axis in 0..3 {
        for side in [0, last] {
            let mut vertex = |i: usize, j: usize| {
                let mut key = [0; 3];
                (key[axis], key[(axis + 1) % 3], key[(axis + 2) % 3]) = (side, i, j);
                *known.entry(key).or_insert_with(|| {
                    let on_cube = dvec3(lines[key[0]], lines[key[1]], lines[key[2]]);
                    let core = on_cube.clamp(DVec3::splat(-inner), DVec3::splat(inner));
                    let normal = (on_cube - core).normalize();
                    mesh.positions.push(core + normal * radius);
                    mesh.normals.push(normal);
                    mesh.positions.len() - 1
                })
            };
            for i in 0..last {
                for j in 0..last {
                    let [a, b, c, d] = [vertex(i, j), vertex(i + 1, j), vertex(i + 1, j + 1), vertex(i, j + 1)];
                    let cell = if side == 0 {
                        [[a, c, b], [a, d, c]]
                    } else {
                        [[a, b, c], [a, c, d]]
                    };
                    mesh.triangles.extend(cell);
                }
            }
        }
    }
    mesh
}

/// A brilliant cut of girdle radius 1, lying on one of its pavilion facets at y = 0, flat shaded.
fn gem() -> Mesh {
    // A facet's normal leans `lean` degrees from the axis; its plane passes the girdle's height at distance `reach`.
    let facet = |turn: f64, lean: f64, reach: f64| {
        let ((sin, cos), azimuth) = (lean.to_radians().sin_cos(), turn.to_radians());
        (dvec3(sin * azimuth.cos(), cos, sin * azimuth.sin()), reach * sin)
    };
    let mut planes = vec![(DVec3::Y, 0.34)];
    for i in 0..8 {
        let turn = 45.0 * f64::from(i);
        planes.push(facet(turn, 35.0, 1.02));
        planes.push(facet(turn + 22.5, 22.0, 1.33));
        planes.push(facet(turn, 180.0 - 41.0, 1.02));
        for side in [-11.25, 11.25] {
            planes.push(facet(turn + side, 42.0, 1.02));
            planes.push(facet(turn + side, 180.0 - 43.5, 1.02));
            planes.push(facet(turn + side, 90.0, 0.985));
        }
    }
    let mut mesh = convex_solid(&planes);
    let rest = DQuat::from_rotation_arc(facet(22.5 + 67.5, 180.0 - 41.0, 1.0).0, -DVec3::Y);
    mesh.positions.iter_mut().for_each(|p| *p = rest * *p);
    let lowest = mesh.positions.iter().map(|p| p.y).fold(f64::INFINITY, f64::min);
    mesh.positions.iter_mut().for_each(|p| p.y -= lowest);
    mesh
}

/// The solid { x : n . x <= d for every plane (n, d) }: vertices are intersections of three planes that no other
/// plane cuts off, shared between the faces.
fn convex_solid(planes: &[(DVec3, f64)]) -> Mesh {
    const TOLERANCE: f64 = 1e-9;
    let mut mesh = Mesh::default();
    for (i, &(a, da)) in planes.iter().enumerate() {
        for (j, &(b, db)) in planes.iter().enumerate().skip(i + 1) {
            for &(c, dc) in &planes[j + 1..] {
                let determinant = a.dot(b.cross(c));
                if determinant.abs() < TOLERANCE {
                    continue;
                }
                let p = (b.cross(c) * da + c.cross(a) * db + a.cross(b) * dc) / determinant;
                let inside = planes.iter().all(|&(n, d)| n.dot(p) <= d + TOLERANCE);
                if inside && mesh.positions.iter().all(|q| q.distance(p) > 1e-6) {
                    mesh.positions.push(p);
                }
            }
        }
    }
    for &(normal, distance) in planes {
        let mut face: Vec<usize> = (0..mesh.positions.len())
            .filter(|&i| (normal.dot(mesh.positions[i]) - distance).abs() < 1e-6)
            .collect();
        if face.len() < 3 {
            continue;
        }
        let centre = face.iter().map(|&i| mesh.positions[i]).sum::<DVec3>() / face.len() as f64;
        let (s, t) = normal.any_orthonormal_pair();
        let angle = |i: usize| {
            let v = mesh.positions[i] - centre;
            f64::atan2(v.dot(t), v.dot(s))
        };
        face.sort_by(|&i, &j| angle(i).total_cmp(&angle(j)));
        let fan = (1..face.len() - 1).map(|i| [face[0], face[i], face[i + 1]]);
        mesh.triangles.extend(fan);
    }
    mesh
}

/// The tiers of the tree, from below: height of the rim, height of the tip, radius of the rim.
const TIERS: [[f64; 3]; 4] = [
    [0.35, 1.55, 1.05],
    [0.95, 2.05, 0.82],
    [1.5, 2.5, 0.6],
    [2.0, 2.9, 0.38],
];
/// Where the tree stands in the room.
const TREE: DVec3 = dvec3(-1.55, 0.0, -1.3);

/// Discs on the floor, as x, z and radius, where the tree, the boxes and the spheres of `many-lights.toml` stand.
const KEPT_CLEAR: [[f64; 3]; 5] = [
    [TREE.x, TREE.z, 0.5],
    [0.55, -0.75, 0.6],
    [0.05, 0.3, 0.45],
    [2.35, -0.6, 0.5],
    [1.55, 0.75, 0.35],
];

/// Cones stacked into a tree at [`TREE`], closed below.
fn tree(tiers: &[[f64; 3]]) -> Mesh {
    const SEGMENTS: usize = 96;
    let mut mesh = Mesh::default();
    for &[rim, tip, radius] in tiers {
        let slope = dvec2(tip - rim, radius).normalize();
        // (radius, height, normal outward, normal up) along the profile, the normals split at the rim.
        let profile = [
            [0.0, rim, 0.0, -1.0],
            [radius, rim, 0.0, -1.0],
            [radius, rim, slope.x, slope.y],
            [0.0, tip, slope.x, slope.y],
        ];
        for pair in profile.chunks(2) {
            let first = mesh.positions.len();
            for &[r, y, outward, up] in pair.iter().rev() {
                for i in 0..=SEGMENTS {
                    let (s, c) = (TAU * i as f64 / SEGMENTS as f64).sin_cos();
                    mesh.positions.push(TREE + dvec3(r * c, y, r * s));
                    mesh.normals.push(dvec3(outward * c, up, outward * s));
                }
            }
            mesh.grid(first, 2, SEGMENTS + 1);
        }
    }
    // A cell at the axis has one triangle without area.
    mesh.triangles.retain(|t| {
        let [a, b, c] = t.map(|i| mesh.positions[i]);
        (b - a).cross(c - a).length() > 1e-12
    });
    mesh
}

/// Lamps on spirals around the tiers of the tree, just off its surface.
fn tree_lights(count: usize, random: &mut Random) -> Vec<DVec3> {
    let total: f64 = TIERS.iter().map(|t| t[2]).sum();
    let mut places = Vec::new();
    for (i, &[rim, tip, radius]) in TIERS.iter().enumerate() {
        let n = if i + 1 == TIERS.len() {
            count - places.len()
        } else {
            (count as f64 * radius / total) as usize
        };
        for k in 0..n {
            // Even spacing along the cone's height squared is even spacing on its surface.
            let along = 1.0 - (1.0 - 0.75 * (k as f64 + 0.5) / n as f64).sqrt();
            let turn = TAU * (4.0 * k as f64 / n as f64 + 0.03 * random.unit());
            let y = rim + (tip - rim) * along + 0.04;
            let r = tree_radius(y) + 0.05;
            places.push(TREE + dvec3(r * turn.cos(), y, r * turn.sin()));
        }
    }
    places
}

/// The radius of the outermost tier at the height `y`, or just above it.
fn tree_radius(y: f64) -> f64 {
    TIERS
        .iter()
        .filter(|&&[rim, tip, _]| (rim - 0.04..tip).contains(&y))
        .map(|&[rim, tip, radius]| radius * (tip - y) / (tip - rim))
        .fold(0.0, f64::max)
}

/// Lamps on strings that hang in shallow arcs from wall to wall.
fn garlands(strings: usize, lamps: usize, random: &mut Random) -> Vec<DVec3> {
    let mut places = Vec::new();
    for string in 0..strings {
        let z = -3.6 + 0.95 * string as f64;
        let sag = 0.35 + 0.3 * random.unit();
        for lamp in 0..lamps {
            let t = (lamp as f64 + 0.5) / lamps as f64 * 2.0 - 1.0;
            let sway = 0.25 * (t * 3.0 + string as f64).sin();
            places.push(dvec3(4.9 * t, 3.95 - sag * (1.0 - t * t), z + sway));
        }
    }
    places
}

/// Lamps a little above the floor, scattered without coming close to other things or to one another.
fn candles(count: usize, random: &mut Random) -> Vec<DVec3> {
    let mut places: Vec<DVec3> = Vec::new();
    while places.len() < count {
        let p = dvec3(
            9.4 * random.unit() - 4.7,
            0.06 + 0.06 * random.unit(),
            8.0 * random.unit() - 3.7,
        );
        let clear = KEPT_CLEAR
            .iter()
            .all(|&[x, z, radius]| dvec2(p.x - x, p.z - z).length() > radius);
        if clear && places.iter().all(|q| q.distance(p) > 0.22) {
            places.push(p);
        }
    }
    places
}

/// A regular tetrahedron, turned at random, normals outward.
fn tetrahedron(centre: DVec3, edge: f64, random: &mut Random) -> Mesh {
    let turn = DQuat::from_euler(
        glam::EulerRot::YXZ,
        TAU * random.unit(),
        TAU * random.unit(),
        TAU * random.unit(),
    );
    let corners = [[1.0, 1.0, 1.0], [1.0, -1.0, -1.0], [-1.0, 1.0, -1.0], [-1.0, -1.0, 1.0]];
    Mesh {
        // These corners of a cube of side 2 are 2 sqrt 2 apart.
        positions: corners
            .map(|c| centre + turn * DVec3::from_array(c) * (edge / 8f64.sqrt()))
            .to_vec(),
        triangles: vec![[0, 1, 2], [0, 2, 3], [0, 3, 1], [1, 3, 2]],
        ..Mesh::default()
    }
}

/// A square colour texture with linear values in [0, 1], row 0 at the top.
struct Texture {
    size: usize,
    texels: Vec<DVec3>,
}

impl Texture {
    /// Evaluates `colour` at the texel centres; both coordinates run from 0 to 1.
    fn new(size: usize, colour: impl Fn(DVec2) -> DVec3) -> Texture {
        let at = |i: usize| dvec2((i % size) as f64 + 0.5, (i / size) as f64 + 0.5) / size as f64;
        Texture {
            size,
            texels: (0..size * size).map(|i| colour(at(i))).collect(),
        }
    }

    /// Writes an 8-bit sRGB PNG.
    fn write(&self, path: &Path) -> Outcome {
        create_parent(path)?;
        let bytes: Vec<u8> = self
            .texels
            .iter()
            .flat_map(|t| t.to_array())
            .map(|c| (srgb_encode(c.clamp(0.0, 1.0) as f32) * 255.0).round() as u8)
            .collect();
        let encoder = image::codecs::png::PngEncoder::new_with_quality(
            fs::File::create(path)?,
            image::codecs::png::CompressionType::Best,
            image::codecs::png::FilterType::Adaptive,
        );
        let side = self.size as u32;
        image::ImageEncoder::write_image(encoder, &bytes, side, side, image::ExtendedColorType::Rgb8)?;
        let mean = self.texels.iter().sum::<DVec3>() / self.texels.len() as f64;
        println!("{}: {side} x {side}, mean reflectance {mean:.3}", path.display());
        Ok(())
    }
}

/// Square stone slabs in a 4 x 4 pattern, each of its own shade, with dark joints.
fn paving(size: usize) -> Texture {
    const SLABS: f64 = 4.0;
    Texture::new(size, |uv| {
        let slab = (uv * SLABS).floor();
        let edge = (uv * SLABS - slab - 0.5).abs().max_element();
        let id = (slab.x + SLABS * slab.y) as u64;
        let shade = 0.86 + 0.28 * unit(id);
        let warm = unit(id + 100);
        let grain = 0.93 + 0.14 * noise(uv, 128, 7) + 0.12 * (noise(uv, 16, 8) - 0.5);
        let stone = dvec3(0.47, 0.42, 0.36).lerp(dvec3(0.40, 0.40, 0.39), warm) * shade * grain;
        stone.lerp(dvec3(0.13, 0.12, 0.11), smoothstep(0.478, 0.490, edge))
    })
}

/// Diamonds and squares of two woods with fine light lines, a pattern that shows refraction well.
fn marquetry(size: usize) -> Texture {
    Texture::new(size, |uv| {
        let cell = (uv * 4.0).floor();
        let local = uv * 4.0 - cell - 0.5;
        let diamond = local.x.abs() + local.y.abs();
        let dark = ((cell.x + cell.y) as u64).is_multiple_of(2);
        let (inner, outer) = if dark {
            (dvec3(0.62, 0.50, 0.36), dvec3(0.10, 0.13, 0.17))
        } else {
            (dvec3(0.16, 0.24, 0.30), dvec3(0.66, 0.58, 0.47))
        };
        let grain = 0.9 + 0.2 * noise(uv, 64, 3);
        let line = 1.0 - smoothstep(0.010, 0.020, (diamond - 0.36).abs());
        let wood = outer.lerp(inner, 1.0 - smoothstep(0.355, 0.365, diamond)) * grain;
        wood.lerp(dvec3(0.75, 0.70, 0.60), line)
    })
}

/// Floor boards along v, each with its own shade and a stretched grain.
fn planks(size: usize) -> Texture {
    const BOARDS: f64 = 8.0;
    Texture::new(size, |uv| {
        let board = (uv.x * BOARDS).floor();
        let id = board as u64;
        // One joint per board, at a height of its own.
        let along = (uv.y + unit(id + 40)).fract();
        let seam = (uv.x * BOARDS - board - 0.5)
            .abs()
            .max(0.5 - 6.0 * along.min(1.0 - along));
        let shade = 0.8 + 0.4 * unit(id + 60);
        let grain = 0.85 + 0.3 * stretched_noise(uv, id);
        let wood = dvec3(0.36, 0.21, 0.115) * shade * grain;
        wood.lerp(dvec3(0.05, 0.03, 0.02), smoothstep(0.465, 0.485, seam))
    })
}

/// Noise that varies quickly across the boards and slowly along them; periodic.
fn stretched_noise(uv: DVec2, seed: u64) -> f64 {
    let across = 128.0 * uv.x;
    let (lo, t) = (across.floor(), across.fract());
    let strand = |i: f64| {
        let offset = unit(i as u64 % 128 + 1000 * seed);
        noise(dvec2(offset, uv.y), 8, 5 + seed)
    };
    strand(lo) * (1.0 - t) + strand(lo + 1.0) * t
}

/// Smooth noise in [0, 1] on a lattice of `cells` x `cells` that repeats with the texture.
fn noise(uv: DVec2, cells: u64, seed: u64) -> f64 {
    let p = uv * cells as f64;
    let (lo, t) = (p.floor(), p.fract());
    let t = t * t * (DVec2::splat(3.0) - 2.0 * t);
    let value = |x: u64, y: u64| unit((x % cells) + (y % cells) * 4096 + seed * 0x0100_0000);
    let (x, y) = (lo.x as u64, lo.y as u64);
    let mix = |a: f64, b: f64, t: f64| a + (b - a) * t;
    mix(
        mix(value(x, y), value(x + 1, y), t.x),
        mix(value(x, y + 1), value(x + 1, y + 1), t.x),
        t.y,
    )
}

/// 0 below `lo`, 1 above `hi`, smooth between.
fn smoothstep(lo: f64, hi: f64, x: f64) -> f64 {
    let t = ((x - lo) / (hi - lo)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

/// A hash of `x` as a number in [0, 1): SplitMix64 (Steele et al. 2014).
fn unit(x: u64) -> f64 {
    let mut z = x.wrapping_add(1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64
}

/// A stream of random numbers that is the same on every run.
struct Random {
    next: u64,
}

impl Random {
    fn new(seed: u64) -> Random {
        Random { next: seed << 32 }
    }

    /// The next number in [0, 1).
    fn unit(&mut self) -> f64 {
        self.next += 1;
        unit(self.next)
    }
}

/// A clear sky by single scattering: what the air above scatters out of the sunlight, a sun disc if wanted, and a
/// plain ground below the horizon with hills along it.
struct Sky {
    width: usize,
    height: usize,
    /// Angle of the sun above the horizon.
    sun_elevation: f64,
    /// Angle of the sun from -Z towards +X.
    sun_azimuth: f64,
    /// Irradiance of the sun on a surface that faces it, above the atmosphere.
    sun_irradiance: f64,
    /// Vertical optical depth of the haze.
    haze: f64,
    /// Angular radius of the sun's disc; `None` leaves the disc out (behind the hills, say).
    sun_radius: Option<f64>,
    /// Reflectance of the ground below the horizon.
    ground: [f64; 3],
}

/// Vertical optical depth of clear air at 680, 550 and 440 nm.
const AIR: DVec3 = dvec3(0.0405, 0.0975, 0.243);

/// Reflectance of the hills.
const WOODS: DVec3 = dvec3(0.06, 0.10, 0.05);

impl Sky {
    /// The direction of a point of the map, `u` and `v` in [0, 1] from the left and from the top.
    fn direction(u: f64, v: f64) -> DVec3 {
        let ((sin_t, cos_t), (sin_p, cos_p)) = ((PI * v).sin_cos(), (TAU * u).sin_cos());
        dvec3(sin_t * sin_p, cos_t, -sin_t * cos_p)
    }

    /// The length of the path through the air, in vertical thicknesses (Kasten and Young 1989).
    fn air_mass(y: f64) -> f64 {
        let elevation = y.clamp(0.0, 1.0).asin().to_degrees();
        1.0 / (y.max(0.0) + 0.505_72 * (elevation + 6.079_95).powf(-1.6364))
    }

    /// Sunlight after the atmosphere, on a surface that faces the sun.
    fn sunlight(&self) -> DVec3 {
        let depth = (AIR + DVec3::splat(self.haze)) * Sky::air_mass(self.sun_elevation.sin());
        (-depth).exp() * self.sun_irradiance
    }

    /// Radiance of the sky and the ground, without the disc of the sun.
    fn radiance(&self, direction: DVec3, sun: DVec3) -> DVec3 {
        let azimuth = f64::atan2(direction.x, -direction.z);
        let hills = 0.034
            + 0.010 * (2.0 * azimuth + 0.6).sin()
            + 0.010 * (5.0 * azimuth + 2.1).sin()
            + 0.006 * (11.0 * azimuth + 0.3).sin()
            + 0.002 * (29.0 * azimuth + 1.7).sin();
        let elevation = direction.y.asin();
        let air = self.scattered(direction, sun);
        if elevation >= hills {
            return air;
        }
        let light = self.sunlight() * sun.y.max(0.0) + self.scattered(DVec3::Y, sun) * PI;
        let reflectance = if elevation > 0.0 {
            WOODS
        } else {
            DVec3::from_array(self.ground)
        };
        let soil = reflectance * light / PI;
        // Distance fades what is near the horizon into the air in front of it.
        let veil = if elevation > 0.0 {
            0.36
        } else {
            0.45 * (-(elevation / 0.06).abs()).exp()
        };
        let horizon = self.scattered(direction.with_y(0.02).normalize(), sun);
        soil.lerp(horizon, veil)
    }

    /// Sunlight that the air scatters once towards the viewer, doubled for the light scattered more often.
    fn scattered(&self, direction: DVec3, sun: DVec3) -> DVec3 {
        let cos = direction.dot(sun);
        let g = 0.76f64;
        let rayleigh = 3.0 / (16.0 * PI) * (1.0 + cos * cos);
        let mie = (1.0 - g * g) / (4.0 * PI * (1.0 + g * g - 2.0 * g * cos).powf(1.5));
        let depth = AIR + DVec3::splat(self.haze);
        let phase = (AIR * rayleigh + DVec3::splat(self.haze * mie)) / depth;
        let opacity = DVec3::ONE - (-depth * Sky::air_mass(direction.y)).exp();
        // On the way in the light loses about what it loses on half its own path.
        let incoming = (-depth * 0.5 * Sky::air_mass(sun.y)).exp() * self.sun_irradiance;
        2.0 * incoming * phase * opacity
    }

    /// The map, with its figures printed under `name`.
    fn render(&self, name: &str) -> Map {
        let (s, c) = self.sun_elevation.sin_cos();
        let mut centre = dvec2((self.sun_azimuth / TAU).rem_euclid(1.0), 0.5 - self.sun_elevation / PI);
        // On the middle of a texel, so that the disc covers one wholly.
        let size = dvec2(self.width as f64, self.height as f64);
        centre = ((centre * size).floor() + 0.5) / size;
        let sun = if self.sun_radius.is_some() {
            Sky::direction(centre.x, centre.y)
        } else {
            dvec3(c * self.sun_azimuth.sin(), s, -c * self.sun_azimuth.cos())
        };
        let at = |i: usize, x: f64, y: f64| {
            let (column, row) = ((i % self.width) as f64, (i / self.width) as f64);
            Sky::direction((column + x) / size.x, (row + y) / size.y)
        };
        let sky: Vec<DVec3> = (0..self.width * self.height)
            .map(|i| {
                let rows = [0.125, 0.375, 0.625, 0.875];
                rows.map(|y| self.radiance(at(i, 0.5, y), sun)).iter().sum::<DVec3>() / rows.len() as f64
            })
            .collect();
        let mut map = Map {
            width: self.width,
            height: self.height,
            texels: sky.clone(),
        };
        if let Some(radius) = self.sun_radius {
            let disc = self.sunlight() / (TAU * (1.0 - radius.cos()));
            for (i, texel) in map.texels.iter_mut().enumerate() {
                if at(i, 0.5, 0.5).angle_between(sun) < radius + 2.0 * PI / size.y {
                    *texel += disc * coverage(|x, y| at(i, x, y).angle_between(sun) < radius);
                }
            }
        }
        map.report(name, &sky, sun);
        map
    }
}

/// The part of the unit square where `inside` holds, from a fine grid.
fn coverage(inside: impl Fn(f64, f64) -> bool) -> f64 {
    const GRID: usize = 64;
    let middle = |i: usize| (i as f64 + 0.5) / GRID as f64;
    let hits = (0..GRID * GRID)
        .filter(|i| inside(middle(i % GRID), middle(i / GRID)))
        .count();
    hits as f64 / (GRID * GRID) as f64
}

/// A latitude-longitude map of radiance, row 0 at +Y.
struct Map {
    width: usize,
    height: usize,
    texels: Vec<DVec3>,
}

impl Map {
    /// Prints the figures that tell how hard the map is to sample; `sky` is the map without the sun.
    fn report(&self, name: &str, sky: &[DVec3], sun: DVec3) {
        let luminance = |v: DVec3| v.dot(dvec3(0.2126, 0.7152, 0.0722));
        let solid_angle = |i: usize| {
            let v = (i / self.width) as f64 / self.height as f64;
            let band = (PI * v).cos() - (PI * (v + 1.0 / self.height as f64)).cos();
            band * TAU / self.width as f64
        };
        let direction = |i: usize| {
            let (x, y) = ((i % self.width) as f64 + 0.5, (i / self.width) as f64 + 0.5);
            Sky::direction(x / self.width as f64, y / self.height as f64)
        };
        // Integrals over the map of luminance times a weight of the direction.
        let integral = |texels: &[DVec3], weight: &dyn Fn(DVec3) -> f64| {
            texels
                .iter()
                .enumerate()
                .map(|(i, &t)| luminance(t) * solid_angle(i) * weight(direction(i)))
                .sum::<f64>()
        };
        let up = |d: DVec3| d.y.max(0.0);
        let upper = |d: DVec3| f64::from(u8::from(d.y > 0.0));
        let brightest = self.texels.iter().map(|&t| luminance(t)).fold(0.0, f64::max);
        let sky_mean = integral(sky, &upper) / TAU;
        let sky_up = integral(sky, &up);
        let sun_up = integral(&self.texels, &up) - sky_up;
        let sun_texels = self.texels.iter().zip(sky).filter(|(a, b)| a != b).count();
        println!("{name}: {} x {}, towards the sun {sun:.4}", self.width, self.height);
        println!("  largest luminance {brightest:.4e}, mean of the sky without the sun {sky_mean:.4}");
        println!(
            "  largest / mean of the sky {:.3e}, largest / mean of the map with the sun {:.3e}",
            brightest / sky_mean,
            brightest / (integral(&self.texels, &|_| 1.0) / (2.0 * TAU))
        );
        println!(
            "  irradiance on level ground: sky {sky_up:.3}, sun {sun_up:.3} (ratio {:.2}, {sun_texels} texels)",
            sun_up / sky_up
        );
    }

    /// Writes float32 RGB with ZIP compression: half floats end at 65504, below the sun. Values are rounded to twelve
    /// significant bits, one more than a half float has, which is what lets the file compress.
    fn write(&self, path: &Path) -> Outcome {
        create_parent(path)?;
        let round = |v: f64| {
            let bits = (v as f32).to_bits();
            f32::from_bits((bits + 0x0800) & 0xffff_f000)
        };
        let channels = exr::prelude::SpecificChannels::rgb(|at: exr::prelude::Vec2<usize>| {
            let [r, g, b] = self.texels[at.y() * self.width + at.x()].to_array().map(round);
            (r, g, b)
        });
        let encoding = exr::prelude::Encoding {
            compression: exr::prelude::Compression::ZIP16,
            ..exr::prelude::Encoding::FAST_LOSSLESS
        };
        let layer = exr::prelude::Layer::new(
            (self.width, self.height),
            exr::prelude::LayerAttributes::default(),
            encoding,
            channels,
        );
        exr::prelude::Image::from_layer(layer)
            .write()
            .non_parallel()
            .to_file(path)?;
        Ok(())
    }
}
