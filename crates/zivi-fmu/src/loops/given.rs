//! A loop as its files tell it.

use zivi::drive::mechanical::{GapTracker, MechanicalReference};
use zivi::system::dynamics::Layout;

use super::compiled::Part;
use crate::table::{Kind, Role, Variable};

/// A loop that was read from its files; it stays for the whole process.
#[derive(Debug)]
pub(super) struct Loop {
    pub(super) token: Vec<u8>,
    pub(super) number: u32,
    pub(super) table: Vec<Variable>,
    pub(super) layout: Layout,
    pub(super) r: usize,
    pub(super) plant: Part,
    pub(super) believed: Part,
    pub(super) law: GapTracker,
    /// The force with which a contact is pressed, if one is requested.
    pub(super) forces: Vec<Option<f64>>,
    pub(super) reference: Option<MechanicalReference>,
}

impl Loop {
    /// The variables: time; a disturbance of each coordinate; coordinates, velocities, gaps, contacts,
    /// contact forces, contacts that are held, controls, the status; the start, and the parameters of
    /// the system and of the one that the controller believes in.
    pub(super) fn table(layout: Layout, r: usize, start: &[f64]) -> Vec<Variable> {
        let Layout { n, m, .. } = layout;
        let parts = [
            (Kind::Real, Role::Time, 1),
            (Kind::Real, Role::Input, n),
            (Kind::Real, Role::Output, 2 * n + m),
            (Kind::Boolean, Role::Output, m),
            (Kind::Real, Role::Output, m),
            (Kind::Boolean, Role::Output, m),
            (Kind::Real, Role::Output, r),
            (Kind::Integer, Role::Output, 1),
        ];
        let mut table = Vec::new();
        for (kind, role, count) in parts {
            table.extend((0..count).map(|_| Variable { kind, role, start: 0.0 }));
        }
        let parameter =
            |start: &f64| Variable { kind: Kind::Real, role: Role::Parameter, start: *start };
        table.extend(start.iter().map(parameter));
        table
    }

    /// Where the first parameter is among the values of a loop of these sizes.
    pub(super) fn first_of(Layout { n, m, .. }: Layout, r: usize) -> usize {
        2 + 3 * n + 4 * m + r
    }

    /// Where the first parameter is, a coordinate at the start.
    pub(super) fn first_parameter(&self) -> usize {
        Self::first_of(self.layout, self.r)
    }
}
