//! A new scheme of fixed steps is a file and a line: this file is such a scheme, semi-implicit
//! Euler with explicit signs, and it runs as the schemes of the library do, events included.
//!
//! ```text
//! v+ = v + h sgn(s) f/R      s+ = s + h R v+      R = 1 - kappa sgn s sgn v
//! ```
//!
//! In flight under a constant force its error after the time `T` is `h f T/2` in `x`, opposite to
//! that of the explicit scheme.

use std::convert::Infallible;

use zivi::method::Settings;
use zivi::record::failure::Failure;
use zivi::record::trajectory::Sample;
use zivi::stepping::fixed_step::{self, FixedStep, Start};
use zivi::{
    ConstantForce, FixedSteps, Force, Grid, Lifted, Method, Monitor, Output, Physical, PointMass,
    PointRun, Quantity, Restitution, Run, Scheme, SetupError, Silent, Status, UserEvent,
};
use zivi_core::setting::Setting;
use zivi_core::{transform, ThetaGammaStep};

/// The scheme: its settings, of which there are none beside the step size.
#[derive(Clone, Copy, Debug, PartialEq)]
struct SemiImplicit;

impl Scheme for SemiImplicit {
    const SETTINGS: &'static [Setting] = &[ThetaGammaStep::STEP];

    fn check(&self, h: f64, restitution: Restitution) -> Result<(), SetupError> {
        Ok(ThetaGammaStep::new(h, 1.0, 1.0, restitution).map(drop)?)
    }

    fn run<E, F: Force<E>>(
        &self,
        restitution: Restitution,
        force: &mut F,
        grid: Grid,
        initial: Physical,
        monitor: &mut impl Monitor<E>,
    ) -> Result<Run<E>, SetupError> {
        let stepper = Stepper { h: grid.h(), restitution, nfev: 0 };
        fixed_step::run(stepper, restitution, force, grid, initial, monitor)
    }
}

/// One step after the other.
struct Stepper {
    h: f64,
    restitution: Restitution,
    nfev: u64,
}

impl<E, F: Force<E>> FixedStep<E, F> for Stepper {
    fn advance(&mut self, start: Start, force: &mut F) -> Result<Sample, Failure<E>> {
        let Start { t, z, sigma } = start;
        let state = transform::project(z, self.restitution);
        let (lambda_s, lambda_v) = (sigma, if z.v < 0.0 { -1.0 } else { 1.0 });
        self.nfev += 1;
        let f = force.at(t, state.x, state.xdot).map_err(Failure::Raised)?;
        let r = self.restitution.r(lambda_s, lambda_v);
        let v = z.v + self.h * lambda_s * f / r;
        Ok(Sample { z: Lifted { s: z.s + self.h * r * v, v }, lambda_s, lambda_v, f })
    }

    fn residual(&self, _: Lifted, _: f64, _: [f64; 2]) -> f64 {
        f64::NAN
    }

    fn resize(&mut self, h: f64) {
        self.h = h;
    }

    fn nfev(&self) -> u64 {
        self.nfev
    }
}

/// A fall of one second from 10 m, thrown down with 1 m/s under `-2 m/s^2`, which ends at 8 m.
fn fall(h: f64, output: Output<'_, Infallible>) -> PointRun<Infallible> {
    let method = FixedSteps { h, scheme: SemiImplicit };
    method.check().unwrap();
    let system = PointMass {
        force: &mut ConstantForce(-2.0),
        restitution: Restitution::from_e(0.5).unwrap(),
    };
    let start = Physical { x: 10.0, xdot: -1.0 };
    method.run(system, (0.0, 1.0), start, output, &mut Silent).unwrap()
}

fn last(run: &PointRun<Infallible>) -> f64 {
    *run.trajectory.columns.of(Quantity::X).last().unwrap()
}

#[test]
fn the_new_scheme_has_the_order_that_its_analysis_gives() {
    for h in [1e-2, 1e-3] {
        let run = fall(h, Output::default());
        assert_eq!(
            (run.trajectory.status, run.counts.accepted),
            (Status::Completed, run.trajectory.nfev)
        );
        // h f T/2 below the parabola
        assert!((last(&run) - (8.0 - h)).abs() < 1e-12, "{h}: {}", last(&run));
    }
}

/// Where `t + t^2 = 1`.
const GOLDEN: f64 = 0.618_033_988_749_894_9;

#[test]
fn it_bounces_and_its_events_are_followed_as_those_of_every_scheme() {
    let half = UserEvent::new(|_, x, _| Ok::<_, Infallible>(x - 9.0));
    let half = UserEvent { terminal: Some(1), ..half };
    let run = fall(1e-3, Output { events: vec![half], ..Output::default() });
    assert_eq!(run.trajectory.status, Status::TerminatedByEvent);
    assert!((run.hits[0][0].t - GOLDEN).abs() < 1e-3);

    let method = FixedSteps { h: 1e-4, scheme: SemiImplicit };
    let restitution = Restitution::from_e(0.5).unwrap();
    let system = PointMass { force: &mut ConstantForce(-2.0), restitution };
    let start = Physical { x: 1.0, xdot: -1.0 };
    let run: PointRun<Infallible> =
        method.run(system, (0.0, 1.5), start, Output::default(), &mut Silent).unwrap();
    let impacts = &run.trajectory.events.impacts;
    assert_eq!(impacts.len(), 1);
    let impact = impacts[0];
    assert!(
        (impact.t - GOLDEN).abs() < 1e-3
            && (impact.xdot_after + 0.5 * impact.xdot_before).abs() < 1e-3
    );
}

#[test]
fn its_settings_are_checked_as_those_of_every_method() {
    let refused = FixedSteps { h: -1.0, scheme: SemiImplicit }.check().unwrap_err();
    assert_eq!(refused.to_string(), "h must be a finite step size > 0, got -1.0");
    let plastic = FixedSteps { h: 1.0, scheme: SemiImplicit };
    assert!(plastic.check_start(Physical::default(), Restitution::from_e(0.0).unwrap()).is_err());
}
