//! What to say of a file: a sentence each, however many parts of the file give rise to it.

use std::collections::HashSet;
use std::path::Path;

/// Sentences and whom they are about.
#[derive(Default)]
pub(super) struct Notes(Vec<Note>);

struct Note {
    sentence: String,
    first: String,
    about: HashSet<String>,
}

impl Notes {
    /// Adds a sentence about a part of the file; `about` is empty for the whole of it.
    pub(super) fn add(&mut self, sentence: impl Into<String>, about: &str) {
        let sentence = sentence.into();
        let note = match self.0.iter_mut().position(|note| note.sentence == sentence) {
            Some(at) => &mut self.0[at],
            None => {
                self.0.push(Note {
                    sentence,
                    first: about.to_owned(),
                    about: HashSet::new(),
                });
                // One has just been added.
                let last = self.0.len() - 1;
                &mut self.0[last]
            }
        };
        if !about.is_empty() {
            note.about.insert(about.to_owned());
        }
    }

    pub(super) fn sentences(&self, path: &Path) -> Vec<String> {
        let file = path.display();
        self.0
            .iter()
            .map(|Note { sentence, first, about }| match about.len() {
                0 => format!("{file}: {sentence}"),
                1 => format!("{file}: {first}: {sentence}"),
                n => format!("{file}: {first} and {} more: {sentence}", n - 1),
            })
            .collect()
    }
}
