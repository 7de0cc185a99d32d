//! Which mutation is on, and which functions were reached: in the copy of the tree only.
extern crate std;
use std::io::Write;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering::Relaxed};

const UNREAD: u32 = u32::MAX;
const RECORD: u32 = u32::MAX - 1;
static ON: AtomicU32 = AtomicU32::new(UNREAD);
static REACHED: [AtomicBool; 8192] = [const { AtomicBool::new(false) }; 8192];

/// The mutation that `ZIVI_MUTANT` names, 0 for none; with `record` `place` is noted once.
#[inline]
pub fn on(place: usize) -> u32 {
    let on = ON.load(Relaxed);
    if on < RECORD {
        return on;
    }
    look(place)
}

#[cold]
#[inline(never)]
fn look(place: usize) -> u32 {
    if ON.load(Relaxed) == UNREAD {
        let given = std::env::var("ZIVI_MUTANT").unwrap_or_default();
        ON.store(if given == "record" { RECORD } else { given.parse().unwrap_or(0) }, Relaxed);
    }
    let on = ON.load(Relaxed);
    if on != RECORD {
        return on;
    }
    if !REACHED[place].swap(true, Relaxed) {
        if let Some(path) = std::env::var_os("ZIVI_REACHED") {
            let file = std::fs::OpenOptions::new().append(true).create(true).open(path);
            let _ = file.and_then(|mut file| file.write_all(std::format!("{place}\n").as_bytes()));
        }
    }
    0
}

/// Note every function again: the next test begins.
#[no_mangle]
pub extern "C" fn zivi_mutants_forget() {
    REACHED.iter().for_each(|reached| reached.store(false, Relaxed));
}
