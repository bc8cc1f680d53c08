//! Progress on standard error: a bar on a terminal, plain lines for a log.

use super::tell;
use indicatif::{ProgressBar, ProgressStyle};
use std::io::IsTerminal;
use std::sync::Mutex;
use std::time::{Duration, Instant};

/// Shortest time between two plain lines.
const LINE_INTERVAL: Duration = Duration::from_secs(1);

/// Shows how much of the work is done.
pub(super) enum Progress {
    /// Nothing is shown.
    Quiet,
    /// A bar with rate and time left.
    Bar(ProgressBar),
    /// `Progress: 42.0%`
    Lines { last: Mutex<(Instant, f64)> },
}

impl Progress {
    /// For camera paths.
    pub(super) fn new(quiet: bool) -> Progress {
        Progress::with_template(quiet, "{bar:32} {percent:>3}%  {per_sec}  {elapsed} gone, {eta} left")
    }

    /// For steps that take unequally long.
    pub(super) fn steps(quiet: bool) -> Progress {
        Progress::with_template(quiet, "{bar:32} {percent:>3}%  {elapsed} gone  {msg}")
    }

    /// What is being done, beside the bar.
    pub(super) fn describe(&self, what: impl FnOnce() -> String) {
        if let Progress::Bar(bar) = self {
            bar.set_message(what());
        }
    }

    fn with_template(quiet: bool, template: &str) -> Progress {
        if quiet {
            Progress::Quiet
        } else if std::io::stderr().is_terminal() {
            let bar = ProgressBar::new(1);
            if let Ok(style) = ProgressStyle::with_template(template) {
                bar.set_style(style.with_key(
                    "per_sec",
                    |state: &indicatif::ProgressState, w: &mut dyn std::fmt::Write| {
                        let _ = write!(w, "{:.2} Mpaths/s", state.per_sec() * 1e-6);
                    },
                ));
            }
            Progress::Bar(bar)
        } else {
            Progress::Lines {
                last: Mutex::new((Instant::now(), 0.0)),
            }
        }
    }

    /// `done` of the work is done, of what is now thought to be `total`. Called from all threads.
    pub(super) fn update(&self, done: u64, total: u64) {
        match self {
            Progress::Quiet => {}
            Progress::Bar(bar) => {
                if done > bar.position() {
                    bar.set_length(total);
                    bar.set_position(done);
                }
            }
            Progress::Lines { last } => {
                // A thread that finds the lock taken leaves the line to the other.
                let Ok(mut last) = last.try_lock() else { return };
                let (time, percent) = &mut *last;
                if time.elapsed() >= LINE_INTERVAL {
                    *time = Instant::now();
                    // What is thought to be the total may grow.
                    *percent = percent.max(100.0 * done as f64 / total as f64);
                    tell(format_args!("Progress: {percent:.1}%"));
                }
            }
        }
    }

    /// The work has ended, all of it or not.
    pub(super) fn finish(&self, complete: bool) {
        match self {
            Progress::Quiet => {}
            Progress::Bar(bar) if complete => bar.finish(),
            Progress::Bar(bar) => bar.abandon(),
            Progress::Lines { .. } if complete => tell(format_args!("Progress: 100.0%")),
            Progress::Lines { .. } => {}
        }
    }
}
