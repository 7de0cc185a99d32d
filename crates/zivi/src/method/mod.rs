//! Methods: one entry from a system, a span and a state to a run.
//!
//! ```text
//! Method::run(settings; system, span, y0, keep, monitor) -> run
//! ```
//!
//! A [`Method`] is its settings. [`AnyMethod`] is one of those that zivi has, chosen while the
//! program runs: batches, and the bindings to other languages, know that one only.
//!
//! A new scheme of fixed steps is a file, in which its settings implement
//! [`Scheme`](crate::stepping::scheme::Scheme), and a line in the list of [`AnyMethod`].

mod interface;
mod mechanism;
mod point_mass;

pub use interface::{Method, Settings, System};
pub use mechanism::Mechanism;
pub use point_mass::{PointMass, PointRun};

use zivi_core::setting::Setting;

use crate::mechanics::{MechanicalOutput, MechanicalRun};
use crate::stepping::explicit::ExplicitEuler;
use crate::stepping::scheme::{FixedSteps, Scheme};
use crate::system::dynamics::Dynamics;
use crate::{
    Force, Monitor, MoreauJean, Output, Physical, Restitution, SetupError, SwitchedRk, ThetaGamma,
};

impl<S: Scheme> Settings for FixedSteps<S> {
    fn check(&self) -> Result<(), SetupError> {
        self.scheme.check(self.h, Restitution::ELASTIC)
    }

    fn check_start(&self, initial: Physical, restitution: Restitution) -> Result<(), SetupError> {
        self.scheme.check(self.h, restitution)?;
        self.scheme.check_start(initial, restitution)
    }

    fn step(&self) -> Option<f64> {
        Some(self.h)
    }
}

/// A run of a mechanical system, or that the method has none.
macro_rules! of_mechanism {
    (Mechanism, $run:expr) => {
        $run
    };
    (, $run:expr) => {
        Err(SetupError::Refused("method must be one that takes several coordinates and gaps"))
    };
}

/// The list of the methods: for each its name, its settings and what it runs.
macro_rules! methods {
    ($($(#[$doc:meta])* $name:ident($settings:ty): PointMass $(, $mechanism:ident)?;)*) => {
        /// Any of the methods, with its settings.
        #[derive(Clone, Copy, Debug, PartialEq)]
        pub enum AnyMethod {
            $($(#[$doc])* $name($settings),)*
        }

        impl AnyMethod {
            /// The names of all methods, with their settings.
            pub const ALL: &'static [(&'static str, &'static [Setting])] =
                &[$((stringify!($name), <$settings>::SETTINGS),)*];
        }

        $(impl From<$settings> for AnyMethod {
            fn from(settings: $settings) -> Self {
                Self::$name(settings)
            }
        })*

        impl Settings for AnyMethod {
            fn check(&self) -> Result<(), SetupError> {
                match self {
                    $(Self::$name(method) => method.check(),)*
                }
            }

            fn check_start(
                &self,
                initial: Physical,
                restitution: Restitution,
            ) -> Result<(), SetupError> {
                match self {
                    $(Self::$name(method) => method.check_start(initial, restitution),)*
                }
            }

            fn step(&self) -> Option<f64> {
                match self {
                    $(Self::$name(method) => method.step(),)*
                }
            }
        }

        impl<'f, E, F: Force<E>> Method<E, PointMass<'f, F>> for AnyMethod {
            fn run(
                &self,
                system: PointMass<'f, F>,
                span: (f64, f64),
                y0: Physical,
                keep: Output<'_, E>,
                monitor: &mut impl Monitor<E>,
            ) -> Result<PointRun<E>, SetupError> {
                match self {
                    $(Self::$name(method) => method.run(system, span, y0, keep, monitor),)*
                }
            }
        }

        impl<'d, E, D: Dynamics<E>> Method<E, Mechanism<'d, D>> for AnyMethod {
            fn run(
                &self,
                system: Mechanism<'d, D>,
                span: (f64, f64),
                y0: (&[f64], &[f64]),
                keep: MechanicalOutput<'_, E>,
                monitor: &mut impl Monitor<E>,
            ) -> Result<MechanicalRun<E>, SetupError> {
                match self {
                    $(Self::$name(_method) => of_mechanism!(
                        $($mechanism)?, _method.run(system, span, y0, keep, monitor)
                    ),)*
                }
            }
        }
    };
}

methods! {
    /// High order with error control.
    SwitchedRk(SwitchedRk): PointMass, Mechanism;
    /// Implicit set-valued signs.
    ThetaGamma(FixedSteps<ThetaGamma>): PointMass, Mechanism;
    /// Impulses at velocity level.
    MoreauJean(FixedSteps<MoreauJean>): PointMass, Mechanism;
    /// Explicit signs.
    ExplicitEuler(FixedSteps<ExplicitEuler>): PointMass;
}
