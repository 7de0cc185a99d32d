//! Exact motion under a constant force: parabolas between impacts, through the Zeno point.
//!
//! ```text
//! x = x0 + x0' t + f t^2/2        x'+ = -e x'-
//! ```
//!
//! After an impact with speed `u` under `f = -g < 0` the flights last `2u/g, 2 e u/g, ...`: the
//! mass rests after `2u/(g (1 - e))`.

use zivi_core::{flight, Physical, Restitution};

use crate::{Events, Impact, Occurrence};

/// Impacts that one call follows one by one (and lists); further ones are skipped in closed form.
const MAX_LISTED: usize = 1000;
/// A flight shorter than this part of the time scale is the end of the accumulation.
const SHORTEST: f64 = 1e-13;

/// A mass in motion from `t` on.
struct BallisticFlight<'a> {
    restitution: Restitution,
    f: f64,
    t: f64,
    state: Physical,
    left: f64,
    events: &'a mut Events,
}

/// The state `duration` after `t`, exact up to rounding; what happens at the wall is noted in
/// `events` (a mass at rest at `t` must have its `rest_time` set).
pub fn advance(
    state: Physical,
    f: f64,
    restitution: Restitution,
    (t, duration): (f64, f64),
    events: &mut Events,
) -> Physical {
    let mut flight = BallisticFlight { restitution, f, t, state, left: duration, events };
    if state.arrives() {
        flight.bounce(state.xdot);
        if flight.comes_to_rest() {
            return flight.state;
        }
    }
    for _ in 0..MAX_LISTED {
        if flight.rests() {
            return flight.state;
        }
        match flight::time_to_wall(flight.state, flight.f) {
            Some(dt) if dt <= flight.left => flight.fall(dt),
            _ => return flight.free(),
        }
        if flight.comes_to_rest() {
            return flight.state;
        }
    }
    flight.skip_bounces();
    flight.free()
}

impl BallisticFlight<'_> {
    /// Whether the mass is on the wall and stays there; otherwise a mass at rest lifts off.
    fn rests(&mut self) -> bool {
        if self.state != Physical::default() {
            return false;
        }
        if self.f <= 0.0 {
            self.events.note(Occurrence::Contact { t: self.t, gap: 0 });
            return true;
        }
        self.events.note(Occurrence::lift_off_of_mass(self.t));
        false
    }

    /// Falls onto the wall, which takes `dt`, and bounces.
    fn fall(&mut self, dt: f64) {
        let speed = flight::speed_at_wall(self.state, self.f);
        self.t += dt;
        self.left -= dt;
        self.bounce(-speed);
    }

    fn bounce(&mut self, xdot_before: f64) {
        let xdot_after = 0.0 - self.restitution.e() * xdot_before;
        let (impact, number) =
            (Impact { t: self.t, xdot_before, xdot_after }, self.events.impacts.len() as u64 + 1);
        self.events.note(Occurrence::of_mass(impact, number));
        self.state = Physical { x: 0.0, xdot: xdot_after };
    }

    /// Whether the mass comes to rest within the remaining time without further listed events; if
    /// so, it is put at rest.
    fn comes_to_rest(&mut self) -> bool {
        let (g, u, e) = (-self.f, self.state.xdot, self.restitution.e());
        if g < 0.0 || (g == 0.0 && u > 0.0) || e == 1.0 && u > 0.0 {
            return false;
        }
        let until_rest = if u > 0.0 { 2.0 * u / (g * (1.0 - e)) } else { 0.0 };
        let listed = until_rest * (1.0 - e) <= SHORTEST * (self.left + until_rest);
        if until_rest > self.left || !listed {
            return false;
        }
        self.t += until_rest;
        self.left -= until_rest;
        self.state = Physical::default();
        self.events.note(Occurrence::rest_of_mass(self.t));
        true
    }

    /// From an impact, past the bounces that end within the time left (or to rest).
    fn skip_bounces(&mut self) {
        let (g, u, e) = (-self.f, self.state.xdot, self.restitution.e());
        if self.state.x > 0.0 || u <= 0.0 || g <= 0.0 {
            return;
        }
        let flight = 2.0 * u / g;
        if e == 1.0 {
            self.left %= flight;
            return;
        }
        let until_rest = flight / (1.0 - e);
        if until_rest <= self.left {
            self.t += until_rest;
            self.left = 0.0;
            self.state = Physical::default();
            self.events.note(Occurrence::rest_of_mass(self.t));
            return;
        }
        // flights 0 .. n-1 last until_rest (1 - e^n), written so that nothing cancels near e = 1
        let n = ((-self.left / until_rest).ln_1p() / e.ln()).floor();
        let (shrunk, lost) = (e.powf(n), -(n * e.ln()).exp_m1());
        self.left = (self.left - until_rest * lost).clamp(0.0, flight * shrunk);
        self.state.xdot = u * shrunk;
    }

    /// Free flight for the time left.
    fn free(self) -> Physical {
        let (Physical { x, xdot }, dt) = (self.state, self.left);
        let end = x + dt * (xdot + 0.5 * self.f * dt);
        Physical { x: end.max(0.0), xdot: xdot + self.f * dt }
    }
}
