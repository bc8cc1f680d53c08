//! The program in a folder of its own.

use ::exr::meta::MetaData;
use ::exr::meta::attribute::{AttributeValue, Text};
use embrace::image::{Decoded, Image, exr, ldr};
use embrace::math::Rgb;
use serde_json::Value;
use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};
use tempfile::TempDir;

pub(crate) const CAMERA: &str =
    "[camera]\nposition = [0, 1, 4]\nlook_at = [0, 0.5, 0]\nvfov = 40\nresolution = [16, 12]\n";
pub(crate) const SKY: &str = "[environment]\nradiance = [0.5, 0.6, 0.8]\n";
pub(crate) const RED: &str = "[materials.red]\ntype = \"diffuse\"\nrgb = [0.7, 0.2, 0.1]\n";
pub(crate) const FLOOR: &str = "[[meshes]]\nfile = \"floor.obj\"\nmaterial = \"red\"\n";
pub(crate) const LAMP: &str = "[[meshes]]\nfile = \"floor.obj\"\nmaterial = \"red\"\n\
    transform = [[0.3, 0, 0, 0], [0, -1, 0, 1.5], [0, 0, -0.3, 0], [0, 0, 0, 1]]\n\
    emission = { radiance = [9, 8, 7], sides = \"both\" }\n";
pub(crate) const SQUARE: &str =
    "v -1 0 1\nv 1 0 1\nv 1 0 -1\nv -1 0 -1\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nf 1/1 2/2 3/3 4/4\n";

/// What a run of the program did.
pub(crate) struct Ran {
    pub(crate) code: Option<i32>,
    pub(crate) stdout: String,
    pub(crate) stderr: String,
}

/// A folder with a scene, removed at the end.
pub(crate) struct Folder(TempDir);

impl Folder {
    pub(crate) fn empty() -> Folder {
        Folder(tempfile::tempdir().unwrap())
    }

    /// A red square under a blue sky and a lamp, in `scene.toml`.
    pub(crate) fn with_scene() -> Folder {
        Folder::with(&[CAMERA, SKY, RED, FLOOR, LAMP].concat())
    }

    pub(crate) fn with(scene: &str) -> Folder {
        let folder = Folder::empty();
        folder.write("scene.toml", scene);
        folder.write("floor.obj", SQUARE);
        folder
    }

    pub(crate) fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    pub(crate) fn write(&self, name: &str, content: impl AsRef<[u8]>) {
        fs::write(self.path(name), content).unwrap();
    }

    pub(crate) fn read(&self, name: &str) -> Vec<u8> {
        fs::read(self.path(name)).unwrap_or_else(|e| panic!("{name}: {e}"))
    }

    pub(crate) fn exr(&self, name: &str) -> Image<Rgb> {
        exr::read(&self.read(name), Path::new(name)).unwrap()
    }

    pub(crate) fn png(&self, name: &str) -> Image<[u8; 3]> {
        match embrace::image::read(Path::new(name), &self.read(name)).unwrap() {
            Decoded::Encoded(ldr::LdrImage::Bits8 { rgb, .. }) => rgb,
            other => panic!("{name} is no 8-bit image: {other:?}"),
        }
    }

    pub(crate) fn json(&self, name: &str) -> Value {
        serde_json::from_slice(&self.read(name)).unwrap()
    }

    pub(crate) fn names(&self) -> BTreeSet<String> {
        let entries = fs::read_dir(self.0.path()).unwrap();
        entries.map(|e| e.unwrap().file_name().into_string().unwrap()).collect()
    }

    /// The program in this folder, the arguments separated by blanks.
    pub(crate) fn command(&self, arguments: &str) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_embrace"));
        command.current_dir(self.0.path()).args(arguments.split_whitespace());
        command
    }

    pub(crate) fn run(&self, arguments: &str) -> Ran {
        let output = self.command(arguments).stdin(Stdio::null()).output().unwrap();
        Ran {
            code: output.status.code(),
            stdout: String::from_utf8(output.stdout).unwrap(),
            stderr: String::from_utf8(output.stderr).unwrap(),
        }
    }

    /// Runs what must succeed.
    pub(crate) fn done(&self, arguments: &str) -> Ran {
        let ran = self.run(arguments);
        assert_eq!(ran.code, Some(0), "{arguments}: {}", ran.stderr);
        ran
    }

    /// Runs what must fail: with this code, a message that has these words, and not a file more or less.
    pub(crate) fn refused(&self, arguments: &str, code: i32, words: &[&str]) {
        let before = self.names();
        let ran = self.run(arguments);
        assert_eq!(ran.code, Some(code), "{arguments}: {}", ran.stderr);
        for word in words {
            assert!(ran.stderr.contains(word), "{arguments}: no `{word}` in: {}", ran.stderr);
        }
        assert!(ran.stderr.starts_with("error: "), "{}", ran.stderr);
        assert_eq!(ran.stdout, "", "{arguments}");
        assert_eq!(self.names(), before, "{arguments}");
    }
}

/// An attribute of an EXR file, if it is there.
pub(crate) fn attribute(exr: &[u8], name: &str) -> Option<AttributeValue> {
    let meta = MetaData::read_from_buffered(exr, false).unwrap();
    let attributes = &meta.headers[0].own_attributes.other;
    attributes.get(&Text::from(name)).cloned()
}

pub(crate) fn int_attribute(exr: &[u8], name: &str) -> i32 {
    match attribute(exr, name) {
        Some(AttributeValue::I32(value)) => value,
        other => panic!("{name} is {other:?}"),
    }
}

#[cfg(unix)]
pub(crate) fn send(signal: &str, child: &Child) {
    let status = Command::new("sh")
        .args(["-c", &format!("kill -{signal} {}", child.id())])
        .status()
        .unwrap();
    assert!(status.success());
}

/// Waits for the end, but not for ever.
#[cfg(unix)]
pub(crate) fn exit_code_within(child: &mut Child, limit: Duration) -> Option<i32> {
    let start = Instant::now();
    loop {
        if let Some(status) = child.try_wait().unwrap() {
            return status.code();
        }
        if start.elapsed() > limit {
            child.kill().unwrap();
            panic!("still running after {limit:?}");
        }
        std::thread::sleep(Duration::from_millis(20));
    }
}
