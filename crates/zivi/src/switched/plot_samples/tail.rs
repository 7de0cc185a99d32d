//! The arcs of an accumulation.

use std::collections::TryReserveError;

use super::contact::moments;
use super::scale::{larger, Scale};
use super::{row, Row, FLATNESS, LOW};
use crate::zeno::tail::Tail;

/// How many arcs of a tail are drawn: those higher than this part of the highest.
const ARCS: usize = 64;
const FINEST: f64 = 1e-3;

pub(super) fn draw_tail(
    tail: &Tail,
    end: f64,
    scale: Scale,
    rows: &mut Vec<Row>,
) -> Result<(), TryReserveError> {
    for arc in (0..ARCS).map_while(|m| tail.arc(m)) {
        // the height of an arc, u h/4
        let height = 0.25 * arc.u * (arc.end - arc.start);
        if arc.start >= end || height < FINEST * scale.x {
            break;
        }
        // a line is off by the height over the square of them; the apex is in the middle
        let flat = FLATNESS * larger(height, LOW * scale.x);
        let parts = 2.0 * (0.5 * (height / flat).sqrt()).ceil();
        rows.try_reserve(parts as usize + 2)?;
        let mut push = |t: f64| rows.push(row(t, arc.at(t)));
        if arc.start > tail.start() {
            push(arc.start);
        }
        let mut last = arc.start;
        for k in 1..parts as usize {
            let t = arc.start + k as f64 / parts * (arc.end - arc.start);
            if arc.start < t && t < arc.end.min(end) {
                push(t);
                last = t;
            }
        }
        if arc.end < end {
            let before = moments(arc.end).into_iter().find(|&t| arc.at(t).x > 0.0);
            before.into_iter().filter(|&t| t > last).for_each(push);
        }
    }
    Ok(())
}
