//! embrace: a path tracer on Intel Embree with a pure-Rust fallback.
#![deny(unsafe_code)]

pub mod accel;
pub mod adaptive;
pub mod aov;
pub mod bsdf;
pub mod camera;
pub mod cli;
pub mod columns;
pub mod error;
mod files;
pub mod film;
pub mod image;
pub mod integrator;
pub mod interaction;
pub mod light;
pub mod material;
pub mod math;
pub mod mesh;
pub mod render;
pub mod sampling;
pub mod scene;
pub mod study;
pub mod texture;

#[cfg(not(any(feature = "embree", feature = "obvhs")))]
compile_error!(
    "embrace needs a ray-query backend: enable the feature `embree` (Intel Embree), the feature `obvhs` (pure Rust), or both"
);
