//! SIGINT and SIGTERM: before rendering they end the program, while rendering they end the render and keep the image.

use signal_hook::consts::{SIGINT, SIGTERM};
use signal_hook::flag;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

/// Watches for signals.
pub(super) struct Interrupt {
    signal: Arc<AtomicUsize>,
    exit_at_once: Arc<AtomicBool>,
}

impl Interrupt {
    /// Starts to watch. Until [`Interrupt::keep_image`] a signal ends the program at once: there is nothing to keep.
    pub(super) fn watch() -> std::io::Result<Interrupt> {
        let signal = Arc::new(AtomicUsize::new(0));
        let exit_at_once = Arc::new(AtomicBool::new(true));
        for number in [SIGINT, SIGTERM] {
            // In this order: the first signal sets what makes the second one final.
            flag::register_conditional_shutdown(number, exit_code(number), exit_at_once.clone())?;
            flag::register(number, exit_at_once.clone())?;
            flag::register_usize(number, signal.clone(), number as usize)?;
        }
        Ok(Interrupt { signal, exit_at_once })
    }

    /// From now on the first signal only raises the flag; the second still ends the program.
    pub(super) fn keep_image(&self) {
        self.exit_at_once.store(false, Ordering::SeqCst);
    }

    /// The exit code of the signal that came, if one did.
    pub(super) fn raised(&self) -> Option<u8> {
        match self.signal.load(Ordering::Relaxed) {
            0 => None,
            number => u8::try_from(exit_code(number as i32)).ok(),
        }
    }
}

fn exit_code(signal: i32) -> i32 {
    128 + signal
}
