//! A mechanical system, alone or with its controller, in place of the models: from files of the archive.
//!
//! The binary is common to all loops. Their data are in the folder of the resources, under the name
//! of the token: numbers, trees of bodies among them, and a library with those systems that are compiled.

#![allow(clippy::indexing_slicing, clippy::expect_used, reason = "a panic becomes a code")]

mod compiled;
mod files;
mod given;
mod tree;

use core::ffi::CStr;
use std::panic::{catch_unwind, AssertUnwindSafe};
use std::sync::Mutex;

use zivi::drive::mechanical::{BelievedPlant, GapKinetics, LawError, Moved};
use zivi::mechanics::{simulate_mechanical, MechanicalOutput};
use zivi::system::dynamics::Driven;
use zivi::system::dynamics::Dynamics;
use zivi::{Monitor, SwitchedRk};

use crate::state::{FmuState, Parts, StepRefusal, MOST, ROOM};
use crate::table::ScalarVariable;
use compiled::{code, Evaluated, Matrix};
use given::{Controlling, LoopState};
use given::{LoadedLoop, LoopController};

/// Kind of an instance.
#[derive(Clone, Copy, Debug)]
pub(crate) struct AnyModel(&'static LoadedLoop);

/// All loops that this process has read.
static KNOWN: Mutex<Vec<AnyModel>> = Mutex::new(Vec::new());

/// Meaning of a code.
pub(crate) fn message(code: i32) -> &'static CStr {
    match code {
        code::START => c"q0 and qdot0 must be finite, and no gap below 0",
        code::EVALUATION => c"the compiled system failed",
        code::DEPENDENT => c"the gaps must be independent: N M^-1 N^T is singular here",
        code::INDEFINITE => c"mass must be positive definite",
        code::UNREACHED => c"the controls do not reach all gaps",
        code::REFUSED => c"the tracker of a gap refuses its reference or its settings",
        code::MOTION => {
            c"the motion over the step could not be computed, or needs more than 1e5 steps"
        }
        _ => c"a fault in zivi",
    }
}

fn code_of(error: LawError<i32>) -> i32 {
    match error {
        LawError::Raised(code) => code,
        LawError::Dependent => code::DEPENDENT,
        LawError::Indefinite => code::INDEFINITE,
        LawError::Unreached(..) => code::UNREACHED,
        LawError::Foreign | LawError::Refused(_) => code::REFUSED,
        LawError::Setup(_) => code::MOTION,
    }
}

/// Runs something, and makes a code of a panic: none crosses the border.
fn guarded<T>(run: impl FnOnce() -> Result<T, i32>) -> Result<T, i32> {
    catch_unwind(AssertUnwindSafe(run)).unwrap_or(Err(code::FAULT))
}

/// Tolerances of the motion of a system alone: those of the periods of a loop.
const RTOL: f64 = 1e-9;
const ATOL: f64 = 1e-12;
/// Steps of the integrator in one communication step.
const MOST_STEPS: usize = 100_000;

/// A system under the controls of a loop.
type Controlled<'a> = Driven<Evaluated<'a>, Matrix<'a>>;

impl AnyModel {
    /// The loop with this token, from the folder of its resources; a folder is a path or a URI (FMI 2 and 3).
    pub(crate) fn of_token(token: &[u8], resources: &[u8]) -> Option<Self> {
        let mut known = KNOWN.lock().ok()?;
        if let Some(model) = known.iter().find(|it| it.0.token == token) {
            return Some(*model);
        }
        let read = guarded(|| files::read(token, resources).ok_or(code::FAULT)).ok()?;
        if read.table.len() > MOST || LoopState::size(&read) > ROOM {
            return None;
        }
        let model = Self(Box::leak(Box::new(read)));
        known.push(model);
        Some(model)
    }

    pub(crate) fn number(self) -> u32 {
        self.0.number
    }

    pub(crate) fn table(self) -> &'static [ScalarVariable] {
        &self.0.table
    }

    /// Starts from the initial state of the parameters.
    pub(crate) fn configure(self, state: &mut FmuState) -> i32 {
        let of = self.0;
        let (q, w) = (of.first_parameter(), of.layout.n);
        let mut moving = LoopState::start(of);
        moving.t0 = state.value(0);
        moving.q = (0..w).map(|j| state.value(q + j)).collect();
        moving.w = (0..w).map(|j| state.value(q + w + j)).collect();
        let checked = guarded(|| {
            let mut plant = of.plant.driven(of.layout, of.r + w, state, true);
            let mut row = vec![0.0; of.layout.len()];
            plant.evaluate(moving.t0, &moving.q, &moving.w, &mut row)?;
            let is_finite = moving.q.iter().chain(&moving.w).all(|it| it.is_finite());
            let is_free = row[of.layout.gap()].iter().all(|gap| *gap >= 0.0);
            if is_finite && is_free {
                of.controls(&mut moving.clone(), state).map(|_| ())
            } else {
                Err(code::START)
            }
        });
        match checked {
            Ok(()) => {
                moving.write(of, &mut state.objects.numbers);
                0
            }
            Err(code) => code,
        }
    }

    /// Advances by a communication step of this length, the inputs held.
    pub(crate) fn step(self, state: &mut FmuState, length: f64) -> Result<(), StepRefusal> {
        let count = match &self.0.controller {
            // of any length
            None if length > 0.0 && length.is_finite() => 0,
            None => return Err(StepRefusal::Length),
            Some(controller) => {
                let parts = Parts::of(length, controller.law.settings.h)?;
                if !parts.whole {
                    return Err(StepRefusal::Multiple);
                }
                parts.count
            }
        };
        let moved = guarded(|| {
            let mut moving = LoopState::read(self.0, &state.objects.numbers);
            if self.0.controller.is_none() {
                self.0.flight(&mut moving, length, state)?;
            }
            for _ in 0..count {
                self.0.period(&mut moving, state)?;
            }
            Ok(moving)
        });
        moved.map_err(StepRefusal::Code)?.write(self.0, &mut state.objects.numbers);
        state.asked = 0;
        Ok(())
    }

    /// Puts the outputs of this moment into the values.
    pub(crate) fn outputs(self, state: &mut FmuState) {
        let seen = guarded(|| self.0.seen(LoopState::read(self.0, &state.objects.numbers), state));
        if let Ok(values) = seen {
            let first = 1 + self.0.layout.n;
            values.iter().enumerate().for_each(|(k, value)| state.put(first + k, *value));
        }
    }
}

impl LoadedLoop {
    /// The controls for the period that starts now, and those that act in it; none without a controller.
    fn controls(
        &self,
        moving: &mut LoopState,
        state: &FmuState,
    ) -> Result<(Vec<f64>, Vec<f64>), i32> {
        let t = moving.t(self.h());
        let LoopState { k, q, w, controller: controlling, .. } = moving;
        match (&self.controller, controlling) {
            (Some(controller), Some(controlling)) => {
                self.tick((controller, controlling), (t, *k as usize), (q, w), state)
            }
            _ => Ok((vec![], vec![])),
        }
    }

    /// The controls of a controller at a time, after a number of periods, for this state of the system.
    fn tick(
        &self,
        (controller, moving): (&LoopController, &mut Controlling),
        (t, k): (f64, usize),
        measured: (&[f64], &[f64]),
        state: &FmuState,
    ) -> Result<(Vec<f64>, Vec<f64>), i32> {
        let LoopController { believed, law, forces, reference } = controller;
        let mut law = law.clone();
        law.state = moving.law.clone();
        for (tracker, state) in law.trackers.iter_mut().zip(&moving.trackers) {
            tracker.set_state(*state);
        }
        let mut driven = believed.driven(self.layout, self.r, state, false);
        let (laws, h) = (believed.laws.as_slice(), law.settings.h);
        let mut believed = BelievedPlant { driven: &mut driven, tasks: None, laws, h };
        let (delay, of) = (law.settings.delay, (self.layout.n, self.layout.m));
        let ends = reference
            .as_ref()
            .map(|reference| [0, 1].map(|end| reference.sample(k + delay + end, of)));
        let mut asked = |i: usize, _: f64| Ok(forces.get(i).copied().flatten());
        let mut u = vec![0.0; self.r];
        let queue = &law.state.sent.queue;
        let late = queue.first().filter(|_| queue.len() == delay).cloned();
        law.tick(&mut believed, t, measured, ends, &mut asked, &mut u).map_err(code_of)?;
        let acting = if delay == 0 { u.clone() } else { late.unwrap_or(vec![0.0; self.r]) };
        moving.trackers = law.trackers.iter().map(|it| it.state()).collect();
        moving.law = law.state;
        Ok((u, acting))
    }

    /// The controls that act, then the disturbance.
    fn forced(&self, acting: &[f64], state: &FmuState) -> Vec<f64> {
        let disturbance = (1..=self.layout.n).map(|j| state.value(j));
        acting.iter().copied().chain(disturbance).collect()
    }

    fn period(&self, moving: &mut LoopState, state: &FmuState) -> Result<(), i32> {
        let (_, acting) = self.controls(moving, state)?;
        if let Some(Controlling { law, counts, .. }) = &mut moving.controller {
            for (count, bit) in counts.iter_mut().zip(given::COUNTED) {
                *count = count.saturating_add(u32::from(law.status & bit != 0));
            }
        }
        let forced = self.forced(&acting, state);
        let mut driven = self.plant.driven(self.layout, forced.len(), state, true);
        let h = self.h();
        let mut plant =
            BelievedPlant { driven: &mut driven, tasks: None, laws: &self.plant.laws, h };
        let moved = plant.moved(moving.t(h), (&moving.q, &moving.w), &forced).map_err(code_of)?;
        moving.k += 1.0;
        arrived(moving, h, moved, &mut plant)
    }

    /// The motion of a system alone over some time.
    fn flight(&self, moving: &mut LoopState, length: f64, state: &FmuState) -> Result<(), i32> {
        let (n, forced) = (self.layout.n, self.forced(&[], state));
        let mut driven = self.plant.driven(self.layout, forced.len(), state, true);
        driven.hold(&forced);
        let settings = SwitchedRk {
            rtol: RTOL,
            atol: [ATOL; 2],
            max_steps: MOST_STEPS,
            ..SwitchedRk::DEFAULT
        };
        let (start, end) = (moving.t0, moving.t0 + length);
        let output = MechanicalOutput { ends: true, ..MechanicalOutput::default() };
        let (laws, y0) = (&self.plant.laws, (moving.q.as_slice(), moving.w.as_slice()));
        let run = simulate_mechanical(
            settings,
            &mut driven,
            laws,
            (start, end),
            y0,
            output,
            &mut UnwatchedLoop,
        )
        .map_err(|_| code::MOTION)?;
        if let Some(code) = run.raised {
            return Err(code);
        }
        let picked = |of: &[f64]| of[of.len() - self.layout.size()..][..n].to_vec();
        let mode = run.samples.modes.last().map(|mode| mode.closed).unwrap_or_default();
        let moved = Moved {
            q: picked(&run.samples.x),
            w: picked(&run.samples.v),
            closed: (0..self.layout.m).map(|i| mode.has(i)).collect(),
            completed: run.status == zivi::Status::Completed,
        };
        moving.t0 = end;
        let (tasks, laws) = (None, laws.as_slice());
        let mut plant = BelievedPlant { driven: &mut driven, tasks, laws, h: length };
        arrived(moving, 0.0, moved, &mut plant)
    }
}

/// Progress is not reported.
struct UnwatchedLoop;

impl Monitor<i32> for UnwatchedLoop {
    fn poll(&mut self, _: usize, _: usize) -> Result<(), i32> {
        Ok(())
    }
}

/// To where a system has moved, onto its contacts.
fn arrived(
    moving: &mut LoopState,
    h: f64,
    moved: Moved,
    plant: &mut BelievedPlant<'_, Evaluated<'_>, Matrix<'_>>,
) -> Result<(), i32> {
    if !moved.completed {
        return Err(code::MOTION);
    }
    let t = moving.t(h);
    (moving.q, moving.w, moving.closed) = (moved.q, moved.w, moved.closed);
    let layout = plant.layout::<i32>();
    let mut kinetics = GapKinetics::new(layout);
    plant.onto(t, (&mut moving.q, &mut moving.w), &moving.closed, &mut kinetics).map_err(code_of)
}

impl LoadedLoop {
    /// The outputs, in the order of the table.
    fn seen(&self, mut moving: LoopState, state: &FmuState) -> Result<Vec<f64>, i32> {
        let (u, acting) = self.controls(&mut moving, state)?;
        let (layout, h) = (self.layout, self.h());
        let forced = self.forced(&acting, state);
        let mut plant: Controlled<'_> = self.plant.driven(layout, forced.len(), state, true);
        plant.hold(&forced);
        let mut row = vec![0.0; layout.len()];
        plant.evaluate(moving.t(h), &moving.q, &moving.w, &mut row)?;
        let mut kinetics = GapKinetics::of(layout, &row, &moving.w).map_err(code_of)?;
        let forces = kinetics.contact_forces(&moving.closed);
        let bits = |of: &[bool]| of.iter().map(|it| f64::from(u8::from(*it))).collect::<Vec<_>>();
        let gaps = row[layout.gap()].to_vec();
        let law = moving.controller.as_ref().map(|it| &it.law);
        let mut status = law.map_or(vec![], |law| vec![f64::from(law.status)]);
        status.extend(moving.controller.iter().flat_map(|it| it.counts.map(f64::from)));
        let held = law.map_or(vec![], |law| bits(&law.latch.held));
        let closed = bits(&moving.closed);
        Ok([moving.q, moving.w, gaps, closed, forces, held, u, status].concat())
    }
}
