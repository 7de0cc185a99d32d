//! Objects of a loop.

/// Values of the largest loop.
pub(crate) const MOST: usize = 512;
/// Numbers of the largest state.
pub(crate) const ROOM: usize = 1024;

/// Numbers that change from period to period.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub(crate) struct Objects {
    pub(crate) numbers: [f64; ROOM],
}

impl Default for Objects {
    fn default() -> Self {
        Self { numbers: [0.0; ROOM] }
    }
}
