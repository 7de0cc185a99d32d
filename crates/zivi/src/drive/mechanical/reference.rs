//! References of mechanical systems at the samples of a controller.

use zivi_core::control::Waypoint;
use zivi_core::{Branch, Physical, SettingError};

use super::believed_plant::BelievedPlant;
use super::law_error::LawError;
use crate::numeric::dense::dot;
use crate::system::dynamics::{Driven, Dynamics};

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
