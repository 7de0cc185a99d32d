//! Fills the columns of a run.

use std::collections::TryReserveError;

use zivi_core::{transform, Lifted, Restitution};

use crate::trajectory::{Columns, Sample};

/// Samples that are staged before they are appended.
const BLOCK: usize = 256;

/// Stages samples in a block that stays in the cache and appends whole blocks to the columns, so
/// that a step pays for no growth of a vector and the projection is done many at a time.
pub(crate) struct Recorder {
    columns: Columns,
    wall: Restitution,
    staged: usize,
    t: [f64; BLOCK],
    s: [f64; BLOCK],
    v: [f64; BLOCK],
    lambda_s: [f64; BLOCK],
    lambda_v: [f64; BLOCK],
    residual: [f64; BLOCK],
}

impl Recorder {
    /// Room for `n` samples.
    pub(crate) fn with_capacity(n: usize, wall: Restitution) -> Result<Self, TryReserveError> {
        let empty = [0.0; BLOCK];
        Ok(Self {
            columns: Columns::with_capacity(n)?,
            wall,
            staged: 0,
            t: empty,
            s: empty,
            v: empty,
            lambda_s: empty,
            lambda_v: empty,
            residual: empty,
        })
    }

    #[inline]
    pub(crate) fn push(&mut self, t: f64, sample: Sample) {
        if self.staged >= BLOCK {
            self.flush();
        }
        // the remainder changes nothing: it shows the compiler that the index is in range
        let k = self.staged % BLOCK;
        self.t[k] = t;
        self.s[k] = sample.z.s;
        self.v[k] = sample.z.v;
        self.lambda_s[k] = sample.lambda_s;
        self.lambda_v[k] = sample.lambda_v;
        self.residual[k] = sample.residual;
        self.staged = k + 1;
    }

    #[inline(never)]
    fn flush(&mut self) {
        let (n, wall, to) = (self.staged, self.wall, &mut self.columns);
        let (s, v) = (&self.s[..n], &self.v[..n]);
        let velocity = |(&s, &v)| transform::project(Lifted { s, v }, wall).xdot;
        to.x.extend(s.iter().map(|s| s.abs()));
        to.xdot.extend(s.iter().zip(v).map(velocity));
        to.t.extend_from_slice(&self.t[..n]);
        to.s.extend_from_slice(s);
        to.v.extend_from_slice(v);
        to.lambda_s.extend_from_slice(&self.lambda_s[..n]);
        to.lambda_v.extend_from_slice(&self.lambda_v[..n]);
        to.residual.extend_from_slice(&self.residual[..n]);
        self.staged = 0;
    }

    pub(crate) fn finish(mut self) -> Columns {
        self.flush();
        self.columns
    }
}
