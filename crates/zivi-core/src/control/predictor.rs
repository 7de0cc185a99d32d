//! Controls that act some periods late: the state in which that of this sample will act.
//!
//! ```text
//! (x, x')(t_k + d h) from (x, x')(t_k) through u_{k-d}, ..., u_{k-1}, each for a period
//! ```
//!
//! through impacts and into rest, exactly where the force is known. A tick for that state, its
//! reference `d` periods ahead, is a tick without delay.

use core::ops::Bound;

use crate::setting::{Setting, SettingError, Value, Values};
use crate::{flight, Physical, Real, Restitution};

/// The longest delay (periods).
pub const MOST_DELAY: usize = 64;

/// The delay of a controller that predicts.
pub const DELAY: Setting = Setting {
    name: "delay",
    meaning: "periods from a measurement to the moment when its control acts",
    unit: "1",
    values: Values::Numbers(Bound::Included(0.0), Bound::Included(MOST_DELAY as Real)),
    range: "a whole number of periods from 0 to 64",
    default: Value::Count(0),
};

/// What comes out as many periods later as it is long.
///
/// ```
/// use zivi_core::control::DelayLine;
/// let mut line = DelayLine::new(2, 0.0)?;
/// assert_eq!([1.0, 2.0, 3.0].map(|it| line.push(it)), [0.0, 0.0, 1.0]);
/// assert!(line.held().eq([2.0, 3.0]));
/// # Ok::<(), zivi_core::SettingError>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DelayLine<T> {
    periods: usize,
    /// Where the oldest is.
    first: usize,
    held: [T; MOST_DELAY],
}

impl<T: Copy> DelayLine<T> {
    /// One of this length, with the same in all its places.
    ///
    /// # Errors
    /// [`SettingError`] if it is longer than [`MOST_DELAY`].
    pub fn new(periods: usize, value: T) -> Result<Self, SettingError> {
        DELAY.check(periods as Real)?;
        Ok(Self { periods, first: 0, held: [value; MOST_DELAY] })
    }

    /// Its length.
    #[must_use]
    pub fn periods(&self) -> usize {
        self.periods
    }

    /// Puts one in and gives the oldest.
    pub fn push(&mut self, value: T) -> T {
        let oldest = self.oldest().unwrap_or(value);
        let last = (self.first + self.periods) % MOST_DELAY;
        if let Some(place) = self.held.get_mut(last) {
            *place = value;
        }
        self.first = (self.first + 1) % MOST_DELAY;
        oldest
    }

    /// The one that comes out next, `None` of a line without length.
    #[must_use]
    pub fn oldest(&self) -> Option<T> {
        self.held().next()
    }

    /// Those in it, the oldest first.
    pub fn held(&self) -> impl Iterator<Item = T> + '_ {
        self.held.iter().cycle().skip(self.first).take(self.periods).copied()
    }
}

impl DelayLine<Real> {
    /// The state after these controls, each for a period `h` (s), with the acceleration `force` beside
    /// them.
    #[must_use]
    pub fn ahead(&self, state: Physical, wall: Restitution, force: Real, h: Real) -> Physical {
        self.held().fold(state, |at, u| flight::after(at, force + u, wall.e(), h))
    }
}
