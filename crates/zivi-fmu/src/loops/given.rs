//! A system or a loop as read from its files.

use super::compiled::CompiledSystem;
use crate::table::{DataType, Role, ScalarVariable};
use zivi::drive::mechanical::{
    GapTracker, GapTrackerState, Latch, MechanicalReference, Offsets, SentControls,
};
use zivi::system::dynamics::Layout;
use zivi_core::control::{TickStatus, TrackerState};
use zivi_core::Lifted;

/// A system, alone or with its controller, that was read from its files; it stays for the whole process.
#[derive(Debug)]
pub(super) struct LoadedLoop {
    pub(super) token: Vec<u8>,
    pub(super) number: u32,
    pub(super) table: Vec<ScalarVariable>,
    pub(super) layout: Layout,
    /// Number of controls.
    pub(super) r: usize,
    pub(super) plant: CompiledSystem,
    pub(super) controller: Option<LoopController>,
}

/// A controller.
#[derive(Debug)]
pub(super) struct LoopController {
    pub(super) believed: CompiledSystem,
    pub(super) law: GapTracker,
    /// The force with which a contact is pressed, if one is requested.
    pub(super) forces: Vec<Option<f64>>,
    pub(super) reference: Option<MechanicalReference>,
}

/// Counters of the updates of a controller.
pub(super) const COUNTED: [u8; 2] = [GapTracker::REFUSED, GapTracker::SATURATED];

impl LoadedLoop {
    /// The variables: time; a disturbance of each coordinate; coordinates, velocities, gaps, contacts,
    /// contact forces; for a controller held contacts, controls, the status, the numbers of updates
    /// rejected and saturated; the initial state, the parameters of the system and of the controller's model.
    pub(super) fn table(sizes: Sizes, start: &[f64]) -> Vec<ScalarVariable> {
        let Sizes { layout: Layout { n, m, .. }, r, is_controlled } = sizes;
        let held = if is_controlled { m } else { 0 };
        let parts = [
            (DataType::Real, Role::Time, 1),
            (DataType::Real, Role::Input, n),
            (DataType::Real, Role::Output, 2 * n + m),
            (DataType::Boolean, Role::Output, m),
            (DataType::Real, Role::Output, m),
            (DataType::Boolean, Role::Output, held),
            (DataType::Real, Role::Output, r),
            (DataType::Integer, Role::Output, if is_controlled { 1 + COUNTED.len() } else { 0 }),
        ];
        let mut table = Vec::new();
        for (kind, role, count) in parts {
            table.extend((0..count).map(|_| ScalarVariable { kind, role, start: 0.0 }));
        }
        let (kind, role) = (DataType::Real, Role::Parameter);
        let parameter = |start: &f64| ScalarVariable { kind, role, start: *start };
        table.extend(start.iter().map(parameter));
        table
    }

    /// Where the first parameter is, a coordinate at the start.
    pub(super) fn first_parameter(&self) -> usize {
        let is_controlled = self.controller.is_some();
        Sizes { layout: self.layout, r: self.r, is_controlled }.first_parameter()
    }

    /// The period of the controller (s), `None` for a system without one.
    pub(super) fn h(&self) -> f64 {
        self.controller.as_ref().map_or(0.0, |it| it.law.settings.h)
    }
}

/// Number of values of each kind.
#[derive(Clone, Copy, Debug)]
pub(super) struct Sizes {
    pub(super) layout: Layout,
    pub(super) r: usize,
    pub(super) is_controlled: bool,
}

impl Sizes {
    /// Where the first parameter is among the values.
    pub(super) fn first_parameter(self) -> usize {
        let Self { layout: Layout { n, m, .. }, r, is_controlled } = self;
        1 + 3 * n + 3 * m + if is_controlled { m + r + 1 + COUNTED.len() } else { 0 }
    }
}

// State that changes from period to period, as plain numbers.

/// State that changes from period to period.
#[derive(Clone, Debug)]
pub(super) struct LoopState {
    /// Time at the start (s).
    pub(super) t0: f64,
    /// Periods since then.
    pub(super) k: f64,
    pub(super) q: Vec<f64>,
    pub(super) w: Vec<f64>,
    pub(super) closed: Vec<bool>,
    pub(super) controller: Option<Controlling>,
}

/// The same of a controller.
#[derive(Clone, Debug)]
pub(super) struct Controlling {
    pub(super) law: GapTrackerState,
    pub(super) trackers: Vec<TrackerState>,
    /// Updates so far with each of the bits [`COUNTED`].
    pub(super) counts: [u32; COUNTED.len()],
}

/// A reader or writer of numbers, so that their order is defined once.
trait Passes {
    fn pass(&mut self, value: &mut f64);
}

struct NumberReader<'a>(core::slice::Iter<'a, f64>);

impl Passes for NumberReader<'_> {
    fn pass(&mut self, value: &mut f64) {
        *value = self.0.next().copied().unwrap_or(0.0);
    }
}

struct Writing<'a>(core::slice::IterMut<'a, f64>);

impl Passes for Writing<'_> {
    fn pass(&mut self, value: &mut f64) {
        if let Some(to) = self.0.next() {
            *to = *value;
        }
    }
}

struct Counting(usize);

impl Passes for Counting {
    fn pass(&mut self, _: &mut f64) {
        self.0 += 1;
    }
}

fn flag(it: &mut impl Passes, value: &mut bool) {
    let mut number = f64::from(u8::from(*value));
    it.pass(&mut number);
    *value = number != 0.0;
}

fn count(it: &mut impl Passes, value: &mut u32) {
    let mut number = f64::from(*value);
    it.pass(&mut number);
    *value = number as u32;
}

/// Numbers that may be missing, in room for `size` of them.
fn optional(it: &mut impl Passes, value: &mut Option<Vec<f64>>, size: usize) {
    let mut is_there = value.is_some();
    flag(it, &mut is_there);
    let mut row = value.take().unwrap_or(vec![0.0; size]);
    row.iter_mut().for_each(|value| it.pass(value));
    *value = is_there.then_some(row);
}

impl LoopState {
    pub(super) fn start(of: &LoadedLoop) -> Self {
        let n = of.layout.n;
        Self {
            t0: 0.0,
            k: 0.0,
            q: vec![0.0; n],
            w: vec![0.0; n],
            closed: vec![false; of.layout.m],
            controller: of.controller.as_ref().map(Controlling::start),
        }
    }

    pub(super) fn t(&self, h: f64) -> f64 {
        self.t0 + h * self.k
    }

    /// Number of values, with a full delay line of controls.
    pub(super) fn size(of: &LoadedLoop) -> usize {
        let delay = of.controller.as_ref().map_or(0, |it| it.law.settings.delay);
        let mut counting = Counting(of.r * delay);
        Self::start(of).pass(&mut counting, of);
        counting.0
    }

    pub(super) fn read(of: &LoadedLoop, numbers: &[f64]) -> Self {
        let mut moving = Self::start(of);
        moving.pass(&mut NumberReader(numbers.iter()), of);
        moving
    }

    pub(super) fn write(&self, of: &LoadedLoop, numbers: &mut [f64]) {
        self.clone().pass(&mut Writing(numbers.iter_mut()), of);
    }

    /// Passes all numbers.
    fn pass(&mut self, it: &mut impl Passes, of: &LoadedLoop) {
        let Self { t0, k, q, w, closed, controller } = self;
        [t0, k].into_iter().chain(q).chain(w).for_each(|value| it.pass(value));
        closed.iter_mut().for_each(|value| flag(it, value));
        if let (Some(controlling), Some(controller)) = (controller, &of.controller) {
            controlling.pass(it, controller, (of.layout.n, of.r));
        }
    }
}

impl Controlling {
    fn start(of: &LoopController) -> Self {
        let trackers = of.law.trackers.iter().map(|it| it.state()).collect();
        Self { law: of.law.state.clone(), trackers, counts: [0; COUNTED.len()] }
    }

    /// Passes all numbers, with these numbers of coordinates and controls.
    fn pass(&mut self, it: &mut impl Passes, of: &LoopController, (n, r): (usize, usize)) {
        let Self { law, trackers, counts } = self;
        counts.iter_mut().for_each(|value| count(it, value));
        let GapTrackerState { latch, accelerations, sent, place, status, least, uncontrolled } =
            law;
        let SentControls { last: u, queue: sent } = sent;
        let Latch { held, beyond, offsets: Offsets { by, seen, still } } = latch;
        held.iter_mut().for_each(|value| flag(it, value));
        [beyond, seen, still].into_iter().flatten().for_each(|value| count(it, value));
        by.iter_mut().chain(accelerations).for_each(|value| it.pass(value));
        optional(it, place, n);
        optional(it, u, r);
        let mut late = sent.len() as u32;
        count(it, &mut late);
        sent.resize((late as usize).min(of.law.settings.delay), vec![0.0; r]);
        sent.iter_mut().flatten().for_each(|value| it.pass(value));
        let mut bits = u32::from(*status);
        count(it, &mut bits);
        *status = bits as u8;
        it.pass(least);
        let mut free = *uncontrolled as u32;
        count(it, &mut free);
        *uncontrolled = free as usize;
        for TrackerState { reference: Lifted { s, v }, side, u, signs, status, .. } in trackers {
            [s, v, side, u].into_iter().chain(signs).for_each(|value| it.pass(value));
            let mut bits = u32::from(status.bits());
            count(it, &mut bits);
            *status = TickStatus::from_bits(bits as u8);
        }
    }
}
