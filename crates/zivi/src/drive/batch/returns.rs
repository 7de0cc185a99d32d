//! Many impacts mapped to the next, on all cores.

use super::{pool, BatchError};
use crate::{ImpactMap, MapParameter, Monitor, Return};

/// Results of the impact map for one of many impacts.
#[derive(Clone, Debug, PartialEq)]
pub struct Mapped {
    /// The next impact.
    pub next: Return,
    /// `[[dphi'/dphi, dphi'/du], [du'/dphi, du'/du]]`.
    pub jacobian: [[f64; 2]; 2],
    /// The derivatives of its phase and speed by each parameter.
    pub by: Vec<[f64; 2]>,
}

/// Number of impacts per task of a thread.
const WIDTH: usize = 64;

/// The next impact of each of many, with derivatives by the state and by parameters.
///
/// # Errors
/// [`BatchError`]: the map cannot be differentiated so, or the monitor wants to stop.
pub fn map_impacts<E>(
    map: &ImpactMap,
    starts: &[[f64; 2]],
    parameters: &[MapParameter],
    threads: usize,
    monitor: &mut impl Monitor<E>,
) -> Result<Vec<Mapped>, BatchError<E>> {
    let one = |&[phase, u]: &[f64; 2]| {
        let (next, jacobian) = map.with_jacobian(phase, u);
        let by = match parameters {
            [] => Vec::new(),
            _ => map.with_parameters(phase, u, parameters)?.1,
        };
        Ok(Mapped { next, jacobian, by })
    };
    let nothing = [[f64::NAN; 2]; 2];
    let work = pool::Work {
        width: WIDTH,
        chunk: |chunk: &[[f64; 2]], _: pool::Stop<'_>| chunk.iter().map(one).collect(),
        lost: |_: &[f64; 2], _| Mapped {
            next: map.next(f64::NAN, f64::NAN),
            jacobian: nothing,
            by: vec![[f64::NAN; 2]; parameters.len()],
        },
    };
    pool::run(starts, threads, monitor, work)
}

/// The orbits of many impacts under maps of their own, or one for all: phase and speed of `n`
/// impacts each, the first after `skip` others.
///
/// # Errors
/// [`BatchError::Raised`]: the monitor wants to stop.
pub fn orbits<E>(
    maps: &[ImpactMap],
    starts: &[[f64; 2]],
    (skip, n): (usize, usize),
    threads: usize,
    monitor: &mut impl Monitor<E>,
) -> Result<Vec<Vec<[f64; 2]>>, BatchError<E>> {
    let numbered: Vec<(usize, [f64; 2])> = starts.iter().copied().enumerate().collect();
    let one = |&(i, start): &(usize, [f64; 2]), stop: &dyn Fn() -> bool| {
        let map = &maps[if maps.len() == 1 { 0 } else { i }];
        let mut out = vec![[f64::NAN; 2]; n];
        map.orbit_unless(start, skip, &mut out, stop);
        out
    };
    let work = pool::Work {
        width: 1,
        chunk: |chunk: &[(usize, [f64; 2])], stop: pool::Stop<'_>| {
            Ok(chunk.iter().map(|item| one(item, stop)).collect())
        },
        lost: |_: &(usize, [f64; 2]), _| vec![[f64::NAN; 2]; n],
    };
    pool::run(&numbered, threads, monitor, work)
}
