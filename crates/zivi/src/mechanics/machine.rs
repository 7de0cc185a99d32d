//! The state of the switched method for a mechanical system, and what holds in every mode.
//!
//! The mode is the set of closed gaps: with none of them it is free flight, else motion on the
//! manifold where they are zero. Between events both are one ordinary differential equation.

use super::contact_probes::ContactProbes;
use super::contact_problem::settle;
use super::corner_log::CornerLog;
use super::corner_log::COLUMNS;
use super::equation::{InContact, LastStep, Stages, State};
use super::kinetics::{Kinetics, Model};
use super::mode::Key;
use super::mode::{Contacts, Next, Response};
use super::piece::Piece;
use crate::record::failure::Failure;
use crate::record::gap_set::GapSet;
use crate::record::occurrence::Occurrence;
use crate::switched::lookahead::Obstacle;
use crate::switched::step_control::StepControl;
use crate::switched::SwitchedRk;
use crate::system::dynamics::{Dynamics, Layout};
use crate::zeno::chain::Chain;
use crate::{Counts, Status};

/// The switched method for mechanical systems as an object that is driven piece by piece.
#[derive(Clone, Debug)]
pub(super) struct Machine {
    pub(super) settings: SwitchedRk,
    pub(super) layout: Layout,
    pub(super) e: Vec<f64>,
    pub(super) kinetics: Kinetics,
    pub(super) aside: Kinetics,
    pub(super) now: State,
    pub(super) contacts: Contacts,
    pub(super) next: Next,
    pub(super) here: Response,
    pub(super) last: LastStep,
    pub(super) gathered: Gathered,
    pub(super) control: StepControl,
    pub(super) probes: ContactProbes,
    /// Steps that end later than this have their polynomials computed.
    pub(super) dense_from: f64,
    pub(super) last_impact: f64,
    pub(super) group: u64,
    pub(super) occurrences: Vec<Occurrence>,
    /// Events since the time last advanced by a step.
    pub(super) stalled: u32,
    pub(super) counts: Counts,
}

/// What impacts gathered that may accumulate.
#[derive(Clone, Debug)]
pub(super) struct Gathered {
    pub(super) chain: Chain<Vec<f64>, Key>,
    pub(super) corners: CornerLog,
    /// Where the forces last kept the system from jumping to the end of them.
    pub(super) obstacle: Option<Obstacle>,
    /// Impacts since a gap last closed or a contact lifted off.
    pub(super) impacts: usize,
}

/// Events at one instant after which the motion is called unsolved. Each pair of impacts of a light body
/// between heavier ones may leave most of the speed.
const MOST_AT_ONCE: u32 = 20_000;
/// A gap of this part of the unit of length is closed at the start.
const NEAR: f64 = 1e-15;
/// Newton iterations of a projection.
const PROJECTIONS: usize = 4;
/// A gap is as its function says while that is larger than this part of its terms.
const ANCHOR: f64 = 1e-5;

impl Machine {
    pub(super) fn new(settings: SwitchedRk, layout: Layout, e: &[f64]) -> Self {
        let size = layout.n + layout.m;
        Self {
            settings,
            layout,
            e: e.to_vec(),
            kinetics: Kinetics::new(layout),
            aside: Kinetics::new(layout),
            now: State::zeros(size),
            contacts: Contacts::default(),
            next: Next::STEP,
            here: Response { slope: vec![0.0; size], lambda: vec![0.0; layout.m], known: false },
            last: LastStep::new(settings.order.pair(), layout),
            gathered: Gathered {
                chain: Chain::new(Key::default(), 0.5, 2 * size, COLUMNS),
                corners: CornerLog::default(),
                obstacle: None,
                impacts: 0,
            },
            control: StepControl { h: settings.first_step, ..StepControl::default() },
            probes: ContactProbes::default(),
            dense_from: f64::INFINITY,
            last_impact: f64::NEG_INFINITY,
            group: 0,
            occurrences: Vec::new(),
            stalled: 0,
            counts: Counts::default(),
        }
    }

    /// Starts at a state whose gaps are open, or closed to rounding: at gaps with a speed towards
    /// zero the impact comes first. The first gap that is not open, and its value, if there is one.
    pub(super) fn start<E, D: Dynamics<E>>(
        &mut self,
        t: f64,
        (q, w): (&[f64], &[f64]),
        model: &mut Model<'_, D>,
    ) -> Result<Option<(usize, f64)>, Failure<E>> {
        let Layout { n, m } = self.layout;
        (self.now.t, self.now.late, self.last_impact) = (t, 0.0, t);
        self.now.x[..n].copy_from_slice(q);
        self.now.xdot[..n].copy_from_slice(w);
        self.kinetics.evaluate(model, t, q, w)?;
        let (mut touching, mut hit) = (GapSet::EMPTY, GapSet::EMPTY);
        for i in 0..m {
            let (gap, rate) = (self.kinetics.gap(i), self.kinetics.rate(i, w));
            let (of_gap, of_rate) = self.kinetics.rounding(i, q, w);
            // a gap that vanishes by cancellation leaves rounding of its terms, which may be larger
            // than what the coordinates tell
            let of_gap = of_gap.max(NEAR * self.kinetics.steepness(i));
            if gap < -8.0 * of_gap {
                return Ok(Some((i, gap)));
            }
            let zero = |value: f64, noise: f64| if value.abs() <= noise { 0.0 } else { value };
            (self.now.x[n + i], self.now.xdot[n + i]) =
                (zero(gap, 8.0 * of_gap), zero(rate, 4.0 * of_rate));
            if self.now.x[n + i] == 0.0 && self.now.xdot[n + i] <= 0.0 {
                let set = if self.now.xdot[n + i] < 0.0 { &mut hit } else { &mut touching };
                *set = set.with(GapSet::of(i));
            }
        }
        self.contacts = Contacts { closed: touching, left: GapSet::EMPTY };
        if !hit.is_empty() {
            self.next = Next::Hit(hit);
        } else if !touching.is_empty() {
            self.project(touching, model)?;
            self.contacts = self.settle(touching)?;
        }
        Ok(None)
    }

    /// One more piece of the motion.
    pub(super) fn advance<E, D: Dynamics<E>>(
        &mut self,
        t_end: f64,
        model: &mut Model<'_, D>,
    ) -> Result<Piece, Failure<E>> {
        self.stalled += 1;
        if self.stalled > MOST_AT_ONCE {
            return Err(Failure::Status(Status::ContactNotSolved));
        }
        match std::mem::replace(&mut self.next, Next::STEP) {
            Next::Hit(gaps) => return self.strike(gaps, model),
            Next::Release { gap, h } => return self.open(gap, h, model),
            Next::Jump(ahead) if ahead.landing.t <= t_end => return self.jump(ahead, model),
            Next::Jump(_) => (),
            Next::Step(experience) => self.next = Next::Step(experience),
        }
        if self.gathered.impacts > self.settings.max_impacts {
            self.gathered.impacts = 0;
            return Err(Failure::Status(Status::ZenoBudget));
        }
        let through = self.through();
        if !through.is_empty() {
            return self.strike(through, model);
        }
        self.prepare(model)?;
        let t = self.now.t;
        self.fly(t_end, model)?;
        if self.now.t > t {
            self.stalled = 0;
        }
        Ok(Piece::Motion)
    }

    /// The gaps that are hit at once, though none of them was seen to come near.
    pub(super) fn through(&self) -> GapSet {
        let n = self.layout.n;
        let open = (0..self.layout.m).filter(|&i| !self.contacts.closed.has(i));
        open.filter(|&i| self.now.x[n + i] <= 0.0 && self.now.xdot[n + i] < 0.0).collect()
    }

    /// Forgets what was learnt from the forces: from here on they are others.
    pub(super) fn restart(&mut self) {
        self.here.known = false;
        if let Next::Jump(_) = self.next {
            self.next = Next::STEP;
        }
        self.gathered.obstacle = None;
        self.gathered.chain.clear();
        self.gathered.corners.clear();
        self.probes = ContactProbes::default();
    }

    /// Whether something happens before the time moves on beyond `t_end`.
    pub(super) fn is_pending(&self, t_end: f64) -> bool {
        self.next.is_due(t_end)
    }

    /// The last step, and the equation of which it is one.
    pub(super) fn stages_of<'r, 'm, D>(
        &'r mut self,
        model: &'r mut Model<'m, D>,
    ) -> (&'r mut Stages, InContact<'r, 'm, D>) {
        let Self { last: LastStep { stages, at_end, .. }, kinetics, contacts, .. } = self;
        (stages, InContact { closed: contacts.closed, kinetics, model, at_end: Some(at_end) })
    }

    /// Evaluates the system at the end of the last step.
    pub(super) fn finish_step<E, D: Dynamics<E>>(
        &mut self,
        model: &mut Model<'_, D>,
    ) -> Result<(), Failure<E>> {
        let (stages, mut equation) = self.stages_of(model);
        stages.finish(&mut equation)
    }

    /// Computes what the polynomials of the last step need.
    pub(super) fn complete_step<E, D: Dynamics<E>>(
        &mut self,
        model: &mut Model<'_, D>,
    ) -> Result<(), Failure<E>> {
        let (stages, mut equation) = self.stages_of(model);
        stages.complete(&mut equation)
    }

    /// Accelerations and contact forces at the present state.
    pub(super) fn prepare<E, D: Dynamics<E>>(
        &mut self,
        model: &mut Model<'_, D>,
    ) -> Result<(), Failure<E>> {
        if !self.here.known {
            let n = self.layout.n;
            self.kinetics.evaluate(model, self.now.t, &self.now.x[..n], &self.now.xdot[..n])?;
            self.refresh()?;
            for i in 0..self.layout.m {
                self.anchor(i, self.kinetics.gap(i), self.kinetics.rate(i, &self.now.xdot[..n]));
            }
        }
        Ok(())
    }

    /// The same, where the system has just been evaluated.
    pub(super) fn refresh<E>(&mut self) -> Result<(), Failure<E>> {
        self.kinetics.contact(self.contacts.closed)?;
        self.here.slope.copy_from_slice(&self.kinetics.acceleration);
        self.here.lambda.copy_from_slice(&self.kinetics.lambda);
        self.here.known = true;
        Ok(())
    }

    /// Sets a gap that was integrated to what its function says, where that has enough digits.
    pub(super) fn anchor(&mut self, i: usize, gap: f64, rate: f64) {
        let n = self.layout.n;
        let size = self.now.x[..n].iter().fold(0.0_f64, |a, b| a.max(b.abs()));
        let clear = gap > ANCHOR * (size + gap) && self.now.x[n + i] > 0.0;
        if clear && !self.contacts.closed.has(i) {
            (self.now.x[n + i], self.now.xdot[n + i]) = (gap, rate);
        }
    }

    /// Moves the coordinates and velocities, along the directions of the impulses, to where the
    /// gaps of a set are zero and have the speeds of the state. The system is evaluated there.
    pub(super) fn project<E, D: Dynamics<E>>(
        &mut self,
        set: GapSet,
        model: &mut Model<'_, D>,
    ) -> Result<(), Failure<E>> {
        let Self { kinetics, now, layout, .. } = self;
        let n = layout.n;
        self.here.known = false;
        for iteration in 0..=PROJECTIONS {
            let (q, gaps) = now.x.split_at_mut(n);
            let (w, speeds) = now.xdot.split_at_mut(n);
            kinetics.evaluate(model, now.t, q, w)?;
            let (mut far, mut fast) = (false, false);
            for i in set.iter() {
                gaps[i] = 0.0;
                let (of_gap, of_rate) = kinetics.rounding(i, q, w);
                far |= kinetics.gap(i).abs() > of_gap;
                fast |= (speeds[i] - kinetics.rate(i, w)).abs() > of_rate;
            }
            if !(far || fast) || iteration == PROJECTIONS {
                break;
            }
            if fast {
                kinetics.solve(set, |at, i| speeds[i] - at.rate(i, w))?;
                kinetics.apply(set, w);
            }
            if far {
                kinetics.solve(set, |at, i| -at.gap(i))?;
                kinetics.apply(set, q);
            }
        }
        Ok(())
    }

    /// Which of the gaps that touch without a speed stay closed, and which the forces open, where
    /// the system has just been evaluated: `0 <= lambda  perp  b + D lambda >= 0`.
    pub(super) fn settle<E>(&mut self, touching: GapSet) -> Result<Contacts, Failure<E>> {
        settle(&mut self.kinetics, touching)
    }
}
