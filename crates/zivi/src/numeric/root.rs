//! A root of a function between two points where it has different signs.
//!
//! Chandrupatla's method (T. R. Chandrupatla, *A new hybrid quadratic/bisection algorithm for
//! finding the zero of a nonlinear function without using derivatives*, Adv. Eng. Softw. 28,
//! 1997): inverse quadratic interpolation where the three last points make it safe, else
//! bisection. It needs no more evaluations than Brent's method and has no cases to tune.

/// A point and the value there.
type Point = (f64, f64);

/// Where a root was found.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Root {
    /// The better of the two points.
    pub(crate) best: f64,
    /// The point on the side where the function has the sign that it has at the second end.
    pub(crate) beyond: f64,
}

/// Evaluations after which the bracket is given as it is; bisection alone takes 53 for a relative
/// width of rounding.
const MOST_EVALUATIONS: usize = 120;

/// The root between `from` and `to`, whose values have opposite signs (a zero counts as the sign
/// that the other end lacks), to rounding of the abscissa.
pub(crate) fn between<E>(
    from: Point,
    to: Point,
    function: impl FnMut(f64) -> Result<f64, E>,
) -> Result<Root, E> {
    within(f64::MIN_POSITIVE, from, to, function)
}

/// Where a function that is not positive at `from` becomes strictly positive, `to` being positive:
/// a zero counts as not yet. To rounding of the abscissa or of the distance of the ends.
pub(crate) fn becomes_positive<E>(
    from: Point,
    to: Point,
    mut function: impl FnMut(f64) -> Result<f64, E>,
) -> Result<Root, E> {
    let strictly = |value: f64| if value > 0.0 { value } else { value.min(-f64::MIN_POSITIVE) };
    let smallest = f64::EPSILON * (to.0 - from.0).abs();
    within(smallest, (from.0, strictly(from.1)), to, |x| function(x).map(strictly))
}

/// The root to rounding of the abscissa or to `finest`.
fn within<E>(
    finest: f64,
    from: Point,
    to: Point,
    mut function: impl FnMut(f64) -> Result<f64, E>,
) -> Result<Root, E> {
    let rising = to.1 > 0.0 || from.1 < 0.0;
    let is_beyond = |value: f64| (value > 0.0) == rising || value == 0.0;
    let (mut one, mut two) = (to, from);
    if to.1 == 0.0 {
        // mostly the root is there; a function that is zero on an interval became so before
        let x = to.0 - 8.0 * f64::EPSILON * to.0.abs().max((to.0 - from.0).abs());
        let before = (x, function(x)?);
        if !is_beyond(before.1) {
            return Ok(Root { best: to.0, beyond: to.0 });
        }
        one = before;
    }
    let mut part = 0.5;
    for _ in 0..MOST_EVALUATIONS {
        let x = one.0 + part * (two.0 - one.0);
        let new = (x, function(x)?);
        let three = if is_beyond(new.1) == is_beyond(one.1) {
            one
        } else {
            let three = two;
            two = one;
            three
        };
        one = new;
        let best = if one.1.abs() < two.1.abs() { one } else { two };
        let width = (two.0 - one.0).abs();
        let smallest = 2.0 * f64::EPSILON * best.0.abs() + finest;
        if smallest >= 0.5 * width {
            break;
        }
        let margin = smallest / width;
        part = next_part(one, two, three).clamp(margin, 1.0 - margin);
    }
    let best = if one.1.abs() < two.1.abs() { one.0 } else { two.0 };
    let beyond = if is_beyond(one.1) { one.0 } else { two.0 };
    Ok(Root { best, beyond })
}

/// Where to look next, as a part of the way from `one` to `two`.
fn next_part(one: Point, two: Point, three: Point) -> f64 {
    let ((x1, f1), (x2, f2), (x3, f3)) = (one, two, three);
    let xi = (x1 - x2) / (x3 - x2);
    let phi = (f1 - f2) / (f3 - f2);
    if phi * phi < xi && (1.0 - phi) * (1.0 - phi) < 1.0 - xi {
        f1 / (f2 - f1) * f3 / (f2 - f3) + (x3 - x1) / (x2 - x1) * f1 / (f3 - f1) * f2 / (f3 - f2)
    } else {
        0.5
    }
}

/// Time until, and rate at, the downward root of `x + xdot d + pull d^2/2` nearest to zero.
pub(crate) fn touchdown(x: f64, xdot: f64, pull: f64) -> Option<(f64, f64)> {
    let squared = xdot * xdot - 2.0 * pull * x;
    if squared < 0.0 {
        return (x <= 0.0).then_some((0.0, xdot.min(0.0)));
    }
    let speed = squared.sqrt();
    if x == 0.0 && xdot <= 0.0 {
        return Some((0.0, xdot));
    }
    let delta = 2.0 * x / (speed - xdot);
    delta.is_finite().then_some((delta, -speed))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::convert::Infallible;

    fn root(a: f64, b: f64, f: impl Fn(f64) -> f64) -> (Root, usize) {
        let mut n = 0;
        let found = between((a, f(a)), (b, f(b)), |x| {
            n += 1;
            Ok::<f64, Infallible>(f(x))
        });
        let Ok(found) = found;
        (found, n)
    }

    #[test]
    fn roots_to_rounding_within_few_evaluations() {
        type Case = (f64, f64, fn(f64) -> f64, f64);
        let cases: [Case; 7] = [
            (0.0, 2.0, |x| x * x - 2.0, 2f64.sqrt()),
            (0.0, 2.0, |x| 2.0 - x * x, 2f64.sqrt()),
            (-1.0, 4.0, |x| (x - 1.0).powi(9), 1.0),
            (0.0, 3.0, |x| if x < 1.5 { -1.0 } else { 1.0 }, 1.5),
            (1.0, 1e9, |x| x.ln() - 3.0, 3f64.exp()),
            (1e9, 1e9 + 4.0, |x| (x - 1e9).cos(), 1e9 + std::f64::consts::FRAC_PI_2),
            (0.0, 1.0, |x| x - 1e-12, 1e-12),
        ];
        for (a, b, f, exact) in cases {
            let (Root { best, beyond }, n) = root(a, b, f);
            // a root of order nine is known to the ninth root of rounding
            let tol = if f(1.0) == 0.0 && f(2.0) == 1.0 { 1e-2 } else { 4e-16 * exact };
            assert!((best - exact).abs() <= tol, "{best:e} for {exact:e}");
            assert!((f(beyond) > 0.0) == (f(b) > 0.0) || f(beyond) == 0.0);
            assert!(n < 70, "{n}");
        }
    }

    #[test]
    fn a_function_that_becomes_zero_and_stays_so() {
        for end in [1.0, 2.0] {
            let (Root { best, beyond }, n) = root(0.0, end, |x| (0.3 - x).max(0.0));
            assert!((best - 0.3).abs() < 1e-15 && (beyond - 0.3).abs() < 1e-15);
            let (Root { best, .. }, _) = root(0.0, end, |x| if x < 0.3 { 1.0 } else { 0.0 });
            assert!((best - 0.3).abs() < 1e-15 && n < 70);
        }
        let (Root { best, .. }, n) = root(0.0, 1.0, |x| x - 1.0);
        assert!(best == 1.0 && n < 5);
    }

    #[test]
    fn an_interval_of_zeros_is_reached_at_its_start() {
        let (found, _) = root(-1.0, 1.0, |x| if x.abs() < 0.25 { 0.0 } else { x });
        assert!((found.beyond + 0.25).abs() < 1e-15, "{found:?}");
    }

    #[test]
    fn strictly_positive_is_what_comes_after_the_zeros() {
        for start in [0.0, 0.1] {
            let f = |x: f64| Ok::<f64, Infallible>((x - 0.3).max(0.0));
            let Ok(found) = becomes_positive((start, 0.0), (1.0, 0.7), f);
            assert!((found.beyond - 0.3).abs() < 1e-15, "{found:?}");
        }
    }

    #[test]
    fn a_zero_at_the_start_is_left() {
        // the value at 0 is zero and the sign after it differs from the one at the end
        let (Root { best, .. }, _) = root(0.0, 1.0, |x| x * (0.25 - x));
        assert!((best - 0.25).abs() < 1e-15 || best == 0.0);
    }
}
