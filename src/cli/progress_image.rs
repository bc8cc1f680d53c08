//! The image so far, written while rendering goes on.

use super::{Failure, tell};
use crate::film::Film;
use crate::image::Image;
use crate::math::Rgb;
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::time::{Duration, Instant};

/// An image, and how many samples its pixels have.
pub(super) type Snapshot = (Image<Rgb>, u32);

/// Hands images to the thread that writes them.
pub(super) struct ProgressImage {
    interval: Duration,
    last: Option<Instant>,
    sender: SyncSender<Snapshot>,
}

impl ProgressImage {
    pub(super) fn new(interval: Duration) -> (ProgressImage, Receiver<Snapshot>) {
        let (sender, receiver) = sync_channel(1);
        let last = None;
        let progress_image = ProgressImage { interval, last, sender };
        (progress_image, receiver)
    }

    /// Has the image written, if it is time. Never waits: while one is being written, and one waits, others are left out.
    pub(super) fn offer(&mut self, film: &Film) {
        if self.last.is_none_or(|last| last.elapsed() >= self.interval) {
            self.last = Some(Instant::now());
            let _ = self.sender.try_send((film.develop(), film.sample_range().0));
        }
    }
}

/// Writes what comes, until the other end is gone. That it cannot is said once, and no reason to stop rendering: the image at
/// the end may still find a place.
pub(super) fn write_all(snapshots: Receiver<Snapshot>, quiet: bool, write: impl Fn(&Snapshot) -> Result<(), Failure>) {
    for snapshot in snapshots {
        if let Err(failure) = write(&snapshot) {
            if !quiet {
                tell(format_args!("warning: {}", failure.message));
            }
            return;
        }
    }
}
