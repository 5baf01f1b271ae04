//! What ends a long solve before its gap: the time that it may take, and whoever wants it to end.

use assignment::Stop;
use kit::error::{Error, Result};
use signal_hook::consts::{SIGINT, SIGTERM};
use signal_hook::flag;
use std::ops::ControlFlow;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// Exit code of a solve that was ended before its gap.
pub(super) const STOPPED_EARLY: u8 = 3;

/// Exit code where a second signal ends the program on the spot, as shells name an interrupt.
const KILLED: i32 = 130;

/// The time that a solve may take, and an ear for signals.
pub(super) struct Limits {
    longest: Duration,
    told_to_end: Arc<AtomicBool>,
}

impl Limits {
    /// From now on, the first SIGTERM or Ctrl-C asks the solve to end, and a second one ends the program.
    pub(super) fn new(max_seconds: Option<f64>) -> Result<Self> {
        let longest = match max_seconds {
            None => Duration::MAX,
            Some(seconds) => Duration::try_from_secs_f64(seconds)
                .map_err(|_| Error::input("--max-seconds", seconds, "a number of seconds, not negative"))?,
        };
        let told_to_end = Arc::new(AtomicBool::new(false));
        for signal in [SIGTERM, SIGINT] {
            flag::register_conditional_shutdown(signal, KILLED, Arc::clone(&told_to_end))
                .and_then(|_| flag::register(signal, Arc::clone(&told_to_end)))
                .map_err(|failure| Error::input("signals", failure, "a system that delivers them"))?;
        }
        Ok(Self { longest, told_to_end })
    }

    /// Whether a solve that began at `start` may go on.
    pub(super) fn check(&self, start: Instant) -> ControlFlow<Stop> {
        if self.told_to_end.load(Ordering::Relaxed) {
            ControlFlow::Break(Stop::Interrupted)
        } else if start.elapsed() >= self.longest {
            ControlFlow::Break(Stop::Time)
        } else {
            ControlFlow::Continue(())
        }
    }
}
