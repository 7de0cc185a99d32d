//! The numbers: doubles, or single precision with the feature `single`.

#[cfg(not(feature = "single"))]
mod precision {
    /// The floating-point type of all quantities.
    pub type Real = f64;

    /// Largest number whose square is taken.
    pub const LARGE: Real = 1e150;
    /// Least number whose square is taken.
    pub const SMALL: Real = 1e-150;
    /// Relative tolerance of the sign tests: a candidate with a smaller violation is treated as
    /// equal to the neighbouring degenerate candidate.
    pub const SIGN_TOLERANCE: Real = 1e-13;

    pub(crate) use libm::sqrt;
}

#[cfg(feature = "single")]
mod precision {
    /// The floating-point type of all quantities.
    pub type Real = f32;

    /// Largest number whose square is taken.
    pub const LARGE: Real = 1e18;
    /// Least number whose square is taken.
    pub const SMALL: Real = 1e-18;
    /// Relative tolerance of the sign tests: a candidate with a smaller violation is treated as
    /// equal to the neighbouring degenerate candidate.
    pub const SIGN_TOLERANCE: Real = 1e-5;

    pub(crate) use libm::sqrtf as sqrt;
}

pub use precision::*;
