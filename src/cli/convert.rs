//! `embrace convert`

use super::{ConvertArgs, Failure, output, tell};
use crate::scene::{self, SaveError};

pub(super) fn run(args: &ConvertArgs) -> Result<(), Failure> {
    if args.output.extension().is_none_or(|e| !e.eq_ignore_ascii_case("toml")) {
        return Err(Failure::usage(format!(
            "{}: the extension must be .toml",
            args.output.display()
        )));
    }
    output::check_writable(&args.output)?;
    let desc = scene::load(&args.scene, args.load.options(args.strict)).map_err(Failure::input)?;
    if !args.quiet {
        for warning in &desc.warnings {
            tell(format_args!("warning: {warning}"));
        }
    }
    scene::save(&desc, &args.output).map_err(|error| match error {
        SaveError::Export(error) => Failure::input(format!("{}: {error}", args.scene.display())),
        error => Failure::output(error),
    })
}
