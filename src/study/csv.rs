//! One line per setting, number of samples and seed.

use super::cell::Cell;
use super::setting::Setting;
use std::fmt::Write;

/// The head of the table.
const HEAD: &str = "setting,spp,seed,seconds,build_seconds,mse,relmse,relmse_trimmed,mean_ratio,fireflies,\
    worst_x,worst_y,worst_luminance,worst_reference,dropped\n";

/// The table. Errors are as measured, the reference's noise included. No field needs quotes.
pub fn table(settings: &[(Setting, Vec<Cell>)]) -> String {
    let mut table = String::from(HEAD);
    for (setting, cells) in settings {
        for cell in cells {
            for run in &cell.runs {
                let (e, worst) = (&run.errors, &run.errors.worst);
                let _ = writeln!(
                    table,
                    "{},{},{},{},{},{},{},{},{},{},{},{},{},{},{}",
                    setting.id,
                    cell.spp,
                    run.seed,
                    run.seconds,
                    cell.build_seconds,
                    e.mse,
                    e.relmse,
                    e.relmse_trimmed,
                    e.mean_ratio,
                    e.fireflies,
                    worst.x,
                    worst.y,
                    worst.luminance,
                    worst.reference,
                    run.dropped
                );
            }
        }
    }
    table
}
