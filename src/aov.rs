//! Arbitrary output variables (AOVs): what can be written beside the image, as layers of the same EXR file.
//!
//! Variance, sample counts and direct and indirect light come from the film. The others describe the first surface that a
//! pixel sees. They are taken in a pass of their own, [`FirstHits`], over the camera rays of the image's own first samples:
//! edges and blur lie where the image has them, and a render without them pays nothing.
//!
//! A pixel has the mean over its samples (a box filter), so that it is between the two sides of an edge as its colour is.
//! Where a sample meets nothing, albedo and normal are zero; position and depth are means over the samples that meet
//! something, since a mean with nowhere is no place.

use crate::accel::Accel;
use crate::film::{Film, Rect};
use crate::image::exr::Layer;
use crate::integrator::{Batch, Kernel, SampleId, Settings};
use crate::interaction::SurfaceInteraction;
use crate::math::DVec3;
use crate::sampling::{Dimension, Sampler};
use crate::scene::{Scene, nearest};
use rayon::prelude::*;
use thiserror::Error;

/// Most samples per pixel that describe the first surface. As many stratified ones leave little noise at edges, and the pass
/// stays short beside the image; the number is not tuned.
const MAX_SAMPLES: u32 = 64;

/// What a layer tells of each pixel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Aov {
    /// Estimated variance of the pixel's mean, the square of its standard error: [`crate::film::PixelSums::variance`].
    Variance,
    /// Number of samples.
    Samples,
    /// Share of light along the normal that the surface scatters: [`crate::bsdf::Bsdf::albedo`].
    Albedo,
    /// Shading normal on the side of the viewer, in world coordinates. A mean of unit vectors, thus shorter than one where
    /// they differ.
    Normal,
    /// Distance from the camera along the view; infinite where nothing is met.
    Depth,
    /// Point in the world coordinates of the scene file; zero where nothing is met.
    Position,
    /// Emission seen directly, and light scattered once.
    Direct,
    /// Light scattered more than once: the image without the direct light.
    Indirect,
}

/// Why a list of AOVs is none.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
pub enum AovError {
    /// There is none of this name.
    #[error("`{0}` is not an AOV{hint}; there are {all}", hint = hint(.0), all = Aov::ALL.map(Aov::name).join(", "))]
    Unknown(String),
    /// One is named more than once.
    #[error("`{0}` is named twice")]
    Twice(&'static str),
}

fn hint(name: &str) -> String {
    let near = nearest(name, Aov::ALL.into_iter().map(Aov::name));
    near.map_or_else(String::new, |near| format!("; did you mean `{near}`?"))
}

impl Aov {
    /// All, in the order of the documentation.
    pub const ALL: [Aov; 8] = [
        Aov::Variance,
        Aov::Samples,
        Aov::Albedo,
        Aov::Normal,
        Aov::Depth,
        Aov::Position,
        Aov::Direct,
        Aov::Indirect,
    ];

    /// Parses a list of names with commas between them.
    ///
    /// # Errors
    /// If a name is unknown, empty, or given twice.
    pub fn parse_list(list: &str) -> Result<Vec<Aov>, AovError> {
        let mut aovs = Vec::new();
        for name in list.split(',').map(str::trim) {
            let known = Aov::ALL.into_iter().find(|aov| aov.name() == name);
            let aov = known.ok_or_else(|| AovError::Unknown(name.to_owned()))?;
            if aovs.contains(&aov) {
                return Err(AovError::Twice(aov.name()));
            }
            aovs.push(aov);
        }
        Ok(aovs)
    }

    /// The name on the command line and of the layer.
    pub const fn name(self) -> &'static str {
        match self {
            Aov::Variance => "variance",
            Aov::Samples => "samples",
            Aov::Albedo => "albedo",
            Aov::Normal => "normal",
            Aov::Depth => "depth",
            Aov::Position => "position",
            Aov::Direct => "direct",
            Aov::Indirect => "indirect",
        }
    }

    /// The channels of the layer.
    pub const fn channels(self) -> &'static [&'static str] {
        match self {
            Aov::Variance | Aov::Albedo | Aov::Direct | Aov::Indirect => &["R", "G", "B"],
            Aov::Normal | Aov::Position => &["X", "Y", "Z"],
            Aov::Depth => &["Z"],
            Aov::Samples => &["Y"],
        }
    }

    /// Whether it tells of the first surface, and so comes from [`FirstHits`].
    pub const fn is_of_first_hit(self) -> bool {
        matches!(self, Aov::Albedo | Aov::Normal | Aov::Depth | Aov::Position)
    }

    /// Whether it is a part of the light, for which the film has to be one of [`Film::split_direct`].
    pub const fn is_part_of_light(self) -> bool {
        matches!(self, Aov::Direct | Aov::Indirect)
    }

    /// The layer of these values of all pixels, row by row.
    pub fn layer<const N: usize>(self, pixels: Vec<[f32; N]>) -> Layer {
        Layer {
            name: self.name(),
            channels: self.channels(),
            values: pixels.into_flattened(),
        }
    }
}

/// One of the layers that the film tells of; `None` for the others, and for the parts of the light if they are not kept apart.
pub fn layer_of(film: &Film, aov: Aov) -> Option<Layer> {
    Some(match aov {
        Aov::Variance => aov.layer(film.map(|pixel| pixel.variance().map(|v| v as f32)).pixels),
        Aov::Samples => aov.layer(film.map(|pixel| [pixel.samples() as f32]).pixels),
        Aov::Direct => aov.layer(film.map_parts(|[direct, _]| direct.map(|s| s as f32))?.pixels),
        Aov::Indirect => aov.layer(film.map_parts(|[_, indirect]| indirect.map(|s| s as f32))?.pixels),
        Aov::Albedo | Aov::Normal | Aov::Depth | Aov::Position => return None,
    })
}

/// The first surface that each pixel of a part of the image sees.
#[derive(Clone, Debug, PartialEq)]
pub struct FirstHits {
    /// Row by row.
    pixels: Vec<Pixel>,
}

/// Means over the samples of a pixel.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Pixel {
    albedo: [f32; 3],
    normal: [f32; 3],
    position: [f32; 3],
    depth: f32,
}

/// Sums over the samples of a pixel, in the order of their index.
#[derive(Clone, Copy, Debug, Default)]
struct Sums {
    albedo: DVec3,
    normal: DVec3,
    position: DVec3,
    depth: f64,
    hits: u32,
}

impl Sums {
    fn means(&self, samples: u32) -> Pixel {
        let of_hits = 1.0 / f64::from(self.hits.max(1));
        let of_all = 1.0 / f64::from(samples);
        let rounded = |mean: DVec3| mean.as_vec3().to_array();
        Pixel {
            albedo: rounded(self.albedo * of_all),
            normal: rounded(self.normal * of_all),
            position: rounded(self.position * of_hits),
            depth: if self.hits == 0 {
                f32::INFINITY
            } else {
                (self.depth * of_hits) as f32
            },
        }
    }
}

impl FirstHits {
    /// Traces the camera rays of the samples from 0 to `spp`, but 64 at most, of every pixel of `crop`, on the threads of the
    /// current rayon pool. The result depends neither on the threads nor on the crop. `stop` is asked every few hundred rays;
    /// `None` once it says yes.
    pub fn trace<A: Accel>(
        scene: &Scene,
        accel: &A,
        kernel: Kernel,
        settings: &Settings,
        crop: Rect,
        spp: u32,
        stop: &(dyn Fn() -> bool + Sync),
    ) -> Option<FirstHits> {
        let samples = spp.clamp(1, MAX_SAMPLES);
        let row_of_blocks = |block: Rect| Rect {
            y0: block.y0,
            y1: block.y1,
            ..crop
        };
        let first_column = Rect {
            x1: crop.x0 + 1,
            ..crop
        };
        let bands: Vec<Rect> = first_column.blocks().map(row_of_blocks).collect();
        let trace_band = |batch: &mut Batch, band: Rect| {
            let mut sums = vec![Sums::default(); band.pixels() as usize];
            // The order of the image, in which the rays of a block are traced together.
            let mut ids = band.blocks().flat_map(|block| {
                (0..samples).flat_map(move |sample| block.coordinates().map(move |(x, y)| SampleId { sample, y, x }))
            });
            while batch.fill(&mut ids) {
                if stop() {
                    return None;
                }
                for (SampleId { x, y, sample }, ray, hit) in kernel.first_hits(scene, accel, settings, batch) {
                    let Some(mut si) = SurfaceInteraction::new::<true>(&scene.geometry, &ray, &hit, false) else {
                        continue;
                    };
                    // Mixtures are chosen from by the sampler, as the image does.
                    let sampler = Sampler::new(settings.sampler, settings.seed, x, y, sample);
                    let (bsdf, _) = scene.general_bsdf(&hit, &mut si, || sampler.get_1d(Dimension::Blend));
                    let sums = &mut sums[((y - band.y0) * band.width() + (x - band.x0)) as usize];
                    sums.albedo += DVec3::from(bsdf.albedo().to_array().map(f64::from));
                    sums.normal += si.frame.n.as_dvec3();
                    sums.position += scene.origin + si.p.as_dvec3();
                    sums.depth += f64::from(scene.camera.depth(si.p));
                    sums.hits += 1;
                }
            }
            Some(sums.iter().map(|sums| sums.means(samples)).collect::<Vec<_>>())
        };
        let bands: Option<Vec<Vec<Pixel>>> = bands.into_par_iter().map_init(Batch::default, trace_band).collect();
        Some(FirstHits {
            pixels: bands?.concat(),
        })
    }

    /// One of the layers that tell of the first surface; `None` for the others.
    pub fn layer(&self, aov: Aov) -> Option<Layer> {
        fn of<const N: usize>(pixels: &[Pixel], value: impl Fn(&Pixel) -> [f32; N]) -> Vec<[f32; N]> {
            pixels.iter().map(value).collect()
        }
        Some(match aov {
            Aov::Albedo => aov.layer(of(&self.pixels, |pixel| pixel.albedo)),
            Aov::Normal => aov.layer(of(&self.pixels, |pixel| pixel.normal)),
            Aov::Position => aov.layer(of(&self.pixels, |pixel| pixel.position)),
            Aov::Depth => aov.layer(of(&self.pixels, |pixel| [pixel.depth])),
            Aov::Variance | Aov::Samples | Aov::Direct | Aov::Indirect => return None,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lists_of_names_are_parsed_in_their_order() {
        let list = "variance,samples,albedo,normal,depth,position,direct,indirect";
        assert_eq!(Aov::parse_list(list).unwrap(), Aov::ALL);
        assert_eq!(
            Aov::parse_list("depth, albedo").unwrap(),
            [Aov::Depth, Aov::Albedo],
            "spaces do not matter"
        );
    }

    #[test]
    fn names_that_are_unknown_or_stand_twice_are_refused() {
        for (list, part) in [
            (
                "depth,normla",
                "`normla` is not an AOV; did you mean `normal`?; there are variance, ",
            ),
            (
                "cryptomatte",
                "`cryptomatte` is not an AOV; there are variance, samples, albedo, ",
            ),
            ("", "`` is not an AOV"),
            ("depth,", "`` is not an AOV"),
            ("Depth", "did you mean `depth`?"),
            ("depth,normal,depth", "`depth` is named twice"),
        ] {
            let message = Aov::parse_list(list).unwrap_err().to_string();
            assert!(message.starts_with(part) || message.contains(part), "{list}: {message}");
        }
    }
}
