//! One number for every bit of thousands of runs by power series: the same on every machine.
//!
//! `tools/same-bits.sh` builds this for several processors and compares what it prints.

use std::convert::Infallible;

use zivi::{
    simulate_switched_rk, Flights, HarmonicWall, ImpactMap, LinearForce, OnMovingWall, Output,
    Physical, Restitution, Silent, SwitchedRk, SwitchedRun,
};

/// Numbers that look random (D. E. Knuth's MMIX generator).
struct Draw(u64);

impl Draw {
    fn within(&mut self, low: f64, high: f64) -> f64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963);
        low + (high - low) * ((self.0 >> 11) as f64 / (1_u64 << 53) as f64)
    }

    fn one_of<const N: usize>(&mut self, values: [f64; N]) -> f64 {
        values[(self.within(0.0, N as f64) as usize).min(N - 1)]
    }

    fn force(&mut self) -> LinearForce {
        let (spring, repelled) = (self.within(0.1, 20.0), self.within(-2.0, 0.0));
        let (damper, wave) = (self.within(0.0, 2.0), self.within(0.0, 15.0));
        LinearForce {
            stiffness: self.one_of([0.0, spring, repelled]),
            damping: self.one_of([0.0, damper, 1e3]),
            gravity: self.within(-1.0, 10.0),
            amplitude: self.one_of([0.0, wave, wave]),
            omega: self.within(0.5, 12.0),
            phase: self.within(-3.0, 3.0),
        }
    }
}

/// All bits so far (G. Fowler, L. C. Noll, K.-P. Vo: FNV-1a, by words).
struct Bits(u64);

impl Bits {
    fn add(&mut self, numbers: impl IntoIterator<Item = f64>) {
        for number in numbers {
            self.0 = (self.0 ^ number.to_bits()).wrapping_mul(0x0100_0000_01b3).rotate_left(7);
        }
    }

    fn add_run(&mut self, run: &SwitchedRun<Infallible>, span: (f64, f64)) {
        let events = &run.trajectory.events;
        for impact in &run.impacts_down_to(1e-9, 50) {
            self.add([impact.t, impact.xdot_before, impact.xdot_after]);
        }
        self.add(events.zeno_times.iter().chain(&events.liftoff_times).copied());
        let times = (0..=40).map(|k| span.0 + (span.1 - span.0) * f64::from(k) / 40.0);
        let path = run.path.iter();
        let states = path.flat_map(|path| times.clone().filter_map(|t| path.at(t)));
        states.for_each(|state| self.add([state.x, state.xdot]));
    }
}

fn runs(n: u32) -> Result<u64, Box<dyn std::error::Error>> {
    let (mut draw, mut bits) = (Draw(1), Bits(0));
    for number in 0..n {
        let mut force = draw.force();
        let e = draw.one_of([0.0, 0.3, 0.6, 0.8, 0.95, 1.0]);
        let start = Physical { x: draw.within(0.0, 2.0), xdot: draw.within(-3.0, 3.0) };
        let span = (0.0, if force.damping > 10.0 { 0.2 } else { 4.0 });
        let settings = SwitchedRk {
            flights: Flights::Series,
            max_steps: 20_000,
            ..SwitchedRk::with_tol(draw.one_of([1e-4, 1e-8, 1e-12]))
        };
        let restitution = Restitution::from_e(e)?;
        let output = Output { dense: true, ..Output::default() };
        let run = if number % 3 == 0 {
            let wave = HarmonicWall {
                amplitude: 0.05,
                omega: draw.within(1.0, 20.0),
                phase: 0.4,
                offset: draw.within(-0.2, 0.2),
            };
            let mut moved = OnMovingWall { force, wall: wave };
            simulate_switched_rk(
                settings,
                restitution,
                &mut moved,
                span,
                start,
                output,
                &mut Silent,
            )?
        } else {
            simulate_switched_rk(
                settings,
                restitution,
                &mut force,
                span,
                start,
                output,
                &mut Silent,
            )?
        };
        bits.add_run(&run, span);
    }
    Ok(bits.0)
}

fn map(n: usize) -> Result<u64, Box<dyn std::error::Error>> {
    let oscillator = LinearForce {
        stiffness: 1.0,
        damping: 0.1,
        gravity: -1.0,
        amplitude: 0.6,
        omega: 0.9,
        phase: 0.0,
    };
    let map = ImpactMap::new(&oscillator, Restitution::from_e(0.8)?)?;
    let (mut bits, mut orbit) = (Bits(0), vec![[0.0; 2]; n]);
    map.orbit(0.3, 1.0, 0, &mut orbit);
    for &[phase, u] in &orbit {
        let (next, jacobian) = map.with_jacobian(phase, u);
        bits.add([next.phase, next.u, next.duration]);
        bits.add(jacobian.into_iter().flatten());
    }
    Ok(bits.0)
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    println!("3000 runs {:016x}", runs(3000)?);
    println!("100000 impacts of the map {:016x}", map(100_000)?);
    Ok(())
}
