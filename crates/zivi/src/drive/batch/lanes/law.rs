//! Kernels of lanes: common interface, waves, single masses.
//!
//! Common part of kernels for different forces.

use crate::drive::batch::lanes::flight::{Lane, Lanes, WIDTH};
use crate::drive::batch::outcome::{Outcome, Saved};
use crate::drive::batch::{Save, Stopped};
use crate::record::events::EventLog;
use crate::stepping::fixed_step::{FixedStep, Start};
use crate::stepping::step_solver::Exact;
use crate::stepping::theta_gamma::ThetaGammaStepper;
use crate::{Failure, Force, Grid, LinearForce, SetupError, Status, Summary};
use pulp::Simd;
use zivi_core::cosine::{cos, turn_into_cosines};
use zivi_core::{transform, Branch, Lifted, Physical, Restitution, ThetaGammaStep};

/// The everyday steps under one kind of force.
pub(super) trait StepLaw<F> {
    /// Looks at a mass after a step of its own, and before steps of another size.
    fn place(&mut self, i: usize, run: &OneByOne<F>, lanes: &Lanes);

    /// Tells a mass what the steps side by side have left, before a step of its own.
    fn tell(&self, i: usize, run: &mut OneByOne<F>);

    /// Evaluates what depends on time alone, for the step that takes its force at `t`.
    fn begin(&mut self, t: f64, runs: &mut [OneByOne<F>]);

    /// Takes the everyday steps of the masses in the first `n` vectors; one whose step is `hard` (not
    /// 0) stays. Gives whether there is one. Must be inlined always.
    fn everyday<S: Simd>(&mut self, simd: S, lanes: &mut Lanes, n: usize, hard: &mut Lane) -> bool;

    /// Evaluations of the force in a number of steps.
    fn nfev(&self, i: usize, run: &OneByOne<F>, steps: u64) -> u64;
}

// The excitations of many linear forces at one time.

/// Excitations; masses whose waves have the same frequency and phase share a cosine.
#[repr(C, align(64))] // lanes begin where vectors of the machine do
pub(super) struct Waves {
    amplitude: Lane,
    /// At the last requested time.
    pub(super) excitation: Lane,
    /// Distinct angular frequencies and phases, and the index of each mass.
    omega: Lane,
    phase: Lane,
    different: usize,
    which: [usize; WIDTH],
}

impl Waves {
    pub(super) fn of(forces: impl Iterator<Item = LinearForce>) -> Self {
        let zero = [0.0; WIDTH];
        let mut waves = Self {
            amplitude: zero,
            excitation: zero,
            omega: zero,
            phase: zero,
            different: 0,
            which: [0; WIDTH],
        };
        for (i, LinearForce { amplitude, omega, phase, .. }) in forces.enumerate() {
            // a force without a wave takes part in any other's
            if amplitude != 0.0 {
                let n = waves.different;
                let known = waves.omega[..n].iter().zip(&waves.phase);
                let mut known = known.map(|(omega, phase)| [*omega, *phase]);
                let place = known.position(|angle| angle == [omega, phase]).unwrap_or(n);
                (waves.omega[place], waves.phase[place]) = (omega, phase);
                waves.different = n.max(place + 1);
                (waves.amplitude[i], waves.which[i]) = (amplitude, place);
            }
        }
        waves
    }

    /// Goes to a time.
    #[inline(always)]
    pub(super) fn go_to(&mut self, t: f64) {
        if self.different <= 1 {
            // none: times no amplitude
            let cosine = cos(self.omega[0] * t + self.phase[0]);
            for (it, amplitude) in self.excitation.iter_mut().zip(&self.amplitude) {
                *it = amplitude * cosine;
            }
            return;
        }
        // whole vectors of any machine
        let n = self.different.next_multiple_of(8).min(WIDTH);
        let mut cosines = [0.0; WIDTH];
        let angles = self.omega.iter().zip(&self.phase);
        for (it, (omega, phase)) in cosines[..n].iter_mut().zip(angles) {
            *it = omega * t + phase;
        }
        turn_into_cosines(&mut cosines[..n]);
        for i in 0..WIDTH {
            self.excitation[i] = self.amplitude[i] * cosines[self.which[i]];
        }
    }
}

// One mass of many: its individual steps, and the records of all steps.

/// A mass, its force and where it starts.
#[derive(Clone, Copy, Debug)]
pub(in crate::drive::batch) struct Mass<F> {
    pub(in crate::drive::batch) step: ThetaGammaStep,
    pub(in crate::drive::batch) force: F,
    pub(in crate::drive::batch) initial: Physical,
}

/// Run of one mass outside the kernels.
pub(super) struct OneByOne<F> {
    pub(super) stepper: ThetaGammaStepper<Exact>,
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
            stepper: ThetaGammaStepper::new(step, Exact),
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

    /// The step after `k` that is not everyday; `None` without one; the mass stops.
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
