//! What is requested of a run of a mechanical system, and what it leaves.

use crate::system::dynamics::Layout;
use std::collections::TryReserveError;

use super::path::MechanicalPath;
use crate::record::contact_mode::ContactMode;
use crate::record::occurrence::Occurrence;
use crate::record::point::MotionPoint;
use crate::record::reserve::Reserve;
use crate::{Counts, LocatedEvent, Status, UserEvent};

/// What a run shall give, besides what happens at the gaps.
pub struct MechanicalOutput<'a, E> {
    /// Times of the samples, increasing and within the span. `None`: a sample at the start, at the
    /// end of each step, after each event at a gap, and at the end.
    pub t_eval: Option<&'a [f64]>,
    /// Times at which the forces are not smooth (s), increasing.
    pub tstops: &'a [f64],
    /// Whether to keep the motion as a function of time.
    pub dense: bool,
    /// Whether to keep of the motion at least the arcs that jumps skip, with the impacts on them.
    pub arcs: bool,
    /// The user's events.
    pub events: Vec<UserEvent<'a, E, MotionPoint>>,
}

impl<E> Default for MechanicalOutput<'_, E> {
    fn default() -> Self {
        Self { t_eval: None, tstops: &[], dense: false, arcs: false, events: Vec::new() }
    }
}

/// Samples of a mechanical system.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct MechanicalSamples {
    /// Times (s).
    pub t: Vec<f64>,
    /// `q`, `g`, and what friction adds, `layout.size()` numbers a sample.
    pub x: Vec<f64>,
    /// Their rates, as many.
    pub v: Vec<f64>,
    /// Contact forces and those of friction, `m + p` numbers a sample.
    pub lambda: Vec<f64>,
    /// The closed gaps, and what friction does.
    pub modes: Vec<ContactMode>,
}

impl MechanicalSamples {
    /// Makes room for so many more, of so many coordinates and gaps.
    pub(super) fn make_room(
        &mut self,
        reserve: &mut Reserve,
        count: usize,
        layout: Layout,
    ) -> Result<(), TryReserveError> {
        const ASIDE: usize = size_of::<f64>();
        reserve.room(&mut self.t, count, ASIDE)?;
        reserve.room(&mut self.x, count * layout.size(), ASIDE)?;
        reserve.room(&mut self.v, count * layout.size(), ASIDE)?;
        reserve.room(&mut self.lambda, count * layout.rows(), ASIDE)?;
        reserve.room(&mut self.modes, count, layout.rows())
    }

    pub(super) fn push(
        &mut self,
        t: f64,
        (x, v): (&[f64], &[f64]),
        lambda: &[f64],
        mode: ContactMode,
    ) {
        self.t.push(t);
        self.x.extend_from_slice(x);
        self.v.extend_from_slice(v);
        self.lambda.extend_from_slice(lambda);
        self.modes.push(mode);
    }
}

/// A run of a mechanical system.
#[derive(Clone, Debug, PartialEq)]
pub struct MechanicalRun<E> {
    /// How many coordinates and gaps there are.
    pub layout: Layout,
    /// Samples.
    pub samples: MechanicalSamples,
    /// What happened at the gaps, in order.
    pub occurrences: Vec<Occurrence>,
    /// The user's events, by function.
    pub hits: Vec<Vec<LocatedEvent<MotionPoint>>>,
    /// The motion as a function of time, if it was asked for.
    pub path: Option<MechanicalPath>,
    /// How the run ended.
    pub status: Status,
    /// The error that the system, an event or the monitor raised.
    pub raised: Option<E>,
    /// How much work was done.
    pub counts: Counts,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn room_is_made_for_every_number_of_the_samples() {
        let (mut samples, mut reserve) = (MechanicalSamples::default(), Reserve::default());
        samples.make_room(&mut reserve, 100, Layout::smooth(4, 3)).unwrap();
        let MechanicalSamples { t, x, v, lambda, modes } = &samples;
        let rooms = [t.capacity(), x.capacity(), v.capacity(), lambda.capacity(), modes.capacity()];
        let needed = [100, 700, 700, 300, 100];
        assert!(rooms.iter().zip(needed).all(|(room, n)| *room >= n), "{rooms:?}");
    }
}
