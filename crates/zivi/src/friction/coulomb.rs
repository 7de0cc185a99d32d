//! Many contacts with friction that act on each other.
//!
//! ```text
//! v = b + D x      0 <= p  perp  v_n >= 0            f in -mu p Sign(v_t),   -L Sign(v_t) in a joint   (1)
//! x_j+1 solves (1) with D + eps I and b - eps x_j                                                     (2)
//! ```
//!
//! Proximal steps (2) make singular `D` regular, and each is solved contact by contact (Gauss-Seidel, M. Jean and
//! J. J. Moreau). Of planar contacts they are needed for the pattern alone, whose equations are solved exactly
//! afterwards. Where slips have directions Newton's method solves the equations of the pattern, for forces and
//! angles, by the shortest steps: the first pattern that obeys (1) without the proximal term is the solution. It
//! starts from no forces at all and depends on the order of contacts by rounding only.

use crate::friction::local::{LocalContact, LocalSlip};
use crate::numeric::dense::dot;
use crate::numeric::elimination::{Elimination, Singular};

/// Most patterns of stick and slip that are tried one by one.
pub(super) const MOST_PATTERNS: usize = 256;
/// The same where the steps find none that obeys the laws: after these it is known that there is none.
pub(super) const ALL_PATTERNS: usize = 1 << 14;
/// The proximal parameter, relative to the diagonal.
const PROXIMAL: f64 = 0.1;
/// Most proximal steps, and most sweeps over all contacts in one of them.
const STEPS: usize = 60;
const SWEEPS: usize = 3000;
/// Changes below this part of the largest number end the sweeps, and the proximal steps.
const SETTLED: f64 = 1e-13;
const STEADY: f64 = 1e-11;
/// Rates below this part of the largest term are none.
const STILL: f64 = 1e-9;
/// Newton steps on a pattern, and how far its equations and inequalities may be violated, relative to the largest
/// term.
const POLISH: usize = 25;
const SOLVED: f64 = 1e-12;
const OBEYED: f64 = 1e-11;
/// Rates that differ by more, relative to the largest term, are others.
const OTHER: f64 = 1e-6;
/// Rates of dependent rows agree to this part of the largest term.
const AGREES: f64 = 1e-7;
/// Singular values below this part of the largest are zero.
const SINGULAR: f64 = 1e-9;
/// Newton's method turns a direction by at most this angle in a step.
const MOST_TURN: f64 = 1.0;
/// Sweeps before the first trial of the pattern of regular contacts; the number doubles after each.
const FIRST_TRIAL: usize = 3;

/// Contact or friction site.
#[derive(Clone, Copy, Debug)]
pub(super) enum Site {
    /// A gap with its row of the problem.
    Gap { normal: usize, friction: Option<Rough> },
    /// A joint with its row, and the limits of its force in slip and in stick.
    Joint { row: usize, limits: (f64, f64) },
    /// A gap with two directions of friction: its rows, the coefficients in slip and in stick, and the direction of a
    /// slip that goes on.
    Cone { rows: [usize; 3], mu: (f64, f64), heading: Option<[f64; 2]> },
}

/// The friction of a gap.
#[derive(Clone, Copy, Debug)]
pub(super) struct Rough {
    pub(super) row: usize,
    /// The coefficients in slip and in stick.
    pub(super) mu: (f64, f64),
    /// The sign of a continuing slip, zero if undetermined.
    pub(super) slip: f64,
}

/// Mode of a site: whether it is closed, and the sign of its slip, zero while sticking.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct SiteMode {
    pub(super) closed: bool,
    pub(super) slip: f64,
    /// The direction of a slip in two directions.
    pub(super) heading: Option<[f64; 2]>,
}

/// A solution of (1).
#[derive(Clone, Debug)]
pub(super) struct CoulombSolution {
    pub(super) modes: Vec<SiteMode>,
    /// The forces by row, where they solve the equations of the modes; none if only the modes are known.
    pub(super) forces: Option<Vec<f64>>,
    /// Whether forces that solve these equations too would move the system otherwise.
    pub(super) is_shared: bool,
    /// Whether a contact could also slip otherwise, with other rates.
    pub(super) is_ambiguous: bool,
}

/// The solution of one site.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum SiteBranch {
    Open,
    /// It is closed, and sticks if it has friction.
    Held,
    /// It slips with this sign.
    Slip(f64),
    /// It slips along this angle.
    Turn(f64),
    /// It goes on to slip in its direction.
    Kept([f64; 2]),
}

/// The problem (1), scaled to a diagonal of ones.
#[derive(Debug)]
pub(super) struct Coulomb {
    sites: Vec<Site>,
    d: Vec<f64>,
    b: Vec<f64>,
    root: Vec<f64>,
}

impl Coulomb {
    /// From `D` row by row and `b`.
    pub(super) fn new(sites: Vec<Site>, d: &[f64], b: &[f64]) -> Self {
        let k = b.len();
        let mut root: Vec<f64> = (0..k).map(|i| d[i * k + i].sqrt()).collect();
        for site in &sites {
            // one scale of both tangents: the cone stays round
            if let Site::Cone { rows: [_, one, other], .. } = *site {
                let larger = root[one].max(root[other]);
                (root[one], root[other]) = (larger, larger);
            }
        }
        let d = (0..k * k).map(|at| d[at] / root[at / k] / root[at % k]).collect();
        let b = b.iter().zip(&root).map(|(b, root)| b / root).collect();
        let both = |(one, other): (f64, f64), by: f64| (one * by, other * by);
        let scaled = |site: &Site| match *site {
            Site::Gap { normal, friction } => Site::Gap {
                normal,
                friction: friction.map(|rough| Rough {
                    mu: both(rough.mu, root[rough.row] / root[normal]),
                    ..rough
                }),
            },
            Site::Joint { row, limits } => Site::Joint { row, limits: both(limits, root[row]) },
            Site::Cone { rows, mu, heading } => {
                let [normal, tangent, _] = rows;
                Site::Cone { rows, mu: both(mu, root[tangent] / root[normal]), heading }
            }
        };
        Self { sites: sites.iter().map(scaled).collect(), d, b, root }
    }

    /// The solution within the allowed number of steps; `None` if numbers overflow.
    pub(super) fn solve(&self) -> Option<CoulombSolution> {
        let k = self.b.len();
        let mut x = vec![0.0; k];
        let mut branches = vec![SiteBranch::Open; self.sites.len()];
        let turns = self.sites.iter().any(|site| matches!(site, Site::Cone { .. }));
        // of dependent contacts the first pattern to obey would depend on their order
        let is_regular = turns && Elimination::new(self.d.clone(), k, SINGULAR).rank() == k;
        for _ in 0..STEPS {
            let shifted: Vec<f64> = self.b.iter().zip(&x).map(|(b, x)| b - PROXIMAL * x).collect();
            let before = x.clone();
            let mut trial = FIRST_TRIAL;
            for sweep in 1..=SWEEPS {
                let mut moved = 0.0_f64;
                for (site, branch) in self.sites.iter().zip(&mut branches) {
                    moved = moved.max(self.relax(site, &shifted, &mut x, branch));
                }
                if moved <= SETTLED * size(&x) {
                    break;
                }
                if is_regular && sweep == trial {
                    trial *= 2;
                    if let Some(solved) = self.judged(&x, &branches) {
                        return Some(solved);
                    }
                }
            }
            if !x.iter().all(|x| x.is_finite()) {
                return None;
            }
            if let Some(solved) = turns.then(|| self.judged(&x, &branches)).flatten() {
                return Some(solved);
            }
            let moved = x.iter().zip(&before).fold(0.0_f64, |a, (x, y)| a.max((x - y).abs()));
            if moved <= STEADY * size(&x) {
                break;
            }
        }
        if let Some(solved) = turns.then(|| self.by_convex_steps()).flatten() {
            return Some(solved);
        }
        let modes = self.modes(&x);
        Some(CoulombSolution { modes, forces: None, is_shared: false, is_ambiguous: false })
    }

    /// The contacts and joints.
    pub(super) fn sites(&self) -> &[Site] {
        &self.sites
    }

    /// `D` row by row, scaled.
    pub(super) fn d(&self) -> &[f64] {
        &self.d
    }

    /// The rates without forces, scaled.
    pub(super) fn b(&self) -> &[f64] {
        &self.b
    }

    /// The rates that forces make.
    pub(super) fn rates(&self, x: &[f64]) -> Vec<f64> {
        self.d.chunks_exact(x.len()).zip(&self.b).map(|(d, b)| b + dot(d, x)).collect()
    }

    /// Mode of each site with these forces.
    fn modes(&self, x: &[f64]) -> Vec<SiteMode> {
        let rates = self.rates(x);
        let still = STILL * (size(&self.b) + size(x));
        let sign = |v: f64| if v.abs() <= still { 0.0 } else { v.signum() };
        let mode = |site: &Site| match *site {
            Site::Gap { normal, friction, .. } => SiteMode {
                closed: rates[normal] <= still,
                slip: friction.map_or(0.0, |it| match it.slip {
                    0.0 => sign(rates[it.row]),
                    slip => slip,
                }),
                heading: None,
            },
            Site::Joint { row, .. } => {
                SiteMode { closed: true, slip: sign(rates[row]), heading: None }
            }
            Site::Cone { rows: [normal, one, other], heading, .. } => {
                let slip = [rates[one], rates[other]];
                let speed = slip[0].hypot(slip[1]);
                let found = (speed > still).then(|| slip.map(|it| it / speed));
                let heading = heading.or(found);
                let slip = f64::from(u8::from(heading.is_some()));
                SiteMode { closed: rates[normal] <= still, slip, heading }
            }
        };
        self.sites.iter().map(mode).collect()
    }

    /// The solution with the pattern of some forces, if that obeys (1), and whether it is the only one.
    pub(super) fn judged(&self, x: &[f64], branches: &[SiteBranch]) -> Option<CoulombSolution> {
        let (solved, at, rates) = self.polished(x, branches)?;
        let is_ambiguous = self.has_others(&at, &rates);
        Some(CoulombSolution { is_ambiguous, ..solved })
    }

    /// The solution with the pattern of some forces, if that obeys (1), its forces and rates.
    fn polished(
        &self,
        x: &[f64],
        branches: &[SiteBranch],
    ) -> Option<(CoulombSolution, SitePattern, Vec<f64>)> {
        let mut at = SitePattern { x: x.to_vec(), branches: branches.to_vec() };
        let most = size(&self.b);
        let mut last = f64::INFINITY;
        let (mut is_shared, mut is_dependent) = (false, false);
        for iteration in 0..POLISH {
            at.take_forces(&self.sites);
            let rates = self.rates(&at.x);
            let (left, equations) = at.equations(&self.sites, &rates);
            let unknowns = at.unknowns(&self.sites, most);
            if equations.is_empty() {
                break;
            }
            let worst = size(&left);
            let rounding = 4.0 * f64::EPSILON * (most + size(&at.x));
            let columns = unknowns.len();
            let matrix = self.slopes((&at, &rates, most), &equations, &unknowns);
            let parts = Singular::new(&matrix, equations.len(), columns);
            let rank = parts.rank(SINGULAR);
            let mut null = parts.null_space(rank).chunks_exact(columns);
            is_shared = null.any(|weights| self.moves(weights, &unknowns));
            is_dependent = rank < equations.len();
            if worst <= rounding || iteration > 1 && worst >= 0.5 * last {
                break;
            }
            last = worst;
            let right: Vec<f64> = left.iter().map(|left| -left).collect();
            at.step(&unknowns, &parts.solve(&right, rank), most)?;
        }
        at.take_forces(&self.sites);
        let rates = self.rates(&at.x);
        let (left, _) = at.equations(&self.sites, &rates);
        let all = most + size(&at.x);
        // rates of dependent rows agree to their rounding only, which may be large relative to small speeds
        let (left, most_left) = (size(&left), if is_dependent { AGREES } else { SOLVED });
        let obeyed = (OBEYED * all).max(4.0 * left);
        if left > most_left * all || at.excess(&self.sites, &rates) > obeyed || all.is_nan() {
            return None;
        }
        let mut modes = self.modes(&at.x);
        for ((mode, branch), site) in modes.iter_mut().zip(&at.branches).zip(&self.sites) {
            match *branch {
                SiteBranch::Open => (),
                SiteBranch::Held => (mode.closed, mode.slip, mode.heading) = (true, 0.0, None),
                SiteBranch::Slip(sign) => (mode.closed, mode.slip) = (true, sign),
                // a force at the edge of its cone that lets nothing slip holds
                SiteBranch::Turn(_) if site.speed(&rates) <= STILL * all => {
                    (mode.closed, mode.slip, mode.heading) = (true, 0.0, None);
                }
                SiteBranch::Turn(angle) => {
                    let (s, c) = angle.sin_cos();
                    (mode.closed, mode.slip, mode.heading) = (true, 1.0, Some([c, s]));
                }
                SiteBranch::Kept(heading) => {
                    (mode.closed, mode.slip, mode.heading) = (true, 1.0, Some(heading));
                }
            }
        }
        let forces = at.x.iter().zip(&self.root).map(|(x, root)| x / root).collect();
        Some((
            CoulombSolution { modes, forces: Some(forces), is_shared, is_ambiguous: false },
            at,
            rates,
        ))
    }

    /// How the equations of a pattern change with its unknowns.
    fn slopes(
        &self,
        (at, rates, most): (&SitePattern, &[f64], f64),
        equations: &[Vec<(usize, f64)>],
        unknowns: &[Unknown],
    ) -> Vec<f64> {
        let k = rates.len();
        let mut all = Vec::with_capacity(equations.len() * unknowns.len());
        for (i, equation) in equations.iter().enumerate() {
            for unknown in unknowns {
                let pairs = equation.iter().flat_map(|a| unknown.along.iter().map(move |b| (a, b)));
                let sum: f64 = pairs.map(|((r, a), (s, b))| a * b * self.d[r * k + s]).sum();
                let site = unknown.turns.filter(|site| at.equation_of(*site, i, &self.sites));
                let turned = site.map(|it| at.turned((&self.sites[it], it), rates, most));
                all.push(sum + turned.unwrap_or(0.0));
            }
        }
        all
    }

    /// Whether a change of the unknowns moves the system.
    fn moves(&self, weights: &[f64], unknowns: &[Unknown]) -> bool {
        let mut change = vec![0.0; self.b.len()];
        for (weight, unknown) in weights.iter().zip(unknowns) {
            unknown.along.iter().for_each(|(row, by)| change[*row] += weight * by);
        }
        self.d.chunks_exact(change.len()).any(|d| dot(d, &change).abs() > STILL)
    }

    /// Whether another solution is found from the alternatives of one contact, the forces of the others fixed.
    fn has_others(&self, at: &SitePattern, rates: &[f64]) -> bool {
        let most = size(&self.b) + size(&at.x);
        self.sites.iter().enumerate().any(|(number, site)| {
            let Site::Cone { rows, mu, heading: None } = *site else { return false };
            // a larger limit in stick has several solutions by itself
            if mu.1 > mu.0 || at.branches[number] == SiteBranch::Open {
                return false;
            }
            let contact = self.contact((rows, mu.0), rows.map(|row| rates[row]), &at.x, 0.0);
            let mut ways: Vec<([f64; 3], SiteBranch)> =
                contact.stick().into_iter().map(|force| (force, SiteBranch::Held)).collect();
            ways.extend(contact.slips().iter().map(|it| it.branch(mu.0)));
            ways.len() > 1
                && ways.into_iter().any(|(force, branch)| {
                    let mut other = at.clone();
                    (0..3).for_each(|i| other.x[rows[i]] = force[i]);
                    other.branches[number] = branch;
                    let found = self.polished(&other.x, &other.branches);
                    let differs = |of: &[f64]| {
                        of.iter().zip(rates).any(|(a, b)| (a - b).abs() > OTHER * most)
                    };
                    found.is_some_and(|it| differs(&it.2))
                })
        })
    }

    /// One contact with the forces of the others: its rates with all of them.
    fn contact(
        &self,
        (rows, mu): ([usize; 3], f64),
        rates: [f64; 3],
        x: &[f64],
        proximal: f64,
    ) -> LocalContact {
        let k = x.len();
        let entry = |i: usize, j: usize| self.d[i * k + j];
        let mut d = rows.map(|i| rows.map(|j| entry(i, j)));
        let own = rows.map(|row| x[row]);
        let b = [0, 1, 2].map(|i| rates[i] - dot(&d[i], &own));
        (0..3).for_each(|i| d[i][i] += proximal);
        LocalContact { d, b, mu }
    }

    /// Solves (2) at one site with the forces of the others, in this way: by how much its own have moved.
    fn relax(&self, site: &Site, b: &[f64], x: &mut [f64], branch: &mut SiteBranch) -> f64 {
        let k = b.len();
        let diagonal = 1.0 + PROXIMAL;
        let entry = |i: usize, j: usize| self.d[i * k + j];
        let others = |x: &[f64], i: usize| b[i] + dot(&self.d[i * k..][..k], x) - x[i];
        match *site {
            Site::Joint { row, limits: (slip, stick) } => {
                let held = -others(x, row) / diagonal;
                let force = if held.abs() <= stick { held } else { slip * held.signum() };
                *branch = if held.abs() <= stick {
                    SiteBranch::Held
                } else {
                    SiteBranch::Slip(-held.signum())
                };
                set(x, row, force)
            }
            Site::Cone { rows, mu: (mu, mu_s), heading } => {
                let rates = rows.map(|row| b[row] + dot(&self.d[row * k..][..k], x));
                let contact = self.contact((rows, mu), rates, x, PROXIMAL);
                let along = |[c, s]: [f64; 2], p: f64| [p, -mu * p * c, -mu * p * s];
                let stuck = LocalContact { mu: mu_s, ..contact };
                let force;
                (force, *branch) =
                    match (heading, heading.is_none().then(|| stuck.stick()).flatten()) {
                        (Some(heading), _) => {
                            let pressed = -contact.b[0] / contact.k(heading);
                            match pressed > 0.0 {
                                true => (along(heading, pressed), SiteBranch::Kept(heading)),
                                false => ([0.0; 3], SiteBranch::Open),
                            }
                        }
                        (None, Some(held)) => (held, SiteBranch::Held),
                        (None, None) => contact
                            .slips()
                            .first()
                            .map_or(([0.0; 3], SiteBranch::Open), |it| it.branch(mu)),
                    };
                (0..3).map(|i| set(x, rows[i], force[i])).fold(0.0, f64::max)
            }
            Site::Gap { normal, friction: None } => {
                let force = (-others(x, normal) / diagonal).max(0.0);
                *branch = if force > 0.0 { SiteBranch::Held } else { SiteBranch::Open };
                set(x, normal, force)
            }
            Site::Gap { normal, friction: Some(Rough { row, mu: (mu, mu_s), slip }) } => {
                let c = entry(normal, row);
                let g = others(x, normal) - c * x[row];
                let w = others(x, row) - c * x[normal];
                let sliding = |sign: f64| -g / (diagonal - mu * sign * c);
                let (p, f, sign) = if slip != 0.0 {
                    let p = sliding(slip).max(0.0);
                    (p, -mu * slip * p, slip)
                } else {
                    let determinant = diagonal * diagonal - c * c;
                    let p = (c * w - diagonal * g) / determinant;
                    let f = (c * g - diagonal * w) / determinant;
                    let slides = |sign: f64| {
                        let p = sliding(sign);
                        let slip = w + c * p - diagonal * mu * sign * p;
                        (p >= 0.0 && sign * slip >= 0.0).then_some((p, -mu * sign * p, sign))
                    };
                    if p >= 0.0 && f.abs() <= mu_s * p {
                        (p, f, 0.0)
                    } else {
                        slides(1.0).or_else(|| slides(-1.0)).unwrap_or((0.0, 0.0, 0.0))
                    }
                };
                *branch = match (p > 0.0, sign) {
                    (false, _) => SiteBranch::Open,
                    (true, 0.0) => SiteBranch::Held,
                    (true, sign) => SiteBranch::Slip(sign),
                };
                let moved = set(x, normal, p);
                moved.max(set(x, row, f))
            }
        }
    }
}

/// Forces with the pattern of their sites.
#[derive(Clone, Debug)]
struct SitePattern {
    x: Vec<f64>,
    branches: Vec<SiteBranch>,
}

/// An unknown of a pattern: how forces change with it, its own first.
struct Unknown {
    along: Vec<(usize, f64)>,
    /// The site whose direction it turns.
    turns: Option<usize>,
}

impl SitePattern {
    /// Makes the forces that others or angles determine what they are.
    fn take_forces(&mut self, sites: &[Site]) {
        for (site, branch) in sites.iter().zip(&self.branches) {
            match (*site, *branch) {
                (Site::Joint { row, limits: (slip, _) }, SiteBranch::Slip(sign)) => {
                    self.x[row] = -slip * sign;
                }
                (Site::Joint { .. }, _) => (),
                (Site::Gap { normal, friction }, branch) => {
                    if branch == SiteBranch::Open {
                        self.x[normal] = 0.0;
                    }
                    let Some(Rough { row, mu: (mu, _), .. }) = friction else { continue };
                    match branch {
                        SiteBranch::Open => self.x[row] = 0.0,
                        SiteBranch::Slip(sign) => self.x[row] = -mu * sign * self.x[normal],
                        _ => (),
                    }
                }
                (Site::Cone { rows, .. }, SiteBranch::Open) => {
                    rows.iter().for_each(|&row| self.x[row] = 0.0)
                }
                (Site::Cone { rows: [n, one, other], mu: (mu, _), .. }, branch) => {
                    if let Some([c, s]) = branch.heading() {
                        (self.x[one], self.x[other]) = (-mu * c * self.x[n], -mu * s * self.x[n]);
                    }
                }
            }
        }
    }

    /// The equations of the pattern as sums of rates, with their residuals.
    fn equations(&self, sites: &[Site], rates: &[f64]) -> (Vec<f64>, Vec<Vec<(usize, f64)>>) {
        let mut all: Vec<Vec<(usize, f64)>> = Vec::new();
        for (site, branch) in sites.iter().zip(&self.branches) {
            let held = site.rows_of(*branch);
            all.extend(held.into_iter().map(|row| vec![(row, 1.0)]));
            if let (Site::Cone { rows: [_, one, other], .. }, SiteBranch::Turn(angle)) =
                (site, branch)
            {
                let (s, c) = angle.sin_cos();
                all.push(vec![(*one, -s), (*other, c)]);
            }
        }
        let left = all.iter().map(|it| it.iter().map(|(row, by)| by * rates[*row]).sum()).collect();
        (left, all)
    }

    /// The unknowns of the pattern, angles in units of which the largest rate is `most`.
    fn unknowns(&self, sites: &[Site], most: f64) -> Vec<Unknown> {
        let mut all: Vec<Unknown> = Vec::new();
        for (at, (site, branch)) in sites.iter().zip(&self.branches).enumerate() {
            let mut held = site.rows_of(*branch).into_iter();
            match (*site, *branch) {
                (Site::Gap { normal, friction: Some(it) }, SiteBranch::Slip(sign)) => {
                    let along = vec![(normal, 1.0), (it.row, -it.mu.0 * sign)];
                    all.push(Unknown { along, turns: None });
                }
                (Site::Cone { rows: [n, one, other], mu: (mu, _), .. }, branch) => {
                    let Some([c, s]) = branch.heading() else {
                        all.extend(
                            held.map(|row| Unknown { along: vec![(row, 1.0)], turns: None }),
                        );
                        continue;
                    };
                    let along = vec![(n, 1.0), (one, -mu * c), (other, -mu * s)];
                    all.push(Unknown { along, turns: None });
                    if let SiteBranch::Turn(_) = branch {
                        let pull = mu * self.x[n] / most;
                        let along = vec![(one, pull * s), (other, -pull * c)];
                        all.push(Unknown { along, turns: Some(at) });
                    }
                }
                _ => all.extend(
                    held.by_ref().map(|row| Unknown { along: vec![(row, 1.0)], turns: None }),
                ),
            }
        }
        all
    }

    /// Changes the unknowns; none if a direction would turn too far.
    fn step(&mut self, unknowns: &[Unknown], step: &[f64], most: f64) -> Option<()> {
        for (unknown, by) in unknowns.iter().zip(step) {
            let Some(site) = unknown.turns else {
                self.x[unknown.along[0].0] += by;
                continue;
            };
            let turn = by / most;
            (turn.abs() <= MOST_TURN).then_some(())?;
            if let SiteBranch::Turn(angle) = &mut self.branches[site] {
                *angle += turn;
            }
        }
        Some(())
    }

    /// Whether an equation is that of the direction of a site.
    fn equation_of(&self, site: usize, number: usize, sites: &[Site]) -> bool {
        let count = |at: usize| {
            let turns = matches!(self.branches[at], SiteBranch::Turn(_));
            sites[at].rows_of(self.branches[at]).len() + usize::from(turns)
        };
        (0..=site).map(count).sum::<usize>() == number + 1
    }

    /// How the equation of a direction changes with that.
    fn turned(&self, (it, site): (&Site, usize), rates: &[f64], most: f64) -> f64 {
        match (it, self.branches[site].heading()) {
            (Site::Cone { rows: [_, one, other], .. }, Some([c, s])) => {
                -(c * rates[*one] + s * rates[*other]) / most
            }
            _ => 0.0,
        }
    }

    /// The largest violation of the inequalities (1).
    fn excess(&self, sites: &[Site], rates: &[f64]) -> f64 {
        let mut worst = 0.0_f64;
        let mut obeys = |value: f64| worst = worst.max(-value);
        let x = &self.x;
        for (site, branch) in sites.iter().zip(&self.branches) {
            match (*site, *branch) {
                (Site::Joint { row, limits: (_, stick) }, SiteBranch::Held) => {
                    obeys(stick - x[row].abs())
                }
                (Site::Joint { row, .. }, SiteBranch::Slip(sign)) => obeys(sign * rates[row]),
                (Site::Joint { .. }, _) => (),
                (Site::Gap { normal, .. }, SiteBranch::Open) => obeys(rates[normal]),
                (Site::Cone { rows: [n, ..], .. }, SiteBranch::Open) => obeys(rates[n]),
                (Site::Gap { normal, friction }, branch) => {
                    obeys(x[normal]);
                    match (friction, branch) {
                        (Some(it), SiteBranch::Slip(sign)) if it.slip == 0.0 => {
                            obeys(sign * rates[it.row])
                        }
                        (Some(it), SiteBranch::Held) => {
                            obeys(it.mu.1 * x[normal] - x[it.row].abs())
                        }
                        _ => (),
                    }
                }
                (Site::Cone { rows: [n, one, other], mu, .. }, branch) => {
                    obeys(x[n]);
                    match branch {
                        SiteBranch::Held => obeys(mu.1 * x[n] - x[one].hypot(x[other])),
                        SiteBranch::Turn(angle) => {
                            obeys(angle.cos() * rates[one] + angle.sin() * rates[other])
                        }
                        _ => (),
                    }
                }
            }
        }
        worst
    }
}

impl LocalSlip {
    /// Its force.
    fn branch(&self, mu: f64) -> ([f64; 3], SiteBranch) {
        let ([c, s], p) = (self.heading, self.pressed);
        ([p, -mu * p * c, -mu * p * s], SiteBranch::Turn(s.atan2(c)))
    }
}

impl SiteBranch {
    /// The direction of a slip.
    fn heading(self) -> Option<[f64; 2]> {
        match self {
            SiteBranch::Turn(angle) => Some([angle.cos(), angle.sin()]),
            SiteBranch::Kept(heading) => Some(heading),
            SiteBranch::Open | SiteBranch::Held | SiteBranch::Slip(_) => None,
        }
    }
}

impl Site {
    /// The rows that stay as they are.
    fn rows_of(&self, branch: SiteBranch) -> Vec<usize> {
        match (*self, branch) {
            (Site::Joint { row, .. }, SiteBranch::Held) => vec![row],
            (Site::Joint { .. }, _) | (_, SiteBranch::Open) => Vec::new(),
            (Site::Gap { normal, friction: Some(it) }, SiteBranch::Held) => vec![normal, it.row],
            (Site::Gap { normal, .. }, _) => vec![normal],
            (Site::Cone { rows, .. }, SiteBranch::Held) => rows.to_vec(),
            (Site::Cone { rows: [normal, ..], .. }, _) => vec![normal],
        }
    }
}

/// The largest magnitude.
pub(super) fn size(x: &[f64]) -> f64 {
    x.iter().fold(f64::MIN_POSITIVE, |size, x| size.max(x.abs()))
}

/// Sets a number: by how much it has moved.
fn set(x: &mut [f64], at: usize, value: f64) -> f64 {
    (std::mem::replace(&mut x[at], value) - value).abs()
}

// Coulomb's law as a sequence of convex problems, for contacts whose solution one by one does not converge.
//
// ```text
// minimise  1/2 x . D x + (b + mu s) . x   over the cones, mu s at the normals        s = |v_t|    (1)
// ```
//
// For given `s` the rates `v = b + D x` are unique, and `s` is a fixed point, which exists where some motion opens all
// contacts (V. Acary, F. Cadoux, C. Lemarechal, J. Malick, A formulation of the linear discrete Coulomb friction
// problem via convex optimization, ZAMM 91, 2011). Each problem is solved by accelerated projected gradients with
// restarts, `s` goes half of the way to its next value, and Newton's method takes over as soon as it obeys the laws.

/// Most steps of `s`, and of the descent in one of them.
const CONVEX_STEPS: usize = 80;
const DESCENT: usize = 4000;
/// Changes below this part of the largest force end a descent.
const CONVEX_SETTLED: f64 = 1e-14;
/// Forces below this part of the largest are none, and contacts with so little to the edge of their cone slip.
const NONE: f64 = 1e-9;
const EDGE: f64 = 1e-7;

impl Coulomb {
    /// The solution by convex problems, unless directions of slip are given.
    pub(super) fn by_convex_steps(&self) -> Option<CoulombSolution> {
        if self.sites().iter().any(Site::is_kept) {
            return None;
        }
        let (mut x, mut slips) = (vec![0.0; self.b().len()], vec![0.0; self.sites().len()]);
        for _ in 0..CONVEX_STEPS {
            let mut b = self.b().to_vec();
            for (site, slip) in self.sites().iter().zip(&slips) {
                if let Some((normal, mu)) = site.cone() {
                    b[normal] += mu * slip;
                }
            }
            self.descend(&b, &mut x)?;
            let rates = self.rates(&x);
            let branches: Vec<SiteBranch> =
                self.sites().iter().map(|site| site.branch_of(&x, &rates)).collect();
            if let Some(solved) = self.judged(&x, &branches) {
                return Some(solved);
            }
            for (site, slip) in self.sites().iter().zip(&mut slips) {
                *slip = 0.5 * (*slip + site.speed(&rates));
            }
        }
        None
    }

    /// To the minimum of (1).
    fn descend(&self, b: &[f64], x: &mut Vec<f64>) -> Option<()> {
        let (k, d) = (b.len(), self.d());
        let sums = d.chunks_exact(k).map(|row| row.iter().map(|it| it.abs()).sum::<f64>());
        let steepest = sums.fold(f64::MIN_POSITIVE, f64::max);
        let (mut ahead, mut weight) = (x.clone(), 1.0_f64);
        for _ in 0..DESCENT {
            let slopes = d.chunks_exact(k).zip(b).map(|(row, b)| b + dot(row, &ahead));
            let mut next: Vec<f64> =
                ahead.iter().zip(slopes).map(|(x, slope)| x - slope / steepest).collect();
            self.sites().iter().for_each(|site| site.project(&mut next));
            let turned: f64 = ahead
                .iter()
                .zip(&next)
                .zip(&*x)
                .map(|((y, next), x)| (y - next) * (next - x))
                .sum();
            let last = if turned > 0.0 { 1.0 } else { weight };
            weight = 0.5 * (1.0 + (1.0 + 4.0 * last * last).sqrt());
            let by = (last - 1.0) / weight;
            let moved = next.iter().zip(&*x).fold(0.0_f64, |most, (a, b)| most.max((a - b).abs()));
            ahead = next.iter().zip(&*x).map(|(next, x)| next + by * (next - x)).collect();
            *x = next;
            if moved <= CONVEX_SETTLED * size(x) {
                break;
            }
        }
        x.iter().all(|x| x.is_finite()).then_some(())
    }
}

impl Site {
    /// Whether its slip goes on in a direction that is given.
    fn is_kept(&self) -> bool {
        match *self {
            Self::Gap { friction, .. } => friction.is_some_and(|it| it.slip != 0.0),
            Self::Joint { .. } => false,
            Self::Cone { heading, .. } => heading.is_some(),
        }
    }

    /// Its normal row and the coefficient of friction.
    fn cone(&self) -> Option<(usize, f64)> {
        match *self {
            Self::Gap { normal, friction } => friction.map(|it| (normal, it.mu.0)),
            Self::Joint { .. } => None,
            Self::Cone { rows, mu, .. } => Some((rows[0], mu.0)),
        }
    }

    /// The slip speed.
    pub(super) fn speed(&self, rates: &[f64]) -> f64 {
        match *self {
            Self::Gap { friction, .. } => friction.map_or(0.0, |it| rates[it.row].abs()),
            Self::Joint { .. } => 0.0,
            Self::Cone { rows: [_, one, other], .. } => rates[one].hypot(rates[other]),
        }
    }

    /// Takes its forces to the nearest within the cone.
    fn project(&self, x: &mut [f64]) {
        match *self {
            Self::Gap { normal, friction: None } => x[normal] = x[normal].max(0.0),
            Self::Joint { row, limits: (slip, _) } => x[row] = x[row].clamp(-slip, slip),
            Self::Gap { normal, friction: Some(it) } => {
                let (pressed, part) = nearest(x[normal], x[it.row].abs(), it.mu.0);
                (x[normal], x[it.row]) = (pressed, part * x[it.row]);
            }
            Self::Cone { rows: [normal, one, other], mu, .. } => {
                let (pressed, part) = nearest(x[normal], x[one].hypot(x[other]), mu.0);
                (x[normal], x[one], x[other]) = (pressed, part * x[one], part * x[other]);
            }
        }
    }

    /// The dynamics with these forces and rates.
    fn branch_of(&self, x: &[f64], rates: &[f64]) -> SiteBranch {
        let none = NONE * size(x);
        match *self {
            Self::Joint { row, limits: (slip, _) } => match x[row].abs() < (1.0 - EDGE) * slip {
                true => SiteBranch::Held,
                false => SiteBranch::Slip(-x[row].signum()),
            },
            Self::Gap { normal, .. } if x[normal] <= none => SiteBranch::Open,
            Self::Gap { friction: None, .. } => SiteBranch::Held,
            Self::Gap { normal, friction: Some(it) } => {
                match x[it.row].abs() < (1.0 - EDGE) * it.mu.0 * x[normal] {
                    true => SiteBranch::Held,
                    false => SiteBranch::Slip(-x[it.row].signum()),
                }
            }
            Self::Cone { rows: [normal, ..], .. } if x[normal] <= none => SiteBranch::Open,
            Self::Cone { rows: [normal, one, other], mu, .. } => {
                let force = x[one].hypot(x[other]);
                if force < (1.0 - EDGE) * mu.0 * x[normal] {
                    return SiteBranch::Held;
                }
                let slides = rates[one].hypot(rates[other]) > EDGE * size(rates);
                SiteBranch::Turn(match slides || force == 0.0 {
                    true => rates[other].atan2(rates[one]),
                    false => (-x[other]).atan2(-x[one]),
                })
            }
        }
    }
}

/// The normal force of the nearest point of a cone, and the part of the tangential one that is left.
fn nearest(pressed: f64, pull: f64, mu: f64) -> (f64, f64) {
    if pull <= mu * pressed {
        (pressed, 1.0)
    } else if mu * pull <= -pressed {
        (0.0, 0.0)
    } else {
        let pressed = (pressed + mu * pull) / (1.0 + mu * mu);
        (pressed, mu * pressed / pull)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_nearest_point_of_a_cone_is_orthogonal_to_what_is_left() {
        let mu = 0.4;
        for (pressed, pull) in [(1.0, 0.3), (-1.0, 0.5), (1.0, 2.0), (-0.5, 2.0)] {
            let (found, part) = nearest(pressed, pull, mu);
            let left = [pressed - found, pull - part * pull];
            assert!(part * pull <= mu * found + 1e-15);
            assert!((left[0] * found + left[1] * part * pull).abs() < 1e-15);
            // what is left is in the polar cone
            assert!(left[0] + mu * left[1] <= 1e-15, "{pressed} {pull}");
        }
    }

    /// The impact of a box on an edge that steps contact by contact do not solve.
    #[test]
    fn an_impact_on_an_edge_with_little_slip() {
        let rows = |flip: f64| {
            let [a, b, c] = [0.805_937, -0.245_16 * flip, 4.340_224];
            [[1.471_021, 0.980_141 * flip, a], [0.980_141 * flip, 7.352_469, b], [a, b, c]]
        };
        let cross = [
            [1.143_043, 0.980_141, 0.802_983],
            [-0.980_141, 7.352_469, 0.245_16],
            [0.802_983, -0.245_16, 4.015_473],
        ];
        let (own, other) = (rows(1.0), rows(-1.0));
        let mut d = vec![0.0; 36];
        for i in 0..3 {
            for j in 0..3 {
                d[6 * i + j] = own[i][j];
                d[6 * (i + 3) + j + 3] = other[i][j];
                d[6 * i + j + 3] = cross[i][j];
                d[6 * (j + 3) + i] = cross[i][j];
            }
        }
        let b = [1.3 * -4.702_993, 0.723_873, 2.327_886, 1.3 * -4.768_367, 0.723_873, 2.186_515];
        let mu = (0.332_23, 0.332_23);
        let cone =
            |first: usize| Site::Cone { rows: [first, first + 1, first + 2], mu, heading: None };
        let found = Coulomb::new(vec![cone(0), cone(3)], &d, &b).by_convex_steps().unwrap();
        let x = found.forces.unwrap();
        let v: Vec<f64> = (0..6).map(|i| b[i] + dot(&d[6 * i..][..6], &x)).collect();
        for at in [0, 3] {
            let (pull, speed) = (x[at + 1].hypot(x[at + 2]), v[at + 1].hypot(v[at + 2]));
            assert!(v[at].abs() < 1e-9 && (pull - mu.0 * x[at]).abs() < 1e-9, "{v:?} {x:?}");
            let along = x[at + 1] * v[at + 1] + x[at + 2] * v[at + 2];
            assert!((along + pull * speed).abs() < 1e-9 && speed > 1e-4);
        }
    }
}
