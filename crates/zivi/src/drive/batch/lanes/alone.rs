//! One mass of many: the steps that it takes by itself, and what is noted of all of them.

use zivi_core::{transform, Branch, Lifted, Physical, Restitution, ThetaGammaStep};

use super::flight::Lanes;
use crate::drive::batch::outcome::{Outcome, Saved};
use crate::drive::batch::{Save, Stopped};
use crate::record::events::EventLog;
use crate::stepping::fixed_step::{FixedStep, Start};
use crate::stepping::step_solver::Exact;
use crate::stepping::theta_gamma::Stepper;
use crate::{Failure, Force, Grid, SetupError, Status, Summary};

/// A mass, its force and where it starts.
#[derive(Clone, Copy, Debug)]
pub(in super::super) struct Mass<F> {
    pub(in super::super) step: ThetaGammaStep,
    pub(in super::super) force: F,
    pub(in super::super) initial: Physical,
}

/// What goes on beside the states: the run of one mass as it is alone.
pub(super) struct OneByOne<F> {
    pub(super) stepper: Stepper<Exact>,
    pub(super) force: F,
    restitution: Restitution,
    log: EventLog,
    pub(super) sigma: f64,
    status: Status,
    /// After how many steps it stopped, if it did.
    pub(super) ended: Option<usize>,
    saved: Saved,
}

impl<F: Force<Stopped>> OneByOne<F> {
    pub(super) fn start(
        mass: Mass<F>,
        z: Lifted,
        grid: Grid,
        save: Save<'_>,
    ) -> Result<Self, SetupError> {
        let Mass { step, force, initial } = mass;
        let restitution = step.restitution();
        let mut run = Self {
            stepper: Stepper::new(step, Exact),
            force,
            restitution,
            log: EventLog::start(grid.t(0), z, initial.arrives(), restitution),
            sigma: transform::side(z, Branch::Positive.sigma()),
            status: Status::Completed,
            ended: None,
            saved: Saved::with_room(save.every(), grid)?,
        };
        run.stepper.evaluate_constant(&mut run.force, grid.t(0));
        if save.every() > 0 {
            run.sample(z);
        }
        Ok(run)
    }

    /// Whether it moves from `z` or may do so: not if it has ended, or rests under a constant.
    pub(super) fn is_busy(&self, z: Lifted) -> bool {
        let rests = z == Lifted::default() && self.stepper.constant().is_some_and(|f| f <= 0.0);
        !rests && self.ended.is_none()
    }

    /// The step after `k` that is not everyday; `None` where there is none, and the mass stops.
    #[cold]
    #[inline(never)]
    pub(super) fn step(&mut self, z: Lifted, k: usize, (t, t_next): (f64, f64)) -> Option<Lifted> {
        let start = Start { t, z, sigma: self.sigma };
        let noted = self.stepper.advance(start, &mut self.force).and_then(|sample| {
            self.log.step((t, z), (t_next, sample.z))?;
            Ok(sample.z)
        });
        match noted {
            Ok(end) => {
                self.sigma = transform::side(end, self.sigma);
                Some(end)
            }
            Err(failure) => {
                self.ended = Some(k);
                self.status = match failure {
                    Failure::Status(status) => status,
                    Failure::Raised(Stopped) => Status::Raised,
                };
                None
            }
        }
    }

    pub(super) fn sample(&mut self, z: Lifted) {
        if self.ended.is_none() {
            let Physical { x, xdot } = transform::project(z, self.restitution);
            self.saved.push(x, xdot);
        }
    }

    pub(super) fn finish(
        self,
        lanes: &Lanes,
        i: usize,
        (grid, k): (Grid, usize),
        nfev: u64,
        save: (Save<'_>, f64),
    ) -> Outcome {
        let Physical { x, xdot } = transform::project(lanes.at(i, self.sigma), self.restitution);
        let (x_max, speed_max) = (lanes.x_max[i], lanes.speed_max[i]);
        let summary = Summary { t: grid.t(self.ended.unwrap_or(k)), x, xdot, x_max, speed_max };
        Outcome::new((self.log.finish(), &[]), self.saved, summary, (self.status, nfev), save)
    }
}
