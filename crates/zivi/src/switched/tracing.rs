//! The motion of an integrator that is driven from outside, kept as a path.

use super::integrator::SwitchedIntegrator;
use super::path::DensePath;
use super::piece::Piece;
use super::stages::Counted;
use crate::record::failure::Failure;
use crate::record::occurrence::Occurrence;
use crate::record::reserve::Reserve;
use crate::{Force, PathPoint, Physical};

/// What drives of an integrator left, one after the other, as one motion.
#[derive(Debug, Default)]
pub(crate) struct Trace {
    path: DensePath,
    reserve: Reserve,
}

impl Trace {
    /// The motion so far.
    pub(crate) fn path(&self) -> &DensePath {
        &self.path
    }

    /// Forgets it.
    pub(crate) fn clear(&mut self) {
        self.path.clear();
    }

    pub(crate) fn into_path(self) -> DensePath {
        self.path
    }
}

impl SwitchedIntegrator {
    /// Tells what happened at the wall in a piece.
    pub(super) fn tell(&self, piece: &Piece, resting: bool, observe: &mut impl FnMut(Occurrence)) {
        match *piece {
            Piece::Flight { impact, .. } => {
                let number = self.counts().impacts;
                impact.into_iter().for_each(|it| observe(Occurrence::of_mass(it, number)));
            }
            Piece::Tail => observe(Occurrence::rest_of_mass(self.t())),
            Piece::Rest { from, lifted } => {
                if !resting {
                    observe(Occurrence::rest_of_mass(from));
                }
                if lifted {
                    observe(Occurrence::lift_off_of_mass(self.t()));
                }
            }
        }
    }

    /// As [`SwitchedIntegrator::observe_to`], and adds the motion to a trace.
    pub(crate) fn trace_to<E, F: Force<E>>(
        &mut self,
        t_end: f64,
        force: &mut F,
        trace: &mut Trace,
        observe: impl FnMut(Occurrence),
    ) -> Result<(), Failure<E>> {
        self.flight().steps_mut().look_from(f64::NEG_INFINITY);
        let Trace { path, reserve } = trace;
        let absorb = |integrator: &mut Self, piece: &Piece, force: &mut Counted<'_, F>| {
            path.make_room(reserve)?;
            match piece {
                Piece::Flight { from, sigma, .. } if integrator.t() > from.t => {
                    for k in 0..integrator.flight().curves() {
                        if k > 0 {
                            // one of many steps at once
                            integrator.flight().steps_mut().spend()?;
                        }
                        path.make_room(reserve)?;
                        if !integrator.flight().keep(k, *sigma, path) {
                            path.push_flight(&integrator.flight().curve(k, *sigma, force)?);
                        }
                    }
                }
                Piece::Flight { .. } => {}
                Piece::Tail => {
                    if let Some(mut tail) = integrator.tail().cloned() {
                        force.bend(&mut tail)?;
                        path.push_tail(&tail);
                    }
                }
                Piece::Rest { from, .. } => path.push_rest(*from, integrator.sigma()),
            }
            Ok(())
        };
        let ended = self.go_to(t_end, force, absorb, observe);
        let Physical { x, xdot } = self.state();
        trace.path.finish(self.t(), PathPoint { x, xdot, sigma: self.sigma() });
        ended
    }
}
