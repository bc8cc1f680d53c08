//! A scene as a tree of objects with their parameters.

use super::super::load::LoadError;
use super::spectrum::SpectrumValue;
use crate::math::{DMat4, DVec3};
use std::path::PathBuf;

/// Where an element stands: index of the file, and line.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Place {
    pub(super) file: u32,
    pub(super) line: u32,
}

/// What an object is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Tag {
    Scene,
    Integrator,
    Sensor,
    Film,
    Sampler,
    Filter,
    Bsdf,
    Texture,
    Emitter,
    Shape,
}

impl Tag {
    pub(super) fn of(element: &str) -> Option<Tag> {
        Some(match element {
            "scene" => Tag::Scene,
            "integrator" => Tag::Integrator,
            "sensor" => Tag::Sensor,
            "film" => Tag::Film,
            "sampler" => Tag::Sampler,
            "rfilter" => Tag::Filter,
            "bsdf" => Tag::Bsdf,
            "texture" => Tag::Texture,
            "emitter" => Tag::Emitter,
            "shape" => Tag::Shape,
            _ => return None,
        })
    }

    /// The name of its element.
    pub(super) fn element(self) -> &'static str {
        match self {
            Tag::Scene => "scene",
            Tag::Integrator => "integrator",
            Tag::Sensor => "sensor",
            Tag::Film => "film",
            Tag::Sampler => "sampler",
            Tag::Filter => "rfilter",
            Tag::Bsdf => "bsdf",
            Tag::Texture => "texture",
            Tag::Emitter => "emitter",
            Tag::Shape => "shape",
        }
    }
}

/// An object: a plugin and its parameters.
#[derive(Debug)]
pub(super) struct Node {
    pub(super) tag: Tag,
    /// The value of `type`.
    pub(super) plugin: String,
    /// Empty without one.
    pub(super) id: String,
    pub(super) place: Place,
    /// Parameters and children in the order of the file.
    pub(super) properties: Vec<Property>,
}

/// A parameter of an object.
#[derive(Debug)]
pub(super) struct Property {
    /// Empty for children without a name.
    pub(super) name: String,
    pub(super) place: Place,
    pub(super) value: Value,
}

/// The value of a parameter.
#[derive(Clone, Debug)]
pub(super) enum Value {
    Boolean(bool),
    Integer(i64),
    Float(f64),
    String(String),
    Vector(DVec3),
    Rgb(DVec3),
    Spectrum(SpectrumValue),
    Transform(DMat4),
    /// Index of a node.
    Object(usize),
    /// The id of one, until all have been read.
    Reference(String),
}

/// A scene as it is written.
#[derive(Debug)]
pub(super) struct Document {
    /// The objects; the scene is the first.
    pub(super) nodes: Vec<Node>,
    pub(super) files: Vec<PathBuf>,
    /// Folders that files are looked for in, in this order.
    pub(super) search: Vec<PathBuf>,
    /// Over all files read.
    pub(super) hasher: blake3::Hasher,
}

impl Document {
    /// The file that a name of the scene stands for: the first there is of those in the scene's folders.
    pub(super) fn file(&self, name: &str) -> PathBuf {
        let mut candidates = self.search.iter().map(|folder| folder.join(name));
        // Without one, the name in the folder of the scene, for the message.
        let beside_scene = || {
            self.search
                .last()
                .map_or_else(|| PathBuf::from(name), |folder| folder.join(name))
        };
        candidates.find(|path| path.exists()).unwrap_or_else(beside_scene)
    }

    /// An error about what stands at `place`, which `what` names.
    pub(super) fn error(&self, place: Place, what: &str, problem: impl Into<String>) -> LoadError {
        LoadError::Key {
            path: self.files[place.file as usize].clone(),
            key: format!("line {}: {what}", place.line),
            problem: problem.into(),
        }
    }

    /// Where something stands, for notes: file and line.
    pub(super) fn describe(&self, place: Place) -> String {
        format!("{}:{}", self.files[place.file as usize].display(), place.line)
    }

    /// An object that contains itself could not be converted, and would be converted for ever.
    pub(super) fn refuse_cycles(&self) -> Result<(), LoadError> {
        // The nodes on the way, each with the number of its properties that are done.
        let mut is_done = vec![false; self.nodes.len()];
        let mut is_on_way = vec![false; self.nodes.len()];
        for start in 0..self.nodes.len() {
            let mut way = vec![(start, 0)];
            while let Some((node, next)) = way.pop() {
                if is_done[node] {
                    continue;
                }
                is_on_way[node] = true;
                let Some(property) = self.nodes[node].properties.get(next) else {
                    is_on_way[node] = false;
                    is_done[node] = true;
                    continue;
                };
                way.push((node, next + 1));
                let Value::Object(child) = property.value else {
                    continue;
                };
                if is_on_way[child] {
                    let problem = format!("refers to \"{}\", which contains it", self.nodes[child].id);
                    return Err(self.error(property.place, "<ref>", problem + "; remove one of the references"));
                }
                way.push((child, 0));
            }
        }
        Ok(())
    }
}
