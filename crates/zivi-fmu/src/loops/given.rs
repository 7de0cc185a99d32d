//! A system, or a loop, as its files tell it.

use zivi::drive::mechanical::{GapTracker, MechanicalReference};
use zivi::system::dynamics::Layout;

use super::compiled::CompiledSystem;
use crate::table::{DataType, Role, ScalarVariable};

/// A system, alone or with its controller, that was read from its files; it stays for the whole process.
#[derive(Debug)]
pub(super) struct LoadedLoop {
    pub(super) token: Vec<u8>,
    pub(super) number: u32,
    pub(super) table: Vec<ScalarVariable>,
    pub(super) layout: Layout,
    /// How many controls there are.
    pub(super) r: usize,
    pub(super) plant: CompiledSystem,
    pub(super) controller: Option<LoopController>,
}

/// A controller.
#[derive(Debug)]
pub(super) struct LoopController {
    pub(super) believed: CompiledSystem,
    pub(super) law: GapTracker,
    /// The force with which a contact is pressed, if one is requested.
    pub(super) forces: Vec<Option<f64>>,
    pub(super) reference: Option<MechanicalReference>,
}

/// What is counted of the updates of a controller.
pub(super) const COUNTED: [u8; 2] = [GapTracker::REFUSED, GapTracker::SATURATED];

impl LoadedLoop {
    /// The variables: time; a disturbance of each coordinate; coordinates, velocities, gaps, contacts,
    /// contact forces; of a controller contacts that are held, controls, the status, how many updates
    /// were rejected and saturated; the start, and the parameters of the system and of the one that the controller believes in.
    pub(super) fn table(sizes: Sizes, start: &[f64]) -> Vec<ScalarVariable> {
        let Sizes { layout: Layout { n, m, .. }, r, is_controlled } = sizes;
        let held = if is_controlled { m } else { 0 };
        let parts = [
            (DataType::Real, Role::Time, 1),
            (DataType::Real, Role::Input, n),
            (DataType::Real, Role::Output, 2 * n + m),
            (DataType::Boolean, Role::Output, m),
            (DataType::Real, Role::Output, m),
            (DataType::Boolean, Role::Output, held),
            (DataType::Real, Role::Output, r),
            (DataType::Integer, Role::Output, if is_controlled { 1 + COUNTED.len() } else { 0 }),
        ];
        let mut table = Vec::new();
        for (kind, role, count) in parts {
            table.extend((0..count).map(|_| ScalarVariable { kind, role, start: 0.0 }));
        }
        let (kind, role) = (DataType::Real, Role::Parameter);
        let parameter = |start: &f64| ScalarVariable { kind, role, start: *start };
        table.extend(start.iter().map(parameter));
        table
    }

    /// Where the first parameter is, a coordinate at the start.
    pub(super) fn first_parameter(&self) -> usize {
        let is_controlled = self.controller.is_some();
        Sizes { layout: self.layout, r: self.r, is_controlled }.first_parameter()
    }

    /// The period of the controller (s), none of a system alone.
    pub(super) fn h(&self) -> f64 {
        self.controller.as_ref().map_or(0.0, |it| it.law.settings.h)
    }
}

/// How many values of each kind there are.
#[derive(Clone, Copy, Debug)]
pub(super) struct Sizes {
    pub(super) layout: Layout,
    pub(super) r: usize,
    pub(super) is_controlled: bool,
}

impl Sizes {
    /// Where the first parameter is among the values.
    pub(super) fn first_parameter(self) -> usize {
        let Self { layout: Layout { n, m, .. }, r, is_controlled } = self;
        1 + 3 * n + 3 * m + if is_controlled { m + r + 1 + COUNTED.len() } else { 0 }
    }
}
