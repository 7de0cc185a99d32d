//! The flights of a linear system of one coordinate, by those of its gaps.

use super::one_coordinate::{OneCoordinate, Pull};
use super::propagation::Propagation;
use super::{hit_together, Bounds, LinearFlight};
use crate::mechanics::mode::Next;
use crate::mechanics::path::Curve;
use crate::mechanics::state::MechanicalState;
use crate::record::gap_set::GapSet;
use crate::record::status::Failure;
use crate::system::force::Smooth;
use crate::Status;

impl LinearFlight {
    /// Acceleration towards its wall of a gap of one coordinate that was hit alone.
    pub(in crate::mechanics) fn pull(&self, hit: GapSet, state: &MechanicalState) -> Option<Pull> {
        let gap = hit.iter().next().filter(|_| hit.len() == 1 && state.closed().is_empty())?;
        self.one.as_ref().map(|one| one.pull(gap, state))
    }

    /// When the force of a gap vanishes, where that is known.
    pub(super) fn lift_off_of(
        &mut self,
        gap: usize,
        state: &MechanicalState,
    ) -> Option<Option<f64>> {
        let alone = state.closed() == GapSet::of(gap);
        self.one.as_mut().filter(|_| alone)?.lift_off(gap, state)
    }

    /// A free step of one coordinate, or the part of it up to an impact.
    pub(super) fn fly_one<E>(
        &mut self,
        one: &mut OneCoordinate,
        bounds: &Bounds,
        state: &mut MechanicalState,
        (motion, smooth): (&Propagation, Smooth),
    ) -> Result<(Next, f64), Failure<E>> {
        self.begin(state, smooth.nearest(state.now().t));
        let lead = one.lead(state);
        self.anchor(state, Some(lead));
        let zeros: Vec<usize> = (0..self.series.len())
            .map(|i| {
                self.series[i] = motion.gaps[i].series(&self.y);
                (self.series[i][0], self.series[i][1]) = state.gap(i);
                self.zeros_at_start(i, state)
            })
            .collect();
        let start = state.now().t;
        let flown = one.fly(bounds.t_end, |i| zeros[i], state);
        let each: Vec<_> = (0..zeros.len()).map(|i| one.series(i)).collect();
        self.series.iter_mut().zip(&each).for_each(|(series, [whole, _])| *series = *whole);
        self.curve = (flown.t > bounds.dense_from && flown.length > 0.0).then(|| {
            let q = one.coordinate_series(&each[lead][1], start, flown.length);
            let gaps = each.iter().flat_map(|[_, part]| part);
            Curve::of_powers(start, flown.length, q.iter().chain(gaps).copied().collect())
        });
        state.pass((flown.length, bounds.t_end), flown.arrives);
        let now = state.parts().1;
        (now.t, now.late) = (flown.t, flown.late);
        [now.x[0], now.xdot[0]] = one.coordinate(flown.t);
        for (i, &[x, v]) in one.ends().iter().enumerate() {
            (now.x[1 + i], now.xdot[1 + i]) = (if flown.closing == Some(i) { 0.0 } else { x }, v);
        }
        if !now.x.iter().chain(&now.xdot).all(|it| it.is_finite()) {
            return Err(Failure::Status(Status::StateNotFinite));
        }
        let next = flown
            .closing
            .map_or(Next::Step, |gap| Next::LocatedEvent(hit_together(gap, flown.length, state)));
        Ok((next, flown.length))
    }
}
