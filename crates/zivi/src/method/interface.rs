//! Interface between systems and methods.

use crate::mechanics::{
    simulate_mechanical, simulate_mechanical_moreau_jean, simulate_mechanical_theta_gamma,
    MechanicalOutput, MechanicalRun,
};
use crate::record::trajectory::Values;
use crate::stepping::fixed_step::{FixedSteps, Scheme};
use crate::system::dynamics::{check_initial, Dynamics};
use crate::{
    simulate_switched_rk, AnyImpactLaw, Counts, Force, LocatedEvent, Monitor, MoreauJean, Motion,
    Output, Physical, Run, Samples, SetupError, StepEvents, SwitchedRk, SwitchedRun, ThetaGamma,
    Trajectory,
};
use zivi_core::setting::Setting;
use zivi_core::Restitution;

/// A mechanical system: its states, the options and the results of a run.
pub trait System<E> {
    /// Where a run starts.
    type State<'a>;
    /// Data to store.
    type Keep<'a>;
    /// Result of a run.
    type Run;
}

/// The settings of a method.
pub trait Settings {
    /// Rejects settings out of range.
    ///
    /// # Errors
    /// [`SetupError`] names the first that is.
    fn check(&self) -> Result<(), SetupError>;

    /// Rejects a start where no run of a mass above a wall can begin.
    ///
    /// # Errors
    /// [`SetupError`] names what is out of range.
    fn check_start(&self, initial: Physical, law: &AnyImpactLaw) -> Result<(), SetupError>;

    /// The step size (s) of a method of fixed steps.
    fn step(&self) -> Option<f64> {
        None
    }
}

/// Description of a method for generic user interfaces.
pub trait Listed: Settings + Sized {
    /// Its name.
    const NAME: &'static str;
    /// Its description in a few words.
    const MEANING: &'static str;
    /// Its settings.
    const SETTINGS: &'static [Setting];
    /// Whether it knows the motion at its steps only.
    const FIXED_STEPS: bool;
    /// Whether a mass may be below the wall at the end of a step.
    const PENETRATES: bool;

    /// The method with the values of its settings, whose ranges [`Settings::check`] knows.
    ///
    /// # Errors
    /// [`SetupError`] where one is missing.
    fn of(values: &Values) -> Result<Self, SetupError>;
}

/// A method that can run a system.
pub trait Method<E, S: System<E>>: Settings {
    /// Runs over a span, `(t0, t1)`, from a state.
    ///
    /// # Errors
    /// [`SetupError`] before anything is computed. Whatever goes wrong later is in the run's status.
    fn run(
        &self,
        system: S,
        span: (f64, f64),
        y0: S::State<'_>,
        keep: S::Keep<'_>,
        monitor: &mut impl Monitor<E>,
    ) -> Result<S::Run, SetupError>;
}

/// The coefficient of restitution that a scheme of fixed steps needs.
pub(crate) fn newton(law: &AnyImpactLaw) -> Result<Restitution, SetupError> {
    law.constant().ok_or(SetupError::Refused(
        "e must be a number, Newton's impact law: of the methods only SwitchedRK takes another",
    ))
}

// A mechanical system of several coordinates and gaps, and the methods that run it.

/// A mechanical system: `M q'' = F + N^T lambda` with gaps `g(t, q) >= 0`.
pub struct Mechanism<'d, D> {
    /// Mass matrix, forces and gaps.
    pub dynamics: &'d mut D,
    /// An impact law for each gap.
    pub laws: &'d [AnyImpactLaw],
}

impl<E, D: Dynamics<E>> System<E> for Mechanism<'_, D> {
    /// Coordinates and velocities.
    type State<'a> = (&'a [f64], &'a [f64]);
    type Keep<'a> = MechanicalOutput<'a, E>;
    type Run = MechanicalRun<E>;
}

impl<'d, E, D: Dynamics<E>> Method<E, Mechanism<'d, D>> for SwitchedRk {
    fn run(
        &self,
        Mechanism { dynamics, laws }: Mechanism<'d, D>,
        span: (f64, f64),
        y0: (&[f64], &[f64]),
        keep: MechanicalOutput<'_, E>,
        monitor: &mut impl Monitor<E>,
    ) -> Result<MechanicalRun<E>, SetupError> {
        simulate_mechanical(*self, dynamics, laws, span, y0, keep, monitor)
    }
}

impl<'d, E, D: Dynamics<E>> Method<E, Mechanism<'d, D>> for FixedSteps<MoreauJean> {
    fn run(
        &self,
        Mechanism { dynamics, laws }: Mechanism<'d, D>,
        span: (f64, f64),
        y0: (&[f64], &[f64]),
        keep: MechanicalOutput<'_, E>,
        monitor: &mut impl Monitor<E>,
    ) -> Result<MechanicalRun<E>, SetupError> {
        let (grid, method, e) = (self.grid(span)?, self.scheme, coefficients(laws)?);
        simulate_mechanical_moreau_jean(method, dynamics, &e, grid, y0, keep.events, monitor)
    }
}

/// The implicit member of the family, `theta = gamma = 1`, only.
impl<'d, E, D: Dynamics<E>> Method<E, Mechanism<'d, D>> for FixedSteps<ThetaGamma> {
    fn run(
        &self,
        Mechanism { dynamics, laws }: Mechanism<'d, D>,
        span: (f64, f64),
        y0: (&[f64], &[f64]),
        keep: MechanicalOutput<'_, E>,
        monitor: &mut impl Monitor<E>,
    ) -> Result<MechanicalRun<E>, SetupError> {
        if self.scheme != ThetaGamma::implicit_euler() {
            return Err(SetupError::Refused(
                "method must be the theta-gamma scheme with theta = gamma = 1 and its exact solver",
            ));
        }
        let (grid, e) = (self.grid(span)?, coefficients(laws)?);
        simulate_mechanical_theta_gamma(dynamics, &e, grid, y0, keep.events, monitor)
    }
}

/// The coefficients of restitution that schemes of fixed steps need.
fn coefficients(laws: &[AnyImpactLaw]) -> Result<Vec<f64>, SetupError> {
    laws.iter().map(|law| Ok(newton(law)?.e())).collect()
}

// A mass above a wall, and the methods that run it.

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
