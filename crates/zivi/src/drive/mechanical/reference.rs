//! References of mechanical systems at the samples of a controller.

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
    /// Accelerations of the gaps without the force of their own contact. Without them, or where one
    /// is NaN, the difference of the rates.
    pub accelerations: Option<&'a [f64]>,
    /// Accelerations of the coordinates without contact forces, 0 without them.
    pub turning: Option<&'a [f64]>,
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
}

impl MechanicalReference {
    /// Sample `k` of a system of `n` coordinates and `m` gaps, the last one beyond the end.
    #[must_use]
    pub fn sample(&self, k: usize, (n, m): (usize, usize)) -> ReferenceSample<'_> {
        let k = k.min((self.q.len() / n).saturating_sub(1));
        let (of_q, of_gaps) = (k * n..(k + 1) * n, k * m..(k + 1) * m);
        ReferenceSample {
            q: &self.q[of_q.clone()],
            w: &self.w[of_q.clone()],
            sides: &self.sides[of_gaps.clone()],
            contacts: &self.contacts[of_gaps.clone()],
            gaps: Some((&self.gaps[of_gaps.clone()], &self.rates[of_gaps.clone()])),
            accelerations: Some(&self.accelerations[of_gaps]),
            turning: Some(&self.turning[of_q]),
        }
    }
}
