//! What FMI 2 and FMI 3 have in common: memory, strings, arrays, stored states.

use core::ffi::{c_char, c_void, CStr};
use core::ptr::NonNull;

use crate::instance::{Instance, Log, Status, ERROR, OK};
use crate::model::Model;
use crate::state::State;
use crate::table::Kind;

extern "C" {
    fn calloc(count: usize, size: usize) -> *mut c_void;
    fn free(pointer: *mut c_void);
}

/// A place on the heap for a value; NULL if there is no memory.
unsafe fn allocated<T>(value: T) -> *mut T {
    // SAFETY: the memory of calloc is aligned for anything
    unsafe {
        let place: *mut T = calloc(1, size_of::<T>()).cast();
        if !place.is_null() {
            place.write(value);
        }
        place
    }
}

/// Frees what was allocated; NULL is harmless.
pub(crate) unsafe fn freed<T>(pointer: *mut T) {
    // SAFETY: the importer gives back what it got
    unsafe { free(pointer.cast()) }
}

/// The bytes of a string, none for NULL.
unsafe fn bytes<'a>(string: *const c_char) -> &'a [u8] {
    match NonNull::new(string.cast_mut()) {
        // SAFETY: a string of an importer ends with 0
        Some(string) => unsafe { CStr::from_ptr(string.as_ptr()) }.to_bytes(),
        None => &[],
    }
}

/// An instance of the model with this token; NULL if there is none, which is told.
pub(crate) unsafe fn instantiated(
    name: *const c_char,
    token: *const c_char,
    log: Log,
    environment: *mut c_void,
) -> *mut Instance {
    // SAFETY: strings of the importer
    let (name, token) = unsafe { (bytes(name), bytes(token)) };
    let Some(model) = Model::of_token(token) else {
        let nobody = Instance::new(Model::Mass, name, log, environment);
        nobody.tell(ERROR, c"the token is of another FMU, or of another version");
        return core::ptr::null_mut();
    };
    // SAFETY: a plain structure
    unsafe { allocated(Instance::new(model, name, log, environment)) }
}

/// The instance of a call.
pub(crate) unsafe fn instance<'a>(pointer: *mut Instance) -> Option<&'a mut Instance> {
    // SAFETY: the importer gives what it got from an instantiation, or NULL
    unsafe { pointer.as_mut() }
}

/// Reads variables of one kind; `write` puts the k-th one into the array of the importer.
pub(crate) unsafe fn get(
    it: *mut Instance,
    references: *const u32,
    count: usize,
    kind: Kind,
    mut write: impl FnMut(usize, f64),
) -> Status {
    // SAFETY: see `instance`
    let Some(it) = (unsafe { instance(it) }) else { return ERROR };
    if count == 0 {
        return OK;
    }
    if references.is_null() {
        return it.tell(ERROR, c"an array is NULL");
    }
    let seen = it.seen();
    for k in 0..count {
        // SAFETY: the array has so many elements
        let reference = unsafe { references.add(k).read() };
        match seen.get(it.model, reference, kind) {
            Some(value) => write(k, value),
            None => return it.tell(ERROR, c"no variable of this type has this reference"),
        }
    }
    OK
}

/// Sets variables of one kind, none if one may not be set; `read` gives the k-th value.
pub(crate) unsafe fn set(
    it: *mut Instance,
    references: *const u32,
    count: usize,
    kind: Kind,
    read: impl Fn(usize) -> f64,
) -> Status {
    // SAFETY: see `instance`
    let Some(it) = (unsafe { instance(it) }) else { return ERROR };
    if count > 0 && references.is_null() {
        return it.tell(ERROR, c"an array is NULL");
    }
    let before = it.state;
    for k in 0..count {
        // SAFETY: the array has so many elements
        let reference = unsafe { references.add(k).read() };
        if it.set(reference, kind, read(k)) != OK {
            it.state = before;
            return ERROR;
        }
    }
    OK
}

/// Copies the state to `*to`, which is allocated if it is NULL.
pub(crate) unsafe fn get_state(it: *mut Instance, to: *mut *mut State) -> Status {
    // SAFETY: see `instance`; `to` points to NULL or to a state
    unsafe {
        let (Some(it), Some(to)) = (instance(it), to.as_mut()) else { return ERROR };
        if to.is_null() {
            *to = allocated(it.state);
        } else {
            to.write(it.state);
        }
        if to.is_null() {
            it.tell(ERROR, c"no memory")
        } else {
            OK
        }
    }
}

/// Puts a state back.
pub(crate) unsafe fn set_state(it: *mut Instance, from: *mut State) -> Status {
    // SAFETY: see `instance`; a state of this library
    unsafe {
        let (Some(it), Some(from)) = (instance(it), from.as_ref()) else { return ERROR };
        if from.model != it.model.number() {
            return it.tell(ERROR, c"the state is of another model");
        }
        it.state = *from;
    }
    OK
}

/// Frees a state; NULL is harmless.
pub(crate) unsafe fn free_state(state: *mut *mut State) -> Status {
    // SAFETY: NULL or a state of this library
    unsafe {
        if let Some(state) = state.as_mut() {
            freed(*state);
            *state = core::ptr::null_mut();
        }
    }
    OK
}

/// Bytes of a stored state.
pub(crate) unsafe fn stored_size(size: *mut usize) -> Status {
    // SAFETY: NULL or a place for a number
    match unsafe { size.as_mut() } {
        Some(size) => {
            *size = size_of::<State>();
            OK
        }
        None => ERROR,
    }
}

/// A state as bytes.
pub(crate) unsafe fn store(
    it: *mut Instance,
    from: *const State,
    to: *mut u8,
    size: usize,
) -> Status {
    // SAFETY: see `instance`; `to` has `size` bytes
    unsafe {
        let Some(it) = instance(it) else { return ERROR };
        if from.is_null() || to.is_null() || size != size_of::<State>() {
            return it.tell(ERROR, c"a stored state has another size");
        }
        core::ptr::copy_nonoverlapping(from.cast(), to, size);
    }
    OK
}

/// A state from bytes, copied to `*to`, which is allocated if it is NULL.
pub(crate) unsafe fn restore(
    it: *mut Instance,
    from: *const u8,
    size: usize,
    to: *mut *mut State,
) -> Status {
    // SAFETY: see `instance`; `from` has `size` bytes; any bytes are a state
    unsafe {
        let (Some(it), Some(to)) = (instance(it), to.as_mut()) else { return ERROR };
        if from.is_null() || size != size_of::<State>() {
            return it.tell(ERROR, c"a stored state has another size");
        }
        let state: State = from.cast::<State>().read_unaligned();
        if state.model != it.model.number() {
            return it.tell(ERROR, c"the state is of another model");
        }
        if to.is_null() {
            *to = allocated(state);
        } else {
            to.write(state);
        }
        if to.is_null() {
            it.tell(ERROR, c"no memory")
        } else {
            OK
        }
    }
}

/// A function that none of the models has.
pub(crate) unsafe fn absent(it: *mut Instance) -> Status {
    // SAFETY: see `instance`
    match unsafe { instance(it) } {
        Some(it) => it.tell(ERROR, c"this function is not provided"),
        None => ERROR,
    }
}
