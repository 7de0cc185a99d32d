//! The Jacobian by differences of `F`, never outside the box.

use super::dense;
use super::problem::{EvaluationError, Problem};

/// `eps^(1/3)`: balances truncation and rounding of second-order differences.
const STEP: f64 = 6.055454452393343e-6;

/// A map without Jacobian; it is taken by second-order differences: central inside the box,
/// one-sided where a bound or the end of the domain of `F` is near, zero for a fixed component.
#[derive(Debug)]
pub struct Differenced<'a, M> {
    map: M,
    lower: &'a [f64],
    upper: &'a [f64],
    work: &'a mut [f64],
}

impl<'a, M> Differenced<'a, M>
where
    M: FnMut(&[f64], &mut [f64]) -> Result<(), EvaluationError>,
{
    /// Length of the workspace for `n` unknowns.
    #[must_use]
    pub const fn workspace_len(n: usize) -> usize {
        4 * n
    }

    /// `None` where the workspace is too short.
    #[must_use]
    pub fn new(map: M, lower: &'a [f64], upper: &'a [f64], work: &'a mut [f64]) -> Option<Self> {
        (work.len() >= Self::workspace_len(lower.len())).then_some(Self { map, lower, upper, work })
    }
}

impl<M> Problem for Differenced<'_, M>
where
    M: FnMut(&[f64], &mut [f64]) -> Result<(), EvaluationError>,
{
    fn map(&mut self, z: &[f64], f: &mut [f64]) -> Result<(), EvaluationError> {
        (self.map)(z, f)
    }

    fn jacobian(&mut self, z: &[f64], jacobian: &mut [f64]) -> Result<(), EvaluationError> {
        let n = z.len();
        let (point, rest) = self.work.split_at_mut_checked(n).ok_or(EvaluationError)?;
        let (here, rest) = rest.split_at_mut_checked(n).ok_or(EvaluationError)?;
        let (first, rest) = rest.split_at_mut_checked(n).ok_or(EvaluationError)?;
        let second = rest.get_mut(..n).ok_or(EvaluationError)?;
        point.copy_from_slice(z);
        let mut here_is_known = false;
        for j in 0..n {
            let (zj, lower, upper) =
                (dense::at(z, j), dense::at(self.lower, j), dense::at(self.upper, j));
            let step = STEP * f64::max(1.0, zj.abs());
            // central where both neighbours are in the box, else two steps into the wider side
            let side = if upper - zj >= zj - lower { 1.0 } else { -1.0 };
            let room = f64::max(upper - zj, zj - lower);
            let one_sided =
                [zj + side * f64::min(step, 0.5 * room), zj + side * f64::min(2.0 * step, room)];
            let central = [zj - step, zj + step];
            let mut done = lower == upper;
            if done {
                (0..n).for_each(|i| dense::put(jacobian, i * n + j, 0.0));
            }
            for (neighbours, is_central) in [(central, true), (one_sided, false)] {
                let [a, b] = neighbours;
                let inside = a.min(b) >= lower && a.max(b) <= upper;
                if done || !inside {
                    continue;
                }
                dense::put(point, j, a);
                (self.map)(point, first)?;
                dense::put(point, j, b);
                (self.map)(point, second)?;
                if is_central {
                    for (i, (fa, fb)) in first.iter().zip(second.iter()).enumerate() {
                        dense::put(jacobian, i * n + j, (fb - fa) / (b - a));
                    }
                } else {
                    if !here_is_known {
                        (self.map)(z, here)?;
                        here_is_known = true;
                    }
                    let (da, db) = (a - zj, b - zj);
                    for (i, ((f, fa), fb)) in
                        here.iter().zip(first.iter()).zip(second.iter()).enumerate()
                    {
                        let slopes = ((fa - f) / da, (fb - f) / db);
                        let slope = slopes.0 + (slopes.0 - slopes.1) * da / (db - da);
                        dense::put(jacobian, i * n + j, slope);
                    }
                }
                dense::put(point, j, zj);
                done = dense::is_finite(first) && dense::is_finite(second);
            }
        }
        Ok(())
    }
}
