//! `embrace compare` and `embrace tonemap`

use super::output::{self, Target};
use super::{CompareArgs, Failure, TonemapArgs, print};
use crate::image::{self, Image, compare::compare as compare_images, flip, ldr};
use crate::math::Rgb;
use std::path::Path;

fn read(path: &Path) -> Result<Image<Rgb>, Failure> {
    let bytes = std::fs::read(path).map_err(|e| Failure::input(format!("{}: cannot be read: {e}", path.display())))?;
    image::read_rgb(path, &bytes).map_err(Failure::input)
}

pub(super) fn compare(args: &CompareArgs) -> Result<(), Failure> {
    if let Some(diff) = &args.diff {
        check_png(diff)?;
        output::check_writable(diff)?;
    }
    let (a, b) = (read(&args.a)?, read(&args.b)?);
    let comparison = compare_images(&a, &b)
        .map_err(|e| Failure::input(format!("{} and {}: {e}", args.a.display(), args.b.display())))?;
    if let Some(path) = &args.diff {
        let map = flip::heat_map(&flip::hdr_flip(&a, &b));
        output::write_atomically(path, |writer| ldr::write_png(writer, &map, path))?;
    }
    if args.json {
        return print(&(serde_json::to_string_pretty(&comparison).map_err(Failure::internal)? + "\n"));
    }
    let [r, g, b] = comparison.mean_ratio;
    let mut table = String::new();
    let mut row = |name: &str, value: String| table += &format!("{name:<16}{value}\n");
    row("size", format!("{} x {}", comparison.width, comparison.height));
    row("MSE", format!("{:.6e}", comparison.mse));
    row("RMSE", format!("{:.6e}", comparison.rmse));
    row("relMSE", format!("{:.6e}", comparison.relmse));
    row("relMSE trimmed", format!("{:.6e}", comparison.relmse_trimmed));
    row("mean ratio", format!("{r:.6} {g:.6} {b:.6}"));
    row("FLIP", format!("{:.6}", comparison.flip));
    for (name, count) in [("A", comparison.nonfinite_a), ("B", comparison.nonfinite_b)] {
        if count > 0 {
            row("not finite", format!("{count} pixels of {name}, left out"));
        }
    }
    print(&table)
}

pub(super) fn tonemap(args: &TonemapArgs) -> Result<(), Failure> {
    check_png(&args.output)?;
    let target = Target::new(&args.output)?;
    target.write(&read(&args.input)?, &[], &output::metadata(), args.exposure)
}

fn check_png(path: &Path) -> Result<(), Failure> {
    if path.extension().is_some_and(|e| e.eq_ignore_ascii_case("png")) {
        return Ok(());
    }
    Err(Failure::usage(format!(
        "{}: the extension must be .png",
        path.display()
    )))
}
