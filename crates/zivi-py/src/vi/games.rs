//! Bimatrix games from Python.

use numpy::{PyArray1, PyReadonlyArray2};
use pyo3::prelude::*;
use zivi_core::vi;

use super::interrupts::Interrupts;
use crate::arrays::{list, zeros, Array};

/// Unscaled strategies at an equilibrium of a game with positive payoffs of equal shape, and the
/// pivots; `None` where none was found within the limit of pivots, or of time (s).
#[pyfunction]
#[pyo3(signature = (a, b, limit, time_limit=None))]
pub(crate) fn lemke_howson(
    py: Python<'_>,
    a: PyReadonlyArray2<'_, f64>,
    b: PyReadonlyArray2<'_, f64>,
    limit: usize,
    time_limit: Option<f64>,
) -> PyResult<Option<(Array, Array, usize)>> {
    let (m, n) = a.as_array().dim();
    let payoffs = |of: PyReadonlyArray2<'_, f64>| list(of.as_array().iter().copied());
    let (a, b) = (payoffs(a)?, payoffs(b)?);
    let (reals, indices) = vi::lemke_howson_len(m, n);
    let (mut reals, mut indices) = (zeros(reals)?, list(std::iter::repeat_n(0, indices))?);
    let (mut x, mut y) = (zeros(m)?, zeros(n)?);
    let interrupts = Interrupts::new(time_limit, None);
    let (found, x, y, interrupts) = py.detach(move || {
        let work = (&mut reals[..], &mut indices[..]);
        let poll = &mut || interrupts.look_detached();
        let found = vi::lemke_howson((&a, &b), (&mut x, &mut y), limit, work, poll);
        (found, x, y, interrupts)
    });
    if let Some(error) = interrupts.raised() {
        return Err(error);
    }
    let array = |values| PyArray1::from_vec(py, values).unbind();
    Ok(found.ok().flatten().map(|pivots| (array(x), array(y), pivots)))
}
