//! How far a long solve is, on stderr: a moving line on a terminal, a line a minute elsewhere.

use indicatif::{ProgressBar, ProgressStyle};
use std::io::IsTerminal as _;
use std::time::{Duration, Instant};

/// A solve that is shorter than this shows no progress bar (chosen).
const PROGRESS_DELAY: Duration = Duration::from_millis(500);

/// Time between lines where stderr is no terminal (chosen).
const LINE_INTERVAL: Duration = Duration::from_secs(60);

/// Says how far a solve is.
pub(super) struct Progress {
    bar: ProgressBar,
    /// Whether lines take the place of the bar.
    lines: bool,
    start: Instant,
    last_line: Instant,
}

impl Progress {
    /// On a terminal, `quiet` means to say nothing.
    pub(super) fn new(quiet: bool) -> Self {
        let style = ProgressStyle::with_template("{spinner} iteration {pos}, relative gap {msg} [{elapsed}]");
        let bar = if quiet {
            ProgressBar::hidden()
        } else {
            ProgressBar::new_spinner()
        };
        let start = Instant::now();
        Self {
            bar: bar.with_style(style.unwrap_or_else(|_| ProgressStyle::default_spinner())),
            lines: !std::io::stderr().is_terminal(),
            start,
            last_line: start,
        }
    }

    pub(super) fn show(&mut self, iteration: usize, relative_gap: f64) {
        if self.lines && self.last_line.elapsed() >= LINE_INTERVAL {
            self.last_line = Instant::now();
            let minutes = self.start.elapsed().as_secs() / 60;
            kit::remark!("iteration {iteration}, relative gap {relative_gap:.3e} [{minutes} min]");
        } else if self.start.elapsed() >= PROGRESS_DELAY {
            self.bar.set_message(format!("{relative_gap:.3e}"));
            self.bar.set_position(iteration as u64);
        }
    }

    pub(super) fn finish(self) {
        self.bar.finish_and_clear();
    }
}
