//! Sets of gaps.

/// Some of the gaps of a system, at most 64.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct GapSet(pub(crate) u64);

impl GapSet {
    /// No gap.
    pub const EMPTY: Self = Self(0);

    /// One gap.
    #[must_use]
    pub fn of(gap: usize) -> Self {
        Self(1 << gap)
    }

    /// Whether the gap is one of them.
    #[must_use]
    pub fn has(self, gap: usize) -> bool {
        self.0 >> gap & 1 == 1
    }

    /// Whether there is none.
    #[must_use]
    pub fn is_empty(self) -> bool {
        self.0 == 0
    }

    /// How many there are.
    #[must_use]
    pub fn len(self) -> usize {
        self.0.count_ones() as usize
    }

    /// With those of the other set.
    #[must_use]
    pub fn with(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }

    /// Without those of the other set.
    #[must_use]
    pub fn without(self, other: Self) -> Self {
        Self(self.0 & !other.0)
    }

    /// The gaps, ascending.
    pub fn iter(self) -> impl Iterator<Item = usize> + Clone {
        let mut left = self.0;
        std::iter::from_fn(move || {
            let gap = left.trailing_zeros() as usize;
            (left != 0).then(|| {
                left &= left - 1;
                gap
            })
        })
    }
}

impl FromIterator<usize> for GapSet {
    fn from_iter<I: IntoIterator<Item = usize>>(gaps: I) -> Self {
        gaps.into_iter().fold(Self::EMPTY, |set, gap| set.with(Self::of(gap)))
    }
}
