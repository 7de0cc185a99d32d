//! Random controllers in random loops, with noise, lifts and references of every kind: every update
//! answers, with a finite control within the bound of its law.

use crate::common::control::{random_wall, stable};
use crate::common::Rng;
use zivi_core::control::{
    Approach, Gains, Landing, Port, TwistingRegulator, TwistingTracker, Waypoint,
};
use zivi_core::{Branch, Physical, Restitution};

/// A mass that is thrown about: the measured state after one more period under `a`.
struct Mass {
    at: Physical,
    e: f64,
    h: f64,
    noise: f64,
}

impl Mass {
    fn new(rng: &Rng, restitution: Restitution, h: f64) -> Self {
        let at = Physical { x: rng.between(0.0, 2.0), xdot: rng.between(-3.0, 3.0) };
        Self { at, e: restitution.e(), h, noise: rng.pick(&[0.0, 1e-6, 1e-3, 0.05]) }
    }

    fn measured(&mut self, rng: &Rng, a: f64) -> Physical {
        let Physical { x, xdot } = self.at;
        let end = xdot + self.h * a;
        let next = x + self.h * end;
        self.at = if (0.0..=10.0).contains(&next) {
            Physical { x: next, xdot: end }
        } else {
            // the wall below, a lid above
            Physical { x: next.clamp(0.0, 10.0), xdot: (-self.e * end).clamp(-50.0, 50.0) }
        };
        let off = |size: f64| size * rng.between(-1.0, 1.0);
        let x = (self.at.x + off(self.noise)).max(-0.09);
        Physical { x, xdot: self.at.xdot + off(10.0 * self.noise) }
    }
}

fn random_tracker(
    rng: &Rng,
    gains: Gains,
    restitutions: [Restitution; 2],
    h: f64,
) -> TwistingTracker {
    let approach = rng.pick(&[Approach::Positive, Approach::Nearest]);
    let landing = Landing::new(rng.pick(&[1, 2, 5, 100]), h).expect("in range");
    let it = TwistingTracker::new(gains, h, restitutions[0], restitutions[1], approach)
        .expect("admissible");
    let mut it = it
        .with_landing(rng.chance(0.8).then_some(landing))
        .with_horizon(rng.pick(&[1.0, rng.between(1.0, 5.0), 50.0]))
        .expect("in range")
        .with_shift(rng.chance(0.5));
    if rng.chance(0.3) {
        it = it.with_press(rng.log_between(1e-3, 1e2), 0.0).expect("in range");
    }
    if rng.chance(0.2) {
        it = it.with_port(Port::default().with_actuator(-20.0, 30.0).expect("in range"));
    }
    let start = Physical { x: rng.between(0.0, 2.0), xdot: rng.between(-3.0, 3.0) };
    it.reset(rng.pick(&[start, Physical::default()])).expect("in range");
    it
}

/// The most a tracker can ask for: `(1 + kappa)(mu1 + mu2 + |F_r|/(1 - kappa_r)) + |F|`, and its
/// landing `|F|` and the largest of `U`, `D` and the press.
fn bound(it: &TwistingTracker, force: f64, force_ref: f64) -> f64 {
    let gains = it.step().gains;
    let (kappa, kappa_ref) =
        (it.step().restitution.kappa(), it.reference_step().restitution().kappa());
    let both = gains.mu1() + gains.mu2() + force_ref.abs() / (1.0 - kappa_ref);
    let landing = it.descent().map_or(0.0, |it| it.accelerations().into_iter().fold(0.0, f64::max));
    ((1.0 + kappa) * both).max(landing) + force.abs()
}

/// A reference near the last one, over the wall or through an impact, or at rest.
fn waypoint(rng: &Rng, last: Waypoint, h: f64) -> Waypoint {
    let Physical { x, xdot } = last.state;
    let next = x + h * xdot;
    let flipped = if last.branch == Branch::Positive { Branch::Negative } else { Branch::Positive };
    let rest = Waypoint { state: Physical::default(), ..last };
    if next < 0.0 {
        let after = Physical { x: 0.0, xdot: xdot.abs() * rng.unit() };
        return rng.pick(&[Waypoint { state: after, branch: flipped }, rest]);
    }
    if next == 0.0 && rng.chance(0.95) {
        return rest;
    }
    let pushed = xdot + h * rng.between(-20.0, if next > 5.0 { 0.0 } else { 15.0 });
    Waypoint { state: Physical { x: next, xdot: pushed }, ..last }
}

/// How many updates were at rest of the reference, and how many it moved.
fn track(loops: u32, seed: u64) -> [u32; 2] {
    let rng = Rng::new(seed);
    let mut seen = [0; 2];
    for _ in 0..loops {
        let (gains, f) = stable(&rng);
        let restitutions = [random_wall(&rng), random_wall(&rng)];
        let h = rng.log_between(1e-5, 1e-1);
        let mut it = random_tracker(&rng, gains, restitutions, h);
        let mut mass = Mass::new(&rng, restitutions[0], h);
        let (given, weight) = (rng.chance(0.3), -rng.log_between(0.1, 30.0));
        let mut now = Waypoint { state: it.reference(), branch: Branch::Positive };
        let (mut u, mut lifts) = (0.0, false);
        for _ in 0..1000 {
            let measured = mass.measured(&rng, u + f + rng.between(-1.0, 1.0));
            let force = f + rng.pick(&[0.0, rng.between(-3.0, 3.0)]);
            lifts ^= rng.chance(if lifts { 0.1 } else { 0.01 });
            let mut force_ref = if lifts && it.reference().x < 5.0 { 5.0 } else { weight };
            u = if given {
                let next = waypoint(&rng, now, h);
                let known = rng.chance(0.5).then_some(force_ref);
                let quotient = (next.state.xdot - now.state.xdot) / h;
                let largest = quotient.abs().max(force.abs());
                force_ref = known.unwrap_or(largest);
                let u = it.tick_to(measured, force, now, next, known);
                now = next;
                u
            } else {
                it.tick(measured, force, force_ref)
            }
            .expect("a good sample");
            let (most, state, at) = (bound(&it, force, force_ref), it.state(), it.reference());
            assert!(u.abs() <= most * (1.0 + 1e-12), "{u} beyond {most}: {it:?} at {measured:?}");
            assert!(state.signs.iter().all(|sign| sign.abs() <= 1.0 + 1e-12), "{state:?}");
            assert!(at.x >= 0.0 && at.x.is_finite() && at.xdot.is_finite(), "{at:?}");
            seen[usize::from(at == Physical::default())] += 1;
        }
    }
    seen
}

fn regulate(loops: u32, seed: u64) {
    let rng = Rng::new(seed);
    for _ in 0..loops {
        let (gains, f) = stable(&rng);
        let (restitution, h) = (random_wall(&rng), rng.log_between(1e-5, 1e-1));
        let landing = Landing::new(rng.pick(&[1, 2, 5, 100]), h).expect("in range");
        let regulator = TwistingRegulator::new(gains, h, restitution).expect("admissible");
        let mut it = regulator.with_landing(rng.chance(0.7).then_some(landing));
        let mut mass = Mass::new(&rng, restitution, h);
        let (most, mut u) = (gains.mu1() + gains.mu2(), 0.0);
        for _ in 0..1000 {
            let measured = mass.measured(&rng, u + f + rng.between(-1.0, 1.0));
            u = it.tick(measured, f + rng.between(-3.0, 3.0)).expect("a good sample");
            assert!(u.abs() <= most * (1.0 + 1e-12), "{u} beyond {most}: {it:?} at {measured:?}");
            assert!(it.state().signs.iter().all(|sign| sign.abs() <= 1.0 + 1e-12));
        }
    }
}

fn stress(loops: u32, seed: u64) {
    let [moving, resting] = track(loops, seed);
    println!("{moving} ticks with a moving reference, {resting} with one at rest");
    assert!(moving > loops * 100 && resting > loops * 50, "{moving} {resting}");
    regulate(loops, seed + 1);
}

#[test]
fn random_loops_leave_the_controllers_sound() {
    stress(60, 31);
}

/// A million of each: `cargo test --release -p zivi-core --test controller_stress -- --ignored`.
#[test]
#[ignore = "some seconds"]
fn a_million_random_ticks_leave_the_controllers_sound() {
    stress(1000, 33);
}
