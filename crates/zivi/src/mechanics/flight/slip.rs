//! Where the slip in a channel of friction ends.

use super::Flying;
use crate::mechanics::mode::Next;
use crate::piecewise::flight::SteppedFlight;
use crate::record::failure::Failure;
use crate::system::dynamics::Dynamics;

/// Iterations for the time when a slip ends, and what ends within this part of a step ends together.
const STOPS: usize = 6;
const TOGETHER_SLIPS: f64 = 1e-11;

/// Gauss's nodes and weights of order 20 on `(0, 1)`: half of them, the others are their mirror images.
const GAUSS: [(f64, f64); 5] = [
    (0.013_046_735_741_414_139, 0.033_335_672_154_344_07),
    (0.067_468_316_655_507_74, 0.074_725_674_575_290_3),
    (0.160_295_215_850_487_8, 0.109_543_181_257_991_02),
    (0.283_302_302_935_376_4, 0.134_633_359_654_998_18),
    (0.425_562_830_509_184_4, 0.147_762_112_357_376_43),
];

impl<D> Flying<'_, '_, D> {
    /// How far the polynomials of the last step move along the directions in which it sticks, by
    /// channel: `int B q' + beta dt`, which should be nothing. Empty where these do not turn or move, and
    /// so where the accelerations keep the step there, and for a step without a length.
    pub(super) fn drift<E>(&mut self) -> Result<Vec<f64>, Failure<E>>
    where
        D: Dynamics<E>,
    {
        let stick = self.state.mode().stick;
        if stick.is_empty() || !self.motion.turns || self.motion.last().h == 0.0 {
            return Ok(Vec::new());
        }
        self.complete()?;
        let p = self.state.layout().p;
        let mut along = self.along();
        let rows = along.rows(along.aside.coordinates());
        let mut drift = vec![0.0; p];
        for (node, weight) in GAUSS.into_iter().flat_map(|(x, w)| [(x, w), (1.0 - x, w)]) {
            along.evaluate(&rows, node)?;
            let h = along.step.h;
            let rates: Vec<f64> = rows.iter().map(|[x, _]| x.slope(node) / h).collect();
            for channel in stick.iter() {
                let row = along.aside.row(channel);
                drift[channel] += weight * h * along.aside.rate(row, &rates);
            }
        }
        Ok(drift)
    }

    /// Whether the channels that began to slip at the start of the step do so at its end.
    pub(super) fn released_channels_slip<E>(&mut self) -> Result<bool, Failure<E>>
    where
        D: Dynamics<E>,
    {
        let (released, mode) = (self.state.released(), self.state.mode());
        if released.is_empty() {
            return Ok(true);
        }
        self.finish()?;
        let (row, last) = (self.state.kinetics().row(0), self.motion.last());
        let first = self.state.layout().n + row;
        Ok(released.iter().all(|channel| {
            let (sign, c) = (mode.sign(channel), first + channel);
            sign * last.end.xdot[c] > 0.0 && sign * last.end_slope(c) > 0.0
        }))
    }

    /// The first channel whose slip ends in the step, and after which part of it.
    pub(super) fn first_stop<E>(&mut self) -> Result<Option<(f64, usize)>, Failure<E>>
    where
        D: Dynamics<E>,
    {
        let mode = self.state.mode();
        let slipping = mode.slipping().without(self.state.released());
        if slipping.is_empty() {
            return Ok(None);
        }
        self.complete()?;
        let first = self.state.layout().n + self.state.kinetics().row(0);
        let root = |channel: usize| {
            let [_, slip] = self.motion.last().polynomials_of(first + channel);
            let slip = if mode.slip_minus.has(channel) { slip.negated() } else { slip };
            slip.first_negative().map(|theta| (theta, channel))
        };
        let roots = slipping.iter().filter_map(root);
        Ok(roots.min_by(|one, other| one.0.total_cmp(&other.0)))
    }

    /// Steps to where the slip in a channel ends, near `now + length`; that in others ends with it to
    /// rounding.
    pub(super) fn stop_slip<E>(&mut self, length: f64, channel: usize) -> Result<Next, Failure<E>>
    where
        D: Dynamics<E>,
    {
        let first = self.state.layout().n + self.state.kinetics().row(0);
        let whole = self.motion.last().h;
        let rounding = |x: f64, t: f64| 4.0 * f64::EPSILON * (t.abs() + x);
        let mut x = length;
        for _ in 0..STOPS {
            self.attempt(x)?;
            self.finish()?;
            let last = self.motion.last();
            let next = x - last.end.xdot[first + channel] / last.end_slope(first + channel);
            if !next.is_finite() || next <= 0.0 || next > 2.0 * whole {
                break;
            }
            let moved = (next - x).abs();
            x = next;
            if moved <= rounding(x, self.state.now().t) {
                break;
            }
        }
        let near = TOGETHER_SLIPS * whole + rounding(x, self.state.now().t);
        let (last, mode) = (self.motion.last(), self.state.mode());
        let stops = |&other: &usize| {
            let c = first + other;
            other == channel || last.end.xdot[c].abs() <= last.end_slope(c).abs() * near
        };
        let channels = mode.slipping().iter().filter(stops).collect();
        self.arrive(x, x - self.motion.last().h)?;
        Ok(Next::Stop(channels))
    }
}

#[cfg(test)]
mod tests {
    use crate::mechanics::{simulate_mechanical, MechanicalOutput};
    use crate::record::occurrence::Occurrence;
    use crate::switched::{Order, SwitchedRk};
    use crate::system::dynamics::{Dynamics, Layout};
    use crate::system::friction::{Channel, Friction};
    use crate::Silent;
    use std::convert::Infallible;

    /// A mass of 1 with the friction 30, and its acceleration while it slips.
    struct Braked(Friction, fn(f64) -> f64);

    impl Dynamics<Infallible> for Braked {
        fn layout(&self) -> Layout {
            Layout { n: 1, m: 0, p: 1 }
        }

        fn friction(&self) -> &Friction {
            &self.0
        }

        fn evaluate(
            &mut self,
            t: f64,
            _: &[f64],
            _: &[f64],
            out: &mut [f64],
        ) -> Result<(), Infallible> {
            out.copy_from_slice(&[1.0, 30.0 + (self.1)(t), 1.0, 0.0, 0.0, 30.0, 30.0]);
            Ok(())
        }
    }

    #[test]
    fn a_stop_is_not_looked_for_far_from_the_step_that_has_it() {
        // 1 m/s, stopped after 0.052 s: by -20 m/s^2, but for 2 ms that no step of 0.1 s looks at.
        // The step onto 0.05 s ends in them, with a slope by which the slip would last to 1.05 s.
        // After 0.15 s the mass is pulled on.
        let acceleration = |t: f64| match t {
            t if (t - 0.05).abs() < 1e-3 => -0.131,
            t if t < 0.15 => -20.0,
            _ => 1.0,
        };
        let settings = SwitchedRk {
            order: Order::Five,
            max_step: 0.1,
            adaptive: false,
            ..SwitchedRk::DEFAULT
        };
        let friction =
            Friction { channels: vec![Channel { gap: None, e_t: 0.0 }], ..Friction::default() };
        let run = simulate_mechanical(
            settings,
            &mut Braked(friction, acceleration),
            &[],
            (0.0, 3.0),
            (&[0.0], &[1.0]),
            MechanicalOutput::default(),
            &mut Silent,
        )
        .unwrap();
        let stops: Vec<f64> = (run.occurrences.iter())
            .filter_map(|it| match *it {
                Occurrence::Transition { t, after: 0, .. } => Some(t),
                _ => None,
            })
            .collect();
        assert!(stops.len() == 1 && (stops[0] - 0.052).abs() < 3e-3, "{stops:?}");
    }
}
