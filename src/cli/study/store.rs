//! The folder of a study: what is finished is kept, each file whole or not at all, and used again if it is of this study.

use crate::cli::output::{self, write_atomically};
use crate::cli::{Failure, tell};
use crate::image::exr::{self, ExrMetadata};
use crate::image::{Image, display, flip, ldr};
use crate::math::Rgb;
use crate::study::cell::{Cell, CellKey, Pictures};
use crate::study::measure::Pixels;
use crate::study::reference::{Noise, Reference, Target};
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use std::fs;
use std::path::{Path, PathBuf};

/// A finished part, and what it is of.
#[derive(Serialize, Deserialize)]
struct Kept<K, T> {
    key: K,
    result: T,
}

/// What must be the same for a stored reference to be used again.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct ReferenceKey {
    pub(super) version: String,
    pub(super) scene_hash: String,
    pub(super) target: Target,
    pub(super) resolution: [u32; 2],
    pub(super) arguments: String,
    pub(super) max_depth: Option<u32>,
    pub(super) backend: String,
    pub(super) spp: u32,
    pub(super) seed: u64,
}

/// What the images of a reference do not say.
#[derive(Serialize, Deserialize)]
struct ReferenceResult {
    noise: Noise,
    /// Of the pixels.
    hash: String,
}

pub(super) struct Store {
    folder: PathBuf,
    quiet: bool,
    exposure: f32,
}

impl Store {
    /// Makes the folder, and checks that files can be made in it.
    pub(super) fn new(folder: &Path, quiet: bool, exposure: f32) -> Result<Store, Failure> {
        for part in ["cells", "pictures"] {
            let path = folder.join(part);
            fs::create_dir_all(&path).map_err(|e| {
                Failure::output(format!(
                    "{}: cannot be made: {e}; choose another folder with -o",
                    path.display()
                ))
            })?;
            output::check_writable(&path.join("test"))?;
        }
        output::check_writable(&folder.join("study.json"))?;
        Ok(Store {
            folder: folder.to_owned(),
            quiet,
            exposure,
        })
    }

    pub(super) fn path(&self, name: impl AsRef<Path>) -> PathBuf {
        self.folder.join(name)
    }

    /// A finished part, if it is there, whole, and of this study; if not, says why.
    pub(super) fn kept<K, T>(&self, name: &str, key: &K) -> Option<T>
    where
        K: DeserializeOwned + PartialEq,
        T: DeserializeOwned,
    {
        let path = self.path(name);
        let bytes = fs::read(&path).ok()?;
        match serde_json::from_slice::<Kept<K, T>>(&bytes) {
            Ok(kept) if kept.key == *key => return Some(kept.result),
            Ok(_) => self.again(&path, "is of another scene, version or setting"),
            // A key of another form is another version's.
            Err(_) => self.again(&path, "is damaged or of another version"),
        }
        None
    }

    fn again(&self, path: &Path, why: &str) {
        if !self.quiet {
            tell(format_args!("note: {} {why}: made again", path.display()));
        }
    }

    pub(super) fn keep<K: Serialize, T: Serialize>(&self, name: &str, key: K, result: T) -> Result<(), Failure> {
        write_atomically(&self.path(name), |writer| {
            serde_json::to_writer(writer, &Kept { key, result })
        })
    }

    /// A finished cell with its pictures.
    pub(super) fn cell(&self, key: &CellKey) -> Option<Cell> {
        let cell = self.kept(&cell_name(key), key)?;
        let pictures = picture_names(&key.setting, key.spp);
        match pictures.iter().find(|name| !self.path(name).is_file()) {
            None => Some(cell),
            Some(name) => {
                self.again(&self.path(name), "is missing");
                None
            }
        }
    }

    /// The cell last: it says that the pictures are there.
    pub(super) fn keep_cell(&self, key: &CellKey, cell: &Cell, pictures: &Pictures) -> Result<(), Failure> {
        let [image, flip] = picture_names(&key.setting, key.spp);
        self.png(&image, &display::to_srgb8(&pictures.image, self.exposure))?;
        self.png(&flip, &flip::heat_map(&pictures.flip))?;
        self.keep(&cell_name(key), key, cell)
    }

    pub(super) fn png(&self, name: &str, image: &Image<[u8; 3]>) -> Result<(), Failure> {
        let path = self.path(name);
        write_atomically(&path, |writer| ldr::write_png(writer, image, &path))
    }

    /// For the report; without pictures it is still one.
    pub(super) fn read(&self, name: &str) -> Option<Vec<u8>> {
        fs::read(self.path(name)).ok()
    }

    pub(super) fn reference(&self, key: &ReferenceKey) -> Option<Reference> {
        let names = ReferenceNames::of(key.target);
        let result: ReferenceResult = self.kept(&names.result, key)?;
        let image = |name: &str| {
            let path = self.path(name);
            exr::read(&fs::read(&path).ok()?, &path).ok()
        };
        let reference = image(&names.image).zip(image(&names.variance)).map(|(mean, variance)| {
            let variance = variance.pixels.iter().map(|p| f64::from(p.r)).collect();
            Reference::new(Pixels::of_image(&mean), Some((result.noise, variance)))
        });
        let reference = reference.filter(|reference| reference.hash == result.hash);
        if reference.is_none() {
            self.again(&self.path(&names.image), "or its variance is missing or damaged");
        }
        reference
    }

    pub(super) fn keep_reference(&self, key: &ReferenceKey, reference: &Reference) -> Result<(), Failure> {
        let Some((noise, variance)) = &reference.noise else {
            return Ok(());
        };
        let names = ReferenceNames::of(key.target);
        let metadata = ExrMetadata {
            scene_hash: Some(key.scene_hash.clone()),
            spp: Some(key.spp),
            seed: Some(key.seed),
            backend: Some(key.backend.clone()),
            ..output::metadata()
        };
        let write = |name: &str, image: &Image<Rgb>| {
            let path = self.path(name);
            write_atomically(&path, |writer| exr::write(writer, image, &metadata, &path))
        };
        let variance = Image {
            width: key.resolution[0],
            height: key.resolution[1],
            pixels: variance.iter().map(|&v| Rgb::splat(v as f32)).collect(),
        };
        write(&names.image, &reference.pixels.to_image())?;
        write(&names.variance, &variance)?;
        let result = ReferenceResult {
            noise: *noise,
            hash: reference.hash.clone(),
        };
        self.keep(&names.result, key, result)
    }

    pub(super) fn text(&self, name: &str, text: &str) -> Result<(), Failure> {
        write_atomically(&self.path(name), |writer| writer.write_all(text.as_bytes()))
    }
}

struct ReferenceNames {
    image: String,
    variance: String,
    result: String,
}

impl ReferenceNames {
    fn of(target: Target) -> ReferenceNames {
        let name = target.name();
        ReferenceNames {
            image: reference_name(target),
            variance: format!("reference-{name}-variance.exr"),
            result: format!("cells/reference-{name}.json"),
        }
    }
}

/// The file of a reference that was rendered.
pub(super) fn reference_name(target: Target) -> String {
    format!("reference-{}.exr", target.name())
}

/// The image of a cell's first seed, and its FLIP errors.
pub(super) fn picture_names(setting: &str, spp: u32) -> [String; 2] {
    ["", "-flip"].map(|suffix| format!("pictures/{setting}-{spp}{suffix}.png"))
}

fn cell_name(key: &CellKey) -> String {
    format!("cells/{}-{}.json", key.setting, key.spp)
}
