//! Events that the user defines: zeros of functions of time and state along the motion.

use super::point::PathPoint;

/// Which changes of sign of a function are events.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Direction {
    /// From positive to negative.
    Falling,
    /// Both.
    #[default]
    Either,
    /// From negative to positive.
    Rising,
}

/// A level that an event waits for: its crossings are the roots of the polynomials of the motion,
/// found like impacts, without a look that could miss them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Level {
    /// `x` reaches this distance (m).
    Position(f64),
    /// `x'` reaches this velocity (m/s).
    Velocity(f64),
}

/// A function of time and state of which `E` is the error it may raise.
pub type EventFunction<'a, E, P = PathPoint> = Box<dyn FnMut(f64, &P) -> Result<f64, E> + 'a>;

/// An event: where a function of time and state changes its sign.
///
/// The function is looked at on both ends of each step and at three points between, and at least
/// 200 times in the span, and the zero is found on the dense output. A zero counts when it is reached, not when it is left: `g = x`
/// has one event, a falling one, at each impact. At an impact `x'` jumps; if `g` changes its sign
/// by that, the event is at the time of the impact and has the state after it. In a tail (see
/// [`crate::Tail`]) the arcs are looked at one by one like steps, down to those that rounding ends,
/// at most a million.
pub struct UserEvent<'a, E, P = PathPoint> {
    /// The function.
    pub function: EventFunction<'a, E, P>,
    /// Which changes of sign count.
    pub direction: Direction,
    /// The run ends at the event of this number (1 for the first), if any.
    pub terminal: Option<usize>,
    /// The level whose crossings the function tells, if it is that simple: where the motion knows
    /// them, the function is not looked at.
    pub level: Option<Level>,
}

impl<'a, E, P> UserEvent<'a, E, P> {
    /// An event in both directions that does not end the run, of a function of time and state.
    pub fn of(function: impl FnMut(f64, &P) -> Result<f64, E> + 'a) -> Self {
        Self {
            function: Box::new(function),
            direction: Direction::Either,
            terminal: None,
            level: None,
        }
    }
}

impl<'a, E> UserEvent<'a, E> {
    /// The same of a function `g(t, x, x')`.
    pub fn new(mut function: impl FnMut(f64, f64, f64) -> Result<f64, E> + 'a) -> Self {
        Self::of(move |t, at| function(t, at.x, at.xdot))
    }

    /// An event where the motion crosses a level.
    #[must_use]
    pub fn at_level(level: Level) -> Self {
        let distance = move |_: f64, at: &PathPoint| {
            Ok(match level {
                Level::Position(c) => at.x - c,
                Level::Velocity(c) => at.xdot - c,
            })
        };
        Self { level: Some(level), ..Self::of(distance) }
    }
}

/// An event that happened.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LocatedEvent<P = PathPoint> {
    /// Time (s).
    pub t: f64,
    /// The state.
    pub at: P,
}

/// Whether a function that goes from `before` to `after` reaches zero in the wanted direction.
pub(crate) fn changes(before: f64, after: f64, direction: Direction) -> bool {
    let rises = before < 0.0 && after >= 0.0;
    let falls = before > 0.0 && after <= 0.0;
    match direction {
        Direction::Rising => rises,
        Direction::Falling => falls,
        Direction::Either => rises || falls,
    }
}
