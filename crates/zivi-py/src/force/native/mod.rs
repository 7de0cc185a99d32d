//! The list of the forces that need no interpreter, and all that is made of it.

mod compiled;
mod force;

use zivi::{
    ConstantForce, Dependence, Force, HarmonicWall, LinearForce, LinearLaw, OnMovingWall,
    TableForce,
};

use force::NativeForce;

pub(crate) use compiled::{compiled_ratio, force_raised, CompiledForce, Raised};

/// All that is made of the list: for each force its names, above a wall at rest and above one that
/// vibrates, and its type. (`$d` is a dollar.)
macro_rules! natives {
    ($d:tt $($fixed:ident, $moving:ident($force:ty);)*) => {
        /// A force that needs no interpreter.
        #[derive(Clone, Copy)]
        pub(crate) enum AnyNative {
            $($fixed($force), $moving(OnMovingWall<$force, HarmonicWall>),)*
        }

        /// The same with its partial derivatives.
        pub(crate) enum NativeSlopes {
            $(
                $fixed(<$force as NativeForce>::Differentiable),
                $moving(OnMovingWall<<$force as NativeForce>::Differentiable, HarmonicWall>),
            )*
        }

        impl AnyNative {
            /// The names of the classes in Python that are made of numbers, with those of these.
            pub(crate) const CLASSES: &'static [Option<(&'static str, &'static [&'static str])>] =
                &[$(<$force as NativeForce>::CLASS,)*];

            /// The force of a class, of its numbers in their order.
            pub(crate) fn of(class: &str, numbers: &[f64]) -> Option<Self> {
                $(
                    if <$force as NativeForce>::CLASS.is_some_and(|(name, _)| name == class) {
                        return <$force as NativeForce>::of(numbers).map(Self::$fixed);
                    }
                )*
                None
            }

            /// The same in the frame of a vibrating wall; `None` if it is in such a frame already.
            pub(crate) fn above(self, wall: HarmonicWall) -> Option<Self> {
                match self {
                    $(Self::$fixed(force) => Some(Self::$moving(OnMovingWall { force, wall })),)*
                    _ => None,
                }
            }

            /// Its parameter of this index: first those of the force, then those of its wall.
            pub(crate) fn parameter(&mut self, index: usize) -> Option<&mut f64> {
                match self {
                    $(
                        Self::$fixed(force) => force.parameter(index).ok(),
                        Self::$moving(OnMovingWall { force, wall }) => {
                            match force.parameter(index) {
                                Ok(own) => Some(own),
                                Err(0) => Some(&mut wall.amplitude),
                                Err(1) => Some(&mut wall.omega),
                                Err(2) => Some(&mut wall.phase),
                                Err(3) => Some(&mut wall.offset),
                                Err(_) => None,
                            }
                        }
                    )*
                }
            }

            /// The same for a run that begins now.
            pub(crate) fn listening(self) -> Self {
                match self {
                    $(Self::$fixed(force) => Self::$fixed(force.listening()),)*
                    moving => moving,
                }
            }

            /// Address of the compiled function, if any.
            pub(crate) fn address(&self) -> Option<usize> {
                match self {
                    $(Self::$fixed(force) => force.address(),)*
                    _ => None,
                }
            }

            /// With its partial derivatives, for a span of a duration (s).
            pub(crate) fn slopes(self, duration: f64) -> NativeSlopes {
                match self {
                    $(
                        Self::$fixed(force) => NativeSlopes::$fixed(force.differentiable(duration)),
                        Self::$moving(OnMovingWall { force, wall }) => {
                            let force = force.differentiable(duration);
                            NativeSlopes::$moving(OnMovingWall { force, wall })
                        }
                    )*
                }
            }
        }

        impl NativeSlopes {
            /// The same in the frame of a vibrating wall; `None` if it is in such a frame already.
            pub(crate) fn above(self, wall: HarmonicWall) -> Option<Self> {
                match self {
                    $(Self::$fixed(force) => Some(Self::$moving(OnMovingWall { force, wall })),)*
                    _ => None,
                }
            }
        }

        impl<E> Force<E> for AnyNative {
            fn at(&mut self, t: f64, x: f64, xdot: f64) -> Result<f64, E> {
                match self {
                    $(
                        Self::$fixed(force) => force.at(t, x, xdot),
                        Self::$moving(force) => force.at(t, x, xdot),
                    )*
                }
            }

            fn dependence(&self) -> Dependence {
                match self {
                    $(
                        Self::$fixed(force) => Force::<E>::dependence(force),
                        Self::$moving(force) => Force::<E>::dependence(force),
                    )*
                }
            }

            fn dependence_at_rest(&self) -> Dependence {
                match self {
                    $(
                        Self::$fixed(force) => Force::<E>::dependence_at_rest(force),
                        Self::$moving(force) => Force::<E>::dependence_at_rest(force),
                    )*
                }
            }

            fn shortest_period(&self) -> Option<f64> {
                match self {
                    $(
                        Self::$fixed(force) => Force::<E>::shortest_period(force),
                        Self::$moving(force) => Force::<E>::shortest_period(force),
                    )*
                }
            }

            fn excitation(&self, t: f64) -> Option<f64> {
                match self {
                    $(
                        Self::$fixed(force) => Force::<E>::excitation(force, t),
                        Self::$moving(force) => Force::<E>::excitation(force, t),
                    )*
                }
            }

            fn excited(&mut self, excitation: f64, t: f64, x: f64, xdot: f64) -> Result<f64, E> {
                match self {
                    $(
                        Self::$fixed(force) => force.excited(excitation, t, x, xdot),
                        Self::$moving(force) => force.excited(excitation, t, x, xdot),
                    )*
                }
            }

            fn is_same(&self, other: &Self) -> bool {
                match (self, other) {
                    $(
                        (Self::$fixed(one), Self::$fixed(two)) => Force::<E>::is_same(one, two),
                        (Self::$moving(one), Self::$moving(two)) => Force::<E>::is_same(one, two),
                    )*
                    _ => false,
                }
            }

            fn as_linear_force(&self) -> Option<LinearForce> {
                match self {
                    $(Self::$fixed(force) => Force::<E>::as_linear_force(force),)*
                    _ => None,
                }
            }

            fn linear(&self) -> Option<LinearLaw> {
                match self {
                    $(
                        Self::$fixed(force) => Force::<E>::linear(force),
                        Self::$moving(force) => Force::<E>::linear(force),
                    )*
                }
            }
        }

        /// One call for every force above a wall at rest, so that each is compiled into its own
        /// loop, and one for those above walls that vibrate.
        macro_rules! with_native {
            ($d given:expr, |$d one:ident| $d run:expr) => {
                match $d given {
                    $($crate::force::AnyNative::$fixed(mut given) => {
                        let $d one = &mut given;
                        $d run
                    })*
                    mut given => {
                        let $d one = &mut given;
                        $d run
                    }
                }
            };
        }

        /// One call for every force with its partial derivatives.
        macro_rules! with_native_slopes {
            ($d given:expr, |$d one:ident| $d run:expr) => {
                match $d given {
                    $(
                        $crate::force::NativeSlopes::$fixed(mut given) => {
                            let $d one = &mut given;
                            $d run
                        }
                        $crate::force::NativeSlopes::$moving(mut given) => {
                            let $d one = &mut given;
                            $d run
                        }
                    )*
                }
            };
        }

        pub(crate) use {with_native, with_native_slopes};
    };
}

natives! { $
    Constant, MovingConstant(ConstantForce);
    Linear, MovingLinear(LinearForce);
    Compiled, MovingCompiled(CompiledForce);
    Table, MovingTable(TableForce<'static>);
}
