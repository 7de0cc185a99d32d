//! The plant model of a controller, its tasks, and the controls that were sent.
//!
//! The model of a plant in a controller.

use zivi_core::control::Waypoint;
use zivi_core::{Branch, Physical, SettingError};

use super::{GapKinetics, LawError};
use crate::mechanics::{simulate_mechanical_loop, Sampling};
use crate::numeric::cholesky;
use crate::numeric::dense::dot;
use crate::numeric::elimination::Singular;
use crate::switched::{Order, SwitchedRk};
use crate::system::dynamics::{Driven, Dynamics, Layout};
use crate::{AnyImpactLaw, Monitor, Status};

/// One step of the pair of order 5 between two of these times, whose length no error controls.
#[must_use]
pub fn one_step_each(settings: SwitchedRk, times: &[f64]) -> SwitchedRk {
    let longest = times.windows(2).map(|it| it[1] - it[0]).fold(0.0, f64::max);
    SwitchedRk { adaptive: false, max_step: longest, order: Order::Five, ..settings }
}

/// Nobody watches.
struct Unwatched;

impl<E> Monitor<E> for Unwatched {
    fn poll(&mut self, _: usize, _: usize) -> Result<(), E> {
        Ok(())
    }
}

/// Steps of Newton's method onto closed gaps.
const PROJECTIONS: usize = 4;

/// A system that is evaluated at states, and moves under held controls, with its impacts and contacts.
#[derive(Debug)]
pub struct BelievedPlant<'a, D, F> {
    /// The system.
    pub driven: &'a mut Driven<D, F>,
    /// Functions of its coordinates that may follow a reference.
    pub tasks: Option<&'a mut Tasks<D>>,
    /// Impact laws of the gaps.
    pub laws: &'a [AnyImpactLaw],
    /// Length of a period (s).
    pub h: f64,
}

/// Coordinates, velocities, contacts.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Moved {
    /// Coordinates.
    pub q: Vec<f64>,
    /// Velocities.
    pub w: Vec<f64>,
    /// Which gaps are closed.
    pub closed: Vec<bool>,
    /// Whether the motion was computed to its end; otherwise it stops at the last valid state.
    pub completed: bool,
}

impl<D, F> BelievedPlant<'_, D, F> {
    /// How many coordinates and gaps there are.
    pub fn layout<E>(&self) -> Layout
    where
        Driven<D, F>: Dynamics<E>,
    {
        Dynamics::<E>::layout(self.driven)
    }

    /// Evaluates the system without controls, and its kinetics; the matrix of inputs is that of this
    /// state from now on.
    ///
    /// # Errors
    /// [`LawError`].
    pub fn look<E>(
        &mut self,
        t: f64,
        (q, w): (&[f64], &[f64]),
        kinetics: &mut GapKinetics,
    ) -> Result<(), LawError<E>>
    where
        Driven<D, F>: Dynamics<E>,
    {
        self.look_at_any(t, (q, w), kinetics)?;
        kinetics.check_independent()
    }

    /// The same of gaps that may depend on each other.
    fn look_at_any<E>(
        &mut self,
        t: f64,
        (q, w): (&[f64], &[f64]),
        kinetics: &mut GapKinetics,
    ) -> Result<(), LawError<E>>
    where
        Driven<D, F>: Dynamics<E>,
    {
        self.driven.release();
        self.driven.evaluate_again(t, q, w, &mut kinetics.row).map_err(LawError::Raised)?;
        kinetics.renew(w)
    }

    /// Moves on by as many periods as there are controls, by one step of order five a period.
    ///
    /// # Errors
    /// [`LawError`], which includes a state with a gap below 0.
    pub fn moved<E>(
        &mut self,
        t: f64,
        (q, w): (&[f64], &[f64]),
        controls: &[f64],
    ) -> Result<Moved, LawError<E>>
    where
        D: Dynamics<E>,
        Driven<D, F>: Dynamics<E>,
    {
        let (h, r, layout) = (self.h, self.driven.control().len(), self.layout::<E>());
        let times: Vec<f64> = (0..=controls.len() / r).map(|k| t + h * k as f64).collect();
        let settings = SwitchedRk { rtol: 1e-9, atol: [1e-12; 2], ..SwitchedRk::DEFAULT };
        let settings = one_step_each(settings, &times);
        let sampling = Sampling { times: &times, stops: &times[1..times.len() - 1] };
        let mut ticks = |k: usize, _: f64, _: (&[f64], &[f64]), u: &mut [f64]| -> Result<(), E> {
            u.copy_from_slice(&controls[k * r..][..r]);
            Ok(())
        };
        let (system, start) = ((&mut *self.driven, self.laws), (&controls[..r], &mut ticks));
        let (run, _) = simulate_mechanical_loop(
            settings,
            system,
            sampling,
            (q, w),
            start,
            (false, None),
            &mut Unwatched,
        )
        .map_err(LawError::Setup)?;
        if let Some(raised) = run.raised {
            return Err(LawError::Raised(raised));
        }
        let last = run.samples.x.len() - layout.size();
        let picked = |of: &[f64]| of[last..][..layout.n].to_vec();
        let mode = run.samples.modes.last().map(|mode| mode.closed).unwrap_or_default();
        let closed = (0..layout.m).map(|i| mode.has(i)).collect();
        let completed = run.status == Status::Completed;
        Ok(Moved { q: picked(&run.samples.x), w: picked(&run.samples.v), closed, completed })
    }

    /// Where a state will be after these controls, from where it fits the contacts that are held.
    ///
    /// # Errors
    /// [`LawError`].
    pub(super) fn ahead<E>(
        &mut self,
        t: f64,
        (q, w): (&[f64], &[f64]),
        held: &[bool],
        controls: Vec<f64>,
        kinetics: &mut GapKinetics,
    ) -> Result<(Vec<f64>, Vec<f64>), LawError<E>>
    where
        D: Dynamics<E>,
        Driven<D, F>: Dynamics<E>,
    {
        let (mut q, mut w) = (q.to_vec(), w.to_vec());
        self.onto(t, (&mut q, &mut w), held, kinetics)?;
        let moved = self.moved(t, (&q, &w), &controls)?;
        Ok((moved.q, moved.w))
    }

    /// Moves a state, M-orthogonally, to where contacts are closed and no gap is below 0.
    ///
    /// # Errors
    /// [`LawError`].
    pub fn onto<E>(
        &mut self,
        t: f64,
        (q, w): (&mut [f64], &mut [f64]),
        closed: &[bool],
        kinetics: &mut GapKinetics,
    ) -> Result<(), LawError<E>>
    where
        Driven<D, F>: Dynamics<E>,
    {
        let mut moved = Vec::with_capacity(closed.len());
        for _ in 0..PROJECTIONS {
            self.look_at_any(t, (q, w), kinetics)?;
            let gaps = kinetics.gaps().to_vec();
            moved.clear();
            moved.extend(closed.iter().zip(&gaps).map(|(closed, gap)| *closed || *gap < 0.0));
            if moved.iter().zip(&gaps).all(|(moved, gap)| !moved || *gap == 0.0) {
                break;
            }
            kinetics.push(&moved, gaps, q);
        }
        if closed.contains(&true) {
            self.look_at_any(t, (q, w), kinetics)?;
            let rates = kinetics.rates.clone();
            kinetics.push(closed, rates, w);
        }
        Ok(())
    }
}

// Functions of the coordinates that follow a reference in addition to the gaps.
//
// ```text
// y'  = J T w + C g' + y_t           C = J M^-1 N^T W^-1
// y'' = J T b + C (g'' - h) + k      Z q'' = b, h and k what g'' and y'' are without acceleration
// J T b = y_r'' - k + C h - kp (y - y_r) - kd (J T w + y_t - y_r')
// ```
//
// What impacts and contact forces do to `y` by `C` is left alone: in flight `y` follows `y_r + C g`,
// in contact `y_r`. Where `J T` has fewer rows than columns, the rest follows the posture; where it
// has not full rank, this is the solution by least squares.

/// Squares of singular values below this part of the largest are zero.
const SMALL: f64 = 1e-12;

/// Functions of the coordinates: the gaps of a system whose masses and forces do not matter.
#[derive(Clone, Debug)]
pub struct Tasks<D> {
    dynamics: D,
    row: Vec<f64>,
}

impl<D> Tasks<D> {
    /// The gaps of this system.
    pub fn new<E>(dynamics: D) -> Self
    where
        D: Dynamics<E>,
    {
        let row = vec![0.0; dynamics.layout().len()];
        Self { dynamics, row }
    }

    /// Changes accelerations in the null space of the gaps, by minimal kinetic energy, so that the
    /// functions follow `goal`: values, first and second derivatives.
    ///
    /// # Errors
    /// What the functions raise.
    pub(super) fn steer<E>(
        &mut self,
        t: f64,
        (q, w): (&[f64], &[f64]),
        (goal, (kp, kd)): (&[f64], (f64, f64)),
        kinetics: &mut GapKinetics,
        wanted: &mut [f64],
    ) -> Result<(), E>
    where
        D: Dynamics<E>,
    {
        self.dynamics.evaluate(t, q, w, &mut self.row)?;
        let (layout, row) = (self.dynamics.layout(), &self.row);
        let Layout { n, m: count, .. } = layout;
        let every = vec![true; kinetics.layout().m];
        let (mut along, mut turning) = (w.to_vec(), vec![0.0; n]);
        kinetics.without_gaps(&every, &mut along);
        kinetics.without_gaps(&every, wanted);
        kinetics.push(&every, kinetics.curvatures().to_vec(), &mut turning);
        let (mut directions, mut missing) = (Vec::with_capacity(count * n), vec![0.0; count]);
        for i in 0..count {
            let jacobian = &row[layout.gradient()][i * n..][..n];
            let rate = dot(jacobian, &along) + row[layout.rate()][i];
            let error = (row[layout.gap()][i] - goal[i], rate - goal[count + i]);
            let drift = row[layout.curvature()][i] + dot(jacobian, &turning);
            let asked = goal[2 * count + i] - drift - kp * error.0 - kd * error.1;
            missing[i] = asked - dot(jacobian, wanted);
            let mut direction = jacobian.to_vec();
            cholesky::solve(&kinetics.mass, n, &mut direction);
            kinetics.without_gaps(&every, &mut direction);
            directions.extend(direction);
        }
        let jacobians = row[layout.gradient()].chunks_exact(n);
        let reach: Vec<f64> = jacobians
            .flat_map(|row| directions.chunks_exact(n).map(move |direction| dot(row, direction)))
            .collect();
        let found = Singular::new(&reach, count, count);
        let parts = found.solve(&missing, found.rank(SMALL));
        for (part, direction) in parts.iter().zip(directions.chunks_exact(n)) {
            wanted.iter_mut().zip(direction).for_each(|(to, by)| *to += part * by);
        }
        Ok(())
    }
}

// The controls that a law has sent: the last ones, and those that do not act yet.

/// Controls that were sent.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SentControls {
    /// The last controls, none before the first update.
    pub last: Option<Vec<f64>>,
    /// Those of as many updates as the delay at most, the oldest first.
    pub queue: Vec<Vec<f64>>,
}

impl SentControls {
    /// Whether they are `r` finite controls each.
    pub(super) fn fits(&self, r: usize) -> bool {
        let fits = |u: &Vec<f64>| u.len() == r && u.iter().all(|it| it.is_finite());
        self.last.iter().chain(&self.queue).all(fits)
    }

    /// The last controls once more, 0 before any.
    pub(super) fn hold(&self, u: &mut [f64]) {
        match &self.last {
            Some(last) => u.copy_from_slice(last),
            None => u.fill(0.0),
        }
    }

    /// Remembers what is sent.
    pub(super) fn send(&mut self, u: &[f64], delay: usize) {
        self.last = Some(u.to_vec());
        if delay > 0 {
            if self.queue.len() == delay {
                self.queue.remove(0);
            }
            self.queue.push(u.to_vec());
        }
    }

    /// The controls of the periods until that of this update acts, one after the other.
    pub(super) fn until(&self, delay: usize, r: usize) -> Vec<f64> {
        let mut controls = vec![0.0; r * (delay - self.queue.len())];
        self.queue.iter().for_each(|u| controls.extend_from_slice(u));
        controls
    }
}

// References of mechanical systems at the samples of a controller.

/// Where a reference is at one sample.
#[derive(Clone, Copy, Debug)]
pub struct ReferenceSample<'a> {
    /// Coordinates.
    pub q: &'a [f64],
    /// Velocities.
    pub w: &'a [f64],
    /// 1 or -1 for each gap, the other after each impact.
    pub sides: &'a [f64],
    /// Which gaps are closed and stay so.
    pub contacts: &'a [bool],
    /// Gaps and their rates; without them the controller's own model says.
    pub gaps: Option<(&'a [f64], &'a [f64])>,
    /// Accelerations of the gaps without the force of their own contact. Missing or NaN
    /// accelerations are replaced by the difference quotient of the rates.
    pub accelerations: Option<&'a [f64]>,
    /// Accelerations of the coordinates without contact forces, 0 without them.
    pub turning: Option<&'a [f64]>,
    /// Functions of the coordinates, then their first and their second derivatives in time.
    pub tasks: Option<&'a [f64]>,
}

/// A reference at all samples, row by row.
#[derive(Clone, Debug, Default)]
pub struct MechanicalReference {
    /// Coordinates, velocities and accelerations of the coordinates.
    pub q: Vec<f64>,
    /// Velocities.
    pub w: Vec<f64>,
    /// Accelerations without contact forces.
    pub turning: Vec<f64>,
    /// Gaps.
    pub gaps: Vec<f64>,
    /// Their rates.
    pub rates: Vec<f64>,
    /// Their accelerations without the force of their own contact.
    pub accelerations: Vec<f64>,
    /// 1 or -1 for each gap.
    pub sides: Vec<f64>,
    /// Which gaps are closed and stay so.
    pub contacts: Vec<bool>,
    /// Task functions of the coordinates with their first and second derivatives.
    pub tasks: Vec<f64>,
}

impl MechanicalReference {
    /// Sample `k` of a system of `n` coordinates and `m` gaps, the last one after the end.
    #[must_use]
    pub fn sample(&self, k: usize, (n, m): (usize, usize)) -> ReferenceSample<'_> {
        let count = self.q.len() / n;
        let (k, width) = (k.min(count.saturating_sub(1)), self.tasks.len() / count.max(1));
        let (of_q, of_gaps) = (k * n..(k + 1) * n, k * m..(k + 1) * m);
        ReferenceSample {
            q: &self.q[of_q.clone()],
            w: &self.w[of_q.clone()],
            sides: &self.sides[of_gaps.clone()],
            contacts: &self.contacts[of_gaps.clone()],
            gaps: Some((&self.gaps[of_gaps.clone()], &self.rates[of_gaps.clone()])),
            accelerations: Some(&self.accelerations[of_gaps]),
            turning: Some(&self.turning[of_q]),
            tasks: (width > 0).then(|| &self.tasks[k * width..][..width]),
        }
    }
}

/// The gaps of a reference that does not tell them, and their rates.
pub(super) type Told = Option<(Vec<f64>, Vec<f64>)>;

pub(super) fn gaps_of<E, D, F>(
    plant: &mut BelievedPlant<'_, D, F>,
    sample: &ReferenceSample<'_>,
) -> Result<Told, LawError<E>>
where
    Driven<D, F>: Dynamics<E>,
{
    if sample.gaps.is_some() {
        return Ok(None);
    }
    let layout = plant.layout();
    let mut row = vec![0.0; layout.len()];
    plant.driven.release();
    plant.driven.evaluate(0.0, sample.q, sample.w, &mut row).map_err(LawError::Raised)?;
    let (gaps, normals, rates) = (&row[layout.gap()], &row[layout.gradient()], &row[layout.rate()]);
    let open = |i: usize, value: f64| if sample.contacts[i] { 0.0 } else { value };
    let rate = |i: usize| dot(&normals[i * layout.n..][..layout.n], sample.w) + rates[i];
    let of = |value: &dyn Fn(usize) -> f64| (0..layout.m).map(|i| open(i, value(i))).collect();
    Ok(Some((of(&|i| gaps[i].max(0.0)), of(&rate))))
}

/// A gap of a reference.
pub(super) fn waypoint(
    name: &'static str,
    sample: &ReferenceSample<'_>,
    i: usize,
) -> Result<Waypoint, SettingError> {
    let side = sample.sides[i];
    let branch = match side {
        1.0 => Branch::Positive,
        -1.0 => Branch::Negative,
        _ => return Err(SettingError { name, value: side, range: "on a side that is 1 or -1" }),
    };
    let (x, xdot) = sample.gaps.map_or((0.0, 0.0), |(gaps, rates)| (gaps[i], rates[i]));
    Ok(Waypoint { state: Physical { x, xdot }, branch })
}

#[cfg(test)]
mod believed_plant_tests {
    use super::*;

    #[test]
    fn a_prediction_takes_steps_of_order_five_whatever_was_set() {
        let settings = SwitchedRk { order: Order::Eight, ..SwitchedRk::DEFAULT };
        let found = one_step_each(settings, &[0.0, 1.0, 3.0]);
        assert_eq!((found.order, found.max_step, found.adaptive), (Order::Five, 2.0, false));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::system::dynamics::{FunctionDynamics, InputMatrix, Layout};
    use crate::AnyImpactLaw;
    use std::convert::Infallible;

    #[test]
    fn gaps_that_a_reference_does_not_tell_are_those_of_the_model() {
        // g_i = (1, 2) . q + 5 t + i
        let layout = Layout::smooth(2, 2);
        let function = |t: f64, q: &[f64], _: &[f64], out: &mut [f64]| {
            out.fill(0.0);
            out[layout.mass()].copy_from_slice(&[1.0, 0.0, 0.0, 1.0]);
            let gap = q[0] + 2.0 * q[1] + 5.0 * t;
            out[layout.gap()].copy_from_slice(&[gap, gap + 1.0]);
            out[layout.gradient()].copy_from_slice(&[1.0, 2.0, 1.0, 2.0]);
            out[layout.rate()].copy_from_slice(&[5.0, 5.0]);
            Ok::<(), Infallible>(())
        };
        type Inputs = fn(f64, &[f64], &mut [f64]) -> Result<(), Infallible>;
        let inputs: InputMatrix<Inputs> = InputMatrix::Constant(vec![1.0, 0.0, 0.0, 1.0]);
        let dynamics = FunctionDynamics { layout, function };
        let mut driven = Driven::new(dynamics, (2, 2), inputs).unwrap();
        let laws: [AnyImpactLaw; 0] = [];
        let mut plant = BelievedPlant { driven: &mut driven, tasks: None, laws: &laws, h: 0.1 };
        let sample = ReferenceSample {
            q: &[0.5, 0.25],
            w: &[3.0, -1.0],
            sides: &[1.0; 2],
            contacts: &[false, true],
            gaps: None,
            accelerations: None,
            turning: None,
            tasks: None,
        };
        let (gaps, rates) = gaps_of(&mut plant, &sample).unwrap().unwrap();
        assert_eq!((gaps, rates), (vec![1.0, 0.0], vec![6.0, 0.0]));
    }
}
