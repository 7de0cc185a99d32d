//! Numbers of a file, one after the other; none behind its end.

/// Numbers of a file, the next first.
pub(super) struct Numbers<'a>(&'a [u8]);

impl<'a> Numbers<'a> {
    pub(super) fn of(bytes: &'a [u8]) -> Self {
        Self(bytes)
    }

    /// Whether all of them have been read.
    pub(super) fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    pub(super) fn one(&mut self) -> Option<f64> {
        let (first, rest) = self.0.split_first_chunk()?;
        self.0 = rest;
        Some(f64::from_le_bytes(*first))
    }

    pub(super) fn array<const K: usize>(&mut self) -> Option<[f64; K]> {
        let mut array = [0.0; K];
        for it in &mut array {
            *it = self.one()?;
        }
        Some(array)
    }

    pub(super) fn many(&mut self, count: usize) -> Option<Vec<f64>> {
        (0..count).map(|_| self.one()).collect()
    }

    /// How many of something there are.
    pub(super) fn count(&mut self) -> Option<usize> {
        let value = self.one()?;
        (value >= 0.0 && value <= self.0.len() as f64 + 64.0).then_some(value as usize)
    }

    /// As many numbers, if a first one says that they are there.
    pub(super) fn optional(&mut self, count: usize) -> Option<Option<Vec<f64>>> {
        match self.one()? {
            0.0 => Some(None),
            _ => self.many(count).map(Some),
        }
    }
}
