//! embrace: a path tracer on Intel Embree with a pure-Rust fallback.
#![deny(unsafe_code)]

pub mod accel;
pub mod image;
pub mod math;
pub mod mesh;
pub mod scene;

#[cfg(not(any(feature = "embree", feature = "obvhs")))]
compile_error!(
    "embrace needs a ray-query backend: enable the feature `embree` (Intel Embree), the feature `obvhs` (pure Rust), or both"
);
