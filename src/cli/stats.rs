//! What `--stats` writes.

use super::outcome::Ending;
use crate::error::{ErrorEstimate, Interval};
use crate::integrator::RayCounts;
use crate::render::DroppedSamples;
use rustix::time::{ClockId, clock_gettime};
use serde::Serialize;

/// One object; all times are in seconds.
#[derive(Serialize)]
pub(super) struct Stats<'a> {
    pub(super) version: &'a str,
    pub(super) scene: String,
    pub(super) scene_hash: &'a str,
    pub(super) backend: &'a str,
    pub(super) backend_version: String,
    pub(super) kernel: String,
    pub(super) intersector: &'static str,
    pub(super) build_quality: &'static str,
    pub(super) threads: usize,
    pub(super) width: u32,
    pub(super) height: u32,
    /// The fewest samples of a pixel, and the most.
    pub(super) spp: u32,
    pub(super) spp_most: u32,
    pub(super) spp_mean: f64,
    pub(super) seed: u64,
    pub(super) interrupted: bool,
    /// What ended it.
    pub(super) stopped_by: Ending,
    /// `null` where the error is not estimated.
    pub(super) error: Option<ErrorStats>,
    pub(super) load_seconds: f64,
    pub(super) build_seconds: f64,
    pub(super) render_seconds: f64,
    pub(super) render_cpu_seconds: f64,
    pub(super) write_seconds: f64,
    pub(super) triangles: u64,
    pub(super) instances: usize,
    pub(super) lights: usize,
    pub(super) paths: u64,
    pub(super) paths_per_second: f64,
    pub(super) rays: Rays,
    pub(super) dropped_samples: DroppedSamples,
    pub(super) peak_memory_bytes: u64,
    pub(super) warnings: &'a [String],
}

/// The error of the image by its own estimate, with the ends of the 95 % intervals.
#[derive(Clone, Copy, Debug, Serialize)]
pub(super) struct ErrorStats {
    confidence: f64,
    relmse: Interval,
    relative_rmse: Interval,
    mse: Interval,
    rmse: Interval,
}

impl From<ErrorEstimate> for ErrorStats {
    fn from(error: ErrorEstimate) -> ErrorStats {
        ErrorStats {
            confidence: 0.95,
            relmse: error.relmse,
            relative_rmse: error.relative_rmse(),
            mse: error.mse,
            rmse: error.rmse(),
        }
    }
}

#[derive(Serialize)]
pub(super) struct Rays {
    pub(super) camera: u64,
    pub(super) bounce: u64,
    pub(super) shadow: u64,
}

impl From<RayCounts> for Rays {
    fn from(rays: RayCounts) -> Rays {
        let RayCounts { camera, bounce, shadow } = rays;
        Rays { camera, bounce, shadow }
    }
}

/// Processor time of all threads so far.
pub(super) fn process_seconds() -> f64 {
    let time = clock_gettime(ClockId::ProcessCPUTime);
    time.tv_sec as f64 + time.tv_nsec as f64 * 1e-9
}

/// The most memory that the process has held; 0 where the system does not tell.
pub(super) fn peak_memory_bytes() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let kibibytes = status
        .lines()
        .find_map(|line| line.strip_prefix("VmHWM:"))
        .and_then(|rest| rest.trim().trim_end_matches("kB").trim().parse::<u64>().ok());
    kibibytes.unwrap_or(0) * 1024
}
