//! The fuzz targets' checks on stable Rust: every file of the kept corpus, which has what fuzzing has found, and some
//! thousand random changes of them. docs/contributing.md says how to fuzz for longer.

#[path = "checks/mod.rs"]
mod checks;
#[path = "../support/mod.rs"]
mod support;

use std::fs;
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};
use support::Random;

/// No input may take longer, whatever it asks for: a hang, and not a busy machine. The slowest of the corpus takes a
/// thousandth of it.
const LIMIT: Duration = Duration::from_secs(30);

/// The files of a target, in the order of their names.
fn corpus(target: &str) -> Vec<(String, Vec<u8>)> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("tests/fuzz/corpus")
        .join(target);
    let entries = fs::read_dir(&folder).unwrap_or_else(|e| panic!("{}: {e}", folder.display()));
    let mut paths: Vec<PathBuf> = entries
        .map(|entry| entry.expect("a folder that can be read").path())
        .collect();
    paths.sort();
    assert!(!paths.is_empty(), "{}: no files", folder.display());
    paths
        .into_iter()
        .map(|path| {
            (
                path.display().to_string(),
                fs::read(&path).expect("a file that can be read"),
            )
        })
        .collect()
}

/// Runs a check and says which input was the matter if it fails; that input is kept under `target/`.
fn run(target: &str, check: checks::Check, what: &str, data: &[u8]) {
    let start = Instant::now();
    let result = catch_unwind(AssertUnwindSafe(|| check(data)));
    let is_slow = start.elapsed() > LIMIT;
    if result.is_err() || is_slow {
        let path = Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("{target}-failure"));
        fs::write(&path, data).expect("the input of a failed test");
        eprintln!("{what}: {:?}; the input is in {}", start.elapsed(), path.display());
    }
    if let Err(panic) = result {
        resume_unwind(panic);
    }
    assert!(!is_slow, "{what}: took longer than {LIMIT:?}");
}

#[test]
fn every_file_of_the_corpus_passes_its_check() {
    for (target, check) in checks::ALL {
        let start = Instant::now();
        let files = corpus(target);
        for (name, data) in &files {
            run(target, check, name, data);
        }
        println!("{target}: {} files in {:?}", files.len(), start.elapsed());
    }
}

#[test]
fn random_changes_of_the_corpus_pass_its_check() {
    support::for_each_in_parallel(&checks::ALL, |&(target, check)| {
        let start = Instant::now();
        let files: Vec<Vec<u8>> = corpus(target).into_iter().map(|(_, data)| data).collect();
        let mut random = Random(1);
        for round in 0..CHANGES {
            let data = changed(&files, &mut random);
            run(target, check, &format!("{target}, change {round}"), &data);
        }
        println!("{target}: {CHANGES} changes in {:?}", start.elapsed());
    });
}

/// Changed inputs per target.
const CHANGES: usize = 4000;

/// One of the files with a few bytes changed, cut, doubled, or taken from another file.
fn changed(files: &[Vec<u8>], random: &mut Random) -> Vec<u8> {
    let mut data = files[random.below(files.len())].clone();
    for _ in 0..1 + random.below(6) {
        let other = &files[random.below(files.len())];
        let (at, length) = (random.below(data.len() + 1), 1 + random.below(16));
        let end = data.len().min(at + length);
        match random.below(6) {
            0 => data[at..end].iter_mut().for_each(|b| *b ^= 1 << random.below(8)),
            1 => data[at..end].iter_mut().for_each(|b| *b = random.bits() as u8),
            2 => data[at..end].fill([0, 0x7f, 0x80, 0xff][random.below(4)]),
            3 => drop(data.drain(at..end)),
            4 => {
                let again = data[at..end].to_vec();
                data.splice(at..at, again);
            }
            _ => {
                let from = random.below(other.len() + 1);
                let piece = &other[from..other.len().min(from + length)];
                data.splice(at..end, piece.iter().copied());
            }
        }
    }
    data
}
