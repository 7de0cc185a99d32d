//! The tracker's exact step: no failure in ten million random instances, every residual
//! recomputed from the equations as the tests write them.

use crate::common::control::{signed, signs, Draw, Instance, DRAWS};
use crate::common::Rng;
use zivi_core::control::cubic::MAX_ITERATIONS;
use zivi_core::control::tracking::{Place, Tracking};
use zivi_core::control::Gains;
use zivi_core::Restitution;

/// What was met in the instances of one draw.
#[derive(Default)]
struct Met {
    residual: f64,
    update: f64,
    control: f64,
    places: [u32; 3],
    iterations: u32,
}

fn worst(a: f64, b: f64) -> f64 {
    if b > a || b.is_nan() {
        b
    } else {
        a
    }
}

fn relative(defect: f64, terms: f64) -> f64 {
    if terms == 0.0 {
        defect.abs()
    } else {
        defect.abs() / terms
    }
}

/// The returned end and control against the equations for the returned signs.
fn misfits(it: &Instance, found: &Tracking) -> (f64, f64) {
    let [ls, lv, les, lev] = signs(found);
    let ([s, v], [of_s, of_v]) = it.end([ls, lv, les, lev]);
    let update = worst(relative(found.end.s - s, of_s), relative(found.end.v - v, of_v));
    let gains = it.step.gains;
    let r = 1.0 - it.step.restitution.kappa() * ls * lv;
    let terms = [
        r * ls * it.target.acceleration,
        -r * ls * gains.mu1() * les,
        -r * ls * gains.mu2() * lev,
        -ls * ls * it.f,
    ];
    let (u, of_u) = (terms.iter().sum::<f64>(), terms.iter().map(|it| it.abs()).sum());
    (update, relative(found.u - u, of_u))
}

impl Met {
    /// Takes an instance in; `share` is the part of its terms' rounding that the terms themselves
    /// account for.
    fn take(&mut self, it: &Instance, share: impl Fn(&Tracking) -> f64) {
        let found = it.solve();
        let amplified = (1.0 - it.step.restitution.kappa()) * share(&found);
        let (update, control) = misfits(it, &found);
        self.residual = worst(self.residual, it.residual(signs(&found)) * amplified);
        self.update = worst(self.update, update * amplified);
        self.control = worst(self.control, control * amplified);
        self.places[match found.place {
            Place::Same => 0,
            Place::Other => 1,
            Place::Wall => 2,
        }] += 1;
        self.iterations = self.iterations.max(found.iterations);
    }
}

fn walk(count: u32, zeros: f64) -> Vec<(Draw, Met)> {
    let rng = Rng::new(41);
    let met = |kind| {
        let mut met = Met::default();
        for _ in 0..count {
            met.take(&Instance::draw(&rng, kind).with_zeros(&rng, zeros), |_| 1.0);
        }
        println!(
            "{kind:?}: (1 - kappa) residual {:.1e}, update {:.1e}, control {:.1e}; \
             same, other, wall {:?}; at most {} iterations",
            met.residual, met.update, met.control, met.places, met.iterations
        );
        (kind, met)
    };
    DRAWS.into_iter().map(met).collect()
}

#[test]
fn ten_million_random_steps_are_solved() {
    for (kind, met) in walk(3_000_000, 0.0) {
        check(kind, &met);
    }
    for (kind, met) in walk(400_000, 0.2) {
        check(kind, &met);
    }
}

/// Every row is a few rounded operations on terms of order one, and `R`, at least `1 - kappa`,
/// inherits the absolute accuracy of its terms: a few `eps/(1 - kappa)` are rounding.
fn check(kind: Draw, met: &Met) {
    let (few, some) = (4.0 * f64::EPSILON, 8.0 * f64::EPSILON);
    assert!(met.residual < few, "{kind:?}: residual {:e}", met.residual);
    assert!(met.update < some, "{kind:?}: update {:e}", met.update);
    assert!(met.control < some, "{kind:?}: control {:e}", met.control);
    assert!(met.places.iter().all(|&count| count > 1000), "{kind:?}: {:?}", met.places);
    // at most two roots: the most iterations that were seen, 21, are far from the cap
    let (most, cap) = (met.iterations, 2 * MAX_ITERATIONS);
    assert!(4 * most <= cap, "{kind:?}: {most} iterations");
}

/// The bracket of the cubic's root does not depend on the force: any force is stepped, and any
/// gains, those for which nothing is stable included. `ls` is a number of order one, known to one
/// rounding: near `ls = 1` a large force makes `h F` times that of it in `ls (1 - ls^2) h F`,
/// however small the term is.
#[test]
fn any_force_and_any_gains_are_stepped() {
    let rng = Rng::new(42);
    for kind in DRAWS {
        let mut met = Met::default();
        for _ in 0..300_000 {
            let mut it = Instance::draw(&rng, kind).with_zeros(&rng, 0.02);
            let mu1 = rng.log_between(1e-3, 1e3);
            it.step.gains = Gains::new(mu1, mu1 * rng.unit().max(1e-6)).expect("in range");
            it.f = signed(&rng, 1e-3, 1e5);
            met.take(&it, |found| {
                let (_, [_, of_v]) = it.end(signs(found));
                of_v / (of_v + it.step.h * it.f.abs())
            });
        }
        println!("{kind:?}: residual {:.1e}, {} iterations", met.residual, met.iterations);
        check(kind, &met);
    }
}

/// An elastic wall, and walls whose `R` is next to zero on one side.
#[test]
fn extreme_walls_are_stepped() {
    let rng = Rng::new(44);
    for kappa in [0.0, 1e-300, 1e-12, 0.9999, 1.0 - 1e-9, 1.0 - f64::EPSILON / 2.0] {
        for kind in DRAWS {
            let mut met = Met::default();
            for _ in 0..50_000 {
                let mut it = Instance::draw(&rng, kind).with_zeros(&rng, 0.02);
                it.step.restitution = Restitution::from_kappa(kappa).expect("in range");
                met.take(&it, |_| 1.0);
            }
            println!("{kappa} {kind:?}: {:e}, {} iterations", met.residual, met.iterations);
            assert!(met.residual < 4.0 * f64::EPSILON, "{kappa} {kind:?}: {:e}", met.residual);
            assert!(met.update < 8.0 * f64::EPSILON, "{kappa} {kind:?}: {:e}", met.update);
        }
    }
}

/// The numbers of a residual that is wrong are wrong: another sign, another end.
#[test]
fn the_residual_sees_a_wrong_sign() {
    let rng = Rng::new(43);
    for kind in DRAWS {
        for _ in 0..10_000 {
            let it = Instance::draw(&rng, kind);
            let found = it.solve();
            if found.place == Place::Wall {
                continue;
            }
            let mut wrong = signs(&found);
            wrong[0] *= -1.0;
            let away = found.end.s.abs() / it.end(wrong).1[0];
            assert!(it.residual(wrong) >= away.min(1.0) * 1e-3, "{it:?}: {found:?}");
        }
    }
}
