//! One path at a time: what it brings and how long it is.

use crate::support::{Prepared, Stage};
use embrace::accel::Accel;
use embrace::integrator::{Batch, KernelChoice, RayCounts, SampleId, Settings, kernel_for};
use embrace::math::Rgb;

/// Traces the samples 0, 1, ... of the first pixel of a scene, each on its own.
pub(crate) fn trace<A: Accel>(stage: &Stage, settings: &Settings, paths: u32) -> Vec<(RayCounts, Rgb)> {
    let Prepared { scene, accel, .. } = stage.prepare::<A>(settings);
    let kernel = kernel_for(&scene, KernelChoice::Auto);
    let mut batch = Batch::default();
    let path = |sample| {
        let mut counts = RayCounts::default();
        assert!(batch.fill(&mut [SampleId { sample, y: 0, x: 0 }].into_iter()));
        kernel.trace(&scene, &accel, settings, &mut batch, &mut counts);
        let (_, radiance, _) = batch.results().next().expect("one path");
        (counts, radiance)
    };
    (0..paths).map(path).collect()
}
