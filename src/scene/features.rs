//! What a scene requires, as a few bits: the path kernel is compiled for sets of them.

use std::fmt;

/// A set of things that a scene contains. What is not in it costs nothing: the code is not in the kernel.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SceneFeatures(pub u32);

impl SceneFeatures {
    /// Light from infinity.
    pub const ENVIRONMENT: SceneFeatures = SceneFeatures(1);
    /// Emitting triangles.
    pub const AREA_LIGHTS: SceneFeatures = SceneFeatures(1 << 1);
    /// Colours that vary over a surface.
    pub const TEXTURES: SceneFeatures = SceneFeatures(1 << 2);
    /// Vertex normals.
    pub const SMOOTH_NORMALS: SceneFeatures = SceneFeatures(1 << 3);
    /// Any scattering but plain diffuse.
    pub const SPECULAR: SceneFeatures = SceneFeatures(1 << 4);
    /// Surfaces that are not opaque everywhere.
    pub const CUTOUTS: SceneFeatures = SceneFeatures(1 << 5);
    /// Materials that take more than a look at their parameters: see [`crate::material::Material::is_general`].
    pub const GENERAL: SceneFeatures = SceneFeatures(1 << 6);
    /// Emitters that are neither triangles of one radiance nor the environment: points, spots, light from far away, and emission
    /// that varies over a surface.
    pub const PUNCTUAL: SceneFeatures = SceneFeatures(1 << 7);
    /// All of the above: serves every scene.
    pub const ALL: SceneFeatures = SceneFeatures((1 << 8) - 1);

    const NAMES: [(SceneFeatures, &'static str); 8] = [
        (SceneFeatures::ENVIRONMENT, "environment"),
        (SceneFeatures::AREA_LIGHTS, "area-lights"),
        (SceneFeatures::TEXTURES, "textures"),
        (SceneFeatures::SMOOTH_NORMALS, "smooth-normals"),
        (SceneFeatures::SPECULAR, "specular"),
        (SceneFeatures::CUTOUTS, "cutouts"),
        (SceneFeatures::GENERAL, "general-materials"),
        (SceneFeatures::PUNCTUAL, "punctual-lights"),
    ];

    /// Whether every bit of `other` is set.
    pub const fn contains(self, other: SceneFeatures) -> bool {
        self.0 & other.0 == other.0
    }

    /// Both sets together.
    pub const fn union(self, other: SceneFeatures) -> SceneFeatures {
        SceneFeatures(self.0 | other.0)
    }

    /// `self` if the condition holds, else nothing.
    pub const fn when(self, condition: bool) -> SceneFeatures {
        if condition { self } else { SceneFeatures(0) }
    }

    /// The names of the bits that are set.
    pub fn names(self) -> Vec<&'static str> {
        SceneFeatures::NAMES
            .iter()
            .filter(|(bit, _)| self.contains(*bit))
            .map(|(_, name)| *name)
            .collect()
    }
}

impl fmt::Display for SceneFeatures {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            SceneFeatures::ALL => f.write_str("all"),
            SceneFeatures(0) => f.write_str("none"),
            _ => f.write_str(&self.names().join("+")),
        }
    }
}
