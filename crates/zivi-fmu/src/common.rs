//! Common part of FMI 2 and FMI 3: memory, strings, arrays, stored states.

use core::ffi::{c_char, c_void, CStr};
use core::ptr::NonNull;

use crate::instance::{kept, Instance, Log, Status, ERROR, OK};
use crate::model::AnyModel;
use crate::state::FmuState;
use crate::table::DataType;

extern "C" {
    fn calloc(count: usize, size: usize) -> *mut c_void;
    fn free(pointer: *mut c_void);
}

/// A place on the heap for a value; NULL without memory.
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

/// An instance of the model with this token; NULL without memory, which is reported.
pub(crate) unsafe fn instantiated(
    name: *const c_char,
    token: *const c_char,
    resources: *const c_char,
    log: Log,
    environment: *mut c_void,
) -> *mut Instance {
    // SAFETY: strings of the importer
    let (name, token, resources) = unsafe { (bytes(name), bytes(token), bytes(resources)) };
    let Some(model) = AnyModel::of_token(token, resources) else {
        let words = c"the token is of another FMU, or of another version";
        log.tell(environment, &kept(name), ERROR, words);
        return core::ptr::null_mut();
    };
    // SAFETY: a plain structure
    unsafe { allocated(Instance::new(model, name, log, environment)) }
}

/// The object at a pointer, unless the pointer is NULL or not aligned.
pub(crate) unsafe fn place<'a, T>(pointer: *mut T) -> Option<&'a mut T> {
    if pointer.is_aligned() {
        // SAFETY: the importer's, or ours
        unsafe { pointer.as_mut() }
    } else {
        None
    }
}

/// The instance of a call.
pub(crate) unsafe fn instance<'a>(pointer: *mut Instance) -> Option<&'a mut Instance> {
    // SAFETY: the importer passes the pointer that an instantiation returned, or NULL
    unsafe { place(pointer) }
}

/// Whether the address of an array with elements is valid.
fn is_array<T>(pointer: *const T) -> bool {
    !pointer.is_null() && pointer.is_aligned()
}

/// Variables of one kind of a call: their references and their values.
pub(crate) struct Variables<T> {
    pub(crate) references: *const u32,
    pub(crate) count: usize,
    pub(crate) values: T,
    /// Number of values, in FMI 3.
    pub(crate) room: usize,
    pub(crate) kind: DataType,
}

impl<T> Variables<T> {
    /// Fault of the arrays.
    fn wrong<V>(&self, values: *const V) -> Option<&'static CStr> {
        if self.room < self.count {
            Some(c"there are less values than references")
        } else if self.count > 0 && !(is_array(self.references) && is_array(values)) {
            Some(c"an array is NULL or not aligned")
        } else {
            None
        }
    }
}

/// Reads variables of one kind into the array of the importer; `made` makes them of numbers.
pub(crate) unsafe fn get<V>(
    it: *mut Instance,
    asked: Variables<*mut V>,
    made: fn(f64) -> V,
) -> Status {
    // SAFETY: see `instance`
    let Some(it) = (unsafe { instance(it) }) else { return ERROR };
    if let Some(words) = asked.wrong(asked.values.cast_const()) {
        return it.tell(ERROR, words);
    }
    if asked.count == 0 {
        return OK;
    }
    let seen = it.seen();
    for k in 0..asked.count {
        // SAFETY: the array has this number of elements
        let reference = unsafe { asked.references.add(k).read() };
        match seen.get(it.model.table(), reference, asked.kind) {
            // SAFETY: as above
            Some(value) => unsafe { asked.values.add(k).write(made(value)) },
            None => return it.tell(ERROR, c"no variable of this type has this reference"),
        }
    }
    OK
}

/// Sets variables of one kind, none if one may not be set; `read` makes numbers of the values.
pub(crate) unsafe fn set<V: Copy>(
    it: *mut Instance,
    asked: Variables<*const V>,
    read: fn(V) -> f64,
) -> Status {
    // SAFETY: see `instance`
    let Some(it) = (unsafe { instance(it) }) else { return ERROR };
    if let Some(words) = asked.wrong(asked.values) {
        return it.tell(ERROR, words);
    }
    let before = it.state;
    for k in 0..asked.count {
        // SAFETY: the arrays have this number of elements
        let (reference, value) =
            unsafe { (asked.references.add(k).read(), asked.values.add(k).read()) };
        if it.set(reference, asked.kind, read(value)) != OK {
            it.state = before;
            return ERROR;
        }
    }
    OK
}

/// Copies the state to `*to`, which is allocated if NULL.
pub(crate) unsafe fn get_state(it: *mut Instance, to: *mut *mut FmuState) -> Status {
    // SAFETY: see `instance`; `to` points to NULL or to a state
    unsafe {
        let (Some(it), Some(to)) = (instance(it), place(to)) else { return ERROR };
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
pub(crate) unsafe fn set_state(it: *mut Instance, from: *mut FmuState) -> Status {
    // SAFETY: see `instance`; a state of this library
    unsafe {
        let (Some(it), Some(from)) = (instance(it), place(from)) else { return ERROR };
        if from.model != it.model.number() {
            return it.tell(ERROR, c"the state is of another model");
        }
        it.state = *from;
    }
    OK
}

/// Frees a state; NULL is harmless.
pub(crate) unsafe fn free_state(state: *mut *mut FmuState) -> Status {
    // SAFETY: NULL or a state of this library
    unsafe {
        if let Some(state) = place(state) {
            freed(*state);
            *state = core::ptr::null_mut();
        }
    }
    OK
}

/// Bytes of a stored state.
pub(crate) unsafe fn stored_size(size: *mut usize) -> Status {
    // SAFETY: NULL or a place for a number
    match unsafe { place(size) } {
        Some(size) => {
            *size = size_of::<FmuState>();
            OK
        }
        None => ERROR,
    }
}

/// A state as bytes.
pub(crate) unsafe fn store(
    it: *mut Instance,
    from: *const FmuState,
    to: *mut u8,
    size: usize,
) -> Status {
    // SAFETY: see `instance`; `to` has `size` bytes
    unsafe {
        let Some(it) = instance(it) else { return ERROR };
        if from.is_null() || to.is_null() || size != size_of::<FmuState>() {
            return it.tell(ERROR, c"a stored state has another size");
        }
        core::ptr::copy_nonoverlapping(from.cast(), to, size);
    }
    OK
}

/// A state from bytes, copied to `*to`, which is allocated if NULL.
pub(crate) unsafe fn restore(
    it: *mut Instance,
    from: *const u8,
    size: usize,
    to: *mut *mut FmuState,
) -> Status {
    // SAFETY: see `instance`; `from` has `size` bytes; any bytes are a state
    unsafe {
        let (Some(it), Some(to)) = (instance(it), place(to)) else { return ERROR };
        if from.is_null() || size != size_of::<FmuState>() {
            return it.tell(ERROR, c"a stored state has another size");
        }
        let state: FmuState = from.cast::<FmuState>().read_unaligned();
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

/// A function that all models lack.
pub(crate) unsafe fn absent(it: *mut Instance) -> Status {
    // SAFETY: see `instance`
    match unsafe { instance(it) } {
        Some(it) => it.tell(ERROR, c"this function is not provided"),
        None => ERROR,
    }
}
