//! Impacts that accumulate: those of one kind at a Zeno point, those of several gaps in a corner.

use crate::impact::chain::ImpactChain;
use crate::impact::corner::CornerApproach;
use crate::impact::Struck;
use crate::kinetics::mode::{Ahead, Key};
use crate::kinetics::{Kinetics, Model};
use crate::motion::one_coordinate::Pull;
use crate::motion::path::Piece;
use crate::motion::state::MechanicalState;
use crate::motion::tail::Mechanism;
use crate::record::events::{FlagKind, Occurrence};
use crate::record::gap_set::{ContactMode, GapSet};
use crate::record::status::Failure;
use crate::switched::accumulation::Deviation;
use crate::switched::SwitchedRk;
use crate::system::dynamics::{Dynamics, Layout};
use crate::system::force::Friction;
use crate::zeno::arc::Bounce;
use crate::zeno::chain::Chain;
use crate::Status;

/// Data of impacts that may accumulate.
#[derive(Clone, Debug)]
pub(crate) struct Accumulation {
    settings: SwitchedRk,
    chain: ImpactChain,
    corner: CornerApproach,
    /// Impacts since a gap last closed or a contact lifted off.
    impacts: usize,
    /// The mechanics away from the state.
    aside: Kinetics,
}

impl Accumulation {
    pub(crate) fn new(settings: SwitchedRk, layout: Layout, friction: &Friction) -> Self {
        Self {
            settings,
            chain: ImpactChain::new(layout.size()),
            corner: CornerApproach::default(),
            impacts: 0,
            aside: Kinetics::new(layout, friction),
        }
    }

    /// The forces have no shorter period (s).
    pub(crate) fn set_period(&mut self, period: f64) {
        self.chain.set_period(period);
    }

    /// The impacts of one kind.
    pub(crate) fn chain(&self) -> &Chain<Vec<f64>, Key> {
        self.chain.impacts()
    }

    /// The tolerances of the Zeno time of the impact sequence and of the state there.
    pub(crate) fn scales(&self, state: &MechanicalState, last: Bounce) -> Vec<f64> {
        self.chain.scales(&self.settings, state, last)
    }

    /// Where the forces last kept the system from jumping to the end of the impact sequence.
    pub(crate) fn obstacle(&self) -> Option<Deviation> {
        self.chain.obstacle()
    }

    /// From here on the forces are others.
    pub(crate) fn restart(&mut self) {
        self.chain.restart();
        self.corner.clear();
    }

    /// A contact opened: what comes next is another accumulation.
    pub(crate) fn clear(&mut self) {
        self.chain.clear();
        self.corner.clear();
        self.impacts = 0;
    }

    /// States after impacts are in other coordinates from here on: what comes next is known by later impacts.
    pub(crate) fn forget_impacts(&mut self) {
        self.chain.clear();
        self.corner.clear();
    }

    /// Whether there was no impact that the next accumulation may be known by.
    pub(crate) fn has_no_impacts(&self) -> bool {
        self.chain.impacts().bounces().is_empty() && self.corner.has_no_impacts()
    }

    /// Friction in a joint or at a closed contact changed in flight: the impacts do not form an
    /// impact sequence with a known ratio.
    pub(crate) fn note_transition(&mut self) {
        self.chain.clear();
        self.corner.note_transition();
    }

    /// An error where there were too many impacts without an end.
    pub(crate) fn check_budget<E>(&mut self) -> Result<(), Failure<E>> {
        if self.impacts > self.settings.max_impacts {
            self.impacts = 0;
            return Err(Failure::Status(Status::ZenoBudget));
        }
        Ok(())
    }

    /// Appends an impact, with the acceleration of a single gap towards its wall, if flights know
    /// it, the restitutions of slow impacts and the state after it; returns the accumulation point,
    /// if determined to the tolerance.
    pub(crate) fn note<E, D: Dynamics<E>>(
        &mut self,
        (struck, pull): (&Struck, Option<Pull>),
        (e, state): (&[f64], &mut MechanicalState),
        model: &mut Model<'_, D>,
    ) -> Result<Option<Ahead>, Failure<E>> {
        self.impacts = if struck.changes_contacts { 1 } else { self.impacts + 1 };
        let Self { settings, chain, corner, aside, .. } = self;
        let mut at = Mechanism { settings, e, state, aside, model };
        let mut zeno = None;
        match struck.key() {
            Some(key) => zeno = chain.note((key, pull), &mut at)?,
            None => chain.clear(),
        }
        if let Some(spent) = struck.spent() {
            zeno = chain.settle(spent, &mut at)?;
        }
        match struck.is_slow {
            true => corner.note(struck, at.state),
            false => corner.clear(),
        }
        if let Some(landing) = zeno {
            return Ok(Some(Ahead { landing, corner: None }));
        }
        let ahead = corner.ahead(&mut at)?;
        Ok(ahead.map(|(landing, set)| Ahead { landing, corner: Some(set) }))
    }

    /// Through the rest of an accumulation, onto the manifold. Its impacts are worked out if it ends
    /// after the first time, the motion between them if it ends after the second.
    pub(crate) fn jump<E, D: Dynamics<E>>(
        &mut self,
        Ahead { landing, corner: into }: Ahead,
        from: (f64, f64),
        (e, state): (&[f64], &mut MechanicalState),
        occurrences: &mut Vec<Occurrence>,
        model: &mut Model<'_, D>,
    ) -> Result<Piece, Failure<E>> {
        let (before, mode) = (state.closed(), state.mode());
        let Self { settings, chain, corner, aside, .. } = self;
        let mut at = Mechanism { settings, e, state, aside, model };
        let (piece, set) = match into {
            Some(set) => {
                let (flights, set) = corner.jump((landing, set), from.1, &mut at)?;
                (Piece::Descent(flights), set)
            }
            None => {
                let (arcs, set) = chain.jump(&landing, from, &mut at)?;
                (Piece::Skipped(arcs), set)
            }
        };
        state.settle(set)?;
        state.refresh()?;
        let t = state.now().t;
        let is_corner =
            |gaps: GapSet| !self.corner.may_be_of_one_gap() || gaps.without(before).len() > 1;
        let corner = into.is_some_and(is_corner);
        if corner {
            self.corner.clear();
        } else if into.is_some() {
            self.corner.end_one_gap();
        } else if self.chain.is_forced() {
            let (kind, gaps) = (FlagKind::ForcedLanding, set.without(before));
            occurrences.push(Occurrence::Flag { kind, t, gaps, size: 0.0 });
        }
        if corner {
            occurrences.push(Occurrence::Corner { t, gaps: set });
        } else {
            let zeno = |gap| Occurrence::Zeno { t, gap, closed: set };
            occurrences.extend(set.without(before).iter().map(zeno));
        }
        note_lifted(t, state.left(), occurrences);
        state.note_transitions(mode, occurrences);
        self.chain.restart();
        self.impacts = 0;
        Ok(piece)
    }
}

impl Accumulation {
    /// To rest where the system is, in all gaps and channels whose speeds are below `slow`: what is left of
    /// accumulations within accumulations, whose patterns tell no end. Whether anything comes to rest. Gaps
    /// that bounce for long however slow they are go on.
    pub(crate) fn rest<E, D: Dynamics<E>>(
        &mut self,
        (slow, lingering): (f64, GapSet),
        state: &mut MechanicalState,
        occurrences: &mut Vec<Occurrence>,
        model: &mut Model<'_, D>,
    ) -> Result<bool, Failure<E>> {
        state.complete(model)?;
        let (t, before, mode, m) = (state.now().t, state.closed(), state.mode(), state.layout().m);
        let goes_on = |state: &MechanicalState, i| lingering.has(i) && state.gap(i).1 != 0.0;
        let rests = |&i: &usize| state.is_still(i, slow) && !goes_on(state, i);
        let set: GapSet = (0..m).filter(rests).collect();
        let slips = state.slips();
        let stops = |&c: &usize| match state.kinetics().gap_of(c) {
            _ if slips[c].abs() > slow => false,
            Some(gap) => set.has(gap),
            None => true,
        };
        let stick: GapSet = (0..slips.len()).filter(stops).collect();
        let moves =
            set.iter().any(|i| state.gap(i).1 != 0.0) || stick.iter().any(|c| slips[c] != 0.0);
        let singular =
            |state: &mut MechanicalState| state.parts().0.solve(set, |_, _| 0.0).is_err();
        if !moves || (state.layout().p == 0 && singular(state)) {
            return Ok(false);
        }
        let z = [&state.now().x[..], &state.now().xdot[..]].concat();
        let landed = ContactMode { stick, ..set.into() };
        let set = state.move_to((t, &z), landed, self.settings.rounding(), model)?;
        state.settle(set)?;
        state.refresh()?;
        let closed = set.without(before);
        match closed.len() {
            0 | 1 => {
                let zeno = |gap| Occurrence::Zeno { t, gap, closed: set };
                occurrences.extend(closed.iter().map(zeno));
            }
            _ => occurrences.push(Occurrence::Corner { t, gaps: set }),
        }
        note_lifted(t, state.left(), occurrences);
        state.note_transitions(mode, occurrences);
        self.chain.restart();
        self.clear();
        Ok(true)
    }
}

/// Notes contacts that the forces open.
pub(crate) fn note_lifted(t: f64, gaps: GapSet, occurrences: &mut Vec<Occurrence>) {
    occurrences.extend(gaps.iter().map(|gap| Occurrence::LiftOff { t, gap }));
}
