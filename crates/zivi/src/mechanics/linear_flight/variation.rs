//! Derivatives of the motion along the flights, by its start and by parameters.
//!
//! For `dy/ds = Y y` a column satisfies `du/ds = Y u + Y_p y` with the derivative `Y_p` with
//! respect to its parameter, if any. Both are power series with one recurrence,
//!
//! ```text
//! u_(k+1) = (Y u_k + Y_p y_k)/(k + 1)      y_(k+1) = Y y_k/(k + 1)
//! ```
//!
//! and a gap or a force `r . y` has the series of `r . u + r_p . y`. With `D F = W` of equation (1) of
//! [`super::propagation`] the forces have the derivative `F_p = D^-1 (W_p - D_p F)`.

use std::sync::Arc;

use super::propagation::{
    contact_forces, factored_mobility, free_acceleration, solve_rows, wall_accelerations, Free,
    Propagation,
};
use super::LinearFlight;
use crate::mechanics::kinetics::Undetermined;
use crate::mechanics::mode::State;
use crate::numeric::coordinates::LinearMap;
use crate::numeric::dense::{axpy, dot};
use crate::numeric::power_series::{value_and_slope, Series, TERMS};
use crate::record::gap_set::GapSet;
use crate::record::status::Failure;
use crate::system::linear_system::LinearSystem;

/// A step that was flown, or the part of it up to an event.
#[derive(Clone, Copy)]
pub(in crate::mechanics) struct Flown<'a> {
    pub(in crate::mechanics) from: &'a State,
    /// The time where it begins, at which the system is evaluated.
    pub(in crate::mechanics) t: f64,
    pub(in crate::mechanics) closed: GapSet,
    /// Its length (s).
    pub(in crate::mechanics) length: f64,
}

/// How the parameters move the flights.
#[derive(Clone, Debug)]
pub(in crate::mechanics) struct FlightRates {
    /// Derivatives of the system without contacts, by parameter.
    free: Vec<Free>,
    /// Their effect on the motion with a set of closed gaps, by parameter, for steps of length `h`.
    known: Vec<(GapSet, Vec<Arc<ParameterVariation>>)>,
    h: f64,
}

impl FlightRates {
    /// Of a system whose numbers have these derivatives by its parameters.
    pub(in crate::mechanics) fn new<'a>(
        flight: &LinearFlight,
        system: &LinearSystem,
        rates: impl Iterator<Item = &'a LinearSystem>,
    ) -> Self {
        let free = rates.map(|rate| flight.free.rates(system, rate)).collect();
        Self { free, known: vec![], h: 0.0 }
    }

    fn variations(
        &mut self,
        flight: &LinearFlight,
        set: GapSet,
    ) -> Result<Vec<Arc<ParameterVariation>>, Undetermined> {
        if self.h != flight.h {
            (self.h, self.known) = (flight.h, vec![]);
        }
        if let Some((_, known)) = self.known.iter().find(|(of, _)| *of == set) {
            return Ok(known.clone());
        }
        let new =
            self.free.iter().map(|rate| ParameterVariation::new(&flight.free, rate, set, self.h));
        let new: Vec<_> = new.map(|it| it.map(Arc::new)).collect::<Result<_, _>>()?;
        self.known.push((set, new.clone()));
        Ok(new)
    }
}

/// How a parameter moves the motion with a set of gaps closed.
#[derive(Clone, Debug)]
struct ParameterVariation {
    /// The rows of `Y_p`, times `h`, that give accelerations.
    acceleration: LinearMap,
    /// By gap the weights `r` of `y` in its value or force, and `r_p`.
    gaps: Vec<[Vec<f64>; 2]>,
}

impl ParameterVariation {
    fn new(free: &Free, rate: &Free, set: GapSet, h: f64) -> Result<Self, Undetermined> {
        let (n, size, count) = (free.n, free.size(), set.len());
        let closed: Vec<usize> = set.iter().collect();
        let forces = contact_forces(free, set, h)?;
        let factor = factored_mobility(free, &closed)?;
        let (rows, by_rate) = (free_acceleration(free, h), free_acceleration(rate, h));
        let mut turned = wall_accelerations((free, rate), &closed, h);
        for (wall, &i) in turned.iter_mut().zip(&closed) {
            let of_drives = &mut wall[2 * n..];
            rate.drives.add_differentiated_twice(&free.drives, h, free.wall(i), of_drives);
            for c in 0..n {
                axpy(wall, -free.normal(i)[c], &by_rate[c]);
                axpy(wall, -rate.normal(i)[c], &rows[c]);
            }
            wall.iter_mut().for_each(|it| *it /= h * h);
            for (&j, force) in closed.iter().zip(&forces) {
                let mobility =
                    dot(rate.normal(i), free.mobility(j)) + dot(free.normal(i), rate.mobility(j));
                axpy(wall, -mobility, force);
            }
        }
        solve_rows(&factor, count, &mut turned);
        let mut acceleration = by_rate;
        for ((&gap, force), by) in closed.iter().zip(&forces).zip(&turned) {
            for (c, row) in acceleration.iter_mut().enumerate() {
                axpy(row, h * h * rate.mobility(gap)[c], force);
                axpy(row, h * h * free.mobility(gap)[c], by);
            }
        }
        let mut pressed = forces.into_iter().zip(turned);
        let gaps = (0..free.gaps()).map(|i| match set.has(i) {
            true => pressed.next().map_or([vec![], vec![]], |(force, by)| [force, by]),
            false => [free.gap(i), rate.gap(i)],
        });
        Ok(Self {
            gaps: gaps.collect(),
            acceleration: LinearMap::new(n, size, |i, j| acceleration[i][j]),
        })
    }
}

impl LinearFlight {
    /// Propagates the derivatives `x` of coordinates and gaps and `v` of their rates over a
    /// completed step, with respect to a parameter if given.
    pub(in crate::mechanics) fn differentiate<E>(
        &mut self,
        flown: Flown<'_>,
        rates: &mut FlightRates,
        parameter: Option<usize>,
        (x, v): (&mut [f64], &mut [f64]),
    ) -> Result<(), Failure<E>> {
        let Flown { t, closed, length, .. } = flown;
        if length <= 0.0 {
            return Ok(());
        }
        let motion = self.propagation(closed)?;
        let (n, h) = (self.free.n, self.h);
        let part = length / h;
        let mut u = vec![0.0; self.free.size()];
        u[..n].copy_from_slice(&x[..n]);
        u[n..2 * n].iter_mut().zip(&*v).for_each(|(u, v)| *u = h * v);
        let series = match parameter {
            None => {
                let series = motion.gaps.iter().map(|gap| gap.series(&u)).collect();
                match part == 1.0 {
                    true => motion.whole(&u, &mut self.end),
                    false => motion.part(&self.free, (h, part), &mut u, &mut self.end, None),
                }
                series
            }
            Some(parameter) => {
                let variation = &rates.variations(self, closed)?[parameter];
                let rate = &rates.free[parameter];
                rate.drives.write_rates(&self.free.drives, t, h, &mut u[2 * n..]);
                self.moved(flown, (&motion, variation, rate), &mut u)
            }
        };
        x[..n].copy_from_slice(&self.end[..n]);
        v[..n].iter_mut().zip(&self.end[n..]).for_each(|(v, end)| *v = end / h);
        for (i, mut a) in series.into_iter().enumerate().filter(|&(i, _)| !closed.has(i)) {
            // gaps are carried along, as in the motion
            (a[0], a[1]) = (x[n + i], h * v[n + i]);
            let [value, slope] = value_and_slope(&a, part);
            (x[n + i], v[n + i]) = (value, slope / h);
        }
        Ok(())
    }

    /// The series of the gaps for a column by a parameter, whose end is in `self.end` then.
    fn moved(
        &mut self,
        Flown { from, t, length, .. }: Flown<'_>,
        (motion, variation, rate): (&Propagation, &ParameterVariation, &Free),
        u: &mut [f64],
    ) -> Vec<Series> {
        let (n, h, free) = (self.free.n, self.h, &self.free);
        let part = length / h;
        let mut y = vec![0.0; u.len()];
        y[..n].copy_from_slice(&from.x[..n]);
        y[n..2 * n].iter_mut().zip(&from.xdot).for_each(|(y, v)| *y = h * v);
        free.drives.write(t, h, &mut y[2 * n..]);
        let mut series = vec![[0.0; TERMS]; variation.gaps.len()];
        let (mut acceleration, mut more, mut power) = (vec![0.0; n], vec![0.0; n], 1.0);
        self.end.fill(0.0);
        for k in 0..TERMS {
            self.end.iter_mut().zip(&*u).for_each(|(end, u)| *end += power * u);
            for (a, [row, by]) in series.iter_mut().zip(&variation.gaps) {
                a[k] = dot(row, u) + dot(by, &y);
            }
            let factor = 1.0 / (k + 1) as f64;
            power *= part;
            more.fill(0.0);
            variation.acceleration.add(&y, &mut more);
            motion.advance(free, (h, factor), u, &mut acceleration);
            axpy(&mut u[n..2 * n], factor, &more);
            rate.drives.add_advance(h, factor, &y[2 * n..], &mut u[2 * n..]);
            motion.advance(free, (h, factor), &mut y, &mut acceleration);
        }
        series
    }

    /// The gap in the last step, by the part of a step of full length.
    pub(in crate::mechanics) fn series(&self, gap: usize) -> &Series {
        &self.series[gap]
    }

    /// The length of a step (s).
    pub(in crate::mechanics) fn step(&self) -> f64 {
        self.h
    }
}
