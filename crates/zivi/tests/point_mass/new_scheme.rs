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
use std::fs;
use std::path::{Path, PathBuf};

use zivi::method::{Listed, Settings, Values};
use zivi::record::status::Failure;
use zivi::record::trajectory::Sample;
use zivi::stepping::fixed_step::{self, FixedStep, Start};
use zivi::{
    AnyMethod, ConstantForce, FixedSteps, Force, Grid, Lifted, Method, Monitor, Output, Physical,
    PointMass, PointRun, Quantity, Restitution, Run, Scheme, SetupError, Silent, Status, UserEvent,
};
use zivi_core::setting::{Setting, Value};
use zivi_core::{transform, ThetaGammaStep};

/// The scheme: its settings, of which there are none beside the step size.
#[derive(Clone, Copy, Debug, PartialEq)]
struct SemiImplicit;

impl Scheme for SemiImplicit {
    const NAME: &'static str = "SemiImplicit";
    const MEANING: &'static str = "semi-implicit Euler with explicit signs";
    const SETTINGS: &'static [Setting] = &[ThetaGammaStep::STEP];

    fn of(_: &Values) -> Result<Self, SetupError> {
        Ok(Self)
    }

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
        law: Restitution::from_e(0.5).unwrap().into(),
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
    let system = PointMass { force: &mut ConstantForce(-2.0), law: restitution.into() };
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
    assert!(plastic
        .check_start(Physical::default(), &Restitution::from_e(0.0).unwrap().into())
        .is_err());
}

#[test]
fn it_is_made_of_the_values_of_its_settings_as_every_method_of_the_list() {
    type Steps = FixedSteps<SemiImplicit>;
    let mut values = Values::default();
    let missing = Steps::of(&values).unwrap_err();
    assert_eq!(missing.to_string(), "h must be given, a finite step size > 0");
    values.set("h", Value::Number(0.25));
    assert_eq!(Steps::of(&values), Ok(FixedSteps { h: 0.25, scheme: SemiImplicit }));
    assert_eq!((Steps::NAME, Steps::SETTINGS.len(), Steps::FIXED_STEPS), ("SemiImplicit", 1, true));

    for entry in AnyMethod::ALL {
        let made = (entry.of)(&values).unwrap();
        assert_eq!(made.step(), entry.fixed_steps.then_some(0.25), "{}", entry.name);
        assert_eq!(made.check(), Ok(()), "{}", entry.name);
        assert!(!entry.meaning.is_empty());
    }
}

fn sources(folder: &Path, found: &mut Vec<PathBuf>) {
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            sources(&path, found);
        } else if path.extension().is_some_and(|it| it == "rs") {
            found.push(path);
        }
    }
}

/// Of a scheme of the library only its file, the list and what the library hands on know the name.
#[test]
fn a_scheme_is_named_in_its_file_and_in_the_list() {
    let crates = Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap();
    let mut files = Vec::new();
    for name in ["zivi", "zivi-py"] {
        sources(&crates.join(name).join("src"), &mut files);
    }
    let mut lines = Vec::new();
    for file in &files {
        let text = fs::read_to_string(file).unwrap();
        let code = text.lines().filter(|line| !line.trim_start().starts_with("//"));
        let place = file.strip_prefix(crates).unwrap().display().to_string();
        let named = code.filter(|line| line.contains("ExplicitEuler")).count();
        if named > 0 && !place.ends_with("explicit.rs") {
            lines.push((place, named));
        }
    }
    lines.sort();
    let expected = [("zivi/src/lib.rs", 1), ("zivi/src/method/mod.rs", 1)];
    assert_eq!(lines, expected.map(|(file, n)| (file.to_string(), n)));
}
