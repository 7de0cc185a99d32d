//! Systems that nobody chose: what a run does may not depend on its tolerance.

use zivi::mechanics::{MechanicalRun, Occurrence};
use zivi::{Order, Status};

use crate::closed_forms::simulate;
use crate::models::{belt2, belt_stop, disc, feeder, rock, rod, Random, Rough};

/// A system, its start, and the end of its run.
type Case = (Rough, Vec<f64>, Vec<f64>, f64);

fn case(family: &str, random: &mut Random) -> Case {
    let mut of = |low: f64, high: f64| random.between(low, high);
    match family {
        "feeder" => {
            let [al, mu, e] = [of(-0.2, 0.3), of(0.1, 0.6), of(0.1, 0.6)];
            let [a, om, beta] = [of(0.02, 0.12), of(6.0, 12.0), of(0.3, 1.0)];
            let start = (vec![0.0, of(0.02, 0.2)], vec![of(-0.5, 0.5), 0.0]);
            (feeder([al, mu, e, a, om, beta]), start.0, start.1, 1.5)
        }
        "disc" => {
            let law = [of(0.05, 0.5), of(0.2, 0.6), 0.0];
            let slope = [of(-0.3, 0.3), of(0.0, 0.03), of(5.0, 12.0)];
            let start =
                (vec![0.0, 0.1 + of(0.05, 0.3), 0.0], vec![of(-1.0, 1.0), 0.0, of(-20.0, 20.0)]);
            (disc(law, slope), start.0, start.1, 1.5)
        }
        "rod" => {
            let (mu, e, th) = (of(0.05, 0.6), of(0.0, 0.5), of(0.2, 1.0));
            let start =
                (vec![0.0, th.sin() + of(0.0, 0.1), th], vec![of(-1.0, 1.0), 0.0, of(-1.0, 0.0)]);
            (rod(mu, e, true), start.0, start.1, 1.2)
        }
        "belt2" => {
            let [l1, l2] = [of(0.6, 1.4), of(0.6, 1.4)];
            let [k12, v] = [of(0.3, 2.0), of(0.1, 0.5)];
            let system = belt2([
                1.0,
                1.0,
                k12,
                v,
                l1,
                l2,
                l1 * of(1.1, 1.4),
                l2 * of(1.1, 1.4),
                of(0.0, 0.5),
            ]);
            (system, vec![of(-0.5, 0.5), of(-0.5, 0.5)], vec![of(-0.5, 0.5), of(-0.5, 0.5)], 20.0)
        }
        "belt_stop" => {
            let (l, v) = (of(0.4, 1.0), of(0.2, 0.6));
            let system = belt_stop(
                [1.0, v, l, l * of(1.1, 1.4), of(0.6, 1.0), of(0.2, 0.8), of(0.0, 0.5)],
                of(0.5, 2.0),
            );
            (system, vec![of(-0.3, 0.3)], vec![of(-0.5, 0.5)], 15.0)
        }
        _ => {
            let (b, h): (f64, f64) = (of(0.3, 0.6), of(1.0, 2.0));
            let (mu, th): (f64, f64) = (of(0.2, 0.8), of(0.05, 0.25));
            // on the left corner
            let y = b * th.sin() + h * th.cos();
            (rock([b, h, mu, 0.0, of(0.0, 0.2), of(3.0, 8.0)]), vec![0.0, y, th], vec![0.0; 3], 1.5)
        }
    }
}

type Event = (&'static str, usize, i8, f64);

/// Events without the impacts before accumulations.
fn events(run: &MechanicalRun<std::convert::Infallible>) -> Vec<Event> {
    let event = |it: &Occurrence| match *it {
        Occurrence::Zeno { t, gap, .. } => Some(("zeno", gap, 0, t)),
        Occurrence::LiftOff { t, gap } => Some(("lift", gap, 0, t)),
        Occurrence::Opened { t, gap } => Some(("open", gap, 0, t)),
        Occurrence::Transition { t, channel, after, .. } => Some(("turn", channel, after, t)),
        _ => None,
    };
    let mut all: Vec<Event> = run.occurrences.iter().filter_map(event).collect();
    all.sort_by(|a, b| a.3.total_cmp(&b.3).then(a.0.cmp(b.0)).then(a.1.cmp(&b.1)));
    all
}

#[test]
fn runs_do_not_depend_on_their_tolerance() {
    const TOL: f64 = 1e-8;
    for family in ["feeder", "disc", "rod", "belt2", "belt_stop", "rock"] {
        let mut random = Random(7);
        let (mut errors, mut nests) = (Vec::new(), 0);
        for number in 0..75 {
            let seed = random.0;
            let run = |tol: f64| {
                let (system, q, w, t1) = case(family, &mut Random(seed));
                simulate(system, (&q, &w), t1, (Order::Eight, tol))
            };
            let (coarse, fine) = (run(TOL), run(1e-11));
            case(family, &mut random);
            assert_eq!(coarse.status, Status::Completed, "{family} {number}");
            assert_eq!(fine.status, Status::Completed, "{family} {number}");
            let (a, b) = (events(&coarse), events(&fine));
            // how many impacts are listed before a corner depends on the tolerance
            let corner = |all: &[Event]| all.iter().rev().find(|it| it.0 == "zeno").map(|it| it.3);
            let until = match (family, corner(&a)) {
                ("rock", Some(t)) => t - 1e-2,
                _ => f64::INFINITY,
            };
            let names = |all: &[Event]| {
                let early = all.iter().filter(|it| it.3 < until);
                early.map(|it| (it.0, it.1, it.2)).collect::<Vec<_>>()
            };
            assert_eq!(names(&a), names(&b), "{family} {number}");
            nests += usize::from(a.len() != b.len());
            let size = coarse.layout.size();
            let n = coarse.layout.n;
            let end = |run: &MechanicalRun<std::convert::Infallible>| {
                let last = run.samples.t.len() - 1;
                [&run.samples.x[last * size..][..n], &run.samples.v[last * size..][..n]].concat()
            };
            let pairs = end(&coarse).into_iter().zip(end(&fine));
            let scale = end(&fine).iter().fold(1.0_f64, |a, b| a.max(b.abs()));
            errors.push(pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f64::max) / (TOL * scale));
        }
        errors.sort_by(f64::total_cmp);
        assert!(errors[74] < 50.0 && errors[37] < 5.0 && nests < 8, "{family} {errors:?}");
    }
}
