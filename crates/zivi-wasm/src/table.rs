//! The table that the page reads.

use core::cell::UnsafeCell;

/// Doubles of a row.
pub(crate) const WIDTH: usize = 13;
/// Samples of the longest run.
pub(crate) const ROWS: usize = 20_001;

/// One sample.
pub(crate) struct SampleRow {
    pub(crate) x: f64,
    pub(crate) xdot: f64,
    pub(crate) s: f64,
    pub(crate) v: f64,
    pub(crate) x_ref: f64,
    pub(crate) xdot_ref: f64,
    pub(crate) u: f64,
    pub(crate) lambda_s: f64,
    pub(crate) lambda_v: f64,
    /// The signs of the reference and of the errors.
    pub(crate) others: [f64; 4],
}

impl SampleRow {
    /// A run has none of it.
    pub(crate) const EMPTY: Self = Self {
        x: f64::NAN,
        xdot: f64::NAN,
        s: f64::NAN,
        v: f64::NAN,
        x_ref: f64::NAN,
        xdot_ref: f64::NAN,
        u: f64::NAN,
        lambda_s: f64::NAN,
        lambda_v: f64::NAN,
        others: [f64::NAN; 4],
    };

    fn doubles(self) -> [f64; WIDTH] {
        let Self { x, xdot, s, v, x_ref, xdot_ref, u, lambda_s, lambda_v, others } = self;
        let [lambda_sr, lambda_vr, lambda_es, lambda_ev] = others;
        [
            x, xdot, s, v, x_ref, xdot_ref, u, lambda_s, lambda_v, lambda_sr, lambda_vr, lambda_es,
            lambda_ev,
        ]
    }
}

pub(crate) struct SampleTable(UnsafeCell<[[f64; WIDTH]; ROWS]>);

// SAFETY: a browser calls the functions of a module one after another
unsafe impl Sync for SampleTable {}

pub(crate) static TABLE: SampleTable = SampleTable(UnsafeCell::new([[0.0; WIDTH]; ROWS]));

impl SampleTable {
    pub(crate) fn start(&self) -> *const f64 {
        self.0.get().cast()
    }

    /// Fills the rows 0 to `n`, at most the size of the table, while there is a next one, and counts
    /// them.
    pub(crate) fn fill(&self, n: u32, mut row: impl FnMut(usize) -> Option<SampleRow>) -> Option<u32> {
        let last = n as usize;
        if last >= ROWS {
            return None;
        }
        // SAFETY: nobody else reads or writes while one of the functions runs, see above
        let rows = unsafe { &mut *self.0.get() };
        let mut filled = 0;
        for (k, to) in rows.iter_mut().take(last + 1).enumerate() {
            let Some(next) = row(k) else { break };
            *to = next.doubles();
            filled += 1;
        }
        Some(filled)
    }
}
