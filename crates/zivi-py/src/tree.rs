//! Trees of bodies from Python.

use std::sync::Arc;

use numpy::{PyArray1, PyReadonlyArray1};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use zivi::system::dynamics::Dynamics;
use zivi::system::tree::{self, Joint, JointKind, TreeDynamics, TreeGap};

use crate::arrays::{vector, Vector};

/// Joints and gaps of a tree, and their numbers.
#[pyclass(frozen, module = "zivi._zivi")]
pub(crate) struct Tree {
    pub(crate) inner: Arc<tree::Tree>,
}

/// The number of a joint; -1 is the world.
fn joint(number: i64) -> Option<usize> {
    usize::try_from(number).ok()
}

fn gap_of((kind, a, b): &(String, i64, i64)) -> Option<TreeGap> {
    match (kind.as_str(), joint(*a)) {
        ("lower", Some(a)) => Some(TreeGap::Lower(a)),
        ("upper", Some(a)) => Some(TreeGap::Upper(a)),
        ("plane", Some(a)) => Some(TreeGap::Plane(a)),
        ("balls", a) => Some(TreeGap::Balls(a, joint(*b))),
        _ => None,
    }
}

#[pymethods]
impl Tree {
    /// Parent (-1 for the world) and whether it is a slide, of each joint; kind and joints of each
    /// gap: "lower", "upper", "plane" or "balls"; the numbers as `zivi::system::tree::Tree` has them.
    #[new]
    #[pyo3(signature = (joints, gaps, numbers))]
    fn new(
        joints: Vec<(i64, bool)>,
        gaps: Vec<(String, i64, i64)>,
        numbers: PyReadonlyArray1<'_, f64>,
    ) -> PyResult<Self> {
        let kind = |slide| if slide { JointKind::Slide } else { JointKind::Hinge };
        let joints = joints
            .into_iter()
            .map(|(parent, slide)| Joint { parent: joint(parent), kind: kind(slide) })
            .collect();
        let gaps: Option<Vec<TreeGap>> = gaps.iter().map(gap_of).collect();
        let numbers = vector(&numbers)?;
        let tree = gaps.and_then(|gaps| tree::Tree { joints, gaps, numbers }.validated());
        let tree = tree.ok_or_else(|| PyValueError::new_err("the parts do not fit together"))?;
        Ok(Self { inner: Arc::new(tree) })
    }

    /// The numbers of an evaluation, one row.
    fn evaluate(
        &self,
        py: Python<'_>,
        t: f64,
        q: PyReadonlyArray1<'_, f64>,
        qdot: PyReadonlyArray1<'_, f64>,
    ) -> PyResult<Vector<f64>> {
        let (q, w, n) = (vector(&q)?, vector(&qdot)?, self.inner.joints.len());
        if [q.len(), w.len()] != [n; 2] {
            return Err(PyValueError::new_err(format!("q and qdot must have {n} entries")));
        }
        let mut row = vec![0.0; self.inner.layout().len()];
        Dynamics::<PyErr>::evaluate(
            &mut TreeDynamics::new(self.inner.clone()),
            t,
            &q,
            &w,
            &mut row,
        )?;
        Ok(PyArray1::from_vec(py, row).unbind())
    }
}
