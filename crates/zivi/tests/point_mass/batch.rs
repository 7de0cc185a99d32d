//! A mass in a batch moves as it moves alone, to the last bit, whatever the number of threads.

use std::convert::Infallible;
use std::sync::atomic::{AtomicU64, Ordering};

use zivi::drive::batch::{
    simulate_batch, simulate_batch_to, BatchError, Member, Outcome, Save, Task,
};
use zivi::{
    simulate_explicit_euler, simulate_moreau_jean, simulate_switched_rk, simulate_theta_gamma,
    AnyMethod, ConstantForce, Dependence, ExplicitEuler, FixedSteps, Force, Grid, HarmonicWall,
    LinearForce, LinearLaw, Monitor, MoreauJean, OnMovingWall, Output, Physical, Quantity,
    Restitution, Run, Silent, Status, Summary, SwitchedRk, ThetaGamma,
};

/// A generator whose draws are the same everywhere.
struct Draws(u64);

impl Draws {
    fn between(&mut self, low: f64, high: f64) -> f64 {
        self.0 =
            self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        low + (high - low) * ((self.0 >> 11) as f64 / (1_u64 << 53) as f64)
    }
}

/// The forces of these tests, as one type: batches are compiled once.
#[derive(Clone, Copy)]
enum TestForce<'a> {
    Constant(ConstantForce),
    Linear(LinearForce),
    /// Counts its evaluations, and may hide that it is linear.
    Counted {
        force: LinearForce,
        linear: bool,
        evaluations: &'a AtomicU64,
    },
    OnMovingWall(OnMovingWall<ConstantForce, HarmonicWall>),
    /// Panics where it is positive.
    Faulty(f64),
}

impl TestForce<'_> {
    fn inner<E>(&self) -> Option<&dyn Force<E>> {
        match self {
            Self::Constant(force) => Some(force),
            Self::Linear(force) | Self::Counted { force, .. } => Some(force),
            Self::OnMovingWall(force) => Some(force),
            Self::Faulty(_) => None,
        }
    }
}

impl<E> Force<E> for TestForce<'_> {
    fn at(&mut self, t: f64, x: f64, xdot: f64) -> Result<f64, E> {
        match self {
            Self::Constant(force) => force.at(t, x, xdot),
            Self::Linear(force) => force.at(t, x, xdot),
            Self::Counted { force, evaluations, .. } => {
                evaluations.fetch_add(1, Ordering::Relaxed);
                force.at(t, x, xdot)
            }
            Self::OnMovingWall(force) => force.at(t, x, xdot),
            Self::Faulty(value) => {
                assert!(*value < 0.0, "a fault");
                Ok(*value)
            }
        }
    }

    fn dependence(&self) -> Dependence {
        self.inner::<E>().map_or(Dependence::State, |force| force.dependence())
    }

    fn shortest_period(&self) -> Option<f64> {
        match self {
            Self::Counted { .. } | Self::Faulty(_) => None,
            _ => self.inner::<E>()?.shortest_period(),
        }
    }

    fn linear(&self) -> Option<LinearLaw> {
        match self {
            Self::Counted { .. } => None,
            _ => self.inner::<E>()?.linear(),
        }
    }

    fn as_linear_force(&self) -> Option<LinearForce> {
        match self {
            Self::Counted { linear: false, .. } => None,
            _ => self.inner::<E>()?.as_linear_force(),
        }
    }

    fn excitation(&self, t: f64) -> Option<f64> {
        match self {
            Self::Counted { .. } => None,
            _ => self.inner::<E>()?.excitation(t),
        }
    }

    fn excited(&mut self, excitation: f64, t: f64, x: f64, xdot: f64) -> Result<f64, E> {
        match self {
            Self::Linear(force) => force.excited(excitation, t, x, xdot),
            Self::OnMovingWall(force) => force.excited(excitation, t, x, xdot),
            _ => self.at(t, x, xdot),
        }
    }

    fn is_same(&self, other: &Self) -> bool {
        match (self, other) {
            (Self::Constant(one), Self::Constant(other)) => Force::<E>::is_same(one, other),
            (Self::Linear(one), Self::Linear(other))
            | (Self::Counted { force: one, .. }, Self::Counted { force: other, .. }) => {
                Force::<E>::is_same(one, other)
            }
            (Self::OnMovingWall(one), Self::OnMovingWall(other)) => Force::<E>::is_same(one, other),
            _ => false,
        }
    }
}

/// Balls with all kinds of walls, forces (also upward, none, absurd) and states (also at rest).
fn balls(n: usize) -> Vec<Member<'static, TestForce<'static>>> {
    let mut draws = Draws(7);
    (0..n)
        .map(|i| {
            let restitution = Restitution::from_e(draws.between(0.05, 1.0)).unwrap();
            let force = match i % 11 {
                3 => 0.0,
                5 => draws.between(0.0, 2.0),
                7 => 1e307,
                8 => f64::NAN,
                _ => -draws.between(0.1, 20.0),
            };
            let x = if i % 5 == 0 { 0.0 } else { draws.between(0.0, 2.0) };
            let xdot = if i % 10 == 0 { 0.0 } else { draws.between(-5.0, 5.0) };
            Member {
                law: restitution.into(),
                force: TestForce::Constant(ConstantForce(force)),
                initial: Physical { x, xdot },
                tstops: &[],
                kicks: &[],
            }
        })
        .collect()
}

/// A task of steps `h` over a span.
fn steps<S>(scheme: S, span: (f64, f64), h: f64) -> Task
where
    AnyMethod: From<FixedSteps<S>>,
{
    Task { method: FixedSteps { h, scheme }.into(), span, slowest: 1e-3 }
}

fn implicit(span: (f64, f64), h: f64) -> Task {
    steps(ThetaGamma::implicit_euler(), span, h)
}

/// A run by the function of its method, not by the entry that batches use.
fn alone(member: &Member<'_, TestForce<'_>>, task: Task) -> Run<Infallible> {
    let Member { law, mut force, initial, tstops, .. } = member.clone();
    let restitution = law.constant().unwrap();
    let (force, Task { method, span, .. }) = (&mut force, task);
    let grid = |h: f64| Grid::new(span.0, span.1, h).unwrap();
    match method {
        AnyMethod::ThetaGamma(FixedSteps { h, scheme }) => {
            simulate_theta_gamma(scheme, restitution, force, grid(h), initial, &mut Silent)
        }
        AnyMethod::ExplicitEuler(FixedSteps { h, .. }) => {
            simulate_explicit_euler(restitution, force, grid(h), initial, &mut Silent)
        }
        AnyMethod::MoreauJean(FixedSteps { h, scheme }) => {
            simulate_moreau_jean(scheme, restitution, force, grid(h), initial, &mut Silent)
        }
        AnyMethod::SwitchedRk(method) => {
            let output = Output { tstops, ..Output::default() };
            simulate_switched_rk(method, restitution, force, span, initial, output, &mut Silent)
                .map(|run| Run { trajectory: run.trajectory, raised: run.raised })
        }
    }
    .unwrap()
}

/// Bits, so that NaN is equal to itself and `-0.0` is not `0.0`.
fn bits(values: &[f64]) -> Vec<u64> {
    values.iter().map(|value| value.to_bits()).collect()
}

fn assert_same(outcome: &Outcome, run: &Run<Infallible>, save: Save, which: usize) {
    let trajectory = &run.trajectory;
    let expected = Summary::of(&trajectory.columns);
    let found = outcome.summary;
    assert_eq!(outcome.status, trajectory.status, "{which}");
    assert_eq!(outcome.nfev, trajectory.nfev, "{which}");
    assert_eq!(
        bits(&[found.t, found.x, found.xdot]),
        bits(&[expected.t, expected.x, expected.xdot]),
        "{which}: {found:?} {expected:?}"
    );
    let events = &trajectory.events;
    let counts = [events.zeno_times.len(), events.liftoff_times.len(), events.impacts.len()];
    assert_eq!(outcome.counts[1..], counts.map(|it| it as u64), "{which}");
    assert_eq!(bits(&[outcome.rest_time]), bits(&[events.rest_time.unwrap_or(f64::NAN)]));
    if save != Save::Statistics {
        assert_eq!([found.x_max, found.speed_max], [0.0; 2], "{which}");
    }
    match save {
        Save::Events => assert_eq!(outcome.events.as_ref(), Some(events)),
        Save::Statistics => assert_eq!(
            bits(&[found.x_max, found.speed_max]),
            bits(&[expected.x_max, expected.speed_max]),
            "{which}"
        ),
        Save::Every(every) => {
            let of = |quantity| trajectory.columns.of(quantity).iter().copied().step_by(every);
            assert_eq!(bits(&outcome.saved.x), bits(&of(Quantity::X).collect::<Vec<_>>()));
            assert_eq!(bits(&outcome.saved.xdot), bits(&of(Quantity::Xdot).collect::<Vec<_>>()));
        }
        Save::Final | Save::Grazing => {
            assert!(outcome.events.is_none() && outcome.saved.x.is_empty());
        }
        Save::At(times, _) => assert_eq!(outcome.saved.x.len(), times.len()),
        Save::Steps(steps, _) => assert_eq!(outcome.saved.s.len(), steps.len()),
    }
}

const SAVES: [Save; 5] =
    [Save::Final, Save::Statistics, Save::Events, Save::Every(1), Save::Every(17)];

#[test]
fn balls_move_as_they_move_alone() {
    let members = balls(150);
    for (theta, gamma) in [(1.0, 1.0), (0.5, 1.0), (1.0, 0.5), (0.7, 0.8)] {
        let method = ThetaGamma { theta, gamma, ..ThetaGamma::implicit_euler() };
        // a span that the step does not divide
        for (span, h) in [((0.0, 2.0), 1e-3), ((1.0, 2.0005), 2e-3)] {
            let task = steps(method, span, h);
            for save in SAVES {
                let ends = simulate_batch(&members, task, save, 2, &mut Silent).unwrap();
                for (i, (member, end)) in members.iter().zip(&ends).enumerate() {
                    assert_same(end, &alone(member, task), save, i);
                }
            }
        }
    }
}

/// Linear forces of all kinds: of time alone or with springs and dampers, pressing, pulling and
/// both in turn, with waves of their own or of all.
fn driven(draws: &mut Draws, n: usize) -> Vec<Member<'static, TestForce<'static>>> {
    let of_all = [draws.between(0.0, 30.0), draws.between(-4.0, 4.0)];
    let shares = draws.between(0.0, 1.0) < 0.5;
    let kind = draws.between(0.0, 5.0) as usize;
    (0..n)
        .map(|_| {
            let mut pick = |choices: [f64; 4]| choices[draws.between(0.0, 4.0) as usize];
            let [a, b, c, d] = [0; 4].map(|_| pick([0.0, 0.3, 0.7, 1.0]));
            let sprung = f64::from(u8::from(kind != 0));
            let [omega, phase] = if shares { of_all } else { [30.0 * (a - 0.5), 4.0 * b] };
            let stiffness = sprung * pick([0.0, 50.0 * c, 1e4 * d, -5.0 * c]);
            let force = LinearForce {
                stiffness,
                damping: sprung * pick([0.0, 2.0 * d, 50.0 * c, -0.3 * d]),
                gravity: if kind == 2 { -stiffness } else { pick([0.0, 9.81, 10.0 * c, -2.0 * d]) },
                amplitude: if kind == 1 { 0.0 } else { pick([0.0, d, 20.0 * c, 9.81]) },
                omega,
                phase,
            };
            let restitution = Restitution::from_e(match pick([0.0, 0.0, 1.0, 2.0]) {
                0.0 => draws.between(0.05, 1.0),
                1.0 => 10.0_f64.powf(draws.between(-12.0, -1.0)),
                _ => 1.0,
            });
            let size = |draws: &mut Draws, most: f64| match draws.between(0.0, 4.0) as usize {
                0 => 0.0,
                1 => 10.0_f64.powf(draws.between(-9.0, 0.0)),
                _ => draws.between(0.0, most),
            };
            // of some the force is a small difference of large terms
            let x = size(draws, 2.0) + f64::from(u8::from(kind == 2 && a > 0.5));
            let xdot = size(draws, 5.0) * if draws.between(0.0, 1.0) < 0.5 { 1.0 } else { -1.0 };
            Member {
                law: restitution.unwrap().into(),
                force: TestForce::Linear(force),
                initial: Physical { x, xdot },
                tstops: &[],
                kicks: &[],
            }
        })
        .collect()
}

const WEIGHTS: [(f64, f64); 6] =
    [(1.0, 1.0), (0.5, 0.5), (0.7, 0.8), (0.5, 1.0), (1.0, 0.3), (0.2, 1.0)];

/// Runs members under linear forces, 48 batches of all sizes and all that is saved; the numbers of
/// rests and lift-offs.
fn driven_are_as_alone<S>(mut draws: Draws, scheme: impl Fn(usize) -> S) -> [u64; 2]
where
    AnyMethod: From<FixedSteps<S>>,
{
    let (mut rests, mut lift_offs) = (0, 0);
    for round in 0..48 {
        // all, but a few, of the lanes; some; more than there are
        let n = [1, 7, 61, 64, 65, 130][round % 6];
        let members = driven(&mut draws, n);
        let h = 10.0_f64.powf(draws.between(-3.3, -1.7));
        let start = draws.between(-3.0, 3.0);
        // the last step is a shorter one in half of them
        let end = start + h * (draws.between(1.0, 900.0).floor() + [0.0, 0.37][round % 2]);
        let task = steps(scheme(round / 3), (start, end), h);
        let save = SAVES[round % 5];
        let ends = simulate_batch(&members, task, save, 1 + round % 3, &mut Silent).unwrap();
        for (i, (member, end)) in members.iter().zip(&ends).enumerate() {
            assert_same(end, &alone(member, task), save, i);
            rests += end.counts[1];
            lift_offs += end.counts[2];
        }
    }
    [rests, lift_offs]
}

#[test]
fn masses_under_linear_forces_move_as_they_move_alone() {
    let happened = driven_are_as_alone(Draws(11), |it| {
        let (theta, gamma) = WEIGHTS[it % 6];
        ThetaGamma { theta, gamma, ..ThetaGamma::implicit_euler() }
    });
    assert!(happened.iter().all(|&it| it > 200), "{happened:?}");
}

#[test]
fn masses_under_linear_forces_move_as_alone_by_moreau_jean() {
    let happened = driven_are_as_alone(Draws(13), |it| MoreauJean {
        theta: [0.5, 1.0, 0.7, 0.0, 0.5, 0.2][it % 6],
    });
    assert!(happened.iter().all(|&it| it > 100), "{happened:?}");
}

#[test]
fn a_step_from_near_a_switch_is_that_of_a_mass_alone() {
    let mut draws = Draws(5);
    let offsets = [0.0, 1e-16, 1e-14, 1e-13, 1e-12, 1e-11, 1e-9, 1e-7, 1e-6, 1e-5, 1e-3, 0.3, 1.0];
    for (theta, gamma) in WEIGHTS {
        // a constant, a wave, a spring and a damper
        for [amplitude, sprung] in [[0.0, 0.0], [1e-300, 0.0], [0.0, 1.0]] {
            let h = 10.0_f64.powf(draws.between(-3.0, -1.0));
            let members: Vec<_> = (0..4000)
                .map(|i| {
                    let e = match i % 4 {
                        0 => 10.0_f64.powf(draws.between(-15.0, -6.0)),
                        _ => draws.between(0.02, 1.0),
                    };
                    let restitution = Restitution::from_e(e).unwrap();
                    let offset = |draws: &mut Draws| {
                        let sign = if draws.between(0.0, 1.0) < 0.5 { 1.0 } else { -1.0 };
                        1.0 + sign * offsets[draws.between(0.0, 13.0) as usize]
                    };
                    let f = draws.between(-5.0, 5.0);
                    let way = if draws.between(0.0, 1.0) < 0.5 { 1.0 } else { -1.0 };
                    // an apex ends the step, or the mass is fast
                    let r = restitution.r(1.0, [1.0, -1.0][i % 2]);
                    let v = match i % 5 {
                        0 => draws.between(0.0, 5.0),
                        1 => 10.0_f64.powf(draws.between(-20.0, 0.0)) * h * f.abs(),
                        _ => gamma * h * f.abs() / r,
                    };
                    let v = way * v * offset(&mut draws);
                    // the wall ends it, is reached somewhere else or does not matter
                    let reach = h * restitution.r(1.0, v.signum()) * v.abs();
                    let drop = [theta, 1.0, theta * gamma, gamma * (theta - gamma).abs(), 2.0]
                        [draws.between(0.0, 5.0) as usize]
                        * h
                        * h
                        * f.abs();
                    let x = match i % 7 {
                        0 => draws.between(0.0, 2.0),
                        1 => reach,
                        2 => drop,
                        3 => (reach - drop).abs(),
                        _ => reach + drop,
                    };
                    let x = x * offset(&mut draws);
                    let stiffness = sprung * draws.between(-10.0, 50.0);
                    let gravity = -f - stiffness * x;
                    let force = LinearForce { stiffness, gravity, damping: sprung, ..NO_FORCE };
                    let force = LinearForce { amplitude, ..force };
                    let xdot = restitution.r(1.0, v.signum()) * v;
                    Member {
                        law: restitution.into(),
                        force: TestForce::Linear(force),
                        initial: Physical { x, xdot },
                        tstops: &[],
                        kicks: &[],
                    }
                })
                .collect();
            let method = ThetaGamma { theta, gamma, ..ThetaGamma::implicit_euler() };
            let task = steps(method, (0.0, 3.0 * h), h);
            let ends = simulate_batch(&members, task, Save::Every(1), 1, &mut Silent).unwrap();
            for (i, (member, end)) in members.iter().zip(&ends).enumerate() {
                assert_same(end, &alone(member, task), Save::Every(1), i);
            }
        }
    }
}

#[test]
fn linear_forces_that_overflow_end_as_they_end_alone() {
    let restitution = Restitution::from_e(0.5).unwrap();
    let member = |force, x| Member {
        law: restitution.into(),
        force: TestForce::Linear(force),
        initial: Physical { x, xdot: 0.0 },
        tstops: &[],
        kicks: &[],
    };
    let most = LinearForce { gravity: f64::MAX, amplitude: f64::MAX, omega: 3.0, ..NO_FORCE };
    let spring = LinearForce { stiffness: -1e6, ..NO_FORCE };
    let fast = LinearForce { amplitude: 1.0, omega: f64::MAX, ..NO_FORCE };
    let members = [
        // at rest, until minus infinity pulls; in flight
        member(most, 0.0),
        member(most, 1.0),
        member(LinearForce { stiffness: 1.0, ..most }, 0.0),
        member(spring, 1.0),
        // grows beyond all numbers
        member(LinearForce { stiffness: -1e3, ..NO_FORCE }, 1.0),
        member(LinearForce { amplitude: 1.0, ..spring }, 0.0),
        member(LinearForce { gravity: -1e300, amplitude: 1.0, ..NO_FORCE }, 1.0),
        // cosines of no angle
        member(fast, 0.0),
        member(fast, 1.0),
        member(LinearForce { damping: 1.0, ..fast }, 1.0),
        member(LinearForce { amplitude: 1e-3, gravity: 9.81, ..NO_FORCE }, 1.0),
    ];
    let span = (0.0, 30.0);
    let moreau = steps(MoreauJean::default(), span, 1e-2);
    for task in [implicit(span, 1e-2), moreau] {
        for save in SAVES {
            let ends = simulate_batch(&members, task, save, 1, &mut Silent).unwrap();
            for (i, (member, end)) in members.iter().zip(&ends).enumerate() {
                assert_same(end, &alone(member, task), save, i);
            }
            let failed = |end: &&Outcome| end.status != Status::Completed;
            assert_eq!(ends.iter().filter(failed).count(), 8, "{task:?}");
        }
    }
}

const NO_FORCE: LinearForce = LinearForce {
    stiffness: 0.0,
    damping: 0.0,
    gravity: 0.0,
    amplitude: 0.0,
    omega: 0.0,
    phase: 0.0,
};

#[test]
fn masses_share_the_evaluations_of_forces_that_are_the_same() {
    let restitution = Restitution::from_e(0.3).unwrap();
    let count = AtomicU64::new(0);
    let member = |i: u32| {
        let amplitude = [5.0, 5.0, 3.0, 5.0, f64::NAN][(i % 5) as usize];
        let force = LinearForce { amplitude, gravity: 9.81, omega: 7.0, ..NO_FORCE };
        let force = TestForce::Counted { force, linear: false, evaluations: &count };
        let initial = Physical { x: 0.02 * f64::from(i), xdot: 0.5 };
        Member { law: restitution.into(), force, initial, tstops: &[], kicks: &[] }
    };
    let members: Vec<_> = (0..40).map(member).collect();
    let task = implicit((0.0, 2.0), 1e-3);
    let ends = simulate_batch(&members, task, Save::Every(7), 1, &mut Silent).unwrap();
    // twice a step, for an apex, impacts and settling, and for those that have no force
    let shared = count.load(Ordering::Relaxed);
    assert!((2 * 2000..3 * 2000).contains(&shared), "{shared}");
    for (i, (member, end)) in members.iter().zip(&ends).enumerate() {
        assert_same(end, &alone(member, task), Save::Every(7), i);
    }
    assert_eq!(ends[4].status, Status::ForceNotFinite);
}

#[test]
fn masses_above_walls_that_vibrate_move_as_they_move_alone() {
    let restitution = Restitution::from_e(0.6).unwrap();
    let mut draws = Draws(3);
    let walls = [(0.01, 20.0, 0.0), (0.01, 20.0, 0.1), (0.02, 31.0, 0.0), (0.0, 0.0, 0.0)];
    let members: Vec<_> = (0..100)
        .map(|i| {
            let (amplitude, omega, offset) = walls[i % 4];
            let wall = HarmonicWall { amplitude, omega, phase: 0.3, offset };
            let force = ConstantForce([-9.81, -2.0, 1.0][i % 3]);
            let (x, xdot) = (draws.between(0.0, 0.3), draws.between(-1.0, 1.0));
            let initial = if i % 7 == 0 { Physical::default() } else { Physical { x, xdot } };
            let force = TestForce::OnMovingWall(OnMovingWall { force, wall });
            Member { law: restitution.into(), force, initial, tstops: &[], kicks: &[] }
        })
        .collect();
    let task = implicit((0.0, 2.0), 1e-3);
    for save in SAVES {
        let ends = simulate_batch(&members, task, save, 2, &mut Silent).unwrap();
        let lift_offs: u64 = ends.iter().map(|end| end.counts[2]).sum();
        assert!(lift_offs > 5, "{lift_offs}");
        for (i, (member, end)) in members.iter().zip(&ends).enumerate() {
            assert_same(end, &alone(member, task), save, i);
        }
    }
}

#[test]
fn most_steps_are_taken_side_by_side() {
    let wave = |gravity| LinearForce { gravity, amplitude: 5.0, omega: 7.0, ..NO_FORCE };
    let spring = LinearForce { stiffness: 20.0, damping: 0.3, gravity: 9.81, ..NO_FORCE };
    let sprung = LinearForce { amplitude: 5.0, omega: 7.0, gravity: 1.0, ..spring };
    // pressing, both in turn, pulling; the last one rests most of the time
    let forces =
        [wave(9.81), wave(1.0), wave(-6.0), spring, sprung, LinearForce { gravity: 8.0, ..sprung }];
    let restitution = Restitution::from_e(0.3).unwrap();
    let start = |i: u32| Physical { x: 0.5 + 0.01 * f64::from(i), xdot: 1.0 };
    for linear in forces {
        let count = AtomicU64::new(0);
        let force = TestForce::Counted { force: linear, linear: true, evaluations: &count };
        let member = |i| Member {
            law: restitution.into(),
            force,
            initial: start(i),
            tstops: &[],
            kicks: &[],
        };
        let members: Vec<_> = (0..20).map(member).collect();
        // other members of the scheme do not rest
        let tasks = [(1.0, 1.0, 4.0), (0.5, 0.8, 0.6)].map(|(theta, gamma, end)| {
            let method = ThetaGamma { theta, gamma, ..ThetaGamma::implicit_euler() };
            steps(method, (0.0, end), 1e-3)
        });
        let moreau = steps(MoreauJean::default(), (0.0, 4.0), 1e-3);
        for task in tasks.into_iter().chain([moreau]) {
            count.store(0, Ordering::Relaxed);
            let ends = simulate_batch(&members, task, Save::Final, 1, &mut Silent).unwrap();
            let alone = count.load(Ordering::Relaxed);
            let all: u64 = ends.iter().map(|end| end.nfev).sum();
            assert!(alone < all / 20, "{:?}: {alone} of {all}", linear);
        }
    }
}

#[test]
fn every_method_and_force_gives_what_it_gives_alone() {
    let force = LinearForce {
        stiffness: 1.0,
        damping: 0.1,
        gravity: 3.0,
        amplitude: 4.0,
        omega: 5.0,
        phase: 0.3,
    };
    let restitution = Restitution::from_e(0.6).unwrap();
    let member = |x| Member {
        law: restitution.into(),
        force: TestForce::Linear(force),
        initial: Physical { x, xdot: 0.5 },
        tstops: &[],
        kicks: &[],
    };
    let members: Vec<_> = (0..40).map(|i| member(0.05 * f64::from(i))).collect();
    let span = (0.0, 3.0);
    let tasks = [
        implicit(span, 1e-3),
        steps(ExplicitEuler, span, 1e-3),
        steps(MoreauJean::default(), span, 1e-3),
        Task { method: SwitchedRk::default().into(), span, slowest: 1e-3 },
    ];
    for task in tasks {
        for save in SAVES {
            if matches!((task.method, save), (AnyMethod::SwitchedRk(_), Save::Every(_))) {
                continue;
            }
            let ends = simulate_batch(&members, task, save, 2, &mut Silent).unwrap();
            for (i, (member, end)) in members.iter().zip(&ends).enumerate() {
                assert_same(end, &alone(member, task), save, i);
            }
        }
    }
}

#[test]
fn the_number_of_threads_changes_nothing() {
    let members = balls(333);
    let task = implicit((0.0, 1.0), 1e-3);
    let of = |threads| simulate_batch(&members, task, Save::Every(100), threads, &mut Silent);
    // debug output tells NaN and the signs of zeros
    let one = format!("{:?}", of(1).unwrap());
    for threads in [2, 3, 64] {
        assert_eq!(format!("{:?}", of(threads).unwrap()), one);
    }
    assert!(simulate_batch(&members[..0], task, Save::Final, 2, &mut Silent).unwrap().is_empty());
}

#[test]
fn the_first_member_that_cannot_start_is_named() {
    let mut members = balls(70);
    members[33].initial.x = -1.0;
    members[60].initial.xdot = f64::NAN;
    let task = implicit((0.0, 1.0), 1e-2);
    let refused = simulate_batch(&members, task, Save::Final, 2, &mut Silent);
    let Err(BatchError::Setup(Some(33), error)) = refused else { panic!("{refused:?}") };
    assert!(error.to_string().starts_with("x0 must be"), "{error}");
}

#[test]
fn runs_that_end_at_times_of_their_own_are_those_of_batches_up_to_there() {
    let task = |end| Task { method: SwitchedRk::default().into(), span: (0.0, end), slowest: 1e-3 };
    let members: Vec<_> = balls(40)
        .into_iter()
        .filter(|it| matches!(it.force, TestForce::Constant(force) if force.0.abs() < 100.0))
        .collect();
    let ends: Vec<f64> = (0..members.len()).map(|i| 0.3 + 0.17 * i as f64).collect();
    let both: Vec<_> = members.iter().cloned().zip(ends.iter().copied()).collect();
    for save in [Save::Final, Save::Events, Save::Grazing] {
        let found = simulate_batch_to(&both, task(1.0), save, 2, &mut Silent).unwrap();
        for ((member, end), found) in both.iter().zip(&found) {
            let alone =
                simulate_batch(std::slice::from_ref(member), task(*end), save, 1, &mut Silent)
                    .unwrap();
            assert_eq!(format!("{found:?}"), format!("{:?}", alone[0]));
        }
    }
    let mut early = both.clone();
    early[3].1 = 0.0;
    let refused = simulate_batch_to(&early, task(1.0), Save::Final, 2, &mut Silent);
    assert!(matches!(refused, Err(BatchError::Setup(Some(3), _))), "{refused:?}");
    let times = Save::At(&[0.1, 0.9], false);
    for (task, save) in [(implicit((0.0, 1.0), 1e-2), Save::Final), (task(1.0), times)] {
        let refused = simulate_batch_to(&both, task, save, 2, &mut Silent);
        let Err(BatchError::Setup(None, error)) = refused else { panic!("{refused:?}") };
        assert!(error.to_string().starts_with("ends must be for the switched method"), "{error}");
    }
}

/// Wants to stop at the second look.
struct Impatient(u32);

impl Monitor<&'static str> for Impatient {
    fn poll(&mut self, done: usize, of: usize) -> Result<(), &'static str> {
        assert!(done <= of);
        self.0 += 1;
        if self.0 > 1 {
            Err("enough")
        } else {
            Ok(())
        }
    }
}

#[test]
fn a_batch_can_be_stopped() {
    // hours of work, were it not stopped
    let members = balls(10_000);
    let task = implicit((0.0, 1e5), 1e-4);
    let ended = simulate_batch(&members, task, Save::Final, 2, &mut Impatient(0));
    assert_eq!(ended, Err(BatchError::Raised("enough")));
}

#[test]
fn a_failure_is_that_of_its_member_alone() {
    let mut members = balls(60);
    // off the wall, so that nothing stops it
    members[7].initial = Physical { x: 1.0, xdot: 0.0 };
    let task = implicit((0.0, 100.0), 1.0);
    let ends = simulate_batch(&members, task, Save::Final, 1, &mut Silent).unwrap();
    let with = |status| ends.iter().filter(|end| end.status == status).count();
    assert_eq!(with(Status::ForceNotFinite), members.len() / 11);
    assert!(with(Status::StateNotFinite) > 0 && with(Status::Completed) > 40);
}

#[test]
fn a_fault_costs_no_other_run_its_result() {
    let restitution = Restitution::from_e(0.5).unwrap();
    let initial = Physical { x: 1.0, xdot: 0.0 };
    let member = |i: u32| Member {
        law: restitution.into(),
        initial,
        tstops: &[],
        kicks: &[],
        force: TestForce::Faulty(if i % 7 == 3 { 1.0 } else { -f64::from(i) - 1.0 }),
    };
    let members: Vec<_> = (0..70).map(member).collect();
    let task = implicit((0.0, 0.5), 1e-2);
    for threads in [1, 3] {
        let ends = simulate_batch(&members, task, Save::Every(5), threads, &mut Silent).unwrap();
        for (i, (member, end)) in members.iter().zip(&ends).enumerate() {
            if i % 7 == 3 {
                assert_eq!((end.status, end.summary.x), (Status::Internal, 1.0));
                assert!(end.saved.x.is_empty() && end.rest_time.is_nan());
            } else {
                assert_same(end, &alone(member, task), Save::Every(5), i);
            }
        }
    }
}

#[test]
fn what_cannot_fit_into_memory_is_refused_before_anything_is_computed() {
    // beyond what any system promises, and years of work
    let members = vec![balls(1)[0].clone(); 100_000];
    let (span, h) = ((0.0, 1e3), 1e-6);
    let refused = |method, save| match simulate_batch(&members, method, save, 1 << 20, &mut Silent)
    {
        Err(BatchError::Setup(None, error)) => error.to_string(),
        other => panic!("{:?}", other.map(|ends| ends.len())),
    };
    // 2 x 16 bytes a sample: what is kept, and the arrays
    let text = refused(implicit(span, h), Save::Every(1));
    assert!(text.contains("100000 runs") && text.contains("1000000001 samples"), "{text}");
    assert!(text.contains(" 3200000.0"), "{text}");
    // a record of one run for each thread
    let text = refused(steps(MoreauJean::default(), span, h), Save::Final);
    assert!(text.contains("the record of 1000000001 steps"), "{text}");
}

#[test]
fn statistics_are_those_of_the_samples_and_the_impacts() {
    // driven: the hardest impact of some is neither the first nor the last
    let force = LinearForce {
        stiffness: 0.0,
        damping: 0.1,
        gravity: 9.81,
        amplitude: 15.0,
        omega: 6.0,
        phase: 0.3,
    };
    let restitution = Restitution::from_e(0.7).unwrap();
    let member = |x| Member {
        law: restitution.into(),
        force: TestForce::Linear(force),
        initial: Physical { x, xdot: 0.5 },
        tstops: &[],
        kicks: &[],
    };
    let far = member(80.0);
    let members: Vec<_> = (1..9).map(|k| member(0.02 * f64::from(k))).chain([far]).collect();
    let (span, h) = ((0.0, 3.0), 1e-3);
    let mut in_between = false;
    for task in [implicit(span, h), steps(MoreauJean::default(), span, h)] {
        let ends = simulate_batch(&members, task, Save::Statistics, 1, &mut Silent).unwrap();
        for (member, end) in members.iter().zip(&ends) {
            let run = alone(member, task).trajectory;
            let of = |quantity| run.columns.of(quantity);
            let largest = |values: &mut dyn Iterator<Item = f64>| values.fold(0.0, f64::max);
            assert_eq!(end.summary.x_max, largest(&mut of(Quantity::X).iter().copied()));
            let speeds = &mut of(Quantity::Xdot).iter().map(|xdot| xdot.abs());
            assert_eq!(end.summary.speed_max, largest(speeds));
            let impacts = &run.events.impacts;
            let speed = |k: usize| -impacts[k].xdot_before;
            if impacts.is_empty() {
                assert!(end.first_impact.is_nan() && end.last_impact.is_nan());
                assert_eq!(end.hardest_impact, 0.0);
                continue;
            }
            let last = impacts.len() - 1;
            let (first, latest) = (impacts[0].t, impacts[last].t);
            assert_eq!((end.first_impact, end.last_resolved), (first, latest));
            assert_eq!(end.hardest_impact, largest(&mut (0..=last).map(speed)));
            in_between |= end.hardest_impact > speed(0).max(speed(last));
        }
        assert!(ends[8].counts[0] == 0 && ends[0].counts[0] > 1);
    }
    assert!(in_between);
}

#[test]
fn only_what_was_asked_for_is_kept() {
    let (span, h) = ((0.0, 1.0), 1e-3);
    for task in [implicit(span, h), steps(MoreauJean::default(), span, h)] {
        for save in SAVES {
            for end in simulate_batch(&balls(8), task, save, 1, &mut Silent).unwrap() {
                assert_eq!(end.events.is_some(), save == Save::Events);
                let samples = end.saved.x.len();
                assert_eq!(samples > 0, matches!(save, Save::Every(_)), "{save:?}");
                assert_eq!(samples, end.saved.xdot.len());
            }
        }
    }
}
