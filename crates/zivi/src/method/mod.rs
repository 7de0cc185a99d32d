//! Methods: one entry from a system, a span and a state to a run.
//!
//! ```text
//! Method::run(settings; system, span, y0, keep, monitor) -> run
//! ```
//!
//! A [`Method`] is its settings. [`AnyMethod`] is one of those that zivi has, chosen while the
//! program runs: batches, and the bindings to other languages, know that one only.
//!
//! A new scheme of fixed steps is a file of `stepping`, in which its settings implement
//! [`Scheme`], and a line in the list at the end of this file: all
//! that offers methods, Python's classes and the keys of files too, reads [`AnyMethod::ALL`].

mod interface;

pub(crate) use interface::newton;
pub use interface::Mechanism;
pub use interface::{Listed, Method, Settings, System};
pub use interface::{PointMass, PointRun};

pub use crate::record::trajectory::Values;

use zivi_core::setting::Setting;
use zivi_core::ThetaGammaStep;

use crate::mechanics::{MechanicalOutput, MechanicalRun};
use crate::stepping::fixed_step::{FixedSteps, Scheme};
use crate::system::dynamics::Dynamics;
use crate::{
    stepping, AnyImpactLaw, Force, Monitor, Output, Physical, Restitution, SetupError, SwitchedRk,
};

impl<S: Scheme> Settings for FixedSteps<S> {
    fn check(&self) -> Result<(), SetupError> {
        self.scheme.check(self.h, Restitution::ELASTIC)
    }

    fn check_start(&self, initial: Physical, law: &AnyImpactLaw) -> Result<(), SetupError> {
        let restitution = newton(law)?;
        self.scheme.check(self.h, restitution)?;
        self.scheme.check_start(initial, restitution)
    }

    fn step(&self) -> Option<f64> {
        Some(self.h)
    }
}

impl<S: Scheme> Listed for FixedSteps<S> {
    const NAME: &'static str = S::NAME;
    const MEANING: &'static str = S::MEANING;
    const SETTINGS: &'static [Setting] = S::SETTINGS;
    const FIXED_STEPS: bool = true;
    const PENETRATES: bool = S::PENETRATES;

    fn of(values: &Values) -> Result<Self, SetupError> {
        Ok(Self { h: values.number(&ThetaGammaStep::STEP)?, scheme: S::of(values)? })
    }
}

/// A method of the list.
#[derive(Clone, Copy, Debug)]
pub struct Entry {
    /// Its name.
    pub name: &'static str,
    /// Its description in a few words.
    pub meaning: &'static str,
    /// Its settings.
    pub settings: &'static [Setting],
    /// Whether it knows the motion at its steps only.
    pub fixed_steps: bool,
    /// Whether a mass may be below the wall at the end of a step.
    pub penetrates: bool,
    /// Whether it also runs mechanical systems.
    pub takes_mechanism: bool,
    /// The method with the values of its settings, as [`Listed::of`] gives it.
    pub of: fn(&Values) -> Result<AnyMethod, SetupError>,
}

impl Entry {
    const fn new<M: Listed>(
        takes_mechanism: bool,
        of: fn(&Values) -> Result<AnyMethod, SetupError>,
    ) -> Self {
        Self {
            name: M::NAME,
            meaning: M::MEANING,
            settings: M::SETTINGS,
            fixed_steps: M::FIXED_STEPS,
            penetrates: M::PENETRATES,
            takes_mechanism,
            of,
        }
    }
}

/// Whether something stands there.
macro_rules! stands {
    () => {
        false
    };
    ($it:ident) => {
        true
    };
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

/// All that is made of the list of the methods.
macro_rules! methods {
    ($($name:ident($settings:ty): PointMass $(, $mechanism:ident)?;)*) => {
        /// Any of the methods, with its settings.
        #[derive(Clone, Copy, Debug, PartialEq)]
        pub enum AnyMethod {
            $(
                #[doc = concat!("`", stringify!($settings), "` with its settings.")]
                $name($settings),
            )*
        }

        impl AnyMethod {
            /// The list of the methods.
            pub const ALL: &'static [Entry] = &[$(
                Entry::new::<$settings>(stands!($($mechanism)?), |values| {
                    <$settings as Listed>::of(values).map(Self::$name)
                }),
            )*];
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
                law: &AnyImpactLaw,
            ) -> Result<(), SetupError> {
                match self {
                    $(Self::$name(method) => method.check_start(initial, law),)*
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
    SwitchedRk(SwitchedRk): PointMass, Mechanism;
    ThetaGamma(FixedSteps<stepping::theta_gamma::ThetaGamma>): PointMass, Mechanism;
    MoreauJean(FixedSteps<stepping::moreau_jean::MoreauJean>): PointMass, Mechanism;
    ExplicitEuler(FixedSteps<stepping::explicit::ExplicitEuler>): PointMass;
}
