//! Refusing input that no solver can use, before `F` is called.

use super::status::InvalidInput;

/// `Ok` when `lower` and `upper` have `n` entries and every `[lower_i, upper_i]` holds a number.
///
/// # Errors
/// [`InvalidInput`] names the first component that is wrong.
pub fn validate_bounds(n: usize, lower: &[f64], upper: &[f64]) -> Result<(), InvalidInput> {
    if n == 0 {
        return Err(InvalidInput::Empty);
    }
    for (name, bound, empty) in
        [("lower", lower, f64::INFINITY), ("upper", upper, f64::NEG_INFINITY)]
    {
        require_length(name, bound, n)?;
        for (index, &value) in bound.iter().enumerate() {
            if value.is_nan() {
                return Err(InvalidInput::NotFinite { name, index, value });
            }
            if value == empty {
                return Err(InvalidInput::EmptyRange { name, index });
            }
        }
    }
    for (index, (&lower, &upper)) in lower.iter().zip(upper).enumerate() {
        if lower > upper {
            return Err(InvalidInput::CrossedBounds { index, lower, upper });
        }
    }
    Ok(())
}

/// `Ok` when `v` has `n` entries.
pub(super) fn require_length(
    name: &'static str,
    v: &[f64],
    expected: usize,
) -> Result<(), InvalidInput> {
    match v.len() {
        got if got == expected => Ok(()),
        got => Err(InvalidInput::Length { name, expected, got }),
    }
}

/// `Ok` when every entry is finite.
pub(super) fn require_finite(name: &'static str, v: &[f64]) -> Result<(), InvalidInput> {
    match v.iter().enumerate().find(|(_, value)| !value.is_finite()) {
        None => Ok(()),
        Some((index, &value)) => Err(InvalidInput::NotFinite { name, index, value }),
    }
}

#[cfg(test)]
mod tests {
    extern crate std;
    use super::*;
    use std::string::{String, ToString};

    const INF: f64 = f64::INFINITY;

    #[test]
    fn every_bad_bound_is_named() {
        let cases = [
            (0, [0.0, 0.0], [1.0, 1.0], "at least one"),
            (3, [0.0, 0.0], [1.0, 1.0], "lower must have 3"),
            (2, [0.0, f64::NAN], [1.0, 1.0], "lower[1]"),
            (2, [0.0, 0.0], [f64::NAN, 1.0], "upper[0]"),
            (2, [0.0, INF], [1.0, INF], "lower[1]"),
            (2, [-INF, 0.0], [-INF, 1.0], "upper[0]"),
            (2, [0.0, 2.0], [1.0, 1.0], "lower[1] must be <= upper[1]"),
        ];
        for (n, lower, upper, expected) in cases {
            let error = validate_bounds(n, &lower, &upper);
            let text = error.map_or_else(|error| error.to_string(), |()| String::new());
            assert!(text.contains(expected), "{text}: {expected}");
        }
        assert_eq!(validate_bounds(2, &[-INF, 1.0], &[INF, 1.0]), Ok(()));
    }
}
