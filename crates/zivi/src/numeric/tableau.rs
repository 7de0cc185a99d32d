//! Runge-Kutta tableaus and Richardson extrapolation.
//!
//! Embedded Runge-Kutta pairs as data.
//!
//! * Dormand and Prince's 5(4) pair with the quartic dense output of Shampine: J. R. Dormand and
//!   P. J. Prince, *A family of embedded Runge-Kutta formulae*, J. Comp. Appl. Math. 6 (1980);
//!   L. F. Shampine, *Some practical Runge-Kutta formulas*, Math. Comp. 46 (1986).
//! * DOP853, order 8 with estimates of orders 5 and 3 and a dense output of order 7 from three
//!   more stages: E. Hairer, S. P. Norsett and G. Wanner, *Solving Ordinary Differential Equations
//!   I*, section II.10.
//!
//! The coefficients are rounded: `sum_j a_ij` differs from `c_i` by some `eps`, and rounding of
//! sums with weights up to 50 adds more. Therefore sums run over the differences of the slopes from
//! the initial one ([`Pair::uniform`]).

use crate::numeric::coordinates::Row;

/// Weights of the stages. That of the start has its place in the conditions only: there is nothing
/// to sum there.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Weights {
    all: &'static [f64],
    /// The coefficients from the first nonzero one after the start.
    rest: &'static [f64],
}

impl Weights {
    const fn new(all: &'static [f64]) -> Self {
        let mut first = 1;
        while first < all.len() && all[first] == 0.0 {
            first += 1;
        }
        Self { all, rest: all.split_at(first).1 }
    }

    /// The sums over what the velocities and the accelerations of the stages have.
    #[inline(always)]
    pub(crate) fn sums(&self, row: &Row) -> (f64, f64) {
        let (mut v, mut k) = (0.0, 0.0);
        for (weight, beyond) in self.rest.iter().zip(&row[self.first()..self.len()]) {
            v += weight * beyond.v;
            k += weight * beyond.k;
        }
        (v, k)
    }

    /// For how many stages.
    #[inline]
    pub(crate) const fn len(&self) -> usize {
        self.all.len()
    }

    /// The first stage that counts.
    #[inline]
    pub(crate) const fn first(&self) -> usize {
        self.all.len() - self.rest.len()
    }

    /// The weights from there on.
    #[inline]
    pub(crate) const fn rest(&self) -> &'static [f64] {
        self.rest
    }
}

/// `A` by rows, the first of them that of the second stage.
type Rows = &'static [Weights];

/// How the error of a step is estimated: weights of the stages.
#[derive(Clone, Copy, Debug)]
pub(crate) enum ErrorEstimate {
    /// The difference between the two orders of the pair.
    Single(Weights),
    /// Two estimates `e5`, `e3` that are combined to `e5^2 / sqrt(e5^2 + 0.01 e3^2)`.
    Double(Weights, Weights),
}

/// The polynomial through a step.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Interpolant {
    /// `y + h sum_i k_i p_i(theta)`: the coefficients of `theta, theta^2, ...` in all `p_i`.
    Monomials([Weights; 4]),
    /// More stages, and the rows of the four coefficients that they give.
    Nested {
        /// Rows of `A` of the further stages, on all stages before them.
        a: Rows,
        /// Weights of all stages.
        d: [Weights; 4],
    },
}

/// An explicit pair: `k_i = f(t + c_i h, y + h sum_j a_ij k_j)`, `y+ = y + h sum_i b_i k_i`.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Pair {
    /// Nodes, those of the end of the step and of further stages included.
    pub(crate) c: &'static [f64],
    /// Coefficients of the stages that make the step.
    pub(crate) a: Rows,
    /// Weights.
    pub(crate) b: Weights,
    /// Error estimate.
    pub(crate) estimate: ErrorEstimate,
    /// The local error is of order `h^q`.
    pub(crate) q: f64,
    /// Dense output.
    pub(crate) interpolant: Interpolant,
}

impl Pair {
    /// How a uniform acceleration leads to the stage `i`: `c_i = sum_j a_ij` times the step size in
    /// the velocity, `sum_j a_ij c_j` times its square in the position. That is `c_i^2/2`, but
    /// nothing in the second stage, which knows the start alone.
    #[inline]
    pub(crate) fn uniform(&self, i: usize) -> [f64; 2] {
        let c = self.c[i];
        [c, if i == 1 { 0.0 } else { 0.5 * c * c }]
    }
}

/// Dormand-Prince 5(4).
pub(crate) static DORMAND_PRINCE_5: Pair = Pair {
    c: &[0.0, 0.2, 0.3, 0.8, 0.8888888888888888, 1.0, 1.0],
    a: &[
        Weights::new(&[0.2]),
        Weights::new(&[0.075, 0.225]),
        Weights::new(&[0.9777777777777777, -3.7333333333333334, 3.5555555555555554]),
        Weights::new(&[
            2.9525986892242035,
            -11.595793324188385,
            9.822892851699436,
            -0.2908093278463649,
        ]),
        Weights::new(&[
            2.8462752525252526,
            -10.757575757575758,
            8.906422717743473,
            0.2784090909090909,
            -0.2735313036020583,
        ]),
    ],
    b: Weights::new(&[
        0.09114583333333333,
        0.0,
        0.44923629829290207,
        0.6510416666666666,
        -0.322376179245283,
        0.13095238095238096,
    ]),
    estimate: ErrorEstimate::Single(Weights::new(&[
        -0.0012326388888888888,
        0.0,
        0.0042527702905061394,
        -0.03697916666666667,
        0.05086379716981132,
        -0.0419047619047619,
        0.025,
    ])),
    q: 5.0,
    interpolant: Interpolant::Monomials([
        Weights::new(&[1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]),
        Weights::new(&[
            -2.8535800653862835,
            0.0,
            4.023133379230305,
            -3.7324019615885042,
            2.5548038301849423,
            -1.3744241142186024,
            1.3824689317781436,
        ]),
        Weights::new(&[
            3.0717434641059005,
            0.0,
            -6.249321565289,
            10.068970589843675,
            -6.399112377351017,
            3.272657752246729,
            -3.764937863556287,
        ]),
        Weights::new(&[
            -1.1270175653862835,
            0.0,
            2.675424484351598,
            -5.685526961588504,
            3.5219323679207912,
            -1.7672812570757455,
            2.382468931778144,
        ]),
    ]),
};

/// DOP853.
pub(crate) static DOP853: Pair = Pair {
    c: &[
        0.0,
        0.05260015195876773,
        0.0789002279381516,
        0.1183503419072274,
        0.2816496580927726,
        0.3333333333333333,
        0.25,
        0.3076923076923077,
        0.6512820512820513,
        0.6,
        0.8571428571428571,
        1.0,
        1.0,
        0.1,
        0.2,
        0.7777777777777778,
    ],
    a: &[
        Weights::new(&[0.05260015195876773]),
        Weights::new(&[0.0197250569845379, 0.0591751709536137]),
        Weights::new(&[0.02958758547680685, 0.0, 0.08876275643042054]),
        Weights::new(&[0.2413651341592667, 0.0, -0.8845494793282861, 0.924834003261792]),
        Weights::new(&[0.037037037037037035, 0.0, 0.0, 0.17082860872947386, 0.12546768756682242]),
        Weights::new(&[
            0.037109375,
            0.0,
            0.0,
            0.17025221101954405,
            0.06021653898045596,
            -0.017578125,
        ]),
        Weights::new(&[
            0.03709200011850479,
            0.0,
            0.0,
            0.17038392571223998,
            0.10726203044637328,
            -0.015319437748624402,
            0.008273789163814023,
        ]),
        Weights::new(&[
            0.6241109587160757,
            0.0,
            0.0,
            -3.3608926294469414,
            -0.868219346841726,
            27.59209969944671,
            20.154067550477894,
            -43.48988418106996,
        ]),
        Weights::new(&[
            0.47766253643826434,
            0.0,
            0.0,
            -2.4881146199716677,
            -0.590290826836843,
            21.230051448181193,
            15.279233632882423,
            -33.28821096898486,
            -0.020331201708508627,
        ]),
        Weights::new(&[
            -0.9371424300859873,
            0.0,
            0.0,
            5.186372428844064,
            1.0914373489967295,
            -8.149787010746927,
            -18.52006565999696,
            22.739487099350505,
            2.4936055526796523,
            -3.0467644718982196,
        ]),
        Weights::new(&[
            2.273310147516538,
            0.0,
            0.0,
            -10.53449546673725,
            -2.0008720582248625,
            -17.9589318631188,
            27.94888452941996,
            -2.8589982771350235,
            -8.87285693353063,
            12.360567175794303,
            0.6433927460157636,
        ]),
    ],
    b: Weights::new(&[
        0.054293734116568765,
        0.0,
        0.0,
        0.0,
        0.0,
        4.450312892752409,
        1.8915178993145003,
        -5.801203960010585,
        0.3111643669578199,
        -0.1521609496625161,
        0.20136540080403034,
        0.04471061572777259,
    ]),
    estimate: ErrorEstimate::Double(
        Weights::new(&[
            0.01312004499419488,
            0.0,
            0.0,
            0.0,
            0.0,
            -1.2251564463762044,
            -0.4957589496572502,
            1.6643771824549864,
            -0.35032884874997366,
            0.3341791187130175,
            0.08192320648511571,
            -0.022355307863886294,
        ]),
        Weights::new(&[
            -0.18980075407240762,
            0.0,
            0.0,
            0.0,
            0.0,
            4.450312892752409,
            1.8915178993145003,
            -5.801203960010585,
            -0.4226823213237919,
            -0.1521609496625161,
            0.20136540080403034,
            0.02265179219836082,
        ]),
    ),
    q: 8.0,
    interpolant: Interpolant::Nested {
        a: &[
            Weights::new(&[
                0.056167502283047954,
                0.0,
                0.0,
                0.0,
                0.0,
                0.0,
                0.25350021021662483,
                -0.2462390374708025,
                -0.12419142326381637,
                0.15329179827876568,
                0.00820105229563469,
                0.007567897660545699,
                -0.008298,
            ]),
            Weights::new(&[
                0.03183464816350214,
                0.0,
                0.0,
                0.0,
                0.0,
                0.028300909672366776,
                0.053541988307438566,
                -0.05492374857139099,
                0.0,
                0.0,
                -0.00010834732869724932,
                0.0003825710908356584,
                -0.00034046500868740456,
                0.1413124436746325,
            ]),
            Weights::new(&[
                -0.42889630158379194,
                0.0,
                0.0,
                0.0,
                0.0,
                -4.697621415361164,
                7.683421196062599,
                4.06898981839711,
                0.3567271874552811,
                0.0,
                0.0,
                0.0,
                -0.0013990241651590145,
                2.9475147891527724,
                -9.15095847217987,
            ]),
        ],
        d: [
            Weights::new(&[
                -8.428938276109013,
                0.0,
                0.0,
                0.0,
                0.0,
                0.5667149535193777,
                -3.0689499459498917,
                2.38466765651207,
                2.117034582445028,
                -0.871391583777973,
                2.2404374302607883,
                0.6315787787694688,
                -0.08899033645133331,
                18.148505520854727,
                -9.194632392478356,
                -4.436036387594894,
            ]),
            Weights::new(&[
                10.427508642579134,
                0.0,
                0.0,
                0.0,
                0.0,
                242.28349177525817,
                165.20045171727028,
                -374.5467547226902,
                -22.113666853125306,
                7.733432668472264,
                -30.674084731089398,
                -9.332130526430229,
                15.697238121770845,
                -31.139403219565178,
                -9.35292435884448,
                35.81684148639408,
            ]),
            Weights::new(&[
                19.985053242002433,
                0.0,
                0.0,
                0.0,
                0.0,
                -387.0373087493518,
                -189.17813819516758,
                527.8081592054236,
                -11.57390253995963,
                6.8812326946963,
                -1.0006050966910838,
                0.7777137798053443,
                -2.778205752353508,
                -60.19669523126412,
                84.32040550667716,
                11.99229113618279,
            ]),
            Weights::new(&[
                -25.69393346270375,
                0.0,
                0.0,
                0.0,
                0.0,
                -154.18974869023643,
                -231.5293791760455,
                357.6391179106141,
                93.40532418362432,
                -37.45832313645163,
                104.0996495089623,
                29.8402934266605,
                -43.53345659001114,
                96.32455395918828,
                -39.17726167561544,
                -149.72683625798564,
            ]),
        ],
    },
};

// Richardson's extrapolation of vectors `S_k -> S` whose errors fall in known powers.
//
// With `S_k^(0) = S + c_1 q^(ak) + c_2 q^((a+1)k) + ...` and the powers `p_j = q^(a+j-1)`,
//
// ```text
// S_k^(j) = (S_k^(j-1) - p_j S_(k-1)^(j-1))/(1 - p_j)                                 (1)
// ```
//
// removes one term after the other.

/// Ratio `q` of the terms of neighbouring rows, and the power that the first column removes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Powers {
    pub(crate) ratio: f64,
    pub(crate) first: f64,
}

/// The newest entry of a column, with the data for its error estimate.
#[derive(Debug)]
pub(crate) struct TableauEntry<'t> {
    /// Number of the column.
    pub(crate) j: usize,
    /// `p_j`, and the power that the next column would remove.
    pub(crate) power: f64,
    next: f64,
    pub(crate) newest: &'t [f64],
    /// The entry of the row before.
    above: &'t [f64],
    /// That of the column before.
    pub(crate) across: &'t [f64],
}

impl TableauEntry<'_> {
    /// The estimated error of a component: the larger of two differences, to the column before and
    /// to the row before. The first alone is optimistic by up to two digits.
    #[inline]
    pub(crate) fn error(&self, c: usize) -> f64 {
        let down = (self.newest[c] - self.above[c]).abs() / (1.0 - self.next);
        (self.newest[c] - self.across[c]).abs().max(down)
    }
}

/// A column that is being made.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Column {
    /// Its number.
    pub(crate) j: usize,
    /// `p_j`.
    pub(crate) power: f64,
    /// How many numbers its entries are together.
    pub(crate) length: usize,
}

/// Makes the columns (1) in the place of the rows, vectors of one length, the newest first, and
/// shows each that has two entries; `across` is memory for one vector.
#[inline]
pub(crate) fn columns(
    rows: &mut [f64],
    across: &mut [f64],
    powers: Powers,
    show: impl FnMut(&TableauEntry<'_>),
) {
    columns_with(rows, across, powers, |_, _| (), show);
}

/// The same with something added to a column before it is shown.
#[inline]
pub(crate) fn columns_with(
    rows: &mut [f64],
    across: &mut [f64],
    Powers { ratio, first }: Powers,
    mut add: impl FnMut(Column, &mut [f64]),
    mut show: impl FnMut(&TableauEntry<'_>),
) {
    let width = across.len();
    let (mut power, mut left) = (first, rows.len() / width);
    for j in 1.. {
        left = left.saturating_sub(1);
        if left < 2 {
            return;
        }
        across.copy_from_slice(&rows[..width]);
        let length = left * width;
        for i in 0..length {
            rows[i] = (rows[i] - power * rows[i + width]) / (1.0 - power);
        }
        add(Column { j, power, length }, rows);
        let (newest, above) = rows.split_at(width);
        show(&TableauEntry { j, power, next: power * ratio, newest, above, across });
        power *= ratio;
    }
}

#[cfg(test)]
mod tableau_tests {
    use super::*;

    /// Whether `sum_j row_j` and `sum_j row_j c_j` are these numbers.
    fn sums(pair: &Pair, row: &[f64], expected: [f64; 2]) {
        let weight = row.iter().fold(0.0, |a: f64, b| a.max(b.abs()));
        let plain: f64 = row.iter().sum();
        let first: f64 = row.iter().zip(pair.c).map(|(a, c)| a * c).sum();
        for (sum, expected) in [plain, first].into_iter().zip(expected) {
            assert!((sum - expected).abs() <= 4e-16 * weight.max(1.0), "{row:?}: {sum} {expected}");
        }
    }

    #[test]
    fn uniform_accelerations_are_integrated_exactly() {
        // what sums over differences leave out
        for pair in [&DORMAND_PRINCE_5, &DOP853] {
            for (i, row) in pair.a.iter().enumerate() {
                sums(pair, row.all, pair.uniform(i + 1));
            }
            let last = pair.b.len();
            sums(pair, pair.b.all, pair.uniform(last));
            match pair.estimate {
                ErrorEstimate::Single(e) => sums(pair, e.all, [0.0; 2]),
                ErrorEstimate::Double(e5, e3) => {
                    sums(pair, e5.all, [0.0; 2]);
                    sums(pair, e3.all, [0.0; 2]);
                }
            }
            match pair.interpolant {
                Interpolant::Monomials(p) => {
                    let expected = [[1.0, 0.0], [0.0, 0.5], [0.0; 2], [0.0; 2]];
                    p.iter().zip(expected).for_each(|(p, it)| sums(pair, p.all, it));
                }
                Interpolant::Nested { a, d } => {
                    for (i, row) in a.iter().enumerate() {
                        sums(pair, row.all, pair.uniform(last + 1 + i));
                    }
                    d.iter().for_each(|row| sums(pair, row.all, [0.0; 2]));
                }
            }
        }
    }
}

#[cfg(test)]
mod richardson_tests {
    use super::*;

    #[test]
    fn a_column_removes_its_power_from_each_component() {
        // S_k = S + sum_j c_j q^(jk), j = 2, 3, 4: nothing is left after three columns
        let (q, s) = (0.4_f64, [3.0, -1.0]);
        let c = [[1.0, 2.0], [-0.5, 0.7], [0.2, -0.4]];
        let row = |k: i32| -> [f64; 2] {
            std::array::from_fn(|i| {
                let terms = c.iter().zip(2..).map(|(c, j)| c[i] * q.powi(j * k));
                s[i] + terms.sum::<f64>()
            })
        };
        let mut rows: Vec<f64> = (0..7).rev().flat_map(row).collect();
        let powers = Powers { ratio: q, first: q * q };
        let (mut off, mut seen) = ([f64::INFINITY; 2], 0);
        columns(&mut rows, &mut [0.0; 2], powers, |entry| {
            seen += 1;
            assert_eq!(entry.j, seen);
            for i in 0..2 {
                let error = (entry.newest[i] - s[i]).abs();
                // each column is better, and the estimate is one of the error
                assert!(error < 1e-14 || (error < 0.1 * off[i] && error <= entry.error(i)));
                off[i] = error;
            }
            if seen == 3 {
                assert!(off[0] < 1e-14 && off[1] < 1e-14, "{off:?}");
            }
        });
        assert_eq!(seen, 5);
    }

    #[test]
    fn two_rows_show_nothing() {
        let powers = Powers { ratio: 0.5, first: 0.25 };
        for n in 0..3 {
            columns(&mut vec![1.0; n], &mut [0.0], powers, |_| panic!("a column"));
        }
    }
}
