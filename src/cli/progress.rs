//! Progress on standard error: a bar on a terminal, plain lines for a log.

use super::tell;
use indicatif::{ProgressBar, ProgressStyle};
use std::io::IsTerminal;
use std::sync::Mutex;
use std::time::{Duration, Instant};

/// Shortest time between two plain lines.
const LINE_INTERVAL: Duration = Duration::from_secs(1);

/// Shows how much of a known amount of work is done.
pub(super) enum Progress {
    /// Nothing is shown.
    Quiet,
    /// A bar with rate and time left.
    Bar(ProgressBar),
    /// `Progress: 42.0%`
    Lines { total: u64, last: Mutex<Instant> },
}

impl Progress {
    /// For `total` camera paths.
    pub(super) fn new(total: u64, quiet: bool) -> Progress {
        if quiet {
            Progress::Quiet
        } else if std::io::stderr().is_terminal() {
            let bar = ProgressBar::new(total);
            let template = "{bar:32} {percent:>3}%  {per_sec}  {elapsed} gone, {eta} left";
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
                total,
                last: Mutex::new(Instant::now()),
            }
        }
    }

    /// `done` of the work is done. Called from all threads.
    pub(super) fn update(&self, done: u64) {
        match self {
            Progress::Quiet => {}
            Progress::Bar(bar) => {
                if done > bar.position() {
                    bar.set_position(done);
                }
            }
            Progress::Lines { total, last } => {
                // A thread that finds the lock taken leaves the line to the other.
                let Ok(mut last) = last.try_lock() else { return };
                if last.elapsed() >= LINE_INTERVAL {
                    *last = Instant::now();
                    tell(format_args!("Progress: {:.1}%", 100.0 * done as f64 / *total as f64));
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
