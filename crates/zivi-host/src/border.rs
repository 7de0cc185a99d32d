//! The C interface: codes, messages, and panics turned into codes.

use std::cell::RefCell;
use std::ffi::{c_char, CString};
use std::panic::{catch_unwind, AssertUnwindSafe};

use zivi::SetupError;
use zivi_c::code::{ZIVI_E_NULL, ZIVI_E_SIZE};

/// An argument is out of range and is named by `zivi_last_error`; nothing was computed.
pub const ZIVI_E_INVALID: i32 = -50;
/// A fault in zivi, described by `zivi_last_error`.
pub const ZIVI_E_PANIC: i32 = -51;
/// Insufficient memory; nothing was computed.
pub const ZIVI_E_MEMORY: i32 = -52;

thread_local! {
    static WORDS: RefCell<CString> = RefCell::default();
}

/// The reason of a rejected call.
pub(crate) struct Refused {
    code: i32,
    words: String,
}

impl Refused {
    pub(crate) const NULL: &'static str = "a pointer is NULL or not aligned";

    pub(crate) fn null() -> Self {
        Self { code: ZIVI_E_NULL, words: Self::NULL.to_owned() }
    }

    pub(crate) fn memory(what: &str, n: usize) -> Self {
        let words = format!("{what} must be small enough for memory, got {n}");
        Self { code: ZIVI_E_MEMORY, words }
    }

    pub(crate) fn setup(error: SetupError) -> Self {
        let code = match error {
            SetupError::Memory(_) => ZIVI_E_MEMORY,
            _ => ZIVI_E_INVALID,
        };
        Self { code, words: error.to_string() }
    }

    pub(crate) fn size() -> Self {
        Self { code: ZIVI_E_SIZE, words: "size is not that of this library's structure".to_owned() }
    }
}

impl<E: std::fmt::Display> From<E> for Refused {
    fn from(error: E) -> Self {
        Self { code: ZIVI_E_INVALID, words: error.to_string() }
    }
}

/// Runs the body of a call; returns a code, and stores a message if the call is rejected or fails.
pub(crate) fn guarded(call: impl FnOnce() -> Result<i32, Refused>) -> i32 {
    let refused = match catch_unwind(AssertUnwindSafe(call)) {
        Ok(Ok(code)) => return code,
        Ok(Err(refused)) => refused,
        Err(panic) => {
            let words = panic.downcast_ref::<String>().cloned();
            let words = words.or_else(|| panic.downcast_ref::<&str>().map(|it| (*it).to_owned()));
            Refused { code: ZIVI_E_PANIC, words: words.unwrap_or_default() }
        }
    };
    let words = CString::new(refused.words.replace('\0', " ")).unwrap_or_default();
    WORDS.with(|kept| *kept.borrow_mut() = words);
    refused.code
}

/// Message of the last call of this thread that returned a code < 0; valid until the next such call.
#[no_mangle]
pub extern "C" fn zivi_last_error() -> *const c_char {
    WORDS.with(|kept| kept.borrow().as_ptr())
}

/// The object at a pointer.
pub(crate) unsafe fn read<'a, T>(pointer: *const T) -> Result<&'a T, Refused> {
    let aligned = pointer.is_aligned();
    // SAFETY: by contract it points to an object
    unsafe { pointer.as_ref() }.filter(|_| aligned).ok_or_else(Refused::null)
}

/// The object at a pointer, to be written.
pub(crate) unsafe fn written<'a, T>(pointer: *mut T) -> Result<&'a mut T, Refused> {
    let aligned = pointer.is_aligned();
    // SAFETY: by contract it points to an object
    unsafe { pointer.as_mut() }.filter(|_| aligned).ok_or_else(Refused::null)
}

/// An array of the caller; NULL is one without elements.
pub(crate) unsafe fn array<'a>(pointer: *const f64, length: usize) -> Result<&'a [f64], Refused> {
    if length == 0 {
        return Ok(&[]);
    }
    if pointer.is_null() || !pointer.is_aligned() || length > isize::MAX as usize / 8 {
        return Err(Refused::null());
    }
    // SAFETY: by contract it has this number of elements
    Ok(unsafe { std::slice::from_raw_parts(pointer, length) })
}

/// A list of equal numbers, if it fits into memory; `what` and `n` are the caller's, for the message.
pub(crate) fn filled<T: Copy>(
    value: T,
    length: usize,
    (what, n): (&str, usize),
) -> Result<Vec<T>, Refused> {
    let mut list = Vec::new();
    list.try_reserve_exact(length).map_err(|_| Refused::memory(what, n))?;
    list.resize(length, value);
    Ok(list)
}

/// A structure states its size.
pub(crate) fn checked_size<T>(size: u32) -> Result<(), Refused> {
    if size as usize == size_of::<T>() {
        Ok(())
    } else {
        Err(Refused::size())
    }
}

/// A function of the caller failed.
#[derive(Clone, Copy, Debug)]
pub(crate) struct CallerFailed;
