//! The models: their parameters, steps and outputs.

use zivi_c::{
    code, MassConfig, ObserverConfig, RegulatorConfig, TrackerConfig, ZIVI_BRANCH_NEAREST,
    ZIVI_BRANCH_POSITIVE, ZIVI_GIVEN_DEPTH, ZIVI_GIVEN_DMAX, ZIVI_GIVEN_Q_D, ZIVI_TICK_LANDING,
    ZIVI_TICK_PAPER,
};

use crate::state::FmuState;
use crate::state::{Parts, StepRefusal};
use crate::table::{closed_loop, mass, observer, regulator, tracker, ScalarVariable};

pub(crate) use zivi_c::message;

/// Which model an instance is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum AnyModel {
    Mass,
    Regulator,
    Tracker,
    Loop,
    Observer,
}

const MODELS: [(AnyModel, &[u8]); 5] = [
    (AnyModel::Mass, b"zivi-impacting-mass-1"),
    (AnyModel::Regulator, b"zivi-twisting-regulator-1"),
    (AnyModel::Tracker, b"zivi-twisting-tracker-1"),
    (AnyModel::Loop, b"zivi-twisting-loop-1"),
    (AnyModel::Observer, b"zivi-impact-observer-1"),
];

impl AnyModel {
    /// The model with this token.
    pub(crate) fn of_token(token: &[u8], _resources: &[u8]) -> Option<Self> {
        MODELS.iter().find(|(_, name)| *name == token).map(|(model, _)| *model)
    }

    pub(crate) fn number(self) -> u32 {
        self as u32 + 1
    }

    pub(crate) fn table(self) -> &'static [ScalarVariable] {
        match self {
            AnyModel::Mass => mass::TABLE,
            AnyModel::Regulator => regulator::TABLE,
            AnyModel::Tracker => tracker::TABLE,
            AnyModel::Loop => closed_loop::TABLE,
            AnyModel::Observer => observer::TABLE,
        }
    }

    /// Makes the objects from the parameters: a code of `zivi-c`.
    pub(crate) fn configure(self, state: &mut FmuState) -> i32 {
        match self {
            AnyModel::Mass => configure_mass(state, mass::H, mass::E, [mass::X0, mass::XDOT0]),
            AnyModel::Regulator => configure_regulator(state),
            AnyModel::Tracker => configure_tracker(state, &TRACKER),
            AnyModel::Loop => {
                use closed_loop::{E, H, X0, XDOT0};
                let code = configure_mass(state, H, E, [X0, XDOT0]);
                if code < 0 {
                    return code;
                }
                configure_tracker(state, &LOOP)
            }
            AnyModel::Observer => configure_observer(state),
        }
    }

    /// Advances by a communication step of this length, the inputs held.
    pub(crate) fn step(self, state: &mut FmuState, length: f64) -> Result<(), StepRefusal> {
        let h = match self {
            AnyModel::Mass => mass::H,
            AnyModel::Regulator => regulator::H,
            AnyModel::Tracker => tracker::H,
            AnyModel::Loop => closed_loop::H,
            AnyModel::Observer => observer::H,
        };
        let parts = Parts::of(length, state.value(h))?;
        if self != AnyModel::Mass && !parts.whole {
            return Err(StepRefusal::Multiple);
        }
        for _ in 0..parts.count {
            self.period(state, parts.h)?;
        }
        state.asked = 0;
        Ok(())
    }

    /// One step of the mass, one update of a controller, or both.
    fn period(self, state: &mut FmuState, h: f64) -> Result<(), StepRefusal> {
        match self {
            AnyModel::Mass => {
                let force = -state.value(mass::G) + state.value(mass::U);
                move_mass(state, h, force)?;
            }
            AnyModel::Regulator => {
                let [x, xdot, force] = regulator_inputs(state);
                state.code = state.objects.regulator.step(x, xdot, force);
            }
            AnyModel::Tracker => {
                let [x, xdot, force, force_ref] = tracker_inputs(state);
                state.code = state.objects.tracker.step(x, xdot, force, force_ref);
            }
            AnyModel::Loop => {
                let (x, xdot) = (state.objects.mass.x, state.objects.mass.xdot);
                let force = state.value(closed_loop::FORCE);
                let force_ref = state.value(closed_loop::FORCE_REF);
                state.code = state.objects.tracker.step(x, xdot, force, force_ref);
                let acting = force + state.value(closed_loop::DISTURBANCE);
                let u = state.objects.tracker.u;
                move_mass(state, h, acting + u)?;
            }
            AnyModel::Observer => {
                let [x, xdot, force, u] = observer_inputs(state);
                state.code = state.objects.observer.step(x, xdot, force, u);
            }
        }
        Ok(())
    }

    /// Puts the outputs of this moment into the values.
    pub(crate) fn outputs(self, state: &mut FmuState) {
        match self {
            AnyModel::Mass => mass_outputs(state),
            AnyModel::Regulator => regulator_outputs(state),
            AnyModel::Tracker => tracker_outputs(state),
            AnyModel::Loop => loop_outputs(state),
            AnyModel::Observer => observer_outputs(state),
        }
    }
}

fn move_mass(state: &mut FmuState, h: f64, force: f64) -> Result<(), StepRefusal> {
    match state.objects.mass.advance(h, force) {
        code if code < 0 => Err(StepRefusal::Code(code)),
        _ => Ok(()),
    }
}

fn configure_mass(state: &mut FmuState, h: usize, e: usize, [x0, xdot0]: [usize; 2]) -> i32 {
    let config = MassConfig { h: state.value(h), e: state.value(e), ..MassConfig::defaults() };
    let (x, xdot) = (state.value(x0), state.value(xdot0));
    match state.objects.mass.init(&config) {
        code if code < 0 => code,
        _ => state.objects.mass.reset(x, xdot),
    }
}

fn configure_regulator(state: &mut FmuState) -> i32 {
    use regulator::{AHEAD, BOUND, DEPTH, E, H, LANDING, MU1, MU2, QUIET, U_MAX, U_MIN};
    let Some(ahead) = periods(state.value(AHEAD)) else { return code::ZIVI_E_AHEAD };
    let config = RegulatorConfig {
        tick: tick_of(state.value(LANDING)),
        ahead,
        mu1: state.value(MU1),
        mu2: state.value(MU2),
        h: state.value(H),
        e: state.value(E),
        bound: state.value(BOUND),
        quiet: state.value(QUIET),
        given: ZIVI_GIVEN_DEPTH,
        depth: state.value(DEPTH),
        u_min: state.value(U_MIN),
        u_max: state.value(U_MAX),
        ..RegulatorConfig::defaults()
    };
    state.objects.regulator.init(&config)
}

fn configure_observer(state: &mut FmuState) -> i32 {
    use observer::{DMAX, E, H, LEARN_E, NOISE_X, NOISE_XDOT, POSITION_ONLY, Q_D, Q_E, SE};
    let config = ObserverConfig {
        position_only: u32::from(state.value(POSITION_ONLY) != 0.0),
        learn_e: u32::from(state.value(LEARN_E) != 0.0),
        q_e: state.value(Q_E),
        h: state.value(H),
        e: state.value(E),
        noise_x: state.value(NOISE_X),
        noise_xdot: state.value(NOISE_XDOT),
        given: ZIVI_GIVEN_Q_D | ZIVI_GIVEN_DMAX,
        q_d: state.value(Q_D),
        se: state.value(SE),
        dmax: state.value(DMAX),
        ..ObserverConfig::defaults()
    };
    state.objects.observer.init(&config)
}

/// Where the parameters of a tracker are in a model, one after another.
struct TrackerPlaces {
    first: usize,
}

/// `MU1, MU2, H, E, E_REF, X_REF0, ...` from here on, the same in both models.
const TRACKER: TrackerPlaces = TrackerPlaces { first: tracker::MU1 };
const LOOP: TrackerPlaces = TrackerPlaces { first: closed_loop::MU1 };
const _: () = assert!(tracker::QUIET - tracker::MU1 == closed_loop::QUIET - closed_loop::MU1);

fn configure_tracker(state: &mut FmuState, places: &TrackerPlaces) -> i32 {
    use tracker::{
        AHEAD, BOUND, DEPTH, E, E_REF, H, HORIZON, LANDING, MU1, MU2, NEAREST, PRESS, QUIET, SHIFT,
        U_MAX, U_MIN, XDOT_REF0, X_REF0,
    };
    let of = |place: usize| state.value(place - MU1 + places.first);
    let Some(ahead) = periods(of(AHEAD)) else { return code::ZIVI_E_AHEAD };
    let config = TrackerConfig {
        branch: if of(NEAREST) == 0.0 { ZIVI_BRANCH_POSITIVE } else { ZIVI_BRANCH_NEAREST },
        tick: tick_of(of(LANDING)),
        ahead,
        shift: u32::from(of(SHIFT) != 0.0),
        mu1: of(MU1),
        mu2: of(MU2),
        h: of(H),
        e: of(E),
        e_ref: of(E_REF),
        bound: of(BOUND),
        press: of(PRESS),
        quiet: of(QUIET),
        horizon: of(HORIZON),
        given: ZIVI_GIVEN_DEPTH,
        depth: of(DEPTH),
        u_min: of(U_MIN),
        u_max: of(U_MAX),
        ..TrackerConfig::defaults()
    };
    let (x_ref, xdot_ref) = (of(X_REF0), of(XDOT_REF0));
    match state.objects.tracker.init(&config) {
        code if code < 0 => code,
        _ => state.objects.tracker.reset(x_ref, xdot_ref),
    }
}

/// A number of periods, at least 1.
fn periods(value: f64) -> Option<u32> {
    (value >= 1.0).then_some(value as u32)
}

fn tick_of(landing: f64) -> u32 {
    if landing == 0.0 {
        ZIVI_TICK_PAPER
    } else {
        ZIVI_TICK_LANDING
    }
}

fn regulator_inputs(state: &FmuState) -> [f64; 3] {
    [regulator::X, regulator::XDOT, regulator::FORCE].map(|place| state.value(place))
}

fn tracker_inputs(state: &FmuState) -> [f64; 4] {
    use tracker::{FORCE, FORCE_REF, X, XDOT};
    [X, XDOT, FORCE, FORCE_REF].map(|place| state.value(place))
}

fn observer_inputs(state: &FmuState) -> [f64; 4] {
    use observer::{FORCE, U, X, XDOT};
    [X, XDOT, FORCE, U].map(|place| state.value(place))
}

fn mass_outputs(state: &mut FmuState) {
    let mass = state.objects.mass;
    state.put(mass::X, mass.x);
    state.put(mass::XDOT, mass.xdot);
    state.put(mass::S, mass.s);
    state.put(mass::V, mass.v);
    let rests = mass.s == 0.0 && mass.v == 0.0;
    state.put(mass::AT_REST, f64::from(u8::from(rests)));
}

/// The control for the inputs that were set since the last step, else that of the last period.
fn regulator_outputs(state: &mut FmuState) {
    let (mut ahead, mut code) = (state.objects.regulator, state.code);
    if state.asked != 0 {
        let [x, xdot, force] = regulator_inputs(state);
        code = ahead.step(x, xdot, force);
    }
    state.put(regulator::U, ahead.u);
    state.put(regulator::STATUS, f64::from(code));
}

/// The same; the reference is that of this sample.
fn tracker_outputs(state: &mut FmuState) {
    let (mut ahead, mut code) = (state.objects.tracker, state.code);
    state.put(tracker::X_REF, ahead.x_ref);
    state.put(tracker::XDOT_REF, ahead.xdot_ref);
    if state.asked != 0 {
        let [x, xdot, force, force_ref] = tracker_inputs(state);
        code = ahead.step(x, xdot, force, force_ref);
    }
    state.put(tracker::U, ahead.u);
    state.put(tracker::STATUS, f64::from(code));
}

/// The estimates at the measurement that was set since the last step, else the last ones.
fn observer_outputs(state: &mut FmuState) {
    use observer::{D_EST, E_EST, E_STD, REFUSED, STATUS, XDOT_EST, X_EST};
    let (mut ahead, mut code) = (state.objects.observer, state.code);
    if state.asked != 0 {
        let [x, xdot, force, u] = observer_inputs(state);
        code = ahead.step(x, xdot, force, u);
    }
    state.put(X_EST, ahead.x);
    state.put(XDOT_EST, ahead.xdot);
    state.put(D_EST, ahead.d);
    state.put(E_EST, ahead.e);
    state.put(E_STD, libm::sqrt(ahead.p_ee));
    state.put(REFUSED, f64::from(ahead.refused));
    state.put(STATUS, f64::from(code));
}

/// The control is that of the sample that is taken now.
fn loop_outputs(state: &mut FmuState) {
    use closed_loop::{FORCE, FORCE_REF, STATUS, U, X, XDOT, XDOT_REF, X_REF};
    let mut ahead = state.objects.tracker;
    let (x, xdot) = (state.objects.mass.x, state.objects.mass.xdot);
    state.put(X, x);
    state.put(XDOT, xdot);
    state.put(X_REF, ahead.x_ref);
    state.put(XDOT_REF, ahead.xdot_ref);
    let code = ahead.step(x, xdot, state.value(FORCE), state.value(FORCE_REF));
    state.put(U, ahead.u);
    state.put(STATUS, f64::from(code));
}
