//! The extension module `zivi._zivi`: conversion, release of the interpreter lock, statuses.
//!
//! No numerics here. `python/zivi` is what users import; `python/zivi/_zivi.pyi` types this module.

mod arrays;
mod ballistic;
mod batch;
mod capsule;
mod closed_loop;
mod control;
mod dynamics;
mod errors;
mod force;
mod friction;
mod impact_law;
mod impact_map;
mod leaving;
mod loop_batch;
mod mechanics;
mod method;
mod motion;
mod observer;
mod partials;
mod record;
mod sensitivity;
mod simulate;
mod switched_rk;
mod system;
mod time_table;
mod tracking;
mod transform;
mod user_events;
mod vi;
mod watch;

use pyo3::prelude::*;

#[pymodule]
fn _zivi(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add("__version__", env!("CARGO_PKG_VERSION"))?;
    module.add("FORMAT", zivi::record::stored::FORMAT)?;
    module.add("STATUS_MESSAGES", record::status_messages())?;
    module.add("METHODS", method::all_methods(module.py())?)?;
    module.add("SETTINGS", method::all_settings(module.py())?)?;
    module.add("IMPACT_LAWS", impact_law::all_laws(module.py())?)?;
    module.add("CONTROL_SETTINGS", control::settings(module.py())?)?;
    module.add_class::<method::Setting>()?;
    module.add_class::<method::Method>()?;
    module.add_class::<method::MethodEntry>()?;
    module.add_class::<impact_law::ImpactLaw>()?;
    module.add_class::<system::PointMass>()?;
    module.add_class::<system::State>()?;
    module.add_class::<system::Mechanism>()?;
    module.add_class::<system::Configuration>()?;
    module.add_class::<friction::Friction>()?;
    module.add_class::<friction::FrictionRecord>()?;
    module.add_class::<system::Keep>()?;
    module.add_class::<user_events::Event>()?;
    module.add_class::<user_events::Hits>()?;
    module.add_function(wrap_pyfunction!(simulate::simulate, module)?)?;
    module.add_function(wrap_pyfunction!(leaving::stop_runs, module)?)?;
    module.add_function(wrap_pyfunction!(leaving::forget_runs, module)?)?;
    module.add_class::<record::RunRecord>()?;
    module.add_class::<transform::Restitution>()?;
    module.add_function(wrap_pyfunction!(transform::lift, module)?)?;
    module.add_function(wrap_pyfunction!(transform::project, module)?)?;
    module.add_function(wrap_pyfunction!(simulate::solve_steps, module)?)?;
    module.add_function(wrap_pyfunction!(tracking::solve_tracking_steps, module)?)?;
    module.add_class::<loop_batch::LoopBatchRecord>()?;
    module.add_function(wrap_pyfunction!(loop_batch::simulate_closed_loop_batch, module)?)?;
    module.add_class::<batch::BatchRecord>()?;
    module.add_function(wrap_pyfunction!(batch::simulate_batch, module)?)?;
    module.add_function(wrap_pyfunction!(batch::available_threads, module)?)?;
    module.add_function(wrap_pyfunction!(batch::grid_times, module)?)?;
    module.add_function(wrap_pyfunction!(impact_map::check_impact_map, module)?)?;
    module.add_function(wrap_pyfunction!(impact_map::map_of_impacts, module)?)?;
    module.add_function(wrap_pyfunction!(impact_map::orbits_of_impacts, module)?)?;
    module.add_class::<switched_rk::MotionPath>()?;
    module.add_class::<sensitivity::Nearest>()?;
    module.add_class::<sensitivity::SensitivityRecord>()?;
    module.add_function(wrap_pyfunction!(sensitivity::sensitivity, module)?)?;
    module.add_function(wrap_pyfunction!(sensitivity::fly_apart, module)?)?;
    module.add_class::<force::Force>()?;
    module.add_class::<force::Wall>()?;
    module.add_class::<time_table::TimeTable>()?;
    module.add_function(wrap_pyfunction!(force::force_raised, module)?)?;
    module.add_class::<mechanics::MechanicalRecord>()?;
    module.add_class::<motion::MechanicalPath>()?;
    module.add_class::<dynamics::Model>()?;
    module.add_class::<dynamics::CompiledFunction>()?;
    module.add_class::<partials::Partials>()?;
    module.add_class::<partials::Moved>()?;
    module.add_class::<partials::MechanicalSensitivityRecord>()?;
    module.add_function(wrap_pyfunction!(partials::mechanical_sensitivity, module)?)?;
    module.add_function(wrap_pyfunction!(dynamics::compiled_model, module)?)?;
    control::add_classes(module)?;
    module.add_class::<observer::Observer>()?;
    module.add_class::<closed_loop::LoopRecord>()?;
    module.add_class::<closed_loop::LiftedSamples>()?;
    module.add_class::<ballistic::Ballistic>()?;
    module.add_function(wrap_pyfunction!(closed_loop::simulate_closed_loop, module)?)?;
    module.add_function(wrap_pyfunction!(ballistic::ballistic_motion, module)?)?;
    module.add_class::<vi::ViRecord>()?;
    module.add_function(wrap_pyfunction!(vi::solve_vi, module)?)?;
    module.add_function(wrap_pyfunction!(vi::solve_avi, module)?)?;
    module.add_function(wrap_pyfunction!(vi::natural_residual, module)?)?;
    module.add_function(wrap_pyfunction!(vi::lemke_howson, module)?)?;
    Ok(())
}
