//! From Embree's error state to an [`Error`] with Embree's own words.
//!
//! Embree keeps one error code per device *and thread*, and calls the device's error callback in
//! the thread whose call failed. So the text is kept per thread too, and a failure in one thread
//! never shows up as one of another.

use crate::error::{Error, Result};
use embree4_sys::{RTCDevice, RTCError, rtcGetDeviceError, rtcSetDeviceErrorFunction};
use std::cell::RefCell;
use std::ffi::{CStr, c_char, c_void};
use std::ptr;

thread_local! {
    /// The text of the first error since the last [`check`], which is the one whose code is kept.
    static TEXT: RefCell<Option<String>> = const { RefCell::new(None) };
}

unsafe extern "C" fn keep_text(_: *mut c_void, _: RTCError, text: *const c_char) {
    // SAFETY: Embree passes null or a string that lives during this call.
    let text = unsafe { owned(text) };
    // Embree may not be unwound through, so a thread that is going away is no reason to panic.
    let _ = TEXT.try_with(|kept| {
        if let Ok(mut kept) = kept.try_borrow_mut() {
            kept.get_or_insert(text.unwrap_or_default());
        }
    });
}

/// From now on, errors of `device` leave their text for [`check`].
pub(super) fn listen(device: RTCDevice) {
    // SAFETY: `device` is a live device; the callback needs no user data and cannot unwind.
    unsafe { rtcSetDeviceErrorFunction(device, Some(keep_text), ptr::null_mut()) }
}

/// Whether the calls in this thread since the last check went well; if not, `doing` failed.
pub(super) fn check(device: RTCDevice, doing: &str) -> Result<()> {
    let text = TEXT.take();
    // SAFETY: `device` is a live device. It was created for the CPU, and a CPU device's codes are
    // all variants of the crate's enum.
    match unsafe { rtcGetDeviceError(device) } {
        RTCError::NONE => Ok(()),
        code => Err(error(doing, code, text)),
    }
}

/// Why no device could be created, when there is none to ask.
pub(super) fn creation_error(doing: &str) -> Error {
    // SAFETY: null asks for the error of this thread's failed device creation; the code is one of
    // a CPU device, as in `check`.
    let code = unsafe { rtcGetDeviceError(ptr::null_mut()) };
    error(doing, code, last_message())
}

#[cfg(embree_last_error_message)]
fn last_message() -> Option<String> {
    // SAFETY: null asks for this thread's message, as above; the string lives until the thread's
    // next error, and is copied here.
    unsafe { owned(super::layout::rtcGetDeviceLastErrorMessage(ptr::null_mut())) }
}

/// Before 4.3.3 Embree gives the code alone.
#[cfg(not(embree_last_error_message))]
fn last_message() -> Option<String> {
    None
}

/// # Safety
/// `text` is null or a C string that lives during the call.
unsafe fn owned(text: *const c_char) -> Option<String> {
    // SAFETY: what this function demands.
    let text = (!text.is_null()).then(|| unsafe { CStr::from_ptr(text) })?;
    Some(text.to_string_lossy().into_owned()).filter(|text| !text.is_empty())
}

fn error(doing: &str, code: RTCError, text: Option<String>) -> Error {
    let text = text.filter(|text| !text.is_empty()).map_or(String::new(), |t| format!(": {t}"));
    let error = Error::new(format!("Embree cannot {doing}{text} ({})", name(code)));
    match code {
        RTCError::OUT_OF_MEMORY => {
            error.remedy("allow Embree more memory, or trace a smaller scene")
        }
        RTCError::UNSUPPORTED_CPU => error.remedy("choose an `isa` that this processor has"),
        _ => error,
    }
}

/// The code as Embree's documentation spells it.
fn name(code: RTCError) -> String {
    format!("RTC_ERROR_{code:?}")
}
