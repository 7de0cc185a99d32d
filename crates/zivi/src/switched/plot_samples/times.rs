//! When a step is sampled.

use super::{LANES, MOST};

/// Samples that are nearer to one another than so many units in the last place of the time are one.
const SAME: f64 = 4.0;

/// Notes the times that divide a span into so many parts, and says how many there are.
#[inline(always)]
pub(super) fn divide((start, end): (f64, f64), parts: f64, times: &mut [f64; MOST]) -> usize {
    let length = end - start;
    // false for NaN, too
    let told_apart = length > SAME * parts * ulp(end);
    let (count, part) = if told_apart { (parts as i32 - 1, length / parts) } else { (0, 0.0) };
    let count = count.max(0) as usize;
    for (k, times) in times.chunks_exact_mut(LANES).enumerate().take(count.div_ceil(LANES)) {
        for (l, t) in times.iter_mut().enumerate() {
            *t = start + (LANES * k + l + 1) as f64 * part;
        }
    }
    count
}

/// Notes a time within a span unless there is one already, and says how many there are.
#[inline(always)]
pub(super) fn insert(
    t: f64,
    (start, end): (f64, f64),
    (times, count): (&mut [f64; MOST], usize),
) -> usize {
    let mut at = count;
    while at > 0 && times[at - 1] >= t {
        at -= 1;
    }
    let before = if at > 0 { times[at - 1] } else { start };
    let after = if at < count { times[at] } else { end };
    let least = SAME * ulp(t);
    if !(t - before > least && after - t > least) {
        return count;
    }
    times.copy_within(at..count, at + 1);
    times[at] = t;
    count + 1
}

/// The unit in the last place.
fn ulp(t: f64) -> f64 {
    t.abs().next_up() - t.abs()
}
