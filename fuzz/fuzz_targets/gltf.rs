#![no_main]

#[path = "../harness.rs"]
mod harness;

harness::target!(gltf);
