//! The variables of the models. The place in a table is the value reference, which never changes
//! once it is released: what is new comes at the end. `python/zivi/fmu/table.py` has the same
//! tables with names and units; a test compares them.

/// The type of a variable.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum DataType {
    Real,
    Integer,
    Boolean,
}

/// Who may set it, and when.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Role {
    /// Nobody: the time of the last communication point.
    Time,
    /// The importer, until the initialisation is over.
    Parameter,
    /// The importer, at any time.
    Input,
    /// Nobody.
    Output,
}

/// A variable without its name.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ScalarVariable {
    pub(crate) kind: DataType,
    pub(crate) role: Role,
    pub(crate) start: f64,
}

#[cfg(not(feature = "loops"))]
macro_rules! variables {
    ($name:ident: $($index:ident $kind:ident $role:ident $start:expr;)*) => {
        #[allow(dead_code, reason = "not every place is asked for by name")]
        pub(crate) mod $name {
            use super::{DataType, Role, ScalarVariable};

            #[allow(non_camel_case_types, clippy::upper_case_acronyms)]
            enum Place { $($index),* }
            $(pub(crate) const $index: usize = Place::$index as usize;)*
            pub(crate) const TABLE: &[ScalarVariable] = &[
                $(ScalarVariable { kind: DataType::$kind, role: Role::$role, start: $start }),*
            ];
        }
    };
}

#[cfg(not(feature = "loops"))]
variables! { mass:
    TIME Real Time 0.0;
    U Real Input 0.0;
    X Real Output 0.0;
    XDOT Real Output 0.0;
    S Real Output 0.0;
    V Real Output 0.0;
    AT_REST Boolean Output 0.0;
    H Real Parameter 1e-3;
    E Real Parameter 0.5;
    G Real Parameter 9.81;
    X0 Real Parameter 1.0;
    XDOT0 Real Parameter 0.0;
}

#[cfg(not(feature = "loops"))]
variables! { regulator:
    TIME Real Time 0.0;
    X Real Input 0.0;
    XDOT Real Input 0.0;
    FORCE Real Input 0.0;
    U Real Output 0.0;
    STATUS Integer Output 0.0;
    MU1 Real Parameter 30.0;
    MU2 Real Parameter 17.0;
    H Real Parameter 1e-3;
    E Real Parameter 0.5;
    BOUND Real Parameter 0.0;
    DEPTH Real Parameter 0.1;
    U_MIN Real Parameter -1e300;
    U_MAX Real Parameter 1e300;
    LANDING Boolean Parameter 1.0;
    AHEAD Integer Parameter 1.0;
    QUIET Real Parameter 0.0;
}

#[cfg(not(feature = "loops"))]
variables! { tracker:
    TIME Real Time 0.0;
    X Real Input 0.0;
    XDOT Real Input 0.0;
    FORCE Real Input -9.81;
    FORCE_REF Real Input -9.81;
    U Real Output 0.0;
    X_REF Real Output 0.0;
    XDOT_REF Real Output 0.0;
    STATUS Integer Output 0.0;
    MU1 Real Parameter 30.0;
    MU2 Real Parameter 17.0;
    H Real Parameter 1e-3;
    E Real Parameter 0.5;
    E_REF Real Parameter 0.0;
    X_REF0 Real Parameter 0.0;
    XDOT_REF0 Real Parameter 0.0;
    BOUND Real Parameter 0.0;
    DEPTH Real Parameter 0.1;
    U_MIN Real Parameter -1e300;
    U_MAX Real Parameter 1e300;
    NEAREST Boolean Parameter 0.0;
    LANDING Boolean Parameter 1.0;
    AHEAD Integer Parameter 1.0;
    PRESS Real Parameter 0.0;
    HORIZON Real Parameter 1.0;
    SHIFT Boolean Parameter 0.0;
    QUIET Real Parameter 0.0;
}

#[cfg(not(feature = "loops"))]
variables! { closed_loop:
    TIME Real Time 0.0;
    DISTURBANCE Real Input 0.0;
    FORCE Real Input -9.81;
    FORCE_REF Real Input -9.81;
    X Real Output 0.0;
    XDOT Real Output 0.0;
    X_REF Real Output 0.0;
    XDOT_REF Real Output 0.0;
    U Real Output 0.0;
    STATUS Integer Output 0.0;
    X0 Real Parameter 1.0;
    XDOT0 Real Parameter 0.0;
    MU1 Real Parameter 30.0;
    MU2 Real Parameter 17.0;
    H Real Parameter 1e-3;
    E Real Parameter 0.5;
    E_REF Real Parameter 0.0;
    X_REF0 Real Parameter 0.0;
    XDOT_REF0 Real Parameter 0.0;
    BOUND Real Parameter 0.0;
    DEPTH Real Parameter 0.1;
    U_MIN Real Parameter -1e300;
    U_MAX Real Parameter 1e300;
    NEAREST Boolean Parameter 0.0;
    LANDING Boolean Parameter 1.0;
    AHEAD Integer Parameter 1.0;
    PRESS Real Parameter 0.0;
    HORIZON Real Parameter 1.0;
    SHIFT Boolean Parameter 0.0;
    QUIET Real Parameter 0.0;
}

#[cfg(not(feature = "loops"))]
variables! { observer:
    TIME Real Time 0.0;
    X Real Input 0.0;
    XDOT Real Input 0.0;
    FORCE Real Input -9.81;
    U Real Input 0.0;
    X_EST Real Output 0.0;
    XDOT_EST Real Output 0.0;
    D_EST Real Output 0.0;
    REFUSED Integer Output 0.0;
    STATUS Integer Output 0.0;
    H Real Parameter 1e-3;
    E Real Parameter 0.5;
    NOISE_X Real Parameter 1e-4;
    NOISE_XDOT Real Parameter 1e-2;
    Q_D Real Parameter 1e-3;
    SE Real Parameter 0.0;
    DMAX Real Parameter 20.0;
    POSITION_ONLY Boolean Parameter 0.0;
    LEARN_E Boolean Parameter 0.0;
    Q_E Real Parameter 0.0;
    E_EST Real Output 0.0;
    E_STD Real Output 0.0;
}
