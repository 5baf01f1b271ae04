//! Programs that this one starts and that shall not outlive it.

use std::process::Command;

/// Asks the system to end the process when the thread that starts it ends, even if that is killed.
#[cfg(target_os = "linux")]
pub(crate) fn end_with_parent(command: &mut Command) {
    use std::os::unix::process::CommandExt;
    // SAFETY: between fork and exec only async-signal-safe calls are allowed; prctl is a bare system call, and the closure
    // allocates nothing.
    #[allow(unsafe_code, reason = "the only way to a parent-death signal")]
    unsafe {
        command.pre_exec(|| match libc::prctl(libc::PR_SET_PDEATHSIG, libc::SIGKILL) {
            0 => Ok(()),
            _ => Err(std::io::Error::last_os_error()),
        });
    }
}

/// Elsewhere a killed parent leaves its children to whoever killed it.
#[cfg(not(target_os = "linux"))]
pub(crate) fn end_with_parent(_: &mut Command) {}
