//! Room that is kept between updates.

use std::sync::{Mutex, PoisonError};

/// Values to work in, as many as threads ask for at once. The one that was given back last is lent first, since it is still near.
#[derive(Default)]
pub struct Pool<T>(Mutex<Vec<T>>);

impl<T: Default> Pool<T> {
    /// Lends a value in whatever state it was given back.
    pub fn lend<R>(&self, work: impl FnOnce(&mut T) -> R) -> R {
        let kept = || self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let value = kept().pop();
        let mut value = value.unwrap_or_default();
        let result = work(&mut value);
        kept().push(value);
        result
    }
}
