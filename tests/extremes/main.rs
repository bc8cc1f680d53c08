//! Numerical stability at the extremes: where renderers break. docs/numerics.md has the table of hazards and figures.

#[path = "../support/mod.rs"]
mod support;

mod accumulation;
mod degenerate;
mod environment;
mod exact;
mod furnace;
mod intersections;
mod irradiance;
mod lights;
mod many_lights;
mod materials;
mod paths;
mod placement;
mod precision;
mod reference;
mod roulette;
