//! Random numbers and the distributions drawn with them.

pub mod alias;
pub mod mis;
pub mod sampler;
pub mod warp;

pub use alias::AliasTable;
pub use sampler::{Dimension, Sampler, SamplerKind};
