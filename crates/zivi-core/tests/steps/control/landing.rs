//! The regulator's landing against the law, the paper's update and the bound that keeps it down.

use crate::common::control::{random_wall, stable};
use crate::common::Rng;
use zivi_core::control::{Gains, Landing, TwistingRegulator};
use zivi_core::{transform, Branch, Physical, Restitution};

/// A regulator, a force within its gains, and a measurement.
struct Draw {
    regulator: TwistingRegulator,
    ahead: u32,
    f: f64,
    at: Physical,
}

impl Draw {
    fn new(rng: &Rng) -> Self {
        let (gains, f) = stable(rng);
        let h = rng.log_between(1e-5, 1e-1);
        let ahead = rng.pick(&[1, 1, 2, 8, 1000]);
        let regulator = TwistingRegulator::new(gains, h, random_wall(rng)).expect("admissible");
        let landing = Landing::new(ahead, h).expect("admissible");
        let reach = h * f64::from(ahead) * gains.mu1();
        let at = Physical {
            x: rng.pick(&[0.0, rng.log_between(1e-12, 10.0)]),
            xdot: reach * rng.pick(&[0.0, rng.between(-3.0, 3.0), rng.between(0.0, 2.0)]),
        };
        Self { regulator: regulator.with_landing(Some(landing)), ahead, f, at }
    }

    fn gains(&self) -> (f64, f64) {
        let gains = self.regulator.step().gains;
        (gains.mu1(), gains.mu2())
    }

    /// `D` and `U`.
    fn decelerations(&self) -> (f64, f64) {
        let (mu1, mu2) = self.gains();
        (mu1 - mu2 - self.f, mu1 + mu2 - self.f)
    }

    fn tick(&self) -> (f64, [f64; 2]) {
        let mut it = self.regulator;
        let u = it.tick(self.at, self.f).expect("a good sample");
        (u, it.state().signs)
    }
}

/// `u = -F - clip(x'/(N h), D, U)`, and what the signs say of it.
#[test]
fn the_control_stops_the_mass_at_the_end_of_the_horizon() {
    let rng = Rng::new(91);
    let mut seen = [0; 3];
    for _ in 0..200_000 {
        let it = Draw::new(&rng);
        let (down, up) = it.decelerations();
        let h = it.regulator.step().h;
        let wanted = it.at.xdot / (f64::from(it.ahead) * h);
        let g = wanted.clamp(down, up);
        let (u, [lambda_s, lambda_v]) = it.tick();
        let (mu1, mu2) = it.gains();
        let size = mu1 + mu2 + it.f.abs() + g.abs();
        assert!((u + it.f + g).abs() <= 4.0 * f64::EPSILON * size, "{u} and {g}");
        assert_eq!((lambda_s, u), (1.0, -mu1 - mu2 * lambda_v));
        let case = if wanted <= down { 0 } else { 1 + usize::from(wanted >= up) };
        seen[case] += 1;
        // as it falls, and as it rises faster than the horizon can stop it: the law to the last bit
        match case {
            0 => assert_eq!(u, -mu1 + mu2),
            2 => assert_eq!(u, -mu1 - mu2),
            _ => assert!(lambda_v.abs() < 1.0 + f64::EPSILON),
        }
    }
    assert!(seen.iter().all(|count| *count > 10_000), "{seen:?}");
}

/// Whatever is measured, the mass is pressed down with `D` at least: no noise can lift it.
#[test]
fn no_measurement_lifts_the_mass() {
    let rng = Rng::new(92);
    for _ in 0..100_000 {
        let mut it = Draw::new(&rng);
        it.at = Physical {
            x: rng.pick(&[0.0, -0.05, rng.log_between(1e-300, 1e300)]),
            xdot: rng.sign() * rng.log_between(1e-300, 1e300),
        };
        let (mu1, mu2) = it.gains();
        let (u, _) = it.tick();
        assert!(u <= -(mu1 - mu2) && u >= -(mu1 + mu2), "{u} at {:?}", it.at);
    }
}

/// Away from the wall and from where it turns round the paper's update says the same.
#[test]
fn far_away_it_is_the_papers_tick_to_the_last_bit() {
    let rng = Rng::new(93);
    let mut compared = 0;
    for _ in 0..100_000 {
        let mut it = Draw::new(&rng);
        let (_, up) = it.decelerations();
        let h = it.regulator.step().h;
        let horizon = f64::from(it.ahead) * h;
        it.at.x = 1.0 + horizon * (it.at.xdot.abs() + horizon * up);
        if it.at.xdot > 0.0 && it.at.xdot <= up * horizon * (1.0 + 1e-12) {
            continue;
        }
        let mut paper = it.regulator.with_landing(None);
        let u = paper.tick(it.at, it.f).expect("a good sample");
        let (landing, signs) = it.tick();
        assert_eq!((landing.to_bits(), signs), (u.to_bits(), paper.state().signs));
        compared += 1;
    }
    assert!(compared > 50_000);
}

#[test]
fn without_a_landing_it_is_the_papers_step() {
    let rng = Rng::new(94);
    for _ in 0..100_000 {
        let it = Draw::new(&rng);
        let mut paper = it.regulator.with_landing(None);
        let z = transform::lift(it.at, Branch::Positive, paper.step().restitution);
        let found = paper.step().solve(z, it.f);
        assert_eq!(paper.tick(it.at, it.f), Ok(found.u));
        assert_eq!(paper.state().signs, [found.lambda_s, found.lambda_v]);
    }
}

#[test]
fn a_horizon_is_at_least_a_period() {
    assert_eq!(Landing::new(0, 1e-3).expect_err("out of range").name, "ahead");
    assert_eq!(Landing::new(u32::MAX, 1e300).expect_err("out of range").name, "h");
    assert_eq!(Landing::new(3, 1e-3).expect("in range").ahead(), 3);
    let gains = Gains::new(3.0, 2.0).expect("in range");
    let restitution = Restitution::from_kappa(0.5).expect("in range");
    let regulator = TwistingRegulator::new(gains, 1e-3, restitution).expect("admissible");
    assert_eq!(regulator.landing().map(|it| it.ahead()), Some(1), "by default");
}
