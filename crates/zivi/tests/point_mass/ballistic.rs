//! Exact motion under a constant force, against its closed forms bounce by bounce.

use zivi::stepping::ballistic::advance;
use zivi::{Events, Physical, Restitution};

fn restitution(e: f64) -> Restitution {
    Restitution::from_e(e).expect("in range")
}

fn close(found: f64, expected: f64, tolerance: f64) {
    assert!((found - expected).abs() <= tolerance, "{found:e} but {expected:e}");
}

const REST: Physical = Physical { x: 0.0, xdot: 0.0 };
const G: f64 = 9.81;

/// Dropped from 1 m: impacts at `t_n = t_0 (1 + 2 (e + .. + e^n))`, speeds `e^n sqrt(2 g)`, rest
/// after the sum of the series; between two impacts a parabola.
#[test]
fn a_drop_bounces_rests_and_stays() {
    for e in [0.0, 0.3, 0.5, 0.9] {
        let (speed, first) = ((2.0 * G).sqrt(), (2.0 / G).sqrt());
        let zeno = first * (1.0 + 2.0 * e / (1.0 - e));
        let start = Physical { x: 1.0, xdot: 0.0 };
        let mut events = Events::default();
        assert_eq!(advance(start, -G, restitution(e), (5.0, 2.0 * zeno), &mut events), REST);
        close(events.zeno_times[0] - 5.0, zeno, 1e-13 * zeno);
        assert_eq!((events.zeno_times.len(), events.rest_time), (1, Some(events.zeno_times[0])));
        let (mut t, mut ratio) = (first, 1.0);
        for impact in events.impacts.iter().take(20) {
            close(impact.t - 5.0, t, 1e-13 * zeno);
            close(impact.xdot_before, -ratio * speed, 1e-13 * speed);
            assert_eq!(impact.xdot_after, -restitution(e).e() * impact.xdot_before);
            ratio *= e;
            t += 2.0 * first * ratio;
        }
        // half way through the second flight it is at its top
        if e > 0.0 {
            let mut events = Events::default();
            let top = advance(start, -G, restitution(e), (0.0, first * (1.0 + e)), &mut events);
            close(top.x, e * e, 1e-14);
            close(top.xdot, 0.0, 1e-14);
            assert_eq!((events.impacts.len(), events.rest_time), (1, None));
        }
    }
}

/// In pieces as in one go, wherever they end.
#[test]
fn pieces_add_up() {
    let (start, e) = (Physical { x: 0.7, xdot: 1.3 }, 0.6);
    let mut whole = Events::default();
    let end = advance(start, -G, restitution(e), (0.0, 1.1), &mut whole);
    for n in [2, 7, 100] {
        let (mut state, mut events) = (start, Events::default());
        let h = 1.1 / f64::from(n);
        for k in 0..n {
            state = advance(state, -G, restitution(e), (f64::from(k) * h, h), &mut events);
        }
        close(state.x, end.x, 1e-12);
        close(state.xdot, end.xdot, 1e-11);
        assert_eq!(events.impacts.len(), whole.impacts.len());
        for (piece, one) in events.impacts.iter().zip(&whole.impacts) {
            close(piece.t, one.t, 1e-13);
        }
    }
}

#[test]
fn rest_ends_with_an_outward_force_only() {
    let mut events = Events { rest_time: Some(1.0), ..Events::default() };
    for inward in [-3.0, 0.0] {
        assert_eq!(advance(REST, inward, restitution(0.5), (2.0, 1.0), &mut events), REST);
        assert_eq!((events.rest_time, events.liftoff_times.len()), (Some(1.0), 0));
    }
    let up = advance(REST, 3.0, restitution(0.5), (3.0, 2.0), &mut events);
    assert_eq!(up, Physical { x: 6.0, xdot: 6.0 });
    assert_eq!((events.rest_time, events.liftoff_times.as_slice()), (None, &[3.0][..]));
}

/// Flights without a contact: away from the wall, and outward forces that turn the mass round.
#[test]
fn a_flight_need_not_meet_the_wall() {
    for (x, xdot, f) in [(1.0, 2.0, 0.0), (1.0, -2.0, 2.5), (0.0, 1.0, 0.0), (2.0, 1.0, 3.0)] {
        let mut events = Events::default();
        let end = advance(Physical { x, xdot }, f, restitution(0.5), (0.0, 3.0), &mut events);
        close(end.x, x + 3.0 * xdot + 4.5 * f, 1e-14 * 30.0);
        close(end.xdot, xdot + 3.0 * f, 1e-14 * 30.0);
        assert!(events.impacts.is_empty() && events.rest_time.is_none());
    }
    // against the same turning force, but too fast
    let mut events = Events::default();
    let start = Physical { x: 1.0, xdot: -2.0 };
    advance(start, 1.5, restitution(0.5), (0.0, 3.0), &mut events);
    close(events.impacts[0].t, (2.0 - 1.0) / 1.5, 1e-15);
    close(events.impacts[0].xdot_before, -1.0, 1e-15);
}

/// No force: a bounce, and on for ever; a plastic wall keeps it.
#[test]
fn without_a_force_one_bounce_is_all() {
    let (mut events, start) = (Events::default(), Physical { x: 1.0, xdot: -2.0 });
    let end = advance(start, 0.0, restitution(0.5), (0.0, 3.0), &mut events);
    assert_eq!((end, events.impacts.len()), (Physical { x: 2.5, xdot: 1.0 }, 1));
    let mut events = Events::default();
    assert_eq!(advance(start, 0.0, restitution(0.0), (0.0, 3.0), &mut events), REST);
    assert_eq!(events.rest_time, Some(0.5));
}

/// At the wall on its way into it: the impact comes first.
#[test]
fn an_incoming_start_at_the_wall_bounces_at_once() {
    let (mut events, start) = (Events::default(), Physical { x: 0.0, xdot: -4.0 });
    let end = advance(start, -2.0, restitution(0.5), (1.0, 0.5), &mut events);
    assert_eq!(end, Physical { x: 0.75, xdot: 1.0 });
    assert_eq!((events.impacts[0].t, events.impacts[0].xdot_after), (1.0, 2.0));
}

/// More bounces than are followed one by one: where the closed form of the series ends.
#[test]
fn thousands_of_bounces_are_skipped_exactly() {
    let (e, u): (f64, f64) = (0.9999, 2.0);
    let start = Physical { x: 0.0, xdot: u };
    let flight = 2.0 * u / G;
    for n in [1500.0_f64, 5000.5] {
        let whole = n.floor();
        // the first `whole` flights, and half of the next one for n = .5
        let speed = u * e.powf(whole);
        let t = flight * (1.0 - e.powf(whole)) / (1.0 - e) + (n - whole) * 2.0 * speed / G;
        let (mut events, part) = (Events::default(), n - whole);
        let end = advance(start, -G, restitution(e), (0.0, t + 1e-3 * (0.5 - part)), &mut events);
        let late = (2.0 * speed / G) * part + 1e-3 * (0.5 - part);
        close(end.x, late * (speed - 0.5 * G * late), 1e-9);
        close(end.xdot, speed - G * late, 1e-8);
        assert_eq!(events.impacts.len(), 1000);
    }
    // the elastic wall: periods
    let mut events = Events::default();
    let end = advance(start, -G, restitution(1.0), (0.0, 4321.25 * flight), &mut events);
    close(end.xdot, u - G * 0.25 * flight, 1e-8);
    assert_eq!(events.rest_time, None);
}

/// The flight of the core, which a predictor takes, is this motion.
#[test]
fn the_flight_of_a_prediction_is_this_motion() {
    let (mut seed, mut rests) = (1_u64, 0);
    let mut uniform = || {
        seed = seed.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (seed >> 11) as f64 / (1_u64 << 53) as f64
    };
    for _ in 0..20_000 {
        let e = 0.7 * uniform();
        let near = if uniform() < 0.5 { 1.0 } else { 1e-3 };
        let start = Physical { x: near * uniform(), xdot: 4.0 * near.sqrt() * (uniform() - 0.5) };
        let start = if uniform() < 0.3 { Physical { x: 0.0, ..start } } else { start };
        let (f, h) = (30.0 * (uniform() - 0.8), 0.3 * uniform());
        let expected = advance(start, f, restitution(e), (0.0, h), &mut Events::default());
        let found = zivi_core::flight::after(start, f, restitution(e).e(), h);
        close(found.x, expected.x, 1e-11);
        close(found.xdot, expected.xdot, 1e-8);
        if expected == REST {
            assert_eq!(found, REST);
            rests += 1;
        }
    }
    assert!(rests > 1000);
}
