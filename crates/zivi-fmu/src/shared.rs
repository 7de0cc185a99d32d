//! Functions that FMI 2 and FMI 3 have alike, under their names in each.

/// Functions with an instance or its state as their only arguments that differ between the versions.
macro_rules! lifecycle {
    (
        free: $free:ident, log: $log:ident, ready: $ready:ident, end: $end:ident, reset: $reset:ident,
        get: $get:ident, set: $set:ident, forget: $forget:ident,
        size: $size:ident, store: $store:ident, restore: $restore:ident $(,)?
    ) => {
        #[no_mangle]
        unsafe extern "C" fn $free(it: *mut Instance) {
            // SAFETY: NULL or ours
            unsafe { common::freed(it) }
        }

        #[no_mangle]
        unsafe extern "C" fn $log(it: *mut Instance) -> Status {
            // SAFETY: NULL or ours; an error is always logged
            unsafe { common::instance(it) }.map_or(ERROR, |_| OK)
        }

        #[no_mangle]
        unsafe extern "C" fn $ready(it: *mut Instance) -> Status {
            // SAFETY: NULL or ours
            unsafe { common::instance(it) }.map_or(ERROR, Instance::exit_initialisation)
        }

        #[no_mangle]
        unsafe extern "C" fn $end(it: *mut Instance) -> Status {
            // SAFETY: NULL or ours
            unsafe { common::instance(it) }.map_or(ERROR, |it| it.go(mode::STEP, mode::TERMINATED))
        }

        #[no_mangle]
        unsafe extern "C" fn $reset(it: *mut Instance) -> Status {
            // SAFETY: NULL or ours
            unsafe { common::instance(it) }.map_or(ERROR, Instance::reset)
        }

        #[no_mangle]
        unsafe extern "C" fn $get(it: *mut Instance, to: *mut *mut FmuState) -> Status {
            // SAFETY: see there
            unsafe { common::get_state(it, to) }
        }

        #[no_mangle]
        unsafe extern "C" fn $set(it: *mut Instance, from: *mut FmuState) -> Status {
            // SAFETY: see there
            unsafe { common::set_state(it, from) }
        }

        #[no_mangle]
        unsafe extern "C" fn $forget(_it: *mut Instance, state: *mut *mut FmuState) -> Status {
            // SAFETY: see there
            unsafe { common::free_state(state) }
        }

        #[no_mangle]
        unsafe extern "C" fn $size(
            _it: *mut Instance,
            _state: *mut FmuState,
            size: *mut usize,
        ) -> Status {
            // SAFETY: see there
            unsafe { common::stored_size(size) }
        }

        #[no_mangle]
        unsafe extern "C" fn $store(
            it: *mut Instance,
            from: *mut FmuState,
            to: *mut u8,
            size: usize,
        ) -> Status {
            // SAFETY: see there
            unsafe { common::store(it, from, to, size) }
        }

        #[no_mangle]
        unsafe extern "C" fn $restore(
            it: *mut Instance,
            from: *const u8,
            size: usize,
            to: *mut *mut FmuState,
        ) -> Status {
            // SAFETY: see there
            unsafe { common::restore(it, from, size, to) }
        }
    };
}

/// Readers and writers of variables of one kind: names, the type in C, what makes it of a number and
/// a number of it, and in FMI 3 the length of the array.
macro_rules! variables {
    ($($get:ident $set:ident: $kind:ident as $type:ty, $made:expr, $read:expr $(, $room:ident)?;)*) => {$(
        #[no_mangle]
        unsafe extern "C" fn $get(
            it: *mut Instance,
            references: *const u32,
            count: usize,
            values: *mut $type,
            $($room: usize,)?
        ) -> Status {
            let (room, kind) = (count, DataType::$kind);
            $(let room = room.min($room);)?
            let asked = common::Variables { references, count, values, room, kind };
            // SAFETY: the arrays have this number of elements
            unsafe { common::get(it, asked, $made) }
        }

        #[no_mangle]
        unsafe extern "C" fn $set(
            it: *mut Instance,
            references: *const u32,
            count: usize,
            values: *const $type,
            $($room: usize,)?
        ) -> Status {
            let (room, kind) = (count, DataType::$kind);
            $(let room = room.min($room);)?
            let asked = common::Variables { references, count, values, room, kind };
            // SAFETY: the arrays have this number of elements
            unsafe { common::set(it, asked, $read) }
        }
    )*};
}

/// Functions that are not provided. They read only the instance of their arguments, which the
/// calling conventions of C allow.
macro_rules! absent {
    ($($name:ident)*) => {$(
        #[no_mangle]
        unsafe extern "C" fn $name(it: *mut Instance) -> Status {
            // SAFETY: NULL or ours
            unsafe { common::absent(it) }
        }
    )*};
}

pub(crate) use {absent, lifecycle, variables};
