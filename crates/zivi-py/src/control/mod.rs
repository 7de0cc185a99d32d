//! The controllers as Python classes: a control update is one call with plain numbers.

use pyo3::prelude::*;
use pyo3::types::PyDict;
use zivi::drive::closed_loop::{AnyController, Controller};
use zivi_core::control::{Port, TwistingTracker};
use zivi_core::observer::ObserverSettings;
use zivi_core::setting::Setting;

use crate::method::described;

mod arguments;
mod mass;
pub(crate) mod mechanical;

use mass::{Explicit, PyRegulator, PyTracker};

/// The classes of controllers, their public names, and their settings with a default.
macro_rules! controllers {
    ($each:ident) => {
        $each! {
            PyRegulator, "TwistingRegulator", [Port::DEPTH];
            PyTracker, "TwistingTracker", [Port::DEPTH, TwistingTracker::HORIZON];
            Explicit, "ExplicitTwisting", [Port::DEPTH];
        }
    };
}

/// Add the classes to the module.
pub(crate) fn add_classes(module: &Bound<'_, PyModule>) -> PyResult<()> {
    macro_rules! each {
        ($($class:ident, $name:literal, $settings:expr;)*) => {
            $(module.add_class::<$class>()?;)*
        };
    }
    controllers!(each);
    Ok(())
}

/// The settings of controllers and of the observer that are numbers with a default, by class.
pub(crate) fn settings(py: Python<'_>) -> PyResult<Bound<'_, PyDict>> {
    let all = PyDict::new(py);
    let put = |name, settings: &[Setting]| all.set_item(name, described(py, settings)?);
    macro_rules! each {
        ($($class:ident, $name:literal, $settings:expr;)*) => {
            $(put($name, &$settings)?;)*
        };
    }
    controllers!(each);
    let observer = [
        ObserverSettings::NOISE_X,
        ObserverSettings::NOISE_XDOT,
        ObserverSettings::Q_D,
        ObserverSettings::SE,
        ObserverSettings::DMAX,
        ObserverSettings::Q_E,
    ];
    put("ImpactObserver", &observer)?;
    Ok(all)
}

/// A controller of ours, `None` for any other object.
pub(crate) fn of_ours(object: &Bound<'_, PyAny>) -> Option<AnyController> {
    macro_rules! each {
        ($($class:ident, $name:literal, $settings:expr;)*) => {
            $(if let Ok(it) = object.cast::<$class>() {
                return Some(it.borrow().any());
            })*
        };
    }
    controllers!(each);
    None
}

/// Run a copy of a controller of ours, so that none is borrowed while other threads may call it, and
/// leave the controller where the copy ends; `None` for any other object.
pub(crate) fn run_copy<R>(
    object: &Bound<'_, PyAny>,
    run: impl FnOnce(&mut (dyn Controller<PyErr> + Send)) -> R,
) -> Option<R> {
    macro_rules! each {
        ($($class:ident, $name:literal, $settings:expr;)*) => {
            $(if let Ok(object) = object.cast::<$class>() {
                let mut copy = object.borrow().any();
                let done = run(copy.dynamic());
                object.borrow_mut().restore(&copy);
                return Some(done);
            })*
        };
    }
    controllers!(each);
    None
}
