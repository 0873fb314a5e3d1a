//! Memory that is needed soon.
//!
//! After a camera has written a picture, what the driver wrote with the frame before is neither in a cache nor in the translation buffer:
//! to wait for both takes half a microsecond for each page. Asked early, the processor fetches it while the mask is applied.
//!
//! Law 1: a prefetch is advice: it reads nothing that a program could see, and no address makes it fail.

/// Asks for all cache lines of a value, to be written to.
#[inline]
pub(crate) fn prefetch<T>(value: *const T) {
    // No such advice is in stable Rust for other processors: there, the memory is waited for.
    #[cfg(target_arch = "x86_64")]
    {
        use std::arch::x86_64::{_MM_HINT_T0, _mm_prefetch};
        for offset in (0..size_of::<T>()).step_by(64) {
            // SAFETY: law 1.
            unsafe { _mm_prefetch::<_MM_HINT_T0>(value.cast::<i8>().wrapping_add(offset)) };
        }
    }
    #[cfg(not(target_arch = "x86_64"))]
    let _ = value;
}
