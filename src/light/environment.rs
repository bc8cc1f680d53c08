//! The light from infinitely far away: a constant, or a latitude-longitude map with importance sampling.
//!
//! Orientation (unrotated): row 0 touches +Y; direction (x, y, z) looks up u = atan2(x, −z) / 2π and v = acos(y) / π.
//! Radiance is interpolated bilinearly, wrapping in u.
//!
//! **Sampling** (the article's equations 8 to 10, mended). A texel is drawn by an alias table over luminance × sin θ: its
//! share of the light, solid angle included. Within it the point is not uniform but tent-distributed around the texel
//! centre, two texels wide. The density over the image is then the *bilinear interpolation* of the table's
//! probabilities, just as radiance is the interpolation of the texels: where radiance reaches into the neighbour of a
//! bright texel, so does the density. Equation 9 turns it into a density per solid angle,
//!
//! p(ω) = w h / (2 π² sin θ) · p_img(u, v).
//!
//! The probabilities are those that the built table implies, kept beside the texel's colour: one lookup gives both.

#![allow(
    clippy::needless_range_loop,
    reason = "a lane is read and written in many columns at once"
)]

use crate::columns::{Column, Columns, padded};
use crate::image::Image;
use crate::math::{DMat3, DVec3, Rgb, Vec3, atan2_turns, floor, floor_f64, sin_cos_turns};
use crate::sampling::{AliasTable, warp};
use prefetch_index::prefetch_index;
use rayon::prelude::*;
use std::f64::consts::{PI, TAU};
use std::ops::Range;
use thiserror::Error;

/// How directions towards an environment map are drawn.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum EnvSampling {
    /// In proportion to the light that comes from them.
    #[default]
    Importance,
    /// In proportion to what is brighter than the mean. The rest is left to bounces: only for estimators that combine both
    /// by multiple importance sampling (MIS compensation, Karlík et al. 2019).
    Compensated,
    /// Uniformly over the sphere.
    Uniform,
}

/// Why there is no environment for an image.
#[derive(Debug, Error, PartialEq)]
pub enum EnvironmentError {
    /// The image has no pixels.
    #[error("the environment map is {0} x {1} texels; it needs at least one")]
    Size(u32, u32),
    /// The turn also stretches.
    #[error(
        "the environment map is turned by a matrix that is no rotation: its columns are not unit vectors at right angles"
    )]
    Turn,
}

/// What the columns of a turn may be off unit length and right angles: numbers of text files have few digits.
const TURN_TOLERANCE: f64 = 1e-4;

/// Light from infinity.
#[derive(Clone, Debug)]
pub enum Environment {
    /// The same radiance from everywhere. Holds no table.
    Constant(Rgb),
    /// A latitude-longitude map.
    Map(EnvironmentMap),
}

/// A latitude-longitude map and its sampling table.
#[derive(Clone, Debug)]
pub struct EnvironmentMap {
    layout: Layout,
    /// Any other turn after that about +Y; absent for most maps.
    turn: Option<Turn>,
    /// Radiance, and the probability of the texel over the mean one.
    texels: Vec<[f32; 4]>,
    /// Absent for a black map and for uniform sampling.
    table: Option<AliasTable>,
    irradiance_scale: f64,
    /// Whether a part of its light is never sampled.
    is_compensated: bool,
}

/// Where directions lie on a map.
#[derive(Clone, Copy, Debug)]
struct Layout {
    width: u32,
    height: u32,
    sin_rotation: f32,
    cos_rotation: f32,
}

/// A rotation, which may mirror: from the map to the world and back.
#[derive(Clone, Copy, Debug)]
struct Turn {
    to_world: [Vec3; 3],
    to_map: [Vec3; 3],
}

impl Turn {
    #[inline(always)]
    fn to_world(self, wi: Vec3) -> Vec3 {
        let [x, y, z] = self.to_world;
        x * wi.x + y * wi.y + z * wi.z
    }

    #[inline(always)]
    fn to_map(self, wi: Vec3) -> Vec3 {
        let [x, y, z] = self.to_map;
        x * wi.x + y * wi.y + z * wi.z
    }

    /// A place that was drawn on the map, as seen from the world.
    #[inline(always)]
    fn sampled(&self, point: EnvironmentPoint) -> EnvironmentPoint {
        EnvironmentPoint {
            wi: self.to_world(point.wi),
            ..point
        }
    }

    /// The place of a direction in the world.
    #[inline(always)]
    fn locate(&self, layout: &Layout, wi: Vec3) -> EnvironmentPoint {
        EnvironmentPoint {
            wi,
            ..layout.locate(self.to_map(wi))
        }
    }
}

/// A direction and its place on the map: finding the place takes arithmetic and looking it up takes memory, and loops
/// that do only one of the two are faster.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EnvironmentPoint {
    /// Unit direction towards it.
    pub wi: Vec3,
    /// The texels around it: upper left, upper right, lower left, lower right.
    texels: [u32; 4],
    /// How far it is from the left to the right and from the upper to the lower ones, in [0, 1].
    fraction: [f32; 2],
    /// Sine of the angle to the pole.
    sin_theta: f32,
}

impl EnvironmentPoint {
    /// A direction to what has no texels.
    #[inline(always)]
    fn nowhere(wi: Vec3) -> EnvironmentPoint {
        EnvironmentPoint {
            wi,
            texels: [0; 4],
            fraction: [0.0; 2],
            sin_theta: 0.0,
        }
    }
}

/// Places by lane, and what lies there.
#[derive(Clone, Debug, Default)]
pub struct EnvironmentColumns {
    numbers: Columns<6>,
    texels: [Column<u32>; 4],
    /// What the texels hold.
    contents: [Columns<4>; 4],
    found: Columns<4>,
}

impl EnvironmentColumns {
    /// The place of lane `i`.
    #[inline(always)]
    pub fn get(&self, i: usize) -> EnvironmentPoint {
        let [x, y, z, fraction_x, fraction_y, sin_theta] = self.numbers.get(i);
        EnvironmentPoint {
            wi: Vec3::new(x, y, z),
            texels: [0, 1, 2, 3].map(|k| self.texels[k][i]),
            fraction: [fraction_x, fraction_y],
            sin_theta,
        }
    }

    /// What [`Environment::lookup_lanes`] has found in lane `i`, as [`Environment::lookup`] states it.
    #[inline(always)]
    pub fn found(&self, i: usize) -> (Rgb, f32) {
        let [r, g, b, pdf_w] = self.found.get(i);
        (Rgb::new(r, g, b), pdf_w)
    }

    /// Replaces the place of lane `i`.
    #[inline(always)]
    pub fn set(&mut self, i: usize, point: &EnvironmentPoint) {
        let EnvironmentPoint {
            wi,
            texels,
            fraction,
            sin_theta,
        } = *point;
        self.numbers
            .set(i, [wi.x, wi.y, wi.z, fraction[0], fraction[1], sin_theta]);
        for k in 0..4 {
            self.texels[k][i] = texels[k];
        }
    }
}

/// An estimate of the irradiance on a surface of any orientation, without occlusion: luminance. From the first three
/// moments of radiance, which is to second order in spherical harmonics (Ramamoorthi and Hanrahan 2001): exact for a
/// constant, within some per cent for a point.
#[derive(Clone, Debug)]
pub(super) struct Irradiance {
    /// ∫ L dω [W·m⁻²].
    fluence: f32,
    /// Polynomial in the normal: constant, linear, and the symmetric matrix by its diagonal and what is beside it.
    constant: f32,
    linear: Vec3,
    diagonal: Vec3,
    mixed: Vec3,
}

impl Irradiance {
    /// Irradiance for the unit normal `n`; for zero, which is both sides, the fluence. Positive unless all is black.
    #[inline(always)]
    pub(super) fn at(&self, n: Vec3) -> f32 {
        if n == Vec3::ZERO {
            return self.fluence;
        }
        let mixed = Vec3::new(n.y * n.z, n.z * n.x, n.x * n.y);
        let value = self.constant + self.linear.dot(n) + self.diagonal.dot(n * n) + self.mixed.dot(mixed);
        // Second order undershoots zero in the shade of a point.
        value.max(0.01 * self.fluence)
    }
}

impl Environment {
    /// Prepares a map for lookup and sampling.
    ///
    /// `image`: row 0 touches +Y; values 0 or more and finite (loading sanitises them). `rotation_degrees` turns the
    /// content about +Y, right-handed. An all-black map is valid and has no power. Time O(texels); 16 bytes a texel, and
    /// 8 more with importance sampling.
    ///
    /// # Errors
    /// [`EnvironmentError::Size`] for an image without pixels.
    pub fn from_map(
        image: &Image<Rgb>,
        scale: f32,
        rotation_degrees: f64,
        sampling: EnvSampling,
    ) -> Result<Environment, EnvironmentError> {
        let (width, height) = (image.width, image.height);
        if image.pixels.is_empty() {
            return Err(EnvironmentError::Size(width, height));
        }
        let row_weights: Vec<f64> = (0..height)
            .map(|row| (PI * (f64::from(row) + 0.5) / f64::from(height)).sin())
            .collect();
        // Of what is brighter than a threshold.
        let weight = |k: usize, threshold: f64| {
            let radiance = image.pixels[k] * scale;
            let luminance =
                0.2126 * f64::from(radiance.r) + 0.7152 * f64::from(radiance.g) + 0.0722 * f64::from(radiance.b);
            (luminance - threshold).max(0.0) * row_weights[k / width as usize]
        };
        let count = image.pixels.len();
        let total: f64 = (0..count).map(|k| weight(k, 0.0)).sum();
        let table_over = |threshold: f64| AliasTable::new((0..count).map(|k| weight(k, threshold)));
        let table = match sampling {
            EnvSampling::Importance => table_over(0.0),
            EnvSampling::Compensated => {
                let mean = total / (f64::from(width) * row_weights.iter().sum::<f64>());
                // Nothing is brighter in a map of one colour.
                table_over(mean).or_else(|| table_over(0.0))
            }
            EnvSampling::Uniform => None,
        };
        let pmf = table.as_ref().map(AliasTable::implied_pmf);
        let texels = (0..count)
            .into_par_iter()
            .map(|k| {
                let [r, g, b] = (image.pixels[k] * scale).to_array();
                [r, g, b, pmf.as_ref().map_or(0.0, |pmf| (pmf[k] * count as f64) as f32)]
            })
            .collect();
        let (sin, cos) = rotation_degrees.to_radians().sin_cos();
        Ok(Environment::Map(EnvironmentMap {
            layout: Layout {
                width,
                height,
                sin_rotation: sin as f32,
                cos_rotation: cos as f32,
            },
            turn: None,
            texels,
            table,
            irradiance_scale: total * 2.0 * PI * PI / count as f64,
            is_compensated: sampling == EnvSampling::Compensated,
        }))
    }

    /// Turns the content further, by a rotation that may mirror.
    ///
    /// # Errors
    /// [`EnvironmentError::Turn`] if the columns of the matrix are not unit vectors at right angles, to 1e-4.
    pub fn turned(mut self, to_world: DMat3) -> Result<Environment, EnvironmentError> {
        let off = (to_world.transpose() * to_world - DMat3::IDENTITY).to_cols_array();
        if !off.iter().all(|off| off.abs() <= TURN_TOLERANCE) {
            return Err(EnvironmentError::Turn);
        }
        if let Environment::Map(map) = &mut self
            && to_world != DMat3::IDENTITY
        {
            let x = to_world.x_axis.normalize();
            let y = (to_world.y_axis - x * x.dot(to_world.y_axis)).normalize();
            let z = x.cross(y) * to_world.determinant().signum();
            let to_world = DMat3::from_cols(x, y, z);
            let columns = |m: DMat3| [m.x_axis, m.y_axis, m.z_axis].map(|column| column.as_vec3());
            map.turn = Some(Turn {
                to_world: columns(to_world),
                to_map: columns(to_world.transpose()),
            });
        }
        Ok(self)
    }

    /// Whether bounces have to find a part of the light, which only multiple importance sampling lets them.
    pub fn is_compensated(&self) -> bool {
        matches!(self, Environment::Map(map) if map.is_compensated)
    }

    /// Luminance integrated over the sphere [W·m⁻²].
    pub fn fluence(&self) -> f64 {
        match self {
            Environment::Constant(radiance) => 4.0 * PI * f64::from(radiance.luminance()),
            Environment::Map(map) => map.irradiance_scale,
        }
    }

    /// What [`Irradiance`] needs. Time O(texels).
    pub(super) fn irradiance(&self) -> Irradiance {
        let fluence = self.fluence();
        let (linear, diagonal, mixed) = match self {
            Environment::Constant(_) => (DVec3::ZERO, DVec3::splat(fluence / 3.0), DVec3::ZERO),
            Environment::Map(map) => map.moments(),
        };
        // Legendre's polynomials of the cosine, weighted by 1/4, 1/2 and 5/16: those of the clamped cosine.
        Irradiance {
            fluence: fluence as f32,
            constant: (fluence * (3.0 / 32.0)) as f32,
            linear: (linear * 0.5).as_vec3(),
            diagonal: (diagonal * (15.0 / 32.0)).as_vec3(),
            mixed: (mixed * (15.0 / 16.0)).as_vec3(),
        }
    }

    /// Radiance from the unit direction `wi`, and the density [1/sr] with which [`Environment::sample`] draws it.
    #[inline]
    pub fn eval(&self, wi: Vec3) -> (Rgb, f32) {
        self.lookup(&self.locate(wi))
    }

    /// Draws the texel for [`Environment::sample`] from 64 random bits; 0 where there is no table.
    #[inline]
    pub fn choose_texel(&self, bits: u64) -> u32 {
        match self {
            Environment::Map(EnvironmentMap { table: Some(table), .. }) => table.sample(bits),
            _ => 0,
        }
    }

    /// Asks for the memory that [`Environment::choose_texel`] reads.
    #[inline(always)]
    pub fn prefetch_choice(&self, bits: u64) {
        if let Environment::Map(EnvironmentMap { table: Some(table), .. }) = self {
            table.prefetch(bits);
        }
    }

    /// [`Environment::sample`] of these lanes, in loops without branches, to the end of their [`padded`] range.
    #[inline(always)]
    pub fn sample_lanes(
        &self,
        lanes: Range<usize>,
        texels: &Column<u32>,
        u: &Columns<2>,
        places: &mut EnvironmentColumns,
    ) {
        let lanes = lanes.start..padded(lanes.end);
        match self {
            Environment::Map(map) if map.table.is_some() => {
                let layout = map.layout;
                for i in lanes.clone() {
                    places.set(i, &layout.sample(texels[i], u.get(i)));
                }
                if let Some(turn) = map.turn {
                    for i in lanes.clone() {
                        places.set(i, &turn.sampled(places.get(i)));
                    }
                }
            }
            Environment::Map(map) => {
                // A uniform direction is as good before a turn as after it.
                let layout = map.layout;
                for i in lanes.clone() {
                    places.set(i, &layout.locate(warp::uniform_sphere(u.get(i))));
                }
                if let Some(turn) = map.turn {
                    for i in lanes.clone() {
                        places.set(i, &turn.sampled(places.get(i)));
                    }
                }
            }
            Environment::Constant(_) => {
                for i in lanes.clone() {
                    places.set(i, &EnvironmentPoint::nowhere(warp::uniform_sphere(u.get(i))));
                }
            }
        }
    }

    /// [`Environment::locate`] of the first `n` lanes, likewise.
    #[inline(always)]
    pub fn locate_lanes(&self, n: usize, directions: &Columns<3>, places: &mut EnvironmentColumns) {
        match self {
            Environment::Map(map) => {
                let layout = map.layout;
                match map.turn {
                    None => {
                        for i in 0..padded(n) {
                            places.set(i, &layout.locate(directions.vec3(i)));
                        }
                    }
                    Some(turn) => {
                        for i in 0..padded(n) {
                            places.set(i, &turn.locate(&layout, directions.vec3(i)));
                        }
                    }
                }
            }
            Environment::Constant(_) => {
                for i in 0..padded(n) {
                    places.set(i, &EnvironmentPoint::nowhere(directions.vec3(i)));
                }
            }
        }
    }

    /// Draws a direction from a place `u` in a texel drawn before.
    #[inline(always)]
    pub fn sample(&self, texel: u32, u: [f32; 2]) -> EnvironmentPoint {
        match self {
            Environment::Map(map) => {
                let point = if map.table.is_some() {
                    map.layout.sample(texel, u)
                } else {
                    map.layout.locate(warp::uniform_sphere(u))
                };
                map.turn.map_or(point, |turn| turn.sampled(point))
            }
            Environment::Constant(_) => self.locate(warp::uniform_sphere(u)),
        }
    }

    /// The place of a unit direction.
    #[inline(always)]
    pub fn locate(&self, wi: Vec3) -> EnvironmentPoint {
        match self {
            Environment::Constant(_) => EnvironmentPoint::nowhere(wi),
            Environment::Map(EnvironmentMap { layout, turn: None, .. }) => layout.locate(wi),
            Environment::Map(EnvironmentMap {
                layout,
                turn: Some(turn),
                ..
            }) => turn.locate(layout, wi),
        }
    }

    /// Radiance from a place, and the density [1/sr] with which [`Environment::sample`] draws it.
    #[inline]
    pub fn lookup(&self, point: &EnvironmentPoint) -> (Rgb, f32) {
        match self {
            Environment::Constant(radiance) => (*radiance, warp::UNIFORM_SPHERE_PDF_W),
            Environment::Map(map) => map.lookup(point),
        }
    }

    /// Asks for the texels of lane `i`.
    #[inline(always)]
    pub fn prefetch_texels(&self, i: usize, places: &EnvironmentColumns) {
        if let Environment::Map(map) = self {
            for k in 0..4 {
                prefetch_index(&map.texels, places.texels[k][i] as usize);
            }
        }
    }

    /// Reads the texels of these lanes.
    #[inline(always)]
    pub fn fetch_lanes(&self, lanes: impl Iterator<Item = usize>, places: &mut EnvironmentColumns) {
        if let Environment::Map(map) = self {
            for i in lanes {
                for k in 0..4 {
                    let texel = map.texels[places.texels[k][i] as usize];
                    places.contents[k].set(i, texel);
                }
            }
        }
    }

    /// [`Environment::lookup`] of the first `n` lanes, of which those are found that [`Environment::fetch_lanes`] has read.
    #[inline(always)]
    pub fn lookup_lanes(&self, n: usize, places: &mut EnvironmentColumns) {
        match self {
            Environment::Map(map) => {
                let has_table = map.table.is_some();
                for i in 0..padded(n) {
                    let texels = [0, 1, 2, 3].map(|k| places.contents[k].get(i));
                    let (radiance, pdf_w) = blend(texels, &places.get(i), has_table);
                    places.found.set(i, [radiance.r, radiance.g, radiance.b, pdf_w]);
                }
            }
            Environment::Constant(_) => {
                for i in 0..padded(n) {
                    let (radiance, pdf_w) = self.lookup(&places.get(i));
                    places.found.set(i, [radiance.r, radiance.g, radiance.b, pdf_w]);
                }
            }
        }
    }

    /// Bytes of the texels and of the sampling table.
    pub fn memory_bytes(&self) -> (usize, usize) {
        match self {
            Environment::Constant(_) => (0, 0),
            Environment::Map(map) => (
                size_of_val(&*map.texels),
                map.table.as_ref().map_or(0, AliasTable::memory_bytes),
            ),
        }
    }
}

/// Sine of the angle to the pole that no direction comes below: the pole itself has no column, and its density would be
/// infinite. Far below what f32 directions tell apart.
const MIN_SIN_THETA: f32 = 1e-8;

impl EnvironmentMap {
    /// Columns and rows.
    pub fn resolution(&self) -> [u32; 2] {
        [self.layout.width, self.layout.height]
    }

    /// Luminance integrated over the sphere times the direction, times the squares of its coordinates, and times the
    /// products yz, zx, xy.
    fn moments(&self) -> (DVec3, DVec3, DVec3) {
        let [width, height] = self.resolution().map(f64::from);
        let columns: Vec<(f64, f64)> = (0..self.layout.width)
            .map(|column| (TAU * (f64::from(column) + 0.5) / width).sin_cos())
            .collect();
        let (sin_rotation, cos_rotation) = (f64::from(self.layout.sin_rotation), f64::from(self.layout.cos_rotation));
        let rows: Vec<[DVec3; 3]> = self
            .texels
            .par_chunks(self.layout.width as usize)
            .enumerate()
            .map(|(row, texels)| {
                let (sin_theta, cos_theta) = (PI * (row as f64 + 0.5) / height).sin_cos();
                let mut sums = [DVec3::ZERO; 3];
                let turned = |wi: DVec3| {
                    let columns = |[x, y, z]: [Vec3; 3]| DMat3::from_cols(x.as_dvec3(), y.as_dvec3(), z.as_dvec3());
                    self.turn.map_or(wi, |turn| columns(turn.to_world) * wi)
                };
                for (&[r, g, b, _], (sin_phi, cos_phi)) in texels.iter().zip(&columns) {
                    let luminance = f64::from(Rgb::new(r, g, b).luminance()) * sin_theta;
                    let (x, z) = (sin_phi * sin_theta, -cos_phi * sin_theta);
                    let wi = DVec3::new(
                        x * cos_rotation + z * sin_rotation,
                        cos_theta,
                        z * cos_rotation - x * sin_rotation,
                    );
                    let wi = turned(wi);
                    sums[0] += wi * luminance;
                    sums[1] += wi * wi * luminance;
                    sums[2] += DVec3::new(wi.y * wi.z, wi.z * wi.x, wi.x * wi.y) * luminance;
                }
                sums
            })
            .collect();
        let texel = 2.0 * PI * PI / (width * height);
        let sum = |k: usize| rows.iter().map(|sums| sums[k]).sum::<DVec3>() * texel;
        (sum(0), sum(1), sum(2))
    }

    #[inline(always)]
    fn lookup(&self, point: &EnvironmentPoint) -> (Rgb, f32) {
        let texels = point.texels.map(|k| self.texels[k as usize]);
        blend(texels, point, self.table.is_some())
    }
}

/// Radiance and density at a place between these texels. Without a table, directions are drawn uniformly.
#[inline(always)]
fn blend([a, b, c, d]: [[f32; 4]; 4], point: &EnvironmentPoint, has_table: bool) -> (Rgb, f32) {
    let [fx, fy] = point.fraction;
    let blend: [f32; 4] = std::array::from_fn(|i| {
        let upper = a[i] + (b[i] - a[i]) * fx;
        let lower = c[i] + (d[i] - c[i]) * fx;
        // The difference form can undershoot zero by an ulp of a hot neighbour.
        (upper + (lower - upper) * fy).max(0.0)
    });
    let pdf_w = if has_table {
        // Equation 9; the probabilities are stored times w h.
        blend[3] / (2.0 * (PI * PI) as f32 * point.sin_theta)
    } else {
        warp::UNIFORM_SPHERE_PDF_W
    };
    (Rgb::new(blend[0], blend[1], blend[2]), pdf_w)
}

impl Layout {
    /// A direction around the centre of a texel, tent-distributed over the image.
    #[inline(always)]
    fn sample(&self, texel: u32, u: [f32; 2]) -> EnvironmentPoint {
        // In f64 and not by division of integers, which no vector unit has. The quotient is at least half a texel off every
        // whole number: exact.
        let row = floor_f64((f64::from(texel) + 0.5) / f64::from(self.width));
        let column = texel as i32 - row * self.width as i32;
        let u_image = (column as f32 + 0.5 + warp::tent(u[0])) / self.width as f32;
        // Past a pole the lookup repeats the last row; folding the density back there matches it exactly.
        let v_image = ((row as f32 + 0.5 + warp::tent(u[1])) / self.height as f32).abs();
        let v_image = 1.0 - (1.0 - v_image).abs();
        let (sin_theta, cos_theta) = sin_cos_turns(0.5 * v_image);
        let sin_theta = sin_theta.abs().max(MIN_SIN_THETA);
        let (sin_phi, cos_phi) = sin_cos_turns(u_image);
        let (x, z) = (sin_phi * sin_theta, -cos_phi * sin_theta);
        let wi = Vec3::new(
            x * self.cos_rotation + z * self.sin_rotation,
            cos_theta,
            z * self.cos_rotation - x * self.sin_rotation,
        );
        self.point(wi, u_image, v_image, sin_theta)
    }

    #[inline(always)]
    fn locate(&self, wi: Vec3) -> EnvironmentPoint {
        let x = wi.x * self.cos_rotation - wi.z * self.sin_rotation;
        let z = wi.x * self.sin_rotation + wi.z * self.cos_rotation;
        let sin_theta = (x * x + z * z).sqrt().max(MIN_SIN_THETA);
        self.point(wi, atan2_turns(x, -z), 2.0 * atan2_turns(sin_theta, wi.y), sin_theta)
    }

    /// The place at image coordinates: `u` up to whole turns, `v` in [0, 1].
    #[inline(always)]
    fn point(&self, wi: Vec3, u: f32, v: f32, sin_theta: f32) -> EnvironmentPoint {
        let (width, height) = (self.width as i32, self.height as i32);
        let column = (u - floor(u) as f32) * width as f32 - 0.5;
        let row = v * height as f32 - 0.5;
        let (left, top) = (floor(column), floor(row));
        let x0 = if left < 0 { width - 1 } else { left.min(width - 1) };
        let x1 = if x0 + 1 == width { 0 } else { x0 + 1 };
        #[allow(
            clippy::manual_clamp,
            reason = "clamp panics for reversed limits, and what may panic is not vectorised"
        )]
        let start = |row: i32| row.max(0).min(height - 1) as u32 * self.width;
        let (upper, lower) = (start(top), start(top + 1));
        EnvironmentPoint {
            wi,
            texels: [
                upper + x0 as u32,
                upper + x1 as u32,
                lower + x0 as u32,
                lower + x1 as u32,
            ],
            fraction: [column - left as f32, row - top as f32],
            sin_theta,
        }
    }
}
