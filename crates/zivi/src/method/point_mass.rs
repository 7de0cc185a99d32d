//! A mass above a wall, and the methods that run it.

use zivi_core::setting::Setting;

use super::interface::{newton, Listed, Method, Settings, System};
use crate::record::values::Values;
use crate::stepping::fixed_step::{FixedSteps, Scheme};
use crate::system::dynamics::check_initial;
use crate::{
    simulate_switched_rk, AnyImpactLaw, Counts, Force, LocatedEvent, Monitor, Motion, Output,
    Physical, Run, Samples, SetupError, StepEvents, SwitchedRk, SwitchedRun, Trajectory,
};

/// A mass above a wall: `x'' = f`, `x >= 0`, and an impact law, as `x'+ = -e x'-`.
pub struct PointMass<'f, F> {
    /// The force.
    pub force: &'f mut F,
    /// Impact law.
    pub law: AnyImpactLaw,
}

impl<E, F: Force<E>> System<E> for PointMass<'_, F> {
    type State<'a> = Physical;
    type Keep<'a> = Output<'a, E>;
    type Run = PointRun<E>;
}

/// A run of any method.
#[derive(Clone, Debug, PartialEq)]
pub struct PointRun<E> {
    /// Samples, impacts, Zeno points, lift-offs, status.
    pub trajectory: Trajectory,
    /// The error that the force, an event or the monitor raised.
    pub raised: Option<E>,
    /// The samples, where [`Output::in_rows`] left them as they were recorded.
    pub rows: Option<Samples>,
    /// The motion between the samples; a fixed-step method has its steps only.
    pub motion: Option<Motion>,
    /// For each event of the user what happened, in order.
    pub hits: Vec<Vec<LocatedEvent>>,
    /// How much work was done.
    pub counts: Counts,
    /// The time and the state up to which the motion is known, whatever is sampled, where that is
    /// not the last sample.
    pub end: Option<(f64, Physical)>,
}

impl<E> PointRun<E> {
    fn of_steps(Run { trajectory, raised }: Run<E>, hits: Vec<Vec<LocatedEvent>>) -> Self {
        let accepted = trajectory.columns.len().saturating_sub(1) as u64;
        let counts = Counts { nfev: trajectory.nfev, accepted, ..Counts::default() };
        Self { trajectory, raised, rows: None, motion: None, hits, counts, end: None }
    }

    /// A run of the switched method above a wall.
    #[must_use]
    pub fn switched(run: SwitchedRun<E>, law: &AnyImpactLaw) -> Self {
        let SwitchedRun { trajectory, raised, rows, path, tails, hits, counts, end } = run;
        let motion = Some(Motion { path, tails, restitution: law.transform() });
        Self { trajectory, raised, rows, motion, hits, counts, end: Some(end) }
    }
}

impl Settings for SwitchedRk {
    fn check(&self) -> Result<(), SetupError> {
        self.validated().map(drop)
    }

    fn check_start(&self, initial: Physical, _: &AnyImpactLaw) -> Result<(), SetupError> {
        self.check().and(check_initial(initial))
    }
}

impl Listed for SwitchedRk {
    const NAME: &'static str = "SwitchedRK";
    const MEANING: &'static str = "high order through impacts, with error control";
    const SETTINGS: &'static [Setting] = SwitchedRk::SETTINGS;
    const FIXED_STEPS: bool = false;
    const PENETRATES: bool = false;

    fn of(values: &Values) -> Result<Self, SetupError> {
        SwitchedRk::of(values)
    }
}

impl<'f, E, F: Force<E>> Method<E, PointMass<'f, F>> for SwitchedRk {
    fn run(
        &self,
        PointMass { force, law }: PointMass<'f, F>,
        span: (f64, f64),
        y0: Physical,
        keep: Output<'_, E>,
        monitor: &mut impl Monitor<E>,
    ) -> Result<PointRun<E>, SetupError> {
        let run = simulate_switched_rk(*self, law.clone(), force, span, y0, keep, monitor)?;
        Ok(PointRun::switched(run, &law))
    }
}

/// Of what is to be kept only the events matter: the samples are the steps.
impl<'f, E, F: Force<E>, S: Scheme> Method<E, PointMass<'f, F>> for FixedSteps<S> {
    fn run(
        &self,
        PointMass { force, law }: PointMass<'f, F>,
        span: (f64, f64),
        y0: Physical,
        keep: Output<'_, E>,
        monitor: &mut impl Monitor<E>,
    ) -> Result<PointRun<E>, SetupError> {
        let (grid, scheme) = (self.grid(span)?, &self.scheme);
        let restitution = newton(&law)?;
        scheme.check(self.h, restitution)?;
        if keep.events.is_empty() {
            let run = scheme.run(restitution, force, grid, y0, monitor)?;
            return Ok(PointRun::of_steps(run, Vec::new()));
        }
        let mut step_events = StepEvents::new(keep.events, span.1 - span.0, monitor);
        let run = scheme.run(restitution, force, grid, y0, &mut step_events)?;
        Ok(PointRun::of_steps(run, step_events.into_hits()))
    }
}
