//! Light from far away: parallel, or from a disc such as the sun's.

use super::{LightSample, delta_sample};
use crate::math::{DVec3, Frame, Rgb, Vec3};
use crate::sampling::warp;
use std::f64::consts::{PI, TAU};

/// Radius [rad] below which a disc is parallel light: directions in f32 are a few percent of it apart.
const SMALLEST_RADIUS: f64 = 1e-6;

/// Up to this many lights, one is chosen by what each brings to the point; among more by irradiance on a surface that faces
/// it, in logarithmic time.
const FEW: usize = 16;

/// Mean cosine at the receiver of light from anywhere.
const MEAN_COS: f64 = 0.25;

/// Cosine of the angle between receiver and light from which on a light is left out: rounding at the horizon.
const BELOW: f32 = -1e-6;

/// Mean cosine at the receiver of a disc that its horizon cuts in half, over the sine of the disc's radius.
const HALF_UP: f32 = 0.4;

/// Light that comes from the same direction everywhere.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DistantLight {
    /// Around the unit direction towards the light.
    frame: Frame,
    /// On a surface that faces it [W·m⁻²].
    irradiance: Rgb,
    disc: Option<Disc>,
}

/// A disc of uniform radiance.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Disc {
    radiance: Rgb,
    sin_radius: f32,
    /// 1 − cosine of the radius.
    height: f32,
    /// Of its directions, drawn uniformly [1/sr].
    pdf_w: f32,
}

impl DistantLight {
    /// Light that goes along `direction` (any length above 0) and brings so much to a surface that faces it [W·m⁻²]. `radius`:
    /// of the disc that it comes from, an angle in radians, in [0, π/2); 0 is parallel light.
    pub fn new(direction: DVec3, irradiance: Rgb, radius: f64) -> DistantLight {
        let height = 2.0 * (0.5 * radius).sin().powi(2);
        let disc = Disc {
            radiance: irradiance.map(|c| (f64::from(c) / (PI * radius.sin().powi(2))) as f32),
            sin_radius: radius.sin() as f32,
            height: height as f32,
            pdf_w: (TAU * height).recip() as f32,
        };
        DistantLight {
            frame: Frame::from_normal(-direction.normalize().as_vec3()),
            irradiance,
            disc: (radius >= SMALLEST_RADIUS && disc.radiance.is_finite()).then_some(disc),
        }
    }

    /// Radiance from the unit direction `wi`, if the disc is there.
    #[inline]
    fn radiance(&self, wi: Vec3) -> Option<Rgb> {
        let disc = self.disc.as_ref()?;
        ((wi - self.frame.n).length_squared() <= 2.0 * disc.height).then_some(disc.radiance)
    }

    /// A direction towards the light from a place `u`, the light being drawn with probability `pmf`. `None` if it is black.
    #[inline]
    fn sample(&self, pmf: f32, u: [f32; 2]) -> Option<LightSample> {
        let Some(disc) = &self.disc else {
            return delta_sample(self.frame.n, self.irradiance, pmf, None);
        };
        let [x, y] = warp::disk(u);
        // Uniform in 1 − cos of the angle to the axis.
        let height = (x * x + y * y) * disc.height;
        let stretch = (disc.height * (2.0 - height)).sqrt();
        let local = Vec3::new(x * stretch, y * stretch, 1.0 - height);
        (!disc.radiance.is_black() && pmf > 0.0).then(|| LightSample {
            wi: self.frame.to_world(local),
            radiance: disc.radiance,
            pdf_w: pmf * disc.pdf_w,
            target: None,
        })
    }

    /// Estimated irradiance on a surface with the unit normal `n`, without occlusion: luminance; that on one which faces the
    /// light for zero, which is both sides. 0 only where nothing of the light is above the horizon.
    fn contribution(&self, n: Vec3) -> f64 {
        let cos = if n == Vec3::ZERO { 1.0 } else { n.dot(self.frame.n) };
        let sin_radius = self.disc.as_ref().map_or(0.0, |disc| disc.sin_radius);
        if cos + sin_radius <= BELOW {
            return 0.0;
        }
        let mean = cos.max(HALF_UP * (cos + sin_radius)).max(-BELOW);
        f64::from(self.irradiance.luminance()) * f64::from(mean)
    }
}

/// All lights from far away, and the choice between them.
#[derive(Clone, Debug, Default)]
pub(super) struct DistantLights {
    lights: Vec<DistantLight>,
    /// Running sums of irradiance; empty where the choice depends on the receiver.
    sums: Vec<f64>,
    /// Those with a disc.
    discs: Vec<u32>,
}

impl DistantLights {
    /// `by_power`: whether the receiver does not count.
    pub(super) fn new(lights: Vec<DistantLight>, by_power: bool) -> DistantLights {
        let mut sum = 0.0;
        let mut sums = Vec::new();
        if by_power || lights.len() > FEW {
            sums.extend(lights.iter().map(|light| {
                sum += f64::from(light.irradiance.luminance());
                sum
            }));
        }
        let discs = (0..lights.len() as u32).filter(|&i| lights[i as usize].disc.is_some());
        DistantLights {
            discs: discs.collect(),
            lights,
            sums,
        }
    }

    pub(super) fn len(&self) -> usize {
        self.lights.len()
    }

    pub(super) fn is_empty(&self) -> bool {
        self.lights.is_empty()
    }

    pub(super) fn has_discs(&self) -> bool {
        !self.discs.is_empty()
    }

    /// Irradiance by all lights on a surface that faces each [W·m⁻²]: luminance.
    pub(super) fn facing(&self) -> f64 {
        self.lights
            .iter()
            .map(|light| f64::from(light.irradiance.luminance()))
            .sum()
    }

    /// Estimated irradiance on a surface with the unit normal `n`, or none if it takes light from both sides, without occlusion
    /// [W·m⁻²]: luminance.
    pub(super) fn irradiance(&self, n: Vec3) -> f64 {
        match self.sums.last() {
            None => self.lights.iter().map(|light| light.contribution(n)).sum(),
            Some(sum) if n == Vec3::ZERO => *sum,
            Some(sum) => MEAN_COS * sum,
        }
    }

    /// Draws a light by `u` in [0, 1): its index and probability. `None` where nothing can contribute.
    pub(super) fn choose(&self, u: f64, n: Vec3) -> Option<(u32, f32)> {
        let index = if let Some(sum) = self.sums.last() {
            // Rounding may lead past the last.
            let at = self.sums.partition_point(|before| *before <= u * sum);
            at.min(self.lights.len() - 1)
        } else {
            let at = u * self.irradiance(n);
            let mut sum = 0.0;
            let mut chosen = None;
            for (i, light) in self.lights.iter().enumerate() {
                let contribution = light.contribution(n);
                if contribution > 0.0 && (chosen.is_none() || sum <= at) {
                    chosen = Some(i);
                }
                sum += contribution;
            }
            chosen?
        };
        let pmf = self.pmf(index as u32, n);
        (pmf > 0.0).then_some((index as u32, pmf))
    }

    /// The probability with which [`DistantLights::choose`] draws a light: the same bits.
    pub(super) fn pmf(&self, index: u32, n: Vec3) -> f32 {
        let i = index as usize;
        let (share, all) = match self.sums.last() {
            Some(sum) => (self.sums[i] - if i == 0 { 0.0 } else { self.sums[i - 1] }, *sum),
            None => (self.lights[i].contribution(n), self.irradiance(n)),
        };
        if share > 0.0 { (share / all) as f32 } else { 0.0 }
    }

    /// See [`DistantLight::sample`].
    pub(super) fn sample(&self, index: u32, pmf: f32, u: [f32; 2]) -> Option<LightSample> {
        self.lights[index as usize].sample(pmf, u)
    }

    /// Discs that a ray along the unit direction `wi` meets, and their radiance.
    pub(super) fn met(&self, wi: Vec3) -> impl Iterator<Item = (u32, Rgb)> {
        let radiance = move |&i: &u32| self.lights[i as usize].radiance(wi).map(|radiance| (i, radiance));
        self.discs.iter().filter_map(radiance)
    }

    /// Density of the directions to a disc, drawn uniformly [1/sr]; 0 for parallel light.
    pub(super) fn disc_pdf_w(&self, index: u32) -> f32 {
        self.lights[index as usize].disc.as_ref().map_or(0.0, |disc| disc.pdf_w)
    }

    pub(super) fn memory_bytes(&self) -> usize {
        size_of_val(&*self.lights) + size_of_val(&*self.sums) + size_of_val(&*self.discs)
    }
}
