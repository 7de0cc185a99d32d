//! Laws of impact with friction against one another, exact values and the inequalities.

use zivi::mechanics::{FlagKind, Occurrence};
use zivi::system::force::FrictionalImpact;
use zivi::{Order, Status};

use crate::closed_forms::simulate;
use crate::models::{rod, rough, slip, Parts, Random, Rough, Row};

const FINE: (Order, f64) = (Order::Eight, 1e-9);

/// Two coordinates that are the gap and the slip of one contact with the mobilities `D`, without forces.
fn contact([nn, nt, tt]: [f64; 3], mu: f64, e: f64, e_t: f64) -> Rough {
    let det = nn * tt - nt * nt;
    rough(2, &[Some(0)], &[e], e_t, move |_, q, _| Parts {
        mass: vec![tt / det, -nt / det, -nt / det, nn / det],
        force: vec![0.0, 0.0],
        gaps: vec![Row { value: q[0], row: vec![1.0, 0.0], curvature: 0.0, rate: 0.0 }],
        channels: vec![slip(&[0.0, 1.0], 0.0, 0.0)],
        limits: vec![(mu, mu)],
    })
}

/// The speeds after an impact, its impulses, and whether the energy grew.
struct After {
    speeds: [f64; 2],
    impulses: [f64; 2],
    grew: bool,
}

fn impact(mut system: Rough, law: FrictionalImpact, before: [f64; 2]) -> After {
    system.friction.law = law;
    let run = simulate(system, (&[0.0, 0.0], &before), 1e-3, FINE);
    assert_eq!(run.status, Status::Completed, "{:?}", run.occurrences);
    let (mut speeds, mut impulses) = ([f64::NAN; 2], [f64::NAN; 2]);
    for it in &run.occurrences {
        match *it {
            Occurrence::Impact { group: 1, after, impulse, .. } => {
                (speeds[0], impulses[0]) = (after, impulse);
            }
            Occurrence::Tangential { group: 1, after, impulse, .. } => {
                (speeds[1], impulses[1]) = (after, impulse);
            }
            _ => (),
        }
    }
    let grew = |it: &Occurrence| matches!(it, Occurrence::Flag { kind: FlagKind::EnergyGain, .. });
    After { speeds, impulses, grew: run.occurrences.iter().any(grew) }
}

/// Kinetic energy of a contact with the mobilities `D`.
fn energy([nn, nt, tt]: [f64; 3], [g, w]: [f64; 2]) -> f64 {
    0.5 * (tt * g * g - 2.0 * nt * g * w + nn * w * w) / (nn * tt - nt * nt)
}

#[test]
fn newton_s_law_may_raise_the_energy_as_kane_s_pendulum_does() {
    let d = [2.5, -1.5, 2.5];
    let after = impact(contact(d, 0.7, 1.0, 0.0), FrictionalImpact::Newton, [-1.0, 0.6]);
    assert_eq!(after.speeds, [1.0, 0.0]);
    assert!((after.impulses[0] - 41.0 / 40.0).abs() < 1e-15);
    assert!((after.impulses[1] - 3.0 / 8.0).abs() < 1e-15);
    assert!(after.grew);
    let change = energy(d, after.speeds) - energy(d, [-1.0, 0.6]);
    assert!((change - 9.0 / 80.0).abs() < 1e-15);
    // the common coefficient keeps it
    let after = impact(contact(d, 0.7, 1.0, 1.0), FrictionalImpact::Newton, [-1.0, 0.6]);
    assert!(!after.grew && energy(d, after.speeds) <= energy(d, [-1.0, 0.6]) + 1e-15);
}

#[test]
fn impacts_obey_their_laws() {
    let mut random = Random(11);
    let (mut gains, mut flags) = (0, 0);
    for _ in 0..1500 {
        let (nn, tt) = (0.3 + 2.0 * random.next(), 0.3 + 2.0 * random.next());
        let cosine = 1.9 * (random.next() - 0.5);
        let d = [nn, cosine * (nn * tt).sqrt(), tt];
        let (mu, e) = (1.4 * random.next(), random.next());
        let before = [-0.1 - random.next(), 4.0 * (random.next() - 0.5)];
        for law in [FrictionalImpact::Newton, FrictionalImpact::Poisson, FrictionalImpact::Stronge]
        {
            let system = contact(d, mu, e, 0.0);
            let After { speeds: [g, w], impulses: [p, pull], grew } = impact(system, law, before);
            let [of_g, of_w] = [d[0] * p + d[1] * pull, d[1] * p + d[2] * pull];
            assert!((before[0] + of_g - g).abs() < 1e-12 && (before[1] + of_w - w).abs() < 1e-12);
            assert!(p >= 0.0 && pull.abs() <= mu * p * (1.0 + 1e-12) && g >= -1e-13);
            let (first, last) = (energy(d, before), energy(d, [g, w]));
            let gain = last > first * (1.0 + 1e-12);
            assert_eq!(grew, gain, "{law:?} {d:?} {mu} {e} {before:?}: {first} {last}");
            if law != FrictionalImpact::Newton {
                assert!(!gain, "{law:?} {d:?} {mu} {e} {before:?}: {first} {last}");
                continue;
            }
            assert!((g + e * before[0]).abs() < 1e-14);
            let slides = pull.abs() < mu * p * (1.0 - 1e-9);
            assert!(!slides || w == 0.0);
            assert!(w.abs() < 1e-12 || pull * w <= 0.0);
            gains += usize::from(gain);
            flags += usize::from(grew);
            if e * e <= 1.0 - cosine * cosine {
                assert!(!gain || nn - mu * d[1].abs() <= 0.0, "{d:?} {mu} {e} {before:?}");
            }
        }
    }
    assert!(gains > 10 && gains == flags, "{gains}");
}

#[test]
fn without_coupling_all_laws_are_one_but_for_the_slip() {
    // sticking impulse in compression, or slip throughout
    for (mu, w) in [(0.2, 3.0), (0.2, -3.0), (0.0, 1.0)] {
        let speeds =
            [FrictionalImpact::Newton, FrictionalImpact::Poisson, FrictionalImpact::Stronge]
                .map(|law| impact(contact([1.0, 0.0, 3.0], mu, 0.5, 0.0), law, [-1.0, w]).speeds);
        for it in &speeds[1..] {
            assert!((it[0] - speeds[0][0]).abs() < 1e-14 && (it[1] - speeds[0][1]).abs() < 1e-14);
        }
    }
}

#[test]
fn a_jammed_rod_goes_on_by_an_impact_without_a_collision() {
    let start = ([0.0, 1.0_f64.sin(), 1.0], [-2.0, 0.0, 0.0]);
    let mut system = rod(1.6, 0.0, false);
    system.friction.impact_without_collision = true;
    let run = simulate(system, (&start.0, &start.1), 0.05, FINE);
    assert_eq!(run.status, Status::Completed, "{:?}", run.occurrences);
    let flag = |it: &&Occurrence| {
        matches!(it, Occurrence::Flag { kind: FlagKind::ImpactWithoutCollision, .. })
    };
    assert_eq!(run.occurrences.iter().filter(flag).count(), 1);
    let found = run.occurrences.iter().find_map(|it| match *it {
        Occurrence::Tangential { before, after, impulse, sticks, .. } => {
            Some((before, after, impulse, sticks))
        }
        _ => None,
    });
    let (before, after, pull, sticks) = found.unwrap();
    // P = (.682, .938), which takes .938 J
    assert!(before == -2.0 && after == 0.0 && sticks && (pull - 0.938).abs() < 5e-4, "{pull}");
    assert!((0.5 * pull * before + 0.938).abs() < 5e-4);
}

#[test]
fn balls_bounce_to_rest_by_every_law() {
    // coupled normal and tangent: a rod's tip; one contact
    for law in [FrictionalImpact::Poisson, FrictionalImpact::Stronge] {
        let mut system = rod(0.3, 0.5, false);
        system.friction.law = law;
        let th: f64 = 0.9;
        let run = simulate(system, (&[0.0, th.sin() + 0.02, th], &[0.3, 0.0, 0.0]), 0.5, FINE);
        assert_eq!(run.status, Status::Completed, "{law:?} {:?}", run.occurrences);
        let zeno = |it: &Occurrence| matches!(it, Occurrence::Zeno { .. });
        assert!(run.occurrences.iter().any(zeno), "{law:?} {:?}", run.occurrences);
        assert!(run.counts.impacts < 25, "{}", run.counts.impacts);
    }
}

/// Two contacts in coordinates that are their gaps and slips, with random mobilities `D = A A^T + I/4`;
/// the second one is closed.
fn two_contacts(random: &mut Random, mu: f64, e: f64, e_t: f64) -> (Rough, Vec<f64>) {
    let a: Vec<f64> = (0..16).map(|_| random.next() - 0.5).collect();
    let d: Vec<f64> = (0..16)
        .map(|ij| {
            let (i, j) = (ij / 4, ij % 4);
            let product: f64 = (0..4).map(|k| a[4 * i + k] * a[4 * j + k]).sum();
            product + if i == j { 0.25 } else { 0.0 }
        })
        .collect();
    let mass = inverse(&d);
    let of = |c: usize| (0..4).map(|k| if k == c { 1.0 } else { 0.0 }).collect::<Vec<f64>>();
    let system = rough(4, &[Some(0), Some(1)], &[e, e], e_t, move |_, q, _| Parts {
        mass: mass.clone(),
        force: vec![0.0; 4],
        gaps: [0, 2].map(|c| Row { value: q[c], row: of(c), curvature: 0.0, rate: 0.0 }).into(),
        channels: [1, 3].map(|c| slip(&of(c), 0.0, 0.0)).into(),
        limits: vec![(mu, mu); 2],
    });
    (system, d)
}

/// Of a symmetric positive definite matrix, by Gauss and Jordan.
fn inverse(d: &[f64]) -> Vec<f64> {
    let n = 4;
    let (mut a, mut b) = (d.to_vec(), vec![0.0; n * n]);
    (0..n).for_each(|i| b[i * n + i] = 1.0);
    for k in 0..n {
        let pivot = a[k * n + k];
        for j in 0..n {
            a[k * n + j] /= pivot;
            b[k * n + j] /= pivot;
        }
        for i in (0..n).filter(|&i| i != k) {
            let factor = a[i * n + k];
            for j in 0..n {
                a[i * n + j] -= factor * a[k * n + j];
                b[i * n + j] -= factor * b[k * n + j];
            }
        }
    }
    b
}

#[test]
fn impacts_over_a_contact_obey_their_laws() {
    let mut random = Random(5);
    let mut counts = [0; 3];
    for case in 0..400 {
        let (mu, e) = (0.8 * random.next(), random.next());
        let law = [FrictionalImpact::Newton, FrictionalImpact::Poisson][case % 2];
        // the common coefficient, with which energy cannot grow
        let e_t = if law == FrictionalImpact::Newton && case % 4 == 0 { e } else { 0.0 };
        let (mut system, d) = two_contacts(&mut random, mu, e, e_t);
        system.friction.law = law;
        let before =
            [-0.2 - random.next(), 2.0 * random.next() - 1.0, 0.0, 2.0 * random.next() - 1.0];
        let run = simulate(system, (&[0.0; 4], &before), 1e-4, FINE);
        let (mut after, mut p) = (before, [0.0; 4]);
        let (mut grew, mut ambiguous) = (false, false);
        for it in &run.occurrences {
            match *it {
                Occurrence::Impact { group: 1, gap, after: speed, impulse, .. } => {
                    (after[2 * gap], p[2 * gap]) = (speed, impulse);
                }
                Occurrence::Tangential { group: 1, channel, after: slip, impulse, .. } => {
                    (after[2 * channel + 1], p[2 * channel + 1]) = (slip, impulse);
                }
                Occurrence::Flag { kind: FlagKind::EnergyGain, .. } => grew = true,
                Occurrence::Flag { kind: FlagKind::ImpactNotUnique, .. } => ambiguous = true,
                _ => (),
            }
        }
        // speeds of contacts without an impulse are not listed
        let full: Vec<f64> =
            (0..4).map(|i| before[i] + (0..4).map(|j| d[4 * i + j] * p[j]).sum::<f64>()).collect();
        for contact in 0..2 {
            let (g, w) = (full[2 * contact], full[2 * contact + 1]);
            let (pressed, pull) = (p[2 * contact], p[2 * contact + 1]);
            assert!(pressed >= -1e-13 && pull.abs() <= mu * pressed + 1e-12, "{case} {p:?}");
            let back = w + e_t * before[2 * contact + 1];
            let sticks = pull.abs() < mu * pressed - 1e-9;
            counts[usize::from(sticks)] += 1;
            if law == FrictionalImpact::Newton {
                assert!(pull * back <= 1e-12, "{case} {pull} {back}");
                assert!(!sticks || back.abs() < 1e-12, "{case} {back}");
                let rebound = g + e * before[2 * contact];
                assert!(rebound > -1e-12 && pressed * rebound < 1e-12, "{case} {rebound}");
            } else {
                assert!(g > -1e-12, "{case} {g}");
            }
            if pressed > 1e-12 {
                assert!((after[2 * contact] - g).abs() < 1e-12);
                assert!((after[2 * contact + 1] - w).abs() < 1e-12);
            } else {
                counts[2] += 1;
            }
        }
        let gain: f64 = (0..4).map(|i| 0.5 * p[i] * (full[i] + before[i])).sum();
        assert_eq!(grew, gain > 1e-11, "{case} {gain}");
        assert!(!grew || (law == FrictionalImpact::Newton && e_t == 0.0), "{case} {gain}");
        assert!(!ambiguous || mu > 0.1);
    }
    assert!(counts.iter().all(|&count| count > 30), "{counts:?}");
}
