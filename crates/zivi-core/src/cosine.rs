//! The cosine of a wave, with the same bits alone and among many, on every machine.
//!
//! ```text
//! x = n pi/2 + r,    |r| <= pi/4:    cos x = cos r, -sin r, -cos r, sin r    for n mod 4 = 0, 1, 2, 3
//! ```
//!
//! Only `+ - *` and bits take part, without a branch: no result depends on a library, and a compiler
//! makes vectors of many. `pi/2` is taken in four parts, the products of the first three with `n` are
//! exact (Cody and Waite); the polynomials are those of fdlibm's kernels.

/// Up to which argument the cosine is without a branch: larger ones need more of `pi/2`.
const REACH: f64 = 1.6e6; // n < 2^20

/// `2^52 + 2^51`: what is added to it is rounded to a whole number, which its last bits are.
const WHOLE: f64 = 6_755_399_441_055_744.0;

/// `pi/2` in parts of 33 bits, and the rest of it.
const QUARTER: [f64; 4] = [
    1.570_796_326_734_125_6,
    6.077_100_506_303_966e-11,
    2.022_266_248_711_166_5e-21,
    8.478_427_660_368_9e-32,
];

/// `(sin r - r)/r^3` and `(cos r - 1 + r^2/2)/r^4` in powers of `r^2`.
const SERIES: [[f64; 2]; 6] = [
    [-1.666_666_666_666_663_2e-1, 4.166_666_666_666_66e-2],
    [8.333_333_333_322_49e-3, -1.388_888_888_887_411e-3],
    [-1.984_126_982_985_795e-4, 2.480_158_728_947_673e-5],
    [2.755_731_370_707_006_8e-6, -2.755_731_435_139_066_3e-7],
    [-2.505_076_025_340_686_3e-8, 2.087_572_321_298_175e-9],
    [1.589_690_995_211_55e-10, -1.135_964_755_778_819_5e-11],
];

/// The cosine of `x` (rad), with an error below one unit in the last place.
///
/// ```
/// assert_eq!(zivi_core::cosine::cos(0.0), 1.0);
/// assert!((zivi_core::cosine::cos(core::f64::consts::PI / 3.0) - 0.5).abs() < 2e-16);
/// ```
#[inline]
#[must_use]
pub fn cos(x: f64) -> f64 {
    if x.abs() <= REACH {
        within(x)
    } else {
        beyond(x)
    }
}

/// Turns many angles into their cosines, with the bits of [`cos`].
///
/// ```
/// use zivi_core::cosine::{cos, turn_into_cosines};
/// let mut angles = [0.5, -2.0, 1e3, 1e9];
/// let alone = angles.map(cos);
/// turn_into_cosines(&mut angles);
/// assert_eq!(angles, alone);
/// ```
#[inline(always)] // with what the machine of its caller can do
pub fn turn_into_cosines(angles: &mut [f64]) {
    if angles.iter().fold(true, |near, x| near & (x.abs() <= REACH)) {
        for angle in angles {
            *angle = within(*angle);
        }
    } else {
        one_by_one(angles);
    }
}

#[cold]
#[inline(never)]
fn one_by_one(angles: &mut [f64]) {
    for angle in angles {
        *angle = cos(*angle);
    }
}

/// For large arguments and NaN.
#[cold]
fn beyond(x: f64) -> f64 {
    libm::cos(x)
}

#[inline(always)]
fn pick(odd: bool, [sin, cos]: [f64; 2]) -> f64 {
    if odd {
        sin
    } else {
        cos
    }
}

#[inline(always)]
fn within(x: f64) -> f64 {
    let shifted = x * core::f64::consts::FRAC_2_PI + WHOLE;
    let (n, bits) = (shifted - WHOLE, shifted.to_bits());
    let [first, second, third, fourth] = QUARTER;
    // the differences are exact; what is lost of the second and third is kept
    let s = x - n * first;
    let second = n * second;
    let rough = s - second;
    let third = n * third;
    let r = rough - third;
    let rest = ((s - rough) - second) + ((rough - r) - third) - n * fourth;
    let z = r * r;
    let odd = bits & 1 != 0;
    let [a, b, c, d, e, f] = SERIES;
    let [a, b, c] = [pick(odd, a), pick(odd, b), pick(odd, c)];
    let [d, e, f] = [pick(odd, d), pick(odd, e), pick(odd, f)];
    let zz = z * z;
    // even and odd powers separately, which a processor sums in parallel
    let series = (a + zz * (c + zz * e)) + z * (b + zz * (d + zz * f));
    let half = 0.5 * z;
    let about = 1.0 - half;
    let lost = (1.0 - about) - half;
    let (head, tail) = if odd {
        (r, rest * about + z * r * series)
    } else {
        (about, lost + (zz * series - r * rest))
    };
    let sign = (bits.wrapping_add(1) & 2) << 62;
    f64::from_bits((head + tail).to_bits() ^ sign)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Arguments and their cosines to 60 digits, rounded: near zeros, at the ends of the intervals
    /// of the polynomials, the argument with the largest error of a million drawn ones, large ones,
    /// and arguments at which the truncated parts of `pi/2` matter.
    #[allow(clippy::approx_constant)] // not near them, but these
    const KNOWN: [[f64; 2]; 18] = [
        [45.553093477052, -6.189806365883577e-19],
        [321307.9594422229, -4.429600834596129e-17],
        [1.5707963267948966, 6.123233995736766e-17],
        [-1.5707963267948966, 6.123233995736766e-17],
        [0.0, 1.0],
        [1e-300, 1.0],
        [-3e-9, 1.0],
        [0.5, 0.8775825618903728],
        [-0.7853981633974483, 0.7071067811865476],
        [0.7853981633974484, 0.7071067811865475],
        [14.990838951926833, -0.7536987999153771],
        [3.141592653589793, -1.0],
        [355.0, -0.999999999545659],
        [-12345.678, 0.7101193587160628],
        [1.6e6, 0.8407644482056118],
        [-1599999.9, 0.7825142071137967],
        [1593889.116963569, -0.491114277325929],
        [1536390.9232447632, 0.24895810982572777],
    ];

    fn is_next_to(found: f64, known: f64) -> bool {
        [known.next_down(), known, known.next_up()].contains(&found)
    }

    #[test]
    fn cosines_are_known() {
        for [x, known] in KNOWN {
            assert!(is_next_to(cos(x), known), "{x}: {} {known}", cos(x));
        }
    }

    /// Drawn arguments: the last bits of a product, spread over this number of orders of magnitude.
    fn drawn(n: u64) -> f64 {
        let part = n.wrapping_mul(0x9e37_79b9_7f4a_7c15) as f64 / u64::MAX as f64 - 0.5;
        let size = match n % 4 {
            0 => 3.2,
            1 => 100.0,
            2 => 1e4,
            _ => 3.2e6,
        };
        part * size
    }

    #[test]
    fn they_are_those_of_another_library() {
        for x in (0..100_000).map(drawn) {
            let (found, other) = (cos(x), libm::cos(x));
            // both errors are below one unit
            assert!((found - other).abs() <= 2.0 * (other.abs().next_up() - other.abs()), "{x}");
        }
    }

    #[test]
    fn many_are_as_one() {
        let far = [1e7, f64::INFINITY, -1e300, f64::NAN, 1.0, -2.0, 1.6e6, 1.7e6];
        for n in 0..10_000 {
            let mut angles: [f64; 8] = core::array::from_fn(|i| drawn(8 * n + i as u64));
            if n == 7 {
                angles = far;
            }
            let alone = angles.map(|x| cos(x).to_bits());
            turn_into_cosines(&mut angles);
            assert_eq!(angles.map(f64::to_bits), alone);
        }
        for x in [1e7, -1e300, 1.600_001e6] {
            assert_eq!(cos(x).to_bits(), libm::cos(x).to_bits());
        }
        assert!(cos(f64::NAN).is_nan() && cos(f64::NEG_INFINITY).is_nan());
    }
}
