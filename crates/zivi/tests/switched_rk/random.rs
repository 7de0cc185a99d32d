//! Random linear forces against the closed form.

use zivi::{LinearForce, Order, Physical, Restitution};

use crate::closed::{self, Story};
use crate::problems::{end, settings, simulate, Random};

struct Problem {
    force: LinearForce,
    e: f64,
    span: (f64, f64),
    start: (f64, f64),
}

impl Problem {
    fn random(random: &mut Random, number: usize) -> Self {
        let free = number % 4 == 0;
        let stiffness = if free { 0.0 } else { random.between(0.05, 4.0) };
        let damping = if free { 0.0 } else { random.between(0.0, 0.9) * stiffness.sqrt() };
        let gravity = random.between(0.5, 10.0);
        let force = LinearForce {
            stiffness,
            damping,
            gravity,
            amplitude: random.between(0.0, 2.5) * gravity,
            omega: random.between(0.5, 7.0),
            phase: random.between(-3.0, 3.0),
        };
        let t0 = random.between(-2.0, 2.0);
        let start = (random.between(0.05, 1.5), random.between(-3.0, 3.0));
        let e = random.between(0.05, 0.85);
        Self { force, e, span: (t0, t0 + 6.0), start }
    }

    fn closed(&self) -> Story {
        closed::simulate(self.force, self.e, self.span, self.start)
    }
}

#[test]
fn a_thousand_random_forces_have_the_events_of_the_closed_form() {
    let mut random = Random(3);
    let (mut zenos, mut lifts, mut impacts) = (0, 0, 0);
    for number in 0..1000 {
        let problem = Problem::random(&mut random, number);
        let Problem { mut force, e, span, start } = problem;
        let story = Problem::closed(&Problem { force, e, span, start });
        let order = if number % 2 == 0 { Order::Eight } else { Order::Five };
        let wall = Restitution::from_e(e).unwrap();
        let initial = Physical { x: start.0, xdot: start.1 };
        let run = simulate(settings(order, 1e-11), wall, &mut force, span, initial);
        let events = &run.trajectory.events;
        let mine = run.impacts_down_to(1e-5, 100_000);
        let theirs: Vec<_> = story.impacts.iter().filter(|it| it[1] >= 1e-5).collect();
        zenos += story.zeno.len();
        lifts += story.lift.len();
        impacts += theirs.len();
        let same = mine.len() == theirs.len() && events.zeno_times.len() == story.zeno.len() && events.liftoff_times.len() == story.lift.len();
        if !same {
            println!("{number} {order:?}: impacts {} {} zeno {:?} {:?} lift {:?} {:?} {force:?} {e} {span:?} {start:?} end {:?} {:?}", mine.len(), theirs.len(), events.zeno_times, story.zeno, events.liftoff_times, story.lift, end(&run), story.end);
            for (a, b) in mine.iter().zip(&theirs) { println!("   {} {}   {} {}", a.t, b[0], a.xdot_after, b[1]); }
        } 
        let worst = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        let (z, l) = (worst(&events.zeno_times, &story.zeno), worst(&events.liftoff_times, &story.lift));
        let i = mine.iter().zip(&theirs).map(|(a,b)| (a.t-b[0]).abs().max((a.xdot_after-b[1]).abs())).fold(0.0,f64::max);
        if z > 1e-8 || l > 1e-13 || i > 1e-8 { println!("{number} {order:?} worst {z:e} {l:e} {i:e}"); }
    }
    println!("{zenos} {lifts} {impacts}");
}
