//! The controllers' steps as box VIs: the maps are the equations, the Jacobians their derivatives,
//! and six signs are two and four.

use crate::common::control::{random_wall, signed, signs, stable, Instance, DRAWS};
use crate::common::Rng;
use zivi_core::control::inclusion::{
    AsProblem, Inclusion, PlantInclusion, RegulationInclusion, TrackingInclusion,
};
use zivi_core::control::regulation::RegulationStep;
use zivi_core::control::tracking::{Target, TrackingStep};
use zivi_core::control::{Approach, Gains, TwistingTracker};
use zivi_core::vi::Problem;
use zivi_core::{transform, Branch, Lifted, Physical, Restitution, ThetaGammaStep};

/// Everything that a step of six signs has; the smaller ones use a part.
#[derive(Clone, Copy, Debug)]
struct Whole {
    h: f64,
    restitution: Restitution,
    restitution_ref: Restitution,
    gains: Gains,
    z: Lifted,
    reference: Lifted,
    f: f64,
    f_ref: f64,
}

fn state(rng: &Rng) -> Lifted {
    Lifted { s: signed(rng, 1e-6, 1e3), v: signed(rng, 1e-6, 1e3) }
}

fn draw(rng: &Rng) -> Whole {
    let (gains, f) = stable(rng);
    Whole {
        h: rng.log_between(1e-5, 1.0),
        restitution: random_wall(rng),
        restitution_ref: random_wall(rng),
        gains,
        z: state(rng),
        reference: state(rng),
        f,
        f_ref: signed(rng, 1e-3, 1e3),
    }
}

fn inside<const N: usize>(rng: &Rng) -> [f64; N] {
    [(); N].map(|()| rng.between(-1.0, 1.0))
}

/// Rows with the magnitudes of their terms.
type Rows = Vec<(f64, f64)>;

impl Whole {
    fn tracking(&self) -> TrackingStep {
        TrackingStep { h: self.h, restitution: self.restitution, gains: self.gains }
    }

    fn regulation(&self) -> RegulationStep {
        RegulationStep { h: self.h, restitution: self.restitution, gains: self.gains }
    }

    /// `v+ = v + h acceleration`, `s+ = s + h R v+`, as rows.
    fn moved(&self, z: Lifted, r: f64, accelerations: &[f64]) -> [(f64, f64); 2] {
        let v = z.v + self.h * accelerations.iter().sum::<f64>();
        let terms = z.v.abs() + self.h * accelerations.iter().map(|it| it.abs()).sum::<f64>();
        [(z.s + self.h * r * v, z.s.abs() + self.h * r * terms), (v, terms)]
    }

    fn regulator_rows(&self, [ls, lv]: [f64; 2]) -> Rows {
        let r = 1.0 - self.restitution.kappa() * ls * lv;
        let pushes = [ls * self.f / r, -self.gains.mu1() * ls / r, -self.gains.mu2() * lv / r];
        self.moved(self.z, r, &pushes).into()
    }

    fn plant_rows(&self, a: f64, aim: Lifted, [ls, lv, les, lev]: [f64; 4]) -> Rows {
        let r = 1.0 - self.restitution.kappa() * ls * lv;
        let square = ls * ls;
        let pushes = [
            -square * self.gains.mu1() * les,
            -square * self.gains.mu2() * lev,
            square * a,
            ls * (1.0 - square) * self.f / r,
        ];
        let [s, v] = self.moved(self.z, r, &pushes);
        vec![s, v, (s.0 - aim.s, s.1 + aim.s.abs()), (v.0 - aim.v, v.1 + aim.v.abs())]
    }

    fn tracker_rows(&self, [ls, lv, lsr, lvr, les, lev]: [f64; 6]) -> Rows {
        let r = 1.0 - self.restitution_ref.kappa() * lsr * lvr;
        let a = lsr * self.f_ref / r;
        let [s_r, v_r] = self.moved(self.reference, r, &[a]);
        let plant = self.plant_rows(a, Lifted { s: s_r.0, v: v_r.0 }, [ls, lv, les, lev]);
        let error = |row: usize, of: f64| (plant[row + 2].0, plant[row].1 + of);
        vec![plant[0], plant[1], s_r, v_r, error(0, s_r.1), error(1, v_r.1)]
    }
}

/// The map against the rows (with the opposite sign), relative to their terms.
fn compare<const N: usize>(map: [f64; N], rows: &Rows, kappa: f64, context: &Whole) -> f64 {
    assert_eq!(rows.len(), N);
    let mut worst: f64 = 0.0;
    for (value, (row, terms)) in map.into_iter().zip(rows) {
        let error = (value + row).abs() / terms * (1.0 - kappa);
        assert!(error < 4.0 * f64::EPSILON, "{error:e}: {map:?}, {rows:?} of {context:?}");
        worst = worst.max(error);
    }
    worst
}

/// What the residual divides by, against the magnitudes of the terms.
fn compare_scales<const N: usize>(scales: [f64; N], rows: &Rows) {
    for (scale, (_, terms)) in scales.into_iter().zip(rows) {
        assert!((scale - terms).abs() <= 1e-14 * terms, "{scales:?}, {rows:?}");
    }
}

#[test]
fn the_scales_are_the_magnitudes_of_the_terms() {
    let rng = Rng::new(66);
    for _ in 0..2_000 {
        let it = draw(&rng);
        let (two, four, six) = (inside(&rng), inside(&rng), inside(&rng));
        let (z, reference, f, f_ref) = (it.z, it.reference, it.f, it.f_ref);
        let regulator = RegulationInclusion { step: &it.regulation(), z, f };
        compare_scales(regulator.scales(two), &it.regulator_rows(two));
        let (step, restitution_ref) = (&it.tracking(), it.restitution_ref);
        let target = Target { end: reference, acceleration: f_ref };
        let plant = PlantInclusion { step, z, f, target };
        compare_scales(plant.scales(four), &it.plant_rows(f_ref, reference, four));
        let whole = TrackingInclusion { step, restitution_ref, z, reference, f, f_ref };
        compare_scales(whole.scales(six), &it.tracker_rows(six));
    }
    let at_rest = RegulationStep { h: 0.1, ..draw(&rng).regulation() };
    let nothing = RegulationInclusion { step: &at_rest, z: Lifted::default(), f: 0.0 };
    assert_eq!(nothing.scales([0.0; 2]), [1.0; 2]);
}

#[test]
fn the_maps_are_the_equations_of_the_steps() {
    let rng = Rng::new(61);
    let mut worst: f64 = 0.0;
    for _ in 0..50_000 {
        let it = draw(&rng);
        let kappa = it.restitution.kappa().max(it.restitution_ref.kappa());
        let (two, four, six) = (inside(&rng), inside(&rng), inside(&rng));
        let regulator = RegulationInclusion { step: &it.regulation(), z: it.z, f: it.f };
        worst = worst.max(compare(regulator.map(two), &it.regulator_rows(two), kappa, &it));
        let target = Target { end: it.reference, acceleration: it.f_ref };
        let plant = PlantInclusion { step: &it.tracking(), z: it.z, f: it.f, target };
        let rows = it.plant_rows(it.f_ref, it.reference, four);
        worst = worst.max(compare(plant.map(four), &rows, kappa, &it));
        let (z, reference, f, f_ref) = (it.z, it.reference, it.f, it.f_ref);
        let restitution_ref = it.restitution_ref;
        let whole =
            TrackingInclusion { step: &it.tracking(), restitution_ref, z, reference, f, f_ref };
        worst = worst.max(compare(whole.map(six), &it.tracker_rows(six), kappa, &it));
    }
    println!("(1 - kappa) times the largest relative difference: {worst:.1e}");
}

/// Central differences with `d` and `2 d`, `d = R/1000` with the smallest `R`, combined to fourth
/// order: truncation about `(d/R)^4 = 1e-12` of the terms, rounding about `1e-13 / R` of them.
fn differenced<const N: usize>(
    jacobian: [[f64; N]; N],
    lambda: [f64; N],
    smallest_r: f64,
    rows_at: impl Fn([f64; N]) -> Rows,
) -> f64 {
    let terms = rows_at(lambda.map(|_| 1.0));
    let d = 1e-3 * smallest_r;
    let mut worst: f64 = 0.0;
    for column in 0..N {
        let quotient = |d: f64| {
            let (mut ahead, mut behind) = (lambda, lambda);
            ahead[column] += d;
            behind[column] -= d;
            let width = ahead[column] - behind[column];
            let (ahead, behind) = (rows_at(ahead), rows_at(behind));
            let slope = |row: usize| (behind[row].0 - ahead[row].0) / width;
            (0..N).map(slope).collect::<Vec<f64>>()
        };
        let (fine, coarse) = (quotient(d), quotient(2.0 * d));
        for row in 0..N {
            let expected = (4.0 * fine[row] - coarse[row]) / 3.0;
            let error = (jacobian[row][column] - expected).abs();
            let scale = expected.abs() + terms[row].1 / smallest_r;
            worst = worst.max(error / scale);
            assert!(error < 1e-9 * scale, "[{row}][{column}]: {error:e} of {scale:e}");
        }
    }
    worst
}

#[test]
fn the_jacobians_are_the_difference_quotients() {
    let rng = Rng::new(62);
    let mut worst: f64 = 0.0;
    for _ in 0..10_000 {
        let it = draw(&rng);
        let smallest = 1.0 - it.restitution.kappa().max(it.restitution_ref.kappa());
        let (z, reference, f, f_ref) = (it.z, it.reference, it.f, it.f_ref);
        let lambda = inside(&rng);
        let jacobian = RegulationInclusion { step: &it.regulation(), z, f }.jacobian(lambda);
        worst = worst.max(differenced(jacobian, lambda, smallest, |at| it.regulator_rows(at)));
        let target = Target { end: reference, acceleration: f_ref };
        let lambda = inside(&rng);
        let jacobian = PlantInclusion { step: &it.tracking(), z, f, target }.jacobian(lambda);
        let rows_at = |at| it.plant_rows(f_ref, reference, at);
        worst = worst.max(differenced(jacobian, lambda, smallest, rows_at));
        let (lambda, step, restitution_ref) = (inside(&rng), &it.tracking(), it.restitution_ref);
        let whole = TrackingInclusion { step, restitution_ref, z, reference, f, f_ref };
        let rows_at = |at| it.tracker_rows(at);
        worst = worst.max(differenced(whole.jacobian(lambda), lambda, smallest, rows_at));
    }
    println!("largest difference {worst:e}");
}

/// The six signs are the reference's two, whose rows contain no other sign, and the plant's four.
#[test]
fn six_signs_are_two_and_four() {
    let rng = Rng::new(63);
    for _ in 0..20_000 {
        let it = draw(&rng);
        let (z, reference, f, f_ref) = (it.z, it.reference, it.f, it.f_ref);
        let (step, restitution_ref) = (&it.tracking(), it.restitution_ref);
        let lambda: [f64; 6] = inside(&rng);
        let [ls, lv, lsr, lvr, les, lev] = lambda;
        let whole = TrackingInclusion { step, restitution_ref, z, reference, f, f_ref };
        let [s, v, s_r, v_r, e_s, e_v] = whole.map(lambda);
        let scheme = ThetaGammaStep::new(it.h, 1.0, 1.0, restitution_ref).expect("admissible");
        let expected = scheme.vi_map(reference, f_ref, [lsr, lvr]);
        let scales = whole.scales(lambda);
        let near = |a: f64, b: f64, scale: f64| (a - b).abs() < 1e-13 * scale / (1.0 - 0.99);
        assert!(near(s_r, expected[0], scales[2]) && near(v_r, expected[1], scales[3]));
        let a = lsr * f_ref / restitution_ref.r(lsr, lvr);
        let target = Target { end: Lifted { s: -s_r, v: -v_r }, acceleration: a };
        let plant = PlantInclusion { step, z, f, target }.map([ls, lv, les, lev]);
        for (found, expected) in [s, v, e_s, e_v].into_iter().zip(plant) {
            let scale = scales.iter().fold(0.0, |a: f64, b| a.max(*b));
            assert!((found - expected).abs() <= 1e-15 * scale, "{it:?}: {found} {expected}");
        }
        // blocks: the reference's rows do not depend on the plant's signs
        let jacobian = whole.jacobian(lambda);
        for row in [2, 3] {
            for column in [0, 1, 4, 5] {
                assert_eq!(jacobian[row][column], 0.0);
            }
        }
    }
}

#[test]
fn the_signs_of_a_tick_solve_all_six_rows() {
    let rng = Rng::new(64);
    let mut worst: f64 = 0.0;
    for round in 0..200_000 {
        let (gains, f) = stable(&rng);
        let (restitution, restitution_ref) = (random_wall(&rng), random_wall(&rng));
        let h = rng.log_between(1e-5, 1e-1);
        let approach = rng.pick(&[Approach::Positive, Approach::Nearest]);
        let mut tracker = TwistingTracker::new(gains, h, restitution, restitution_ref, approach)
            .expect("admissible");
        let unit = if round % 2 == 0 { 1.0 } else { h * gains.mu1() };
        let size = |rng: &Rng, low: f64| unit * rng.log_between(low, 10.0);
        let start = Physical { x: size(&rng, 1e-4) * unit.min(h), xdot: size(&rng, 1e-3) };
        tracker.reset(start).expect("in range");
        let x = if rng.chance(0.1) { 0.0 } else { size(&rng, 1e-4) * unit.min(h) };
        let measured = Physical { x, xdot: rng.sign() * size(&rng, 1e-3) };
        let before = tracker.state().reference;
        let f_ref = if rng.chance(0.2) { 1.0 } else { -1.0 } * rng.log_between(1e-2, 1e2);
        tracker.tick(measured, f, f_ref).expect("a usable sample");
        let lifted = transform::lift(measured, Branch::Positive, restitution);
        // of least mu1 |e_s| + e_v^2/2
        let far = |sigma: f64| {
            let (s, v) = (sigma * lifted.s - before.s, sigma * lifted.v - before.v);
            gains.mu1() * s.abs() + 0.5 * v * v
        };
        let mirror = approach == Approach::Nearest && far(-1.0) < far(1.0);
        let z = if mirror { Lifted { s: -lifted.s, v: -lifted.v } } else { lifted };
        let (step, lambda) = (tracker.step(), tracker.state().signs);
        let whole = TrackingInclusion { step, restitution_ref, z, reference: before, f, f_ref };
        let it = Whole { h, restitution, restitution_ref, gains, z, reference: before, f, f_ref };
        let own = whole.residual(lambda);
        let mut misfit: f64 = 0.0;
        for (sign, (row, terms)) in lambda.into_iter().zip(it.tracker_rows(lambda)) {
            let towards = if terms == 0.0 { 0.0 } else { -row / terms };
            misfit = misfit.max((sign - 1.0).max((sign + 1.0).min(towards)).abs());
        }
        let rounding = 1.0 - restitution.kappa().max(restitution_ref.kappa());
        worst = worst.max(misfit.max(own) * rounding);
        assert!(misfit.max(own) * rounding < 1e-15, "{own:e}, {misfit:e}: {lambda:?} of {it:?}");
    }
    println!("(1 - kappa) times the largest residual: {worst:.1e}");
}

/// The step under `(s, v, s_r, v_r, A) -> -(..)`: the end and the signs change sign, the control
/// does not.
#[test]
fn the_step_is_symmetric() {
    let rng = Rng::new(65);
    for kind in DRAWS {
        for _ in 0..50_000 {
            let it = Instance::draw(&rng, kind).with_zeros(&rng, 0.05);
            if it.z.s == 0.0 {
                continue; // both sides of the wall are then the side of s
            }
            let (found, mirrored) = (it.solve(), it.mirrored().solve());
            let signs_mirrored = signs(&found).map(|it| 0.0 - it);
            assert_eq!(signs(&mirrored), signs_mirrored, "{it:?}");
            assert_eq!((mirrored.end.s, mirrored.end.v), (-found.end.s, -found.end.v), "{it:?}");
            assert_eq!((mirrored.u, mirrored.place), (found.u, found.place), "{it:?}");
        }
    }
}

/// The general solver sees the same rows and slopes.
#[test]
fn as_a_problem_a_step_is_the_same() {
    let rng = Rng::new(5);
    for _ in 0..20 {
        let whole = draw(&rng);
        let step =
            RegulationStep { h: whole.h, restitution: whole.restitution, gains: whole.gains };
        let inclusion = RegulationInclusion { step: &step, z: whole.z, f: whole.f };
        let lambda: [f64; 2] = inside(&rng);
        let (mut f, mut jacobian) = ([f64::NAN; 2], [f64::NAN; 4]);
        let mut problem = AsProblem(inclusion);
        problem.map(&lambda, &mut f).expect("defined");
        problem.jacobian(&lambda, &mut jacobian).expect("defined");
        assert_eq!(f, inclusion.map(lambda));
        assert_eq!(jacobian, inclusion.jacobian(lambda).as_flattened());
    }
}
