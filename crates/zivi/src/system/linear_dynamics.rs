//! Linear systems as models, and their partial derivatives.
//!
//! A linear system as a model of a run.

use std::sync::Arc;

use super::dynamics::{Dynamics, Layout};
use super::linear_system::{GapMotion, LinearGap, LinearSystem};
use super::partials::{DifferentiableDynamics, Neighbours, TimedState, MOVES, WEIGHTS};
use crate::numeric::coordinates::LinearMap;
use crate::numeric::dense::sum_of_products;

/// A linear system that is ready to be evaluated.
#[derive(Clone, Debug)]
pub struct LinearDynamics {
    system: Arc<LinearSystem>,
    layout: Layout,
    /// `(K, C)`.
    matrix: LinearMap,
    /// `(q, q')`.
    state: Vec<f64>,
    /// The values of a table.
    values: Vec<f64>,
    /// The loads, and the time that they are at: at an impact it stands.
    load: Vec<f64>,
    at: f64,
}

impl LinearDynamics {
    /// For runs of this system.
    #[must_use]
    pub fn new(system: Arc<LinearSystem>) -> Self {
        let layout = Layout::smooth(system.load.len(), system.gaps.len());
        let n = layout.n;
        let entry = |i: usize, j: usize| match j.checked_sub(n) {
            None => -system.stiffness[i * n + j],
            Some(j) => -system.damping[i * n + j],
        };
        let matrix = LinearMap::new(n, 2 * n, entry);
        let [values, load] = [(); 2].map(|()| vec![0.0; n]);
        let state = vec![0.0; 2 * n];
        Self { system, layout, matrix, state, values, load, at: f64::NAN }
    }

    /// Computes the loads.
    fn load_at(&mut self, t: f64) {
        let Self { system, values, load, .. } = self;
        load.copy_from_slice(&system.load);
        for wave in &system.waves {
            let swing = (wave.omega * t + wave.phase).cos();
            for (load, amplitude) in load.iter_mut().zip(&wave.amplitude) {
                *load += amplitude * swing;
            }
        }
        for table in &system.tables {
            table.values(t, values);
            load.iter_mut().zip(&*values).for_each(|(load, value)| *load += value);
        }
        self.at = t;
    }

    /// `p + ... - K q - C q'`.
    fn force(&mut self, t: f64, q: &[f64], w: &[f64], out: &mut [f64]) {
        if t != self.at {
            self.load_at(t);
        }
        let Self { matrix, state, load, .. } = self;
        out.copy_from_slice(load);
        let (first, second) = state.split_at_mut(q.len());
        first.copy_from_slice(q);
        second.copy_from_slice(w);
        matrix.add(state, out);
    }
}

impl<E> Dynamics<E> for LinearDynamics {
    fn layout(&self) -> Layout {
        self.layout
    }

    fn evaluate(&mut self, t: f64, q: &[f64], w: &[f64], out: &mut [f64]) -> Result<(), E> {
        let layout = self.layout;
        out[layout.mass()].copy_from_slice(&self.system.mass);
        for (row, it) in out[layout.gradient()].chunks_exact_mut(layout.n).zip(&self.system.gaps) {
            row.copy_from_slice(&it.normal);
        }
        Dynamics::<E>::evaluate_again(self, t, q, w, out)
    }

    fn evaluate_again(&mut self, t: f64, q: &[f64], w: &[f64], out: &mut [f64]) -> Result<(), E> {
        self.force(t, q, w, &mut out[self.layout.force()]);
        Dynamics::<E>::evaluate_gaps(self, t, q, w, out)
    }

    fn evaluate_gaps(&mut self, t: f64, q: &[f64], _: &[f64], out: &mut [f64]) -> Result<(), E> {
        let (m, layout) = (self.layout.m, self.layout);
        let (positions, rest) = out[layout.gap().start..].split_at_mut(m);
        let (_, rest) = rest.split_at_mut(m * layout.n);
        let (curvatures, rates) = rest.split_at_mut(m);
        let numbers = positions.iter_mut().zip(curvatures).zip(rates);
        for (it, ((gap, curvature), of_time)) in self.system.gaps.iter().zip(numbers) {
            let [position, rate, acceleration] = it.motion.at(t);
            let along: f64 = it.normal.iter().zip(q).map(|(n, q)| n * q).sum();
            *gap = along + it.offset - position;
            *curvature = -acceleration;
            *of_time = -rate;
        }
        Ok(())
    }

    fn linear(&self) -> Option<&Arc<LinearSystem>> {
        Some(&self.system)
    }
}

// A linear system with its partial derivatives, in closed form.
//
// The derivatives of its numbers by a parameter are a system themselves, `M_p`, `C_p`, ..:
//
// ```text
// F_q = -K      F_w = -C      F_t = -sum_j w_j p_j sin(w_j t + phi_j) + sum_j u_j'
// F_p = p_p - K_p q - C_p q' + sum_j (p_j,p cos - p_j (w_j,p t + phi_j,p) sin)(w_j t + phi_j) + sum_j u_j,p
// ```

/// A linear system that is ready to be evaluated, and its derivatives by parameters.
#[derive(Clone, Debug)]
pub struct LinearPartials {
    dynamics: LinearDynamics,
    system: Arc<LinearSystem>,
    rates: Vec<Arc<LinearSystem>>,
}

impl LinearPartials {
    /// A system with the derivatives of its numbers by parameter; `None` if sizes differ.
    #[must_use]
    pub fn new(system: Arc<LinearSystem>, rates: Vec<Arc<LinearSystem>>) -> Option<Self> {
        let alike = |it: &Arc<LinearSystem>| {
            LinearSystem::combination(&[(1.0, &*system), (1.0, it)]).is_some()
        };
        let fits = rates.iter().all(alike);
        let dynamics = LinearDynamics::new(system.clone());
        fits.then_some(Self { dynamics, system, rates })
    }

    /// The same by differences of systems with moved parameters, exact but for rounding where the
    /// numbers are polynomials of them up to the sixth degree; none where more than numbers moves.
    #[must_use]
    pub fn differenced(
        system: Arc<LinearSystem>,
        moved: &[Neighbours<Arc<LinearSystem>>],
    ) -> Option<Self> {
        let rate = |Neighbours { step, systems }: &Neighbours<Arc<LinearSystem>>| {
            let weight = |k: usize| WEIGHTS[MOVES[k].abs() as usize - 1] * MOVES[k].signum() / step;
            // numbers that stay leave exactly zero if those of one distance are adjacent
            let parts = [3, 2, 4, 1, 5, 0].map(|k| (weight(k), &*systems[k]));
            LinearSystem::combination(&parts).map(Arc::new)
        };
        Self::new(system, moved.iter().map(rate).collect::<Option<_>>()?)
    }

    /// By the time.
    fn by_time(&self, t: f64, layout: Layout, out: &mut [f64]) {
        let mut powers = [0.0; 4];
        let system = &*self.system;
        let force = &mut out[layout.force()];
        for wave in &system.waves {
            let swing = -wave.omega * (wave.omega * t + wave.phase).sin();
            force.iter_mut().zip(&wave.amplitude).for_each(|(out, p)| *out += p * swing);
        }
        for table in &system.tables {
            for (column, out) in force.iter_mut().enumerate() {
                *out += table.motion(t, column)[1];
            }
        }
        for (i, gap) in system.gaps.iter().enumerate() {
            let [_, speed, acceleration] = gap.motion.at(t);
            let jerk = match &gap.motion {
                GapMotion::Fixed => 0.0,
                GapMotion::Harmonic(wall) => -wall.omega * wall.omega * speed,
                GapMotion::Table(table) => {
                    table.expansion(t, 0, &mut powers);
                    6.0 * powers[3]
                }
            };
            out[layout.gap().start + i] = -speed;
            out[layout.rate().start + i] = -acceleration;
            out[layout.curvature().start + i] = -jerk;
        }
    }

    /// By a parameter.
    fn by_parameter(&self, at: TimedState<'_>, rate: &LinearSystem, out: &mut [f64]) {
        let (layout, n, system) =
            (Dynamics::<()>::layout(&self.dynamics), at.q.len(), &self.system);
        out[layout.mass()].copy_from_slice(&rate.mass);
        let force = &mut out[layout.force()];
        force.copy_from_slice(&rate.load);
        for (i, out) in force.iter_mut().enumerate() {
            let along = |matrix: &[f64], x: &[f64]| -> f64 {
                matrix[i * n..][..n].iter().zip(x).map(|(a, x)| a * x).sum()
            };
            *out -= along(&rate.stiffness, at.q) + along(&rate.damping, at.w);
            for (wave, by) in system.waves.iter().zip(&rate.waves) {
                let (sin, cos) = (wave.omega * at.t + wave.phase).sin_cos();
                let turned = by.omega * at.t + by.phase;
                *out += by.amplitude[i] * cos - wave.amplitude[i] * turned * sin;
            }
            *out += rate.tables.iter().map(|table| table.value(at.t, i)).sum::<f64>();
        }
        for (i, (gap, by)) in system.gaps.iter().zip(&rate.gaps).enumerate() {
            let [position, speed, acceleration] = of_wall(&gap.motion, &by.motion, at.t);
            let along: f64 = by.normal.iter().zip(at.q).map(|(n, q)| n * q).sum();
            out[layout.gap().start + i] = along + by.offset - position;
            out[layout.gradient()][i * n..][..n].copy_from_slice(&by.normal);
            out[layout.curvature().start + i] = -acceleration;
            out[layout.rate().start + i] = -speed;
        }
    }
}

/// The derivatives of `[w, w', w'']` by a parameter.
fn of_wall(motion: &GapMotion, rate: &GapMotion, t: f64) -> [f64; 3] {
    match (motion, rate) {
        (GapMotion::Harmonic(wall), GapMotion::Harmonic(by)) => {
            let (sin, cos) = (wall.omega * t + wall.phase).sin_cos();
            let (a, w, turned) = (wall.amplitude, wall.omega, by.omega * t + by.phase);
            let speed = by.amplitude * w + a * by.omega;
            let acceleration = speed * w + a * w * by.omega;
            [
                by.offset + by.amplitude * cos - a * turned * sin,
                -speed * sin - a * w * turned * cos,
                -acceleration * cos + a * w * w * turned * sin,
            ]
        }
        (_, rate) => rate.at(t),
    }
}

impl<E> Dynamics<E> for LinearPartials {
    fn layout(&self) -> Layout {
        Dynamics::<E>::layout(&self.dynamics)
    }

    fn evaluate(&mut self, t: f64, q: &[f64], w: &[f64], out: &mut [f64]) -> Result<(), E> {
        self.dynamics.evaluate(t, q, w, out)
    }

    fn evaluate_again(&mut self, t: f64, q: &[f64], w: &[f64], out: &mut [f64]) -> Result<(), E> {
        self.dynamics.evaluate_again(t, q, w, out)
    }

    fn evaluate_gaps(&mut self, t: f64, q: &[f64], w: &[f64], out: &mut [f64]) -> Result<(), E> {
        self.dynamics.evaluate_gaps(t, q, w, out)
    }

    fn linear(&self) -> Option<&Arc<LinearSystem>> {
        Some(&self.system)
    }
}

impl<E> DifferentiableDynamics<E> for LinearPartials {
    fn parameters(&self) -> usize {
        self.rates.len()
    }

    fn partials(&mut self, at: TimedState<'_>, by: &[usize], out: &mut [f64]) -> Result<(), E> {
        let layout = Dynamics::<E>::layout(self);
        let (length, n) = (layout.len(), layout.n);
        out.fill(0.0);
        let mut rows = out.chunks_exact_mut(length);
        if let Some(out) = rows.next() {
            self.by_time(at.t, layout, out);
        }
        for j in 0..2 * n {
            let Some(out) = rows.next() else { break };
            let (matrix, column) = match j < n {
                true => (&self.system.stiffness, j),
                false => (&self.system.damping, j - n),
            };
            for (i, out) in out[layout.force()].iter_mut().enumerate() {
                *out = -matrix[i * n + column];
            }
            if j < n {
                for (out, gap) in out[layout.gap()].iter_mut().zip(&self.system.gaps) {
                    *out = gap.normal[column];
                }
            }
        }
        for (&parameter, out) in by.iter().zip(rows) {
            self.by_parameter(at, &self.rates[parameter], out);
        }
        Ok(())
    }

    fn linear_rate(&self, parameter: usize) -> Option<&Arc<LinearSystem>> {
        self.rates.get(parameter)
    }
}

// Constant parts of a mechanical system: constants, flat gaps, belts.
//
// ```text
// g_i = n_i . q + c_i - w_i(t)      h_i = -w_i''      g_t,i = -w_i'
// ```
//
// The surface of a channel of friction moves along its tangent with a wall: `beta = -w'`, `k = -w''`.

/// The numbers of an evaluation that need no function.
#[derive(Clone, Debug)]
pub struct FlatParts {
    layout: Layout,
    /// An evaluation with the constants; the places of variable parts are zero.
    row: Vec<f64>,
    /// Flat gaps by their numbers.
    gaps: Vec<(usize, FlatGap)>,
    /// Surfaces that move, by channel.
    belts: Vec<(usize, GapMotion)>,
    /// Channels that hold in stick what they take in slip.
    without_static: Vec<usize>,
    /// Whether `M` and `N` are among the constants.
    has_constant_matrices: bool,
}

/// The value of a flat gap: its normal is among the constants.
#[derive(Clone, Debug)]
struct FlatGap {
    /// Coordinates on which it depends: those from here on.
    first: usize,
    normal: Vec<f64>,
    offset: f64,
    motion: GapMotion,
}

impl FlatGap {
    fn new(gap: LinearGap) -> Self {
        let LinearGap { normal, offset, motion } = gap;
        let is_there = |n: &f64| *n != 0.0;
        let first = normal.iter().position(is_there).unwrap_or(0);
        let end = normal.iter().rposition(is_there).map_or(0, |last| last + 1);
        Self { first, normal: normal[first..end].to_vec(), offset, motion }
    }

    /// `n . q + c`.
    fn value(&self, q: &[f64]) -> f64 {
        sum_of_products(&self.normal, &q[self.first..][..self.normal.len()]) + self.offset
    }
}

impl FlatParts {
    /// Constants in the places of an evaluation, flat gaps by number, moving surfaces and channels
    /// without static limits by channel; `None` where sizes or numbers do not fit together.
    #[must_use]
    pub fn new(
        layout: Layout,
        row: Vec<f64>,
        gaps: Vec<(usize, LinearGap)>,
        belts: Vec<(usize, GapMotion)>,
        without_static: Vec<usize>,
    ) -> Option<Self> {
        let fits = row.len() == layout.len()
            && gaps.iter().all(|(i, gap)| *i < layout.m && gap.normal.len() == layout.n)
            && belts.iter().map(|it| &it.0).chain(&without_static).all(|c| *c < layout.p);
        let gaps = gaps.into_iter().map(|(i, gap)| (i, FlatGap::new(gap))).collect();
        fits.then_some(Self {
            layout,
            row,
            gaps,
            belts,
            without_static,
            has_constant_matrices: false,
        })
    }

    /// The same where no function gives parts of `M`, `N` or `B`.
    #[must_use]
    pub fn with_constant_matrices(self) -> Self {
        Self { has_constant_matrices: true, ..self }
    }

    /// How many coordinates, gaps and channels of friction there are.
    #[must_use]
    pub fn layout(&self) -> Layout {
        self.layout
    }

    /// Whether `M` and `N` never change.
    #[must_use]
    pub fn has_constant_matrices(&self) -> bool {
        self.has_constant_matrices
    }

    /// Writes constants, flat gaps and belts.
    pub fn write(&self, t: f64, q: &[f64], out: &mut [f64]) {
        out.copy_from_slice(&self.row);
        self.write_gaps(t, q, out);
        self.write_belts(t, out);
    }

    /// The same over an earlier evaluation, whose `M`, `N` and `B` stay.
    pub fn write_again(&self, t: f64, q: &[f64], out: &mut [f64]) {
        if !self.has_constant_matrices {
            return self.write(t, q, out);
        }
        let (force, limits) = (self.layout.force(), self.layout.curvature().start..self.row.len());
        out[force.clone()].copy_from_slice(&self.row[force]);
        out[limits.clone()].copy_from_slice(&self.row[limits]);
        self.write_gaps(t, q, out);
        self.write_belts(t, out);
    }

    /// Writes values, curvatures and rates of the flat gaps alone.
    pub fn write_gaps(&self, t: f64, q: &[f64], out: &mut [f64]) {
        let (value, curvature, rate) =
            (self.layout.gap().start, self.layout.curvature().start, self.layout.rate().start);
        for (i, gap) in &self.gaps {
            let along = gap.value(q);
            if let GapMotion::Fixed = gap.motion {
                out[value + i] = along;
            } else {
                let [position, speed, acceleration] = gap.motion.at(t);
                out[value + i] = along - position;
                out[curvature + i] = -acceleration;
                out[rate + i] = -speed;
            }
        }
    }

    fn write_belts(&self, t: f64, out: &mut [f64]) {
        let m = self.layout.m;
        let (curvature, rate) = (self.layout.curvature().start + m, self.layout.rate().start + m);
        for (channel, motion) in &self.belts {
            let [_, speed, acceleration] = motion.at(t);
            out[curvature + channel] = -acceleration;
            out[rate + channel] = -speed;
        }
    }

    /// Copies the limits while slipping to those while sticking, where there are no others. Functions
    /// write before that.
    pub fn finish(&self, out: &mut [f64]) {
        let (slip, stick) = (self.layout.limit().start, self.layout.static_limit().start);
        for channel in &self.without_static {
            out[stick + channel] = out[slip + channel];
        }
    }
}

#[cfg(test)]
mod linear_partials_tests {
    use std::convert::Infallible;

    use super::*;
    use crate::system::linear_system::{LinearGap, LoadWave};
    use crate::system::partials::{parameter_step, DifferencedDynamics};
    use crate::system::time_table::TimeTable;
    use crate::HarmonicWall;

    /// A system of two coordinates all of whose numbers depend on `p`.
    fn system(p: f64) -> LinearSystem {
        let table = |a: f64| {
            let ends = Some([vec![0.0; 2], vec![p; 2]]);
            let coefficients = (0..16).map(|k| a * p * f64::from(k % 5) + 0.3).collect();
            Arc::new(TimeTable::new(vec![0.0, 1.0, 2.5], coefficients, (4, 2), ends).unwrap())
        };
        let wall = HarmonicWall { amplitude: 0.2 + p, omega: 3.0 * p, phase: p, offset: 0.1 * p };
        let motions = [GapMotion::Harmonic(wall), GapMotion::Table(table(0.1)), GapMotion::Fixed];
        let gap = |(i, motion): (usize, GapMotion)| LinearGap {
            normal: vec![1.0 - p * i as f64, p],
            offset: p * p,
            motion,
        };
        LinearSystem {
            mass: vec![2.0 + p, 0.1 * p, 0.1 * p, 1.5],
            damping: vec![0.2 * p, 0.3, -0.1, p],
            stiffness: vec![4.0, -p, -p, 3.0 * p * p],
            load: vec![p, -1.0],
            waves: vec![LoadWave { amplitude: vec![p, 2.0], omega: 2.0 + p, phase: 0.3 * p }],
            tables: vec![table(1.0)],
            gaps: motions.into_iter().enumerate().map(gap).collect(),
        }
    }

    fn neighbours(p: f64) -> Neighbours<Arc<LinearSystem>> {
        let step = parameter_step(p);
        Neighbours { step, systems: MOVES.map(|k| Arc::new(system(p + k * step))) }
    }

    #[test]
    fn they_are_those_of_differences() {
        let p = 0.7;
        let mut exact = LinearPartials::differenced(Arc::new(system(p)), &[neighbours(p)]).unwrap();
        let Neighbours { step, systems } = neighbours(p);
        let systems = systems.map(LinearDynamics::new);
        let dynamics = LinearDynamics::new(Arc::new(system(p)));
        let mut differences =
            DifferencedDynamics::new(dynamics, vec![Neighbours { step, systems }], 1.0);
        let length = Dynamics::<Infallible>::layout(&exact).len();
        let (mut found, mut wanted) = (vec![0.0; 6 * length], vec![0.0; 6 * length]);
        for (t, q, w) in [(0.4, [0.3, -1.0], [2.0, 0.7]), (1.7, [1.3, 0.2], [-0.4, 0.1])] {
            let at = TimedState { t, q: &q, w: &w };
            let Ok::<(), Infallible>(()) = exact.partials(at, &[0], &mut found);
            let Ok::<(), Infallible>(()) = differences.partials(at, &[0], &mut wanted);
            for (k, (found, wanted)) in found.iter().zip(&wanted).enumerate() {
                let error = (found - wanted).abs();
                assert!(error < 1e-9 * (1.0 + wanted.abs()), "{k} {found} {wanted}");
            }
        }
        assert_eq!(exact.rates[0].gaps[2].motion, GapMotion::Fixed);
        assert_eq!(exact.rates[0].mass[3], 0.0);
    }

    #[test]
    fn what_moves_more_than_numbers_has_none() {
        let (p, known) = (0.7, Arc::new(system(0.7)));
        let with = |change: &dyn Fn(&mut LinearSystem)| {
            let mut moved = neighbours(p);
            let mut other = system(p);
            change(&mut other);
            moved.systems[2] = Arc::new(other);
            LinearPartials::differenced(known.clone(), &[moved])
        };
        assert!(with(&|_| ()).is_some());
        assert!(with(&|it| it.waves.clear()).is_none());
        assert!(with(&|it| it.tables.clear()).is_none());
        assert!(with(&|it| it.gaps.truncate(2)).is_none());
        assert!(with(&|it| it.gaps.swap(0, 2)).is_none());
        let knots = TimeTable::new(vec![0.0, 1.1, 2.5], vec![0.0; 16], (4, 2), None).unwrap();
        assert!(with(&|it| it.tables[0] = Arc::new(knots.clone())).is_none());
        assert!(with(&|it| it.gaps[1].motion = GapMotion::Table(Arc::new(knots.clone()))).is_none());
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::HarmonicWall;

    const WALL: HarmonicWall =
        HarmonicWall { amplitude: 0.5, omega: 2.0, phase: 0.25, offset: 0.125 };

    fn parts() -> FlatParts {
        let layout = Layout { n: 2, m: 2, p: 1, k: 0 };
        let mut row = vec![0.0; layout.len()];
        row[layout.mass()].copy_from_slice(&[2.0, 0.5, 0.5, 1.0]);
        row[layout.limit().start] = 0.75;
        let flat =
            LinearGap { normal: vec![0.0, 3.0], offset: 1.0, motion: GapMotion::Harmonic(WALL) };
        let belts = vec![(0, GapMotion::Harmonic(WALL))];
        FlatParts::new(layout, row, vec![(1, flat)], belts, vec![0]).unwrap()
    }

    #[test]
    fn flat_gaps_and_belts_move_as_their_walls() {
        let (parts, t) = (parts(), 0.7);
        let layout = parts.layout();
        let mut out = vec![f64::NAN; layout.len()];
        parts.write(t, &[9.0, 0.25], &mut out);
        parts.finish(&mut out);
        let angle: f64 = 2.0 * t + 0.25;
        let (speed, acceleration) = (-angle.sin(), -2.0 * angle.cos());
        let near = |a: f64, b: f64| assert!((a - b).abs() < 1e-15, "{a} {b}");
        near(out[layout.gap()][1], 0.75 + 1.0 - 0.125 - 0.5 * angle.cos());
        for row in [1, 2] {
            near(out[layout.rate()][row], -speed);
            near(out[layout.curvature()][row], -acceleration);
        }
        assert_eq!(out[layout.mass()], [2.0, 0.5, 0.5, 1.0]);
        assert_eq!((out[layout.limit().start], out[layout.static_limit().start]), (0.75, 0.75));
    }

    #[test]
    fn a_second_evaluation_forgets_what_others_wrote() {
        let (parts, q) = (parts().with_constant_matrices(), [1.0, 2.0]);
        let (mut once, mut again) =
            (vec![0.0; parts.layout().len()], vec![0.0; parts.layout().len()]);
        parts.write(0.5, &q, &mut once);
        parts.write(0.1, &[3.0, 4.0], &mut again);
        again[parts.layout().force()].fill(7.0);
        again[parts.layout().limit()].fill(7.0);
        parts.write_again(0.5, &q, &mut again);
        assert_eq!(once, again);
    }

    #[test]
    fn sizes_that_do_not_fit_are_told() {
        let layout = Layout { n: 1, m: 1, p: 0, k: 0 };
        let gap = |normal| LinearGap { normal, offset: 0.0, motion: GapMotion::Fixed };
        let with = |row, gaps, belts| FlatParts::new(layout, row, gaps, belts, vec![]);
        let row = || vec![0.0; layout.len()];
        assert!(with(row(), vec![(0, gap(vec![1.0]))], vec![]).is_some());
        assert!(with(vec![0.0], vec![], vec![]).is_none());
        assert!(with(row(), vec![(1, gap(vec![1.0]))], vec![]).is_none());
        assert!(with(row(), vec![(0, gap(vec![1.0, 2.0]))], vec![]).is_none());
        assert!(with(row(), vec![], vec![(0, GapMotion::Fixed)]).is_none());
    }
}
