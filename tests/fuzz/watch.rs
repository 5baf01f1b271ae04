//! Runs an input under a watch: a panic is an answer, and what never ends is ended.

use rustix::time::{ClockId, clock_gettime};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::{Mutex, Once};
use std::thread;
use std::time::{Duration, Instant};

/// When an input that has not ended never will (chosen: far above what is allowed, on the slowest machine).
const NEVER: Duration = Duration::from_secs(60);

/// What runs now, and since when.
static RUNNING: Mutex<Option<(Instant, &'static str, Vec<u8>)>> = Mutex::new(None);

/// The answer of `work`, nothing where it panics, and its processor time: on a busy machine any other says little.
pub fn timed<T>(name: &'static str, input: &[u8], work: impl FnOnce() -> T) -> (Result<T, ()>, Duration) {
    static WATCH: Once = Once::new();
    WATCH.call_once(|| drop(thread::spawn(watch)));
    *RUNNING.lock().unwrap() = Some((Instant::now(), name, input.to_vec()));
    let before = processor_time();
    let answer = catch_unwind(AssertUnwindSafe(work));
    let time = processor_time() - before;
    *RUNNING.lock().unwrap() = None;
    (answer.map_err(drop), time)
}

/// What this thread has used so far.
fn processor_time() -> Duration {
    let time = clock_gettime(ClockId::ThreadCPUTime);
    Duration::new(time.tv_sec.unsigned_abs(), time.tv_nsec.unsigned_abs() as u32)
}

/// Ends the program if an input does not end.
fn watch() {
    loop {
        thread::sleep(NEVER / 10);
        if let Some((start, name, input)) = &*RUNNING.lock().unwrap()
            && start.elapsed() > NEVER
        {
            let path = crate::keep(name, input);
            eprintln!("{name}: it does not end; the input is {}", path.display());
            std::process::exit(1);
        }
    }
}
