//! Standard output and standard error of all commands. Neither stops the work: who does not read a line, or has no room for it,
//! still gets the files.

use std::fmt::Arguments;
use std::io::{ErrorKind, Write as _, stderr, stdout};
use std::sync::OnceLock;

/// Why standard output takes nothing any more.
static LOST: OnceLock<ErrorKind> = OnceLock::new();

/// Prints a line to standard output.
#[macro_export]
macro_rules! say {
    ($($argument:tt)*) => {
        $crate::output::line(format_args!($($argument)*))
    };
}

/// Prints a sentence or more, with line breaks where a terminal ends.
#[macro_export]
macro_rules! tell {
    ($($argument:tt)*) => {
        $crate::say!("{}", $crate::text::wrapped(&format!($($argument)*), "  "))
    };
}

/// Prints a line to standard error, if that can be written.
#[macro_export]
macro_rules! remark {
    ($($argument:tt)*) => {
        $crate::output::line_of_error(format_args!($($argument)*))
    };
}

/// What [`say!`](crate::say) does.
pub fn line(text: Arguments<'_>) {
    if LOST.get().is_none()
        && let Err(error) = writeln!(stdout(), "{text}")
    {
        LOST.get_or_init(|| error.kind());
    }
}

/// What [`remark!`](crate::remark) does.
pub fn line_of_error(text: Arguments<'_>) {
    // There is nobody left to tell.
    let _unheard = writeln!(stderr(), "{text}");
}

/// Why standard output did not take everything, if it should have: that nobody reads on (`host-sim | head`) is no failure.
pub fn failure() -> Option<ErrorKind> {
    if let Err(error) = stdout().flush() {
        LOST.get_or_init(|| error.kind());
    }
    LOST.get().copied().filter(|kind| *kind != ErrorKind::BrokenPipe)
}
