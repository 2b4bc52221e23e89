//! Long work beside a Python that stays alive: other threads run, Ctrl-C is heard, progress is told.

use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::thread;
use std::time::Duration;

use pyo3::prelude::*;

/// How often Python is asked for signals.
const EVERY: Duration = Duration::from_millis(50);

/// What long work shares with who waits for it.
#[derive(Debug, Default)]
pub(crate) struct Shared {
    /// Set by Ctrl-C: the work should end soon.
    pub(crate) stop: AtomicBool,
    /// How much is done, in units of the work's own.
    pub(crate) done: AtomicU64,
}

/// Does `work` on another thread. Meanwhile `progress`, if there is one, is called with `(done, of)`.
///
/// # Errors
/// `KeyboardInterrupt`, or whatever else a handler or `progress` raises, once the work has ended.
///
/// # Panics
/// If `work` does.
pub(crate) fn interruptible<T: Send>(
    py: Python<'_>,
    of: u64,
    progress: Option<&Bound<'_, PyAny>>,
    work: impl FnOnce(&Shared) -> T + Send,
) -> PyResult<T> {
    let shared = Shared::default();
    thread::scope(|scope| {
        let worker = scope.spawn(|| work(&shared));
        let (mut told, mut raised) = (0, None);
        while !worker.is_finished() {
            py.detach(|| thread::park_timeout(EVERY));
            if raised.is_some() {
                continue;
            }
            let done = shared.done.load(Ordering::Relaxed);
            let news = progress.filter(|_| done > told);
            told = done;
            let heard = py.check_signals();
            raised =
                heard.and_then(|()| news.map_or(Ok(()), |p| p.call1((done, of)).map(drop))).err();
            if raised.is_some() {
                shared.stop.store(true, Ordering::Relaxed);
            }
        }
        let result = worker.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic));
        raised.map_or(Ok(result), Err)
    })
}
