//! Validity of the derivatives: the radius, in units of the variables of differentiation, at which
//! to first order an event of the run appears, disappears, or passes the end.

use crate::switched::{grazing, SwitchedRk};

/// Reason for the limit of a derivative.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Limit {
    /// An impact that is pulled off the wall: it vanishes.
    Impact = 0,
    /// A minimum of the distance in flight: an impact appears.
    Minimum = 1,
    /// The pull at a Zeno point: the chain no longer ends.
    Zeno = 2,
    /// A maximum of the force at rest: a lift-off appears.
    Rest = 3,
    /// The force hardly rises at a lift-off: it vanishes.
    LiftOff = 4,
    /// An event near the end of the run passes it.
    End = 5,
    /// An event near a jump of the force passes it.
    Stop = 6,
    /// The speed after an impact, or the pull at it, vanishes.
    Chain = 7,
}

/// The nearest event: what it is, when, and how deep (in its own unit).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Nearest {
    /// The reason.
    pub limit: Limit,
    /// When (s).
    pub t: f64,
    /// How far the run is from it: a height (m) of an impact or a minimum, a force (m/s^2) at a
    /// Zeno point, at rest or at a lift-off, a time (s) at the end and at jumps, a force or a speed
    /// (m/s) in a chain.
    pub depth: f64,
}

/// The radii of all columns.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Validity {
    pub(crate) radius: Vec<f64>,
    pub(crate) nearest: Vec<Option<Nearest>>,
    /// The smallest depth of an impact or a minimum.
    pub(crate) shallowest: f64,
}

impl Validity {
    pub(crate) fn new(m: usize) -> Self {
        Self { radius: vec![f64::INFINITY; m], nearest: vec![None; m], shallowest: f64::INFINITY }
    }

    /// Whether an impact or a minimum is decided by the tolerances of a run that is up to so high.
    pub(crate) fn is_undecided(&self, settings: &SwitchedRk, highest: f64) -> bool {
        grazing::is_undecided(self.shallowest, highest, settings)
    }

    /// An event of this depth, which falls by `rates` for one unit of each column.
    pub(crate) fn note(
        &mut self,
        limit: Limit,
        t: f64,
        depth: f64,
        rates: impl IntoIterator<Item = f64>,
    ) {
        if matches!(limit, Limit::Impact | Limit::Minimum) {
            self.shallowest = self.shallowest.min(depth);
        }
        let known = self.radius.iter_mut().zip(&mut self.nearest);
        for ((radius, nearest), rate) in known.zip(rates) {
            let reach = depth / rate.abs();
            if reach < *radius {
                (*radius, *nearest) = (reach, Some(Nearest { limit, t, depth }));
            }
        }
    }
}
