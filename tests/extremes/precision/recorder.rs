//! Paths in f32 as the renderer takes them: a backend that writes down what it is asked and what it answers.

use embrace::accel::{Accel, AccelError, BuildOptions, Geometry, Hit, Intersector, Ray};
use embrace::film::Rect;
use embrace::integrator::{Batch, KernelChoice, RayCounts, SampleId, Settings, kernel_for};
use embrace::math::Rgb;
use embrace::scene::Scene;
use std::sync::{Mutex, PoisonError};

/// A path in f32.
pub(super) struct Path {
    pub(super) radiance: Rgb,
    pub(super) vertices: Vec<Vertex>,
}

/// One step of it.
pub(super) struct Vertex {
    /// The ray that leads here.
    pub(super) ray: Ray,
    /// What it meets.
    pub(super) hit: Option<Hit>,
    /// The ray towards the emitter sample, if there is one, and whether it is occluded.
    pub(super) shadow: Option<(Ray, bool)>,
}

/// The path of one sample, by the renderer's own kernel.
pub(super) fn path<A: Accel>(scene: &Scene, accel: &Recorder<A>, settings: &Settings, id: SampleId) -> Path {
    let kernel = kernel_for(scene, KernelChoice::Auto);
    let mut batch = Batch::default();
    assert!(batch.fill(&mut [id].into_iter()));
    kernel.trace(scene, accel, settings, &mut batch, &mut RayCounts::default());
    let (_, radiance, _) = batch.results().next().expect("the sample asked for");

    let [x1, y1] = scene.camera.resolution();
    let block = Rect::block(id.x, id.y).intersection(Rect { x0: 0, y0: 0, x1, y1 });
    let place = block.coordinates().position(|pixel| pixel == (id.x, id.y));
    let mut vertices: Vec<Vertex> = Vec::new();
    for query in accel.take() {
        let vertex = |(ray, hit)| Vertex { ray, hit, shadow: None };
        match query {
            // The rays of the whole block are traced for the sake of the one.
            Query::Camera(rays) => vertices.push(vertex(rays[place.expect("the pixel is in its block")])),
            Query::Bounce(ray, hit) => vertices.push(vertex((ray, hit))),
            Query::Shadow(ray, occluded) => {
                vertices.last_mut().expect("a shadow ray starts at a hit").shadow = Some((ray, occluded));
            }
        }
    }
    Path { radiance, vertices }
}

/// Wraps a backend.
pub(super) struct Recorder<A> {
    backend: A,
    queries: Mutex<Vec<Query>>,
}

enum Query {
    Camera(Vec<(Ray, Option<Hit>)>),
    Bounce(Ray, Option<Hit>),
    Shadow(Ray, bool),
}

impl<A> Recorder<A> {
    fn record(&self, queries: impl Iterator<Item = Query>) {
        self.queries
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .extend(queries);
    }

    fn take(&self) -> Vec<Query> {
        std::mem::take(&mut *self.queries.lock().unwrap_or_else(PoisonError::into_inner))
    }
}

impl<A: Accel> Accel for Recorder<A> {
    const NAME: &'static str = A::NAME;
    const INTERSECTORS: &'static [Intersector] = A::INTERSECTORS;

    fn build(geometry: &Geometry, options: BuildOptions) -> Result<Self, AccelError> {
        Ok(Recorder {
            backend: A::build(geometry, options)?,
            queries: Mutex::default(),
        })
    }

    fn intersect(&self, ray: &Ray) -> Option<Hit> {
        let hit = self.backend.intersect(ray);
        self.record([Query::Bounce(*ray, hit)].into_iter());
        hit
    }

    fn occluded(&self, ray: &Ray) -> bool {
        let occluded = self.backend.occluded(ray);
        self.record([Query::Shadow(*ray, occluded)].into_iter());
        occluded
    }

    fn intersect_coherent(&self, rays: &[Ray], hits: &mut Vec<Option<Hit>>) {
        let first = hits.len();
        self.backend.intersect_coherent(rays, hits);
        let answers = rays.iter().copied().zip(hits[first..].iter().copied());
        self.record([Query::Camera(answers.collect())].into_iter());
    }

    fn occluded_many(&self, rays: &[Ray], occluded: &mut Vec<bool>) {
        let first = occluded.len();
        self.backend.occluded_many(rays, occluded);
        let answers = rays.iter().zip(&occluded[first..]);
        self.record(answers.map(|(ray, occluded)| Query::Shadow(*ray, *occluded)));
    }

    fn memory_bytes(&self) -> usize {
        self.backend.memory_bytes()
    }

    fn version() -> String {
        A::version()
    }
}
