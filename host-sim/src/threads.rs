//! Thread pools of a chosen size.

use kit::error::{Error, Result};
use rayon::{ThreadPool, ThreadPoolBuilder};

/// A thread pool of this size; one thread a core without it.
///
/// # Errors
/// If the system gives no threads.
pub fn thread_pool(threads: Option<u16>) -> Result<ThreadPool> {
    ThreadPoolBuilder::new()
        .num_threads(threads.map_or(0, usize::from))
        .build()
        .map_err(|error| Error::input("threads", error, "threads that the system can start"))
}
