//! Mechanical systems with their partial derivatives: by time, coordinates, velocities, parameters.

use std::sync::Arc;

use super::dynamics::{Dynamics, Layout};
use super::impact_law::AnyImpactLaw;
use super::linear_system::LinearSystem;

/// A time and a state of a mechanical system.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TimedState<'a> {
    /// Time (s).
    pub t: f64,
    /// Coordinates.
    pub q: &'a [f64],
    /// Velocities.
    pub w: &'a [f64],
}

/// A direction in state and parameters.
#[derive(Clone, Copy, Debug)]
pub struct StateDirection<'a> {
    /// By how much the coordinates move.
    pub q: &'a [f64],
    /// By how much the velocities move.
    pub w: &'a [f64],
    /// The parameter that moves at unit rate, by its number.
    pub parameter: Option<usize>,
}

/// Derivatives along single directions of a system whose numbers do not depend on time: for few
/// directions they cost less than all partial derivatives.
pub trait DirectionalDerivative: std::fmt::Debug + Send + Sync {
    /// All numbers of an evaluation (as [`Layout`] says) at coordinates and velocities, and their
    /// derivatives along a direction.
    fn along(
        &self,
        at: (&[f64], &[f64]),
        direction: StateDirection<'_>,
        out: (&mut [f64], &mut [f64]),
    );
}

/// A mechanical system whose partial derivatives are known.
pub trait DifferentiableDynamics<E>: Dynamics<E> {
    /// How many parameters it has.
    fn parameters(&self) -> usize;

    /// How far coordinates and velocities move in a run, roughly: differences take their steps from
    /// it.
    fn set_extent(&mut self, _q: &[f64], _w: &[f64]) {}

    /// The derivatives of all numbers of an evaluation (as [`Layout`] says), one
    /// after the other by: the time, each coordinate, each velocity, and the parameters `by`.
    ///
    /// # Errors
    /// Whatever the system raises.
    fn partials(&mut self, at: TimedState<'_>, by: &[usize], out: &mut [f64]) -> Result<(), E>;

    /// The same derivatives along single directions, if the system has them.
    fn directional(&self) -> Option<Arc<dyn DirectionalDerivative>> {
        None
    }

    /// The derivatives of the numbers of a linear system ([`Dynamics::linear`], whose system has all
    /// of them) by a parameter.
    fn linear_rate(&self, _parameter: usize) -> Option<&Arc<LinearSystem>> {
        None
    }

    /// How a parameter moves the laws of the gaps, if it does.
    fn moved_laws(&self, _parameter: usize) -> Option<&MovedLaws> {
        None
    }

    /// How far from a state the last derivatives looked: in the time, each coordinate, each velocity, and the
    /// parameters `by`. `None` for exact derivatives.
    fn reach(&self, _by: &[usize]) -> Option<Vec<f64>> {
        None
    }
}

impl<E, D: DifferentiableDynamics<E> + ?Sized> DifferentiableDynamics<E> for &mut D {
    fn parameters(&self) -> usize {
        (**self).parameters()
    }

    fn set_extent(&mut self, q: &[f64], w: &[f64]) {
        (**self).set_extent(q, w);
    }

    fn partials(&mut self, at: TimedState<'_>, by: &[usize], out: &mut [f64]) -> Result<(), E> {
        (**self).partials(at, by, out)
    }

    fn directional(&self) -> Option<Arc<dyn DirectionalDerivative>> {
        (**self).directional()
    }

    fn linear_rate(&self, parameter: usize) -> Option<&Arc<LinearSystem>> {
        (**self).linear_rate(parameter)
    }

    fn moved_laws(&self, parameter: usize) -> Option<&MovedLaws> {
        (**self).moved_laws(parameter)
    }

    fn reach(&self, by: &[usize]) -> Option<Vec<f64>> {
        (**self).reach(by)
    }
}

/// The step of a difference relative to the extent of its variable.
const STEP: f64 = 5e-4;
/// `f' = sum_k c_k (f(x + k h) - f(x - k h))/h`, of sixth order.
pub(crate) const WEIGHTS: [f64; 3] = [45.0 / 60.0, -9.0 / 60.0, 1.0 / 60.0];

/// Multiples of the step by which [`DifferencedDynamics`] moves a parameter: the systems
/// of a [`Neighbours`] belong to `p + k h`.
pub const MOVES: [f64; 6] = [-3.0, -2.0, -1.0, 1.0, 2.0, 3.0];

/// The step of a difference by a parameter, exact in binary.
#[must_use]
pub fn parameter_step(value: f64) -> f64 {
    let h = STEP * if value == 0.0 { 1.0 } else { value.abs() };
    let up = value + h;
    up - value
}

/// How a parameter moves a number of the contact force of a gap: gap, number, derivative.
pub type MovedNumber = (usize, usize, f64);

/// The laws of the gaps with other values of one parameter.
#[derive(Clone, Debug, Default)]
pub struct MovedLaws {
    /// `h`.
    pub step: f64,
    /// The impact laws that move, with the number of their gap, at `p + k h` with the factors [`MOVES`].
    pub impacts: Vec<(usize, [AnyImpactLaw; 6])>,
    /// Derivatives of the numbers of contact forces by the parameter.
    pub contacts: Vec<MovedNumber>,
}

impl MovedLaws {
    /// The derivative by the parameter of a number of the impact law of a gap.
    #[must_use]
    pub fn of_impact(&self, gap: usize, number: impl Fn(&AnyImpactLaw) -> f64) -> f64 {
        let Some((_, laws)) = self.impacts.iter().find(|it| it.0 == gap) else { return 0.0 };
        let across = |k: usize| number(&laws[3 + k]) - number(&laws[2 - k]);
        (0..3).map(|k| WEIGHTS[k] * across(k)).sum::<f64>() / self.step
    }
}

/// The system with other values of one parameter.
#[derive(Clone, Debug)]
pub struct Neighbours<D> {
    /// `h`.
    pub step: f64,
    /// The systems of `p + k h`, with the factors [`MOVES`].
    pub systems: [D; 6],
}

/// A system whose partial derivatives are central differences of sixth order: what rounding and
/// truncation leave of them is about `1e-12` of the numbers.
#[derive(Clone, Debug)]
pub struct DifferencedDynamics<D> {
    /// The system.
    pub dynamics: D,
    neighbours: Vec<Neighbours<D>>,
    /// Extents of the time, the coordinates and the velocities.
    extent: Vec<f64>,
    point: Vec<f64>,
    row: Vec<f64>,
}

impl<D> DifferencedDynamics<D> {
    /// Finite differences of a system over a duration (s).
    pub fn new(dynamics: D, neighbours: Vec<Neighbours<D>>, duration: f64) -> Self {
        let extent = vec![duration.abs().min(1.0)];
        Self { dynamics, neighbours, extent, point: Vec::new(), row: Vec::new() }
    }
}

impl<E, D: Dynamics<E>> Dynamics<E> for DifferencedDynamics<D> {
    fn layout(&self) -> Layout {
        self.dynamics.layout()
    }

    fn evaluate(&mut self, t: f64, q: &[f64], w: &[f64], out: &mut [f64]) -> Result<(), E> {
        self.dynamics.evaluate(t, q, w, out)
    }

    fn is_steady(&self) -> bool {
        self.dynamics.is_steady()
    }
}

impl<D> DifferencedDynamics<D> {
    /// Adds `weight (f(point) - f(other))` to `out`, where `other` is `point` but for one number: what never
    /// changes has no derivative, not even rounding.
    fn add_pair<E>(
        &mut self,
        n: usize,
        (c, other): (usize, f64),
        weight: f64,
        out: &mut [f64],
    ) -> Result<(), E>
    where
        D: Dynamics<E>,
    {
        let mut pair = [vec![0.0; out.len()], vec![0.0; out.len()]];
        for row in &mut pair {
            let (q, w) = self.point[1..].split_at(n);
            self.dynamics.evaluate(self.point[0], q, w, row)?;
            self.point[c] = other;
        }
        let [one, other] = &pair;
        let differences = one.iter().zip(other).map(|(one, other)| one - other);
        out.iter_mut().zip(differences).for_each(|(out, difference)| *out += weight * difference);
        Ok(())
    }

    /// Adds `weight f(point)` to `out`.
    fn add<E>(&mut self, n: usize, weight: f64, out: &mut [f64]) -> Result<(), E>
    where
        D: Dynamics<E>,
    {
        self.row.resize(out.len(), 0.0);
        let (q, w) = self.point[1..].split_at(n);
        self.dynamics.evaluate(self.point[0], q, w, &mut self.row)?;
        out.iter_mut().zip(&self.row).for_each(|(out, value)| *out += weight * value);
        Ok(())
    }

    /// The derivative by a parameter.
    fn by_parameter<E>(
        &mut self,
        at: TimedState<'_>,
        parameter: usize,
        out: &mut [f64],
    ) -> Result<(), E>
    where
        D: Dynamics<E>,
    {
        self.row.resize(out.len(), 0.0);
        let Neighbours { step, systems } = &mut self.neighbours[parameter];
        if systems[0].layout().p > 0 {
            // what never changes has no derivative, not even rounding
            let mut other = vec![0.0; out.len()];
            for k in 0..MOVES.len() / 2 {
                let last = MOVES.len() - 1 - k;
                let weight = WEIGHTS[MOVES[last] as usize - 1] / *step;
                systems[last].evaluate(at.t, at.q, at.w, &mut self.row)?;
                systems[k].evaluate(at.t, at.q, at.w, &mut other)?;
                let differences = self.row.iter().zip(&other).map(|(one, other)| one - other);
                out.iter_mut().zip(differences).for_each(|(out, it)| *out += weight * it);
            }
            return Ok(());
        }
        for (system, factor) in systems.iter_mut().zip(MOVES) {
            let weight = WEIGHTS[factor.abs() as usize - 1] * factor.signum() / *step;
            system.evaluate(at.t, at.q, at.w, &mut self.row)?;
            out.iter_mut().zip(&self.row).for_each(|(out, value)| *out += weight * value);
        }
        Ok(())
    }
}

impl<E, D: Dynamics<E>> DifferentiableDynamics<E> for DifferencedDynamics<D> {
    fn parameters(&self) -> usize {
        self.neighbours.len()
    }

    fn reach(&self, by: &[usize]) -> Option<Vec<f64>> {
        let most = WEIGHTS.len() as f64;
        let of_state = self.extent.iter().map(|extent| most * STEP * extent);
        let of_parameters = by.iter().map(|&it| most * self.neighbours[it].step);
        Some(of_state.chain(of_parameters).collect())
    }

    fn set_extent(&mut self, q: &[f64], w: &[f64]) {
        self.extent.truncate(1);
        self.extent.extend(q.iter().chain(w).map(|&size| if size > 0.0 { size } else { 1.0 }));
    }

    fn partials(&mut self, at: TimedState<'_>, by: &[usize], out: &mut [f64]) -> Result<(), E> {
        let length = self.layout().len();
        let here: Vec<f64> = [&[at.t], at.q, at.w].concat();
        self.extent.resize(here.len(), 1.0);
        out.fill(0.0);
        let (of_state, of_parameters) = out.split_at_mut(here.len() * length);
        for (c, out) in of_state.chunks_exact_mut(length).enumerate() {
            self.point.clone_from(&here);
            if c > 0 {
                self.extent[c] = self.extent[c].max(here[c].abs());
            }
            let up = here[c] + STEP * self.extent[c];
            let h = up - here[c];
            for (k, weight) in WEIGHTS.into_iter().enumerate() {
                if self.layout().p > 0 {
                    let moved = |sign: f64| here[c] + sign * (k + 1) as f64 * h;
                    self.point[c] = moved(1.0);
                    self.add_pair(at.q.len(), (c, moved(-1.0)), weight / h, out)?;
                    continue;
                }
                for sign in [1.0, -1.0] {
                    self.point[c] = here[c] + sign * (k + 1) as f64 * h;
                    self.add(at.q.len(), sign * weight / h, out)?;
                }
            }
        }
        for (&parameter, out) in by.iter().zip(of_parameters.chunks_exact_mut(length)) {
            self.by_parameter(at, parameter, out)?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::convert::Infallible;

    const LAYOUT: Layout = Layout::smooth(1, 0);

    /// `M = 2 + sin(p q)`, `F = p t w^3`
    #[derive(Clone, Copy)]
    struct System(f64);

    impl Dynamics<Infallible> for System {
        fn layout(&self) -> Layout {
            LAYOUT
        }

        fn evaluate(
            &mut self,
            t: f64,
            q: &[f64],
            w: &[f64],
            out: &mut [f64],
        ) -> Result<(), Infallible> {
            out.copy_from_slice(&[2.0 + (self.0 * q[0]).sin(), self.0 * t * w[0].powi(3)]);
            Ok(())
        }
    }

    #[test]
    fn differences_are_right_to_rounding() {
        let (p, t, q, w) = (1.3, 0.7, 0.4, -1.2);
        let step = parameter_step(p);
        let neighbours = Neighbours { step, systems: MOVES.map(|k| System(p + k * step)) };
        let mut differenced = DifferencedDynamics::new(System(p), vec![neighbours], 3.0);
        let mut out = [0.0; 8];
        let Ok(()) = differenced.partials(TimedState { t, q: &[q], w: &[w] }, &[0], &mut out);
        let cos = (p * q).cos();
        let exact = [
            [0.0, p * w.powi(3)],
            [p * cos, 0.0],
            [0.0, 3.0 * p * t * w * w],
            [q * cos, t * w.powi(3)],
        ];
        for (known, exact) in out.iter().zip(exact.as_flattened()) {
            assert!((known - exact).abs() < 5e-12, "{known} {exact}");
        }
    }
}
