//! Columns of samples, and fallible memory for them.
//!
//! The samples of a run, a row for each quantity.

use std::collections::TryReserveError;
use zivi_core::Lifted;

/// One state of a run with the multipliers of the step that led to it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sample {
    /// The state.
    pub z: Lifted,
    /// `lambda_s` in `sgn s`.
    pub lambda_s: f64,
    /// `lambda_v` in `sgn v`.
    pub lambda_v: f64,
    /// The force of the step (m/s^2).
    pub f: f64,
}

/// The sampled quantities, in the order of the rows of a [`Columns`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Quantity {
    /// Time (s).
    T,
    /// Distance from the wall (m).
    X,
    /// Velocity (m/s).
    Xdot,
    /// Transformed position (m).
    S,
    /// Transformed velocity (m/s).
    V,
    /// Multiplier of the position's sign.
    LambdaS,
    /// Multiplier of the velocity's sign.
    LambdaV,
    /// Relative natural residual of the step that ends at the sample (0 at the first).
    Residual,
}

impl Quantity {
    /// All of them, in order.
    pub const ALL: [Quantity; QUANTITIES] = [
        Quantity::T,
        Quantity::X,
        Quantity::Xdot,
        Quantity::S,
        Quantity::V,
        Quantity::LambdaS,
        Quantity::LambdaV,
        Quantity::Residual,
    ];
}

/// Number of sampled quantities.
pub const QUANTITIES: usize = 8;

/// Numbers (64 MB) up to which the memory of a record may come from recycled memory, which an
/// allocator can only zero by touching all of it.
const LAZY: usize = 1 << 23;

/// The samples: one block of memory, a row for each [`Quantity`].
///
/// One block and not eight vectors, since a large one can be backed by large pages (see
/// [`crate::Monitor::record_allocated`]): filling fresh memory costs more than the steps do.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Columns {
    block: Vec<f64>,
    room: usize,
    len: usize,
}

impl Columns {
    /// Zeroed memory for `room` samples; `advise` is called with its address before it is touched.
    pub(crate) fn with_room(
        room: usize,
        advise: impl FnOnce(*const f64, usize),
    ) -> Result<Self, TryReserveError> {
        let size = QUANTITIES * room;
        let mut block = Vec::new();
        block.try_reserve_exact(size)?;
        if size <= LAZY {
            advise(block.as_ptr(), size);
            block.resize(size, 0.0);
        } else {
            // fresh from the system, which hands out pages as they are filled: a run that is
            // stopped early has not paid for all of them
            drop(block);
            block = vec![0.0; size];
            advise(block.as_ptr(), size);
        }
        Ok(Self { block, room, len: 0 })
    }

    /// Number of samples.
    #[must_use]
    pub fn len(&self) -> usize {
        self.len
    }

    /// Whether there is no sample.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len == 0
    }

    /// The samples of one quantity.
    #[must_use]
    pub fn of(&self, quantity: Quantity) -> &[f64] {
        &self.block[quantity as usize * self.room..][..self.len]
    }

    /// The whole block and the length of its rows, of which the first [`Columns::len`] entries
    /// are samples.
    #[must_use]
    pub fn into_block(self) -> (Vec<f64>, usize) {
        (self.block, self.room)
    }

    /// Forgets the samples and keeps the memory.
    pub(crate) fn clear(&mut self) {
        self.len = 0;
    }

    /// The next sample, in the order of [`Quantity`]: there must be room for it.
    #[inline]
    pub(crate) fn push(&mut self, sample: [f64; QUANTITIES]) {
        assert!(self.len < self.room, "a record of {} samples is full", self.room);
        for (row, value) in sample.into_iter().enumerate() {
            self.block[row * self.room + self.len] = value;
        }
        self.len += 1;
    }

    /// Room for the next `n` samples of every quantity, in the order of [`Quantity`].
    pub(crate) fn extend(&mut self, n: usize) -> [&mut [f64]; QUANTITIES] {
        let from = self.len;
        self.len += n;
        let mut rows = self.block.chunks_exact_mut(self.room);
        std::array::from_fn(|_| match rows.next() {
            Some(row) => &mut row[from..from + n],
            None => &mut [],
        })
    }
}

// Lists that grow with a run: where memory ends, the run ends and keeps what it has.

/// Bytes below which nothing is set aside: so much is always to be had.
const LITTLE: usize = 1 << 16;

/// Memory that is set aside while the lists of a run grow, for the arrays that are made of them
/// when it is over; dropping it makes room for those. It is one block, because the largest of them
/// is one array: several blocks, each between others, leave no place that is long enough.
#[derive(Debug, Default)]
pub(crate) struct Reserve {
    block: Vec<u8>,
}

impl Reserve {
    /// Makes room in `list` for `n` more entries, and sets `beside` bytes aside for each.
    ///
    /// # Errors
    /// There is no such room; the list is unchanged.
    #[inline]
    pub(crate) fn room<T>(
        &mut self,
        list: &mut Vec<T>,
        n: usize,
        beside: usize,
    ) -> Result<(), TryReserveError> {
        if list.capacity() - list.len() >= n {
            return Ok(());
        }
        self.grow(list, n, beside)
    }

    #[cold]
    fn grow<T>(
        &mut self,
        list: &mut Vec<T>,
        n: usize,
        beside: usize,
    ) -> Result<(), TryReserveError> {
        let capacity = list.capacity();
        // an overflowing size is rejected by the allocator
        let wanted = capacity.saturating_mul(2).max(list.len().saturating_add(n)).max(4);
        let bytes = (wanted - capacity).saturating_mul(beside);
        if bytes <= LITTLE {
            return list.try_reserve_exact(wanted - list.len());
        }
        let held = self.block.capacity();
        let grown = self
            .set_aside(held.saturating_add(bytes))
            .and_then(|()| list.try_reserve_exact(wanted - list.len()));
        if grown.is_err() {
            // the previous entries fit again
            self.set_aside(held).ok();
        }
        grown
    }

    /// Resizes the block; the old block is released first, so that memory is never doubled.
    fn set_aside(&mut self, bytes: usize) -> Result<(), TryReserveError> {
        self.block = Vec::new();
        self.block.try_reserve_exact(bytes)
    }
}

#[cfg(test)]
mod reserve_tests {
    use super::*;

    #[test]
    fn a_list_grows_with_what_is_set_aside_for_it() {
        let (mut reserve, mut list) = (Reserve::default(), Vec::new());
        for k in 0..100_000_u64 {
            reserve.room(&mut list, 1, 48).unwrap();
            list.push(k);
        }
        let aside = reserve.block.capacity();
        assert!(aside >= 48 * list.len() - LITTLE, "{aside}");
    }

    #[test]
    fn what_does_not_fit_leaves_the_list_as_it_was() {
        let (mut reserve, mut list) = (Reserve::default(), vec![1_u8, 2]);
        reserve.room(&mut list, 1 << 20, 8).unwrap();
        let aside = reserve.block.capacity();
        assert!(reserve.room(&mut list, usize::MAX, 1).is_err());
        assert!(reserve.room(&mut list, 1 << 22, usize::MAX).is_err());
        assert_eq!((list, reserve.block.capacity()), (vec![1, 2], aside));
    }
}
