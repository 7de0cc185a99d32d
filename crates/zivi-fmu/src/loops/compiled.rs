//! Systems that were compiled when the unit was exported, and trees of bodies.

use core::ffi::{c_int, c_void};

use zivi::system::dynamics::{Driven, InputMatrix};
use zivi::system::dynamics::{Dynamics, Layout};
use zivi::system::tree::TreeDynamics;
use zivi::AnyImpactLaw;

use super::tree::ParametricTree;
use crate::state::FmuState;

/// Codes of errors.
pub(super) mod code {
    pub(in super::super) const START: i32 = -1;
    pub(in super::super) const EVALUATION: i32 = -2;
    pub(in super::super) const DEPENDENT: i32 = -3;
    pub(in super::super) const INDEFINITE: i32 = -4;
    pub(in super::super) const UNREACHED: i32 = -5;
    pub(in super::super) const REFUSED: i32 = -6;
    pub(in super::super) const MOTION: i32 = -7;
    pub(in super::super) const FAULT: i32 = -8;
}

/// `int f(double t, const double *q, const double *w, double *out, void *parameters)`, 0 for success.
pub(super) type Function =
    unsafe extern "C" fn(f64, *const f64, *const f64, *mut f64, *mut c_void) -> c_int;

/// How controls act.
#[derive(Debug)]
pub(super) enum Inputs {
    /// `B`, row by row.
    Constant(Vec<f64>),
    /// A function that fills it in.
    Function(Function),
}

/// The evaluated object.
#[derive(Debug)]
pub(super) enum LoopSystem {
    Compiled(Function),
    Tree(ParametricTree),
}

/// A system: the plant or the controller's model.
#[derive(Debug)]
pub(super) struct CompiledSystem {
    pub(super) system: LoopSystem,
    pub(super) inputs: Inputs,
    pub(super) laws: Vec<AnyImpactLaw>,
    /// Position and number of its parameters among the values.
    pub(super) parameters: (usize, usize),
}

/// A system with the parameters of an instance.
#[derive(Clone, Debug)]
pub(super) enum Evaluated<'a> {
    Compiled { layout: Layout, function: Function, parameters: &'a [f64] },
    Tree(Box<TreeDynamics>),
}

/// The matrix of inputs as a function.
pub(super) type Matrix<'a> = Box<dyn FnMut(f64, &[f64], &mut [f64]) -> Result<(), i32> + 'a>;

/// Calls a function with these parameters; it only reads them.
fn call(
    function: Function,
    t: f64,
    (q, w): (&[f64], &[f64]),
    out: &mut [f64],
    parameters: &[f64],
) -> Result<(), i32> {
    let data = parameters.as_ptr().cast_mut().cast();
    // SAFETY: the export compiled the function for these sizes, and it keeps no pointer
    match unsafe { function(t, q.as_ptr(), w.as_ptr(), out.as_mut_ptr(), data) } {
        0 => Ok(()),
        _ => Err(code::EVALUATION),
    }
}

impl Dynamics<i32> for Evaluated<'_> {
    fn layout(&self) -> Layout {
        match self {
            Self::Compiled { layout, .. } => *layout,
            Self::Tree(tree) => tree.tree().layout(),
        }
    }

    fn evaluate(&mut self, t: f64, q: &[f64], w: &[f64], out: &mut [f64]) -> Result<(), i32> {
        match self {
            Self::Compiled { function, parameters, .. } => {
                call(*function, t, (q, w), out, parameters)
            }
            Self::Tree(tree) => tree.evaluate(t, q, w, out),
        }
    }
}

impl CompiledSystem {
    /// The system with this many inputs; a disturbance of each coordinate is the last of them.
    pub(super) fn driven<'a>(
        &'a self,
        layout: Layout,
        inputs: usize,
        state: &'a FmuState,
        disturbed: bool,
    ) -> Driven<Evaluated<'a>, Matrix<'a>> {
        let (first, count) = self.parameters;
        let parameters = state.values.get(first..first + count).unwrap_or_default();
        let (n, r) = (layout.n, if disturbed { inputs - layout.n } else { inputs });
        let widened = move |narrow: &[f64], to: &mut [f64]| {
            for (i, row) in to.chunks_exact_mut(inputs).enumerate() {
                row.fill(0.0);
                row[..r].copy_from_slice(&narrow[i * r..][..r]);
                if disturbed {
                    row[r + i] = 1.0;
                }
            }
        };
        let matrix = match &self.inputs {
            Inputs::Constant(matrix) => {
                let mut wide = vec![0.0; n * inputs];
                widened(matrix, &mut wide);
                InputMatrix::Constant(wide)
            }
            Inputs::Function(function) => {
                let (function, mut narrow) = (*function, vec![0.0; n * r]);
                let fill: Matrix<'a> = Box::new(move |t, q, to| {
                    call(function, t, (q, q), &mut narrow, parameters)?;
                    widened(&narrow, to);
                    Ok(())
                });
                InputMatrix::Function(fill)
            }
        };
        let system = match &self.system {
            LoopSystem::Compiled(function) => {
                Evaluated::Compiled { layout, function: *function, parameters }
            }
            LoopSystem::Tree(tree) => {
                Evaluated::Tree(Box::new(TreeDynamics::new(tree.at(parameters))))
            }
        };
        let empty = system.clone();
        // a constant matrix has this size
        Driven::new(system, (n, inputs), matrix).unwrap_or_else(|| {
            let zeros = InputMatrix::Constant(vec![0.0; n * inputs]);
            Driven::new(empty, (n, inputs), zeros).expect("n rows of the inputs")
        })
    }
}
