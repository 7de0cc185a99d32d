//! Fills the columns of a run.

use std::collections::TryReserveError;

use zivi_core::{transform, Lifted, Restitution};

use crate::trajectory::{Columns, Sample};

/// Steps that are staged before they are appended.
const BLOCK: usize = 256;

/// Stages steps in a block that stays in the cache and appends whole blocks to the columns, so
/// that a step pays for no growth of a vector, and what is computed from a step but not needed
/// for the next (the projection, the residual) is computed many at a time.
pub(crate) struct Recorder {
    columns: Columns,
    wall: Restitution,
    staged: usize,
    /// The state before the staged steps.
    before: Lifted,
    t: [f64; BLOCK],
    s: [f64; BLOCK],
    v: [f64; BLOCK],
    lambda_s: [f64; BLOCK],
    lambda_v: [f64; BLOCK],
    f: [f64; BLOCK],
}

impl Recorder {
    /// Room for `n` steps from the initial state `z`, whose signs are recorded as its multipliers.
    pub(crate) fn start(
        n: usize,
        t: f64,
        z: Lifted,
        wall: Restitution,
    ) -> Result<Self, TryReserveError> {
        let mut columns = Columns::with_capacity(n + 1)?;
        let physical = transform::project(z, wall);
        columns.t.push(t);
        columns.x.push(physical.x);
        columns.xdot.push(physical.xdot);
        columns.s.push(z.s);
        columns.v.push(z.v);
        columns.lambda_s.push(zivi_core::sgn(z.s));
        columns.lambda_v.push(zivi_core::sgn(z.v));
        columns.residual.push(0.0);
        let (t, s, v, f) = ([0.0; BLOCK], [0.0; BLOCK], [0.0; BLOCK], [0.0; BLOCK]);
        let (lambda_s, lambda_v) = ([0.0; BLOCK], [0.0; BLOCK]);
        Ok(Self { columns, wall, staged: 0, before: z, t, s, v, lambda_s, lambda_v, f })
    }

    /// Steps that can be staged before the block must be flushed.
    #[inline]
    pub(crate) fn room(&self) -> usize {
        BLOCK - self.staged
    }

    /// Whether the block must be flushed before the next [`Recorder::push`].
    #[inline]
    pub(crate) fn is_full(&self) -> bool {
        self.staged >= BLOCK
    }

    #[inline(always)]
    pub(crate) fn push(&mut self, t: f64, sample: Sample) {
        // the remainder changes nothing: it shows the compiler that the index is in range
        let k = self.staged % BLOCK;
        self.t[k] = t;
        self.s[k] = sample.z.s;
        self.v[k] = sample.z.v;
        self.lambda_s[k] = sample.lambda_s;
        self.lambda_v[k] = sample.lambda_v;
        self.f[k] = sample.f;
        self.staged = k + 1;
    }

    /// Appends the staged steps; `residual` of a step is asked for its start, its force and its
    /// multipliers.
    #[inline(never)]
    pub(crate) fn flush(&mut self, residual: impl Fn(Lifted, f64, [f64; 2]) -> f64) {
        let (n, wall, to) = (self.staged, self.wall, &mut self.columns);
        let (s, v, f) = (&self.s[..n], &self.v[..n], &self.f[..n]);
        let (lambda_s, lambda_v) = (&self.lambda_s[..n], &self.lambda_v[..n]);
        let (Some((&last_s, earlier_s)), Some((&last_v, earlier_v))) =
            (s.split_last(), v.split_last())
        else {
            return;
        };
        let velocity = |(&s, &v)| transform::project(Lifted { s, v }, wall).xdot;
        to.x.extend(s.iter().map(|s| s.abs()));
        to.xdot.extend(s.iter().zip(v).map(velocity));
        to.t.extend_from_slice(&self.t[..n]);
        to.s.extend_from_slice(s);
        to.v.extend_from_slice(v);
        to.lambda_s.extend_from_slice(lambda_s);
        to.lambda_v.extend_from_slice(lambda_v);
        to.residual.push(residual(self.before, f[0], [lambda_s[0], lambda_v[0]]));
        let starts = earlier_s.iter().zip(earlier_v);
        let signs = lambda_s[1..].iter().zip(&lambda_v[1..]);
        let later = starts.zip(signs).zip(&f[1..]);
        to.residual.extend(later.map(|(((&s, &v), (&lambda_s, &lambda_v)), &f)| {
            residual(Lifted { s, v }, f, [lambda_s, lambda_v])
        }));
        self.before = Lifted { s: last_s, v: last_v };
        self.staged = 0;
    }

    pub(crate) fn into_columns(self) -> Columns {
        self.columns
    }
}
