//! What a run asks of a method that advances piece by piece.

use crate::record::failure::Failure;
use crate::record::point::Recorded;
use crate::system::stops::Smooth;

/// A method that advances piece by piece: a step, a jump, an event at an instant.
pub(crate) trait Piecewise {
    /// A state, as it is recorded.
    type Point: Recorded;
    /// What is told of a piece.
    type Piece;

    /// Time (s).
    fn t(&self) -> f64;

    /// Writes the present state.
    fn state_to(&self, to: &mut Self::Point);

    /// Whether something happens before the time moves on beyond `t_end`.
    fn is_pending(&self, _t_end: f64) -> bool {
        false
    }

    /// Forgets what was learnt from the forces: from here on they are others.
    fn restart(&mut self);

    /// Steps that end later than `t` have their polynomials computed; the motion within those that
    /// end later than `drawn` is requested.
    fn look_from(&mut self, t: f64, drawn: f64);
}

/// What a method asks: a force, or the equations of motion. Times at which it is not smooth are
/// declared.
pub(crate) trait Rhs {
    /// Between which of these it is.
    fn smooth(&mut self) -> &mut Smooth;
}

/// Takes the pieces of a run; one that follows the motion may refuse a step and ask for a shorter.
pub(crate) trait Driver<M: Piecewise, S, E> {
    /// The next piece of the motion, towards `t_end`.
    fn step(&mut self, method: &mut M, t_end: f64, asked: &mut S) -> Result<M::Piece, Failure<E>>;

    /// A declared time is passed: from here on the forces may be others.
    fn enter(&mut self, _method: &mut M, _asked: &mut S) -> Result<(), Failure<E>> {
        Ok(())
    }
}

/// A method that takes a piece as it comes.
pub(crate) trait Advance<S, E>: Piecewise {
    /// The next piece of the motion, towards `t_end`.
    fn next(&mut self, t_end: f64, asked: &mut S) -> Result<Self::Piece, Failure<E>>;
}

/// Takes the pieces as they come.
pub(crate) struct NoSink;

impl<M: Advance<S, E>, S, E> Driver<M, S, E> for NoSink {
    fn step(&mut self, method: &mut M, t_end: f64, asked: &mut S) -> Result<M::Piece, Failure<E>> {
        method.next(t_end, asked)
    }
}
