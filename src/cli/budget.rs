//! What a render may take: samples, time, and the error to stop at.

use super::{Failure, RenderArgs};
use crate::adaptive::NoiseTarget;
use crate::render::ErrorControl;
use std::time::{Duration, Instant};

/// Samples per pixel where nothing is said about effort.
const DEFAULT_SPP: u32 = 64;

/// Most samples of a pixel where only an error is given: an error that is out of reach ends some time.
const NOISE_SPP: u32 = 16_384;

/// Samples of each pixel before its error is judged.
const MIN_SPP: u32 = 16;

/// What it takes to write a channel of a pixel to one file, at most, in seconds (docs/performance.md).
const WRITE_SECONDS_PER_VALUE: f64 = 1.1e-7;

/// Paths per second in a simple scene, to tell how many a time is good for.
const PATHS_PER_SECOND: f64 = 1e6;

/// What a render may take.
#[derive(Clone, Copy, Debug)]
pub(super) struct Budget {
    /// Most samples of a pixel.
    pub(super) spp: u32,
    /// What is done about the error.
    pub(super) error: ErrorControl,
    time: Option<Duration>,
    /// When time started to count, if loading counts as well.
    started: Option<Instant>,
}

impl Budget {
    /// Of the command line of a program that started at `started`.
    pub(super) fn new(args: &RenderArgs, started: Instant) -> Result<Budget, Failure> {
        let (time, noise) = (args.time, args.noise);
        let by_default = match (time, noise) {
            (None, None) => DEFAULT_SPP,
            (None, Some(_)) => NOISE_SPP,
            (Some(_), _) => u32::MAX,
        };
        let spp = args.spp.unwrap_or(by_default);
        let error = match noise {
            Some(relative_rmse) => ErrorControl::Bounded(NoiseTarget {
                relative_rmse,
                min_spp: args.min_spp.unwrap_or(MIN_SPP),
            }),
            None => ErrorControl::Ignored,
        };
        if noise.is_some() && !args.estimator.tells_error() {
            return Err(Failure::usage(
                "--noise needs the error, which samples of --sampler sobol-whole do not tell; take sobol",
            ));
        }
        if let Some(min_spp) = args.min_spp
            && min_spp > spp
        {
            return Err(Failure::usage(format!("--min-spp {min_spp} is more than --spp {spp}")));
        }
        Ok(Budget {
            spp,
            error,
            time,
            started: args.time_total.then_some(started),
        })
    }

    /// Paths that an image of so many pixels will take, as far as is known before it starts.
    pub(super) fn paths(&self, pixels: u64) -> u64 {
        let by_time = self
            .time
            .map_or(u64::MAX, |time| (time.as_secs_f64() * PATHS_PER_SECOND) as u64);
        pixels.saturating_mul(self.spp.into()).min(by_time)
    }

    /// Whether something else than the number of samples may end the render.
    pub(super) fn is_open(&self) -> bool {
        self.time.is_some() || matches!(self.error, ErrorControl::Bounded(_))
    }

    /// Starts the clock, for an image of so many pixels, of which so many channels are written, in all files together.
    pub(super) fn start(&self, pixels: u64, channels: usize) -> Clock {
        let now = Instant::now();
        let limit = self.time.map(|time| {
            let Some(started) = self.started else { return time };
            let writing = Duration::from_secs_f64(WRITE_SECONDS_PER_VALUE * pixels as f64 * channels as f64);
            let left = time.saturating_sub(now - started);
            // At most half of what is left: some image late is better than none.
            left - writing.min(left / 2)
        });
        Clock { started: now, limit }
    }
}

/// Runs while samples are taken.
#[derive(Clone, Copy, Debug)]
pub(super) struct Clock {
    started: Instant,
    limit: Option<Duration>,
}

impl Clock {
    /// Time since the start.
    pub(super) fn elapsed(&self) -> Duration {
        self.started.elapsed()
    }

    /// Whether time is up.
    pub(super) fn is_up(&self) -> bool {
        self.is_past(1.0)
    }

    /// Whether this share of the time is over.
    pub(super) fn is_past(&self, share: f64) -> bool {
        self.limit.is_some_and(|limit| self.elapsed() >= limit.mul_f64(share))
    }

    /// How many paths there will be in all, of which `done` are done, if nothing else ends the render before `expected` of
    /// them.
    pub(super) fn expect(&self, done: u64, expected: u64) -> u64 {
        let by_time = self.limit.map(|limit| {
            let share = self.elapsed().as_secs_f64() / limit.as_secs_f64().max(1e-9);
            (done as f64 / share.min(1.0)) as u64
        });
        expected.min(by_time.unwrap_or(u64::MAX)).max(done)
    }
}

/// A time with a unit: `30s`, `1.5m`, `250ms`, `2h`; a plain number is seconds.
pub(super) fn parse_time(text: &str) -> Result<Duration, String> {
    let unit = text.trim_start_matches(|c: char| c.is_ascii_digit() || c == '.');
    let number = &text[..text.len() - unit.len()];
    let seconds = match unit {
        "" | "s" => Some(1.0),
        "ms" => Some(1e-3),
        "m" | "min" => Some(60.0),
        "h" => Some(3600.0),
        _ => None,
    };
    let time = seconds.zip(number.parse::<f64>().ok());
    let time = time.and_then(|(unit, number)| Duration::try_from_secs_f64(number * unit).ok());
    time.filter(|time| !time.is_zero())
        .ok_or_else(|| "expected a time above zero, such as 30s, 1.5m, 250ms or 2h".into())
}

/// A relative error above zero.
pub(super) fn parse_noise(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(noise) if noise > 0.0 && noise.is_finite() => Ok(noise),
        _ => Err("expected a relative error above 0, such as 0.01 for one per cent".into()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_are_read_with_their_unit() {
        for (text, milliseconds) in [
            ("30s", 30_000),
            ("2", 2000),
            ("1.5m", 90_000),
            ("250ms", 250),
            ("2h", 7_200_000),
        ] {
            assert_eq!(parse_time(text), Ok(Duration::from_millis(milliseconds)), "{text}");
        }
        for text in [
            "",
            "s",
            "0",
            "0s",
            "-1s",
            "1e400",
            "1.2.3s",
            "10 s",
            "5d",
            "1e3",
            "0.0000000001ms",
            "nan",
            "inf",
        ] {
            assert!(parse_time(text).is_err(), "{text}");
        }
    }

    #[test]
    fn a_clock_expects_what_time_allows() {
        let clock = |limit| Clock {
            started: Instant::now() - Duration::from_secs(5),
            limit,
        };
        assert_eq!(clock(None).expect(100, 1000), 1000);
        assert!(clock(Some(Duration::from_secs(4))).is_up());
        assert_eq!(clock(Some(Duration::from_secs(4))).expect(100, 1000), 100);
        let half = clock(Some(Duration::from_secs(10)));
        assert!(!half.is_up() && half.is_past(0.4));
        assert!((190..=200).contains(&half.expect(100, 1000)));
        assert_eq!(half.expect(100, 150), 150);
    }
}
