//! Panics as results, without their noise.

use std::panic::{AssertUnwindSafe, catch_unwind, set_hook, take_hook};
use std::thread::{Scope, scope};

/// Returns the result of `job`, or the message with which it panicked.
pub fn caught<T>(job: impl FnOnce() -> T) -> Result<T, String> {
    catch_unwind(AssertUnwindSafe(job)).map_err(|panic| {
        let text = panic.downcast_ref::<String>().cloned();
        text.or(panic.downcast_ref::<&str>().map(|text| (*text).to_owned())).unwrap_or_default()
    })
}

/// `job` with a scope for its threads; no panic writes to standard error until they have ended.
pub fn quietly<'env, T>(job: impl for<'s> FnOnce(&'s Scope<'s, 'env>) -> T) -> T {
    let usual = take_hook();
    set_hook(Box::new(|_| {}));
    let result = scope(job);
    set_hook(usual);
    result
}
