//! Lists that grow with a run: where memory ends, the run ends and keeps what it has.

use std::collections::TryReserveError;

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
    /// There is no such room; the list is as it was.
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
        // a size beyond all numbers is refused by the allocator
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
            // what was there before fits again
            self.set_aside(held).ok();
        }
        grown
    }

    /// Makes the block so long; what it held before is given back first, so that memory is never
    /// taken twice.
    fn set_aside(&mut self, bytes: usize) -> Result<(), TryReserveError> {
        self.block = Vec::new();
        self.block.try_reserve_exact(bytes)
    }
}

#[cfg(test)]
mod tests {
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
