//! Communication steps: how they are rejected, and how they are cut.

/// How a communication step is rejected.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum StepRefusal {
    /// It is not a positive number, or has too many steps of `h`.
    Length,
    /// It is not a multiple of `h`.
    Multiple,
    /// A step of the mass has no end.
    Code(i32),
}

/// A communication step in equal parts.
pub(crate) struct Parts {
    pub(crate) count: u64,
    #[cfg_attr(feature = "loops", allow(dead_code, reason = "a loop keeps its period"))]
    pub(crate) h: f64,
    /// Whether it is a multiple of the step size asked for.
    pub(crate) whole: bool,
}

impl Parts {
    /// As many parts as steps `h` fit, each exactly `h` where the length is a multiple of it, else
    /// a little shorter.
    pub(crate) fn of(length: f64, h: f64) -> Result<Self, StepRefusal> {
        const MOST: f64 = 1e9;
        let ratio = length / h;
        if !(ratio > 0.0 && ratio <= MOST) {
            return Err(StepRefusal::Length);
        }
        let nearest = (ratio + 0.5) as u64;
        if nearest >= 1 && (ratio - nearest as f64).abs() <= 1e-6 {
            return Ok(Self { count: nearest, h, whole: true });
        }
        let count = ratio as u64 + 1;
        Ok(Self { count, h: length / count as f64, whole: false })
    }
}
