//! Impact laws: the speed after an impact from the speed before it.
//!
//! ```text
//! x'+ = after(v)      v = -x'- > 0      0 <= after(v) <= v                                  (1)
//! ```
//!
//! A new law is a file, in which its settings implement [`ImpactLaw`] and [`ParametricLaw`], and a
//! line in the list of [`AnyImpactLaw`]. Laws without numeric parameters follow after the list.

mod law;
mod speed_dependent;
mod tabulated;

pub use law::{ImpactLaw, ParametricLaw};
pub use speed_dependent::FunctionImpact;
pub use speed_dependent::SpeedDependentImpact;
pub use tabulated::TabulatedImpact;

use zivi_core::setting::Setting;
use zivi_core::{Restitution, SettingError};

/// The list of the laws, for each its name and its type: first those of a name and parameters.
macro_rules! impact_laws {
    (
        parametric { $($(#[$parametric_doc:meta])* $parametric:ident($parametric_law:ty);)* }
        others { $($(#[$other_doc:meta])* $other:ident($other_law:ty);)* }
    ) => {
        impact_laws! {
            $($(#[$parametric_doc])* $parametric($parametric_law);)*
            $($(#[$other_doc])* $other($other_law);)*
        }

        impl AnyImpactLaw {
            /// The names of all laws that have parameters, with these.
            pub const ALL: &'static [(&'static str, &'static [Setting])] =
                &[$((stringify!($parametric), <$parametric_law>::PARAMETERS),)*];

            /// The law of this name; `None` if unknown.
            #[must_use]
            pub fn named(name: &str, values: &[f64]) -> Option<Result<Self, SettingError>> {
                $(if name == stringify!($parametric) {
                    return Some(<$parametric_law>::of(values).map(Self::$parametric));
                })*
                None
            }
        }
    };
    ($($(#[$doc:meta])* $name:ident($law:ty);)*) => {
        /// Any of the impact laws.
        #[derive(Clone, Debug, PartialEq)]
        pub enum AnyImpactLaw {
            $($(#[$doc])* $name($law),)*
        }

        $(impl From<$law> for AnyImpactLaw {
            #[inline]
            fn from(law: $law) -> Self {
                Self::$name(law)
            }
        })*

        impl AnyImpactLaw {
            /// The speed after an impact at the speed `v > 0` (m/s).
            #[inline]
            #[must_use]
            pub fn after(&self, v: f64) -> f64 {
                match self { $(Self::$name(law) => law.after(v),)* }
            }

            /// The derivative of the speed after by the one before.
            #[must_use]
            pub fn slope(&self, v: f64) -> f64 {
                match self { $(Self::$name(law) => law.slope(v),)* }
            }

            /// The derivative of the speed after by a parameter, by its number.
            #[must_use]
            pub fn by(&self, parameter: usize, v: f64) -> f64 {
                match self { $(Self::$name(law) => law.by(parameter, v),)* }
            }

            /// As [`ImpactLaw::limit`].
            #[inline]
            #[must_use]
            pub fn limit(&self) -> Option<f64> {
                match self { $(Self::$name(law) => law.limit(),)* }
            }

            /// As [`ImpactLaw::limit_by`].
            #[must_use]
            pub fn limit_by(&self, parameter: usize) -> f64 {
                match self { $(Self::$name(law) => law.limit_by(parameter),)* }
            }

            /// As [`ImpactLaw::geometric_up_to`].
            #[inline]
            #[must_use]
            pub fn geometric_up_to(&self) -> f64 {
                match self { $(Self::$name(law) => law.geometric_up_to(),)* }
            }

            /// As [`ImpactLaw::is_newton_when_slow`].
            #[must_use]
            pub fn is_newton_when_slow(&self) -> bool {
                match self { $(Self::$name(law) => law.is_newton_when_slow(),)* }
            }

            /// As [`ImpactLaw::sum_of_speeds`].
            #[must_use]
            pub fn sum_of_speeds(&self, u: f64) -> Option<f64> {
                match self { $(Self::$name(law) => law.sum_of_speeds(u),)* }
            }

            /// As [`ImpactLaw::constant`].
            #[inline]
            #[must_use]
            pub fn constant(&self) -> Option<Restitution> {
                match self { $(Self::$name(law) => law.constant(),)* }
            }

            /// The coefficient of restitution `after(v)/v` at a speed; that of slow impacts at none.
            #[inline]
            #[must_use]
            pub fn ratio(&self, v: f64) -> f64 {
                match self.constant() {
                    Some(newton) => newton.e(),
                    None if v > 0.0 => self.after(v) / v,
                    None => self.limit().unwrap_or(1.0),
                }
            }

            /// As [`Self::ratio`], but 0 where the speeds that follow have a sum of at most `slow`
            /// (m/s), and are no geometric impact sequence.
            #[inline]
            #[must_use]
            pub fn ratio_unless_slow(&self, v: f64, slow: f64) -> f64 {
                if let Some(newton) = self.constant() {
                    return newton.e();
                }
                let e = self.ratio(v);
                let spent = e * v <= slow && self.geometric_up_to() == 0.0;
                let sum = if spent { self.sum_of_speeds(e * v) } else { None };
                if sum.is_some_and(|sum| sum <= slow) { 0.0 } else { e }
            }

            /// As [`ImpactLaw::transform`].
            #[must_use]
            pub fn transform(&self) -> Restitution {
                match self { $(Self::$name(law) => law.transform(),)* }
            }
        }
    };
}

impact_laws! {
    parametric {
        /// Newton's: one coefficient of restitution for all speeds.
        NewtonImpact(Restitution);
        /// A coefficient that is a power of the speed.
        SpeedDependentImpact(SpeedDependentImpact);
    }
    others {
        /// A coefficient that is linear between measured speeds.
        TabulatedImpact(TabulatedImpact);
        /// A coefficient that is a function of the speed.
        FunctionImpact(FunctionImpact);
    }
}

/// Newton's law with each of these coefficients, as mechanical systems take them.
///
/// # Errors
/// [`SettingError`] names the first that is not from 0 to 1.
///
/// ```
/// use zivi::system::impact_law::newton_impacts;
/// assert_eq!(newton_impacts(&[0.5, 0.3])?[1].ratio(2.0), 0.3);
/// assert!(newton_impacts(&[1.5]).is_err());
/// # Ok::<(), zivi_core::SettingError>(())
/// ```
pub fn newton_impacts(e: &[f64]) -> Result<Vec<AnyImpactLaw>, SettingError> {
    e.iter().map(|&e| Restitution::of(&[e]).map(AnyImpactLaw::NewtonImpact)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn laws() -> Vec<AnyImpactLaw> {
        let newton = [0.0, 0.3, 1.0].map(|e| AnyImpactLaw::from(Restitution::from_e(e).unwrap()));
        let of = |values: [f64; 4]| SpeedDependentImpact::of(&values).unwrap().into();
        let powers = [
            [0.5, 1.0, 0.25, 1.0],
            [0.5, 2.0, 0.25, 0.9],
            [0.5, 0.1, -0.3, 0.7],
            [0.8, 1.0, -2.0, 1.0],
            [0.4, 1.0, 0.0, 1.0],
            [0.0, 1.0, 0.5, 1.0],
            [0.0, 1.0, -0.5, 0.0],
        ];
        newton.into_iter().chain(powers.map(of)).collect()
    }

    #[test]
    fn no_impact_adds_energy() {
        for law in laws() {
            for power in -60..60 {
                let v = 10_f64.powf(f64::from(power) / 4.0);
                let after = law.after(v);
                assert!(after >= 0.0 && after <= v, "{law:?} {v}: {after}");
            }
        }
    }

    #[test]
    fn slopes_are_differences() {
        for law in laws() {
            for v in [1e-3, 0.03, 0.4, 0.9, 1.7, 23.0] {
                let h = 1e-6 * v;
                let difference = (law.after(v + h) - law.after(v - h)) / (2.0 * h);
                assert!((law.slope(v) - difference).abs() < 1e-8, "{law:?} {v}");
            }
        }
    }

    #[test]
    fn derivatives_by_parameters_are_differences() {
        let values = [[0.5, 1.0, 0.25, 0.9], [0.6, 0.1, -0.3, 0.7]];
        for values in values {
            for parameter in 0..4 {
                for v in [1e-3, 0.03, 0.4, 1.7, 23.0] {
                    let at = |step: f64| {
                        let mut moved = values;
                        moved[parameter] += step;
                        SpeedDependentImpact::of(&moved).unwrap()
                    };
                    let h = 1e-7;
                    let difference = (at(h).after(v) - at(-h).after(v)) / (2.0 * h);
                    let by = at(0.0).by(parameter, v);
                    assert!((by - difference).abs() < 1e-6 * v.max(1.0), "{parameter} {v}");
                    let limits = (at(h).limit(), at(-h).limit());
                    let difference = (limits.0.unwrap() - limits.1.unwrap()) / (2.0 * h);
                    assert!((at(0.0).limit_by(parameter) - difference).abs() < 1e-8);
                }
            }
        }
    }

    #[test]
    fn laws_have_their_limit_where_they_say() {
        for law in laws() {
            let (up_to, limit) = (law.geometric_up_to(), law.limit().unwrap());
            if up_to > 0.0 {
                let v = 0.999 * up_to.min(1e3);
                assert!((law.after(v) / v - limit).abs() < 1e-15, "{law:?}");
            } else {
                assert!(limit == 0.0 && law.after(1e-200) < 1e-200, "{law:?}");
            }
        }
    }

    #[test]
    fn names_lead_to_laws_and_what_is_out_of_range_is_named() {
        assert!(AnyImpactLaw::named("Hertz", &[]).is_none());
        let newton = AnyImpactLaw::named("NewtonImpact", &[0.5]).unwrap();
        assert_eq!(newton, Ok(Restitution::from_e(0.5).unwrap().into()));
        for (values, wrong) in [
            ([1.1, 1.0, 0.2, 1.0], "e0"),
            ([f64::NAN, 1.0, 0.2, 1.0], "e0"),
            ([0.5, 0.0, 0.2, 1.0], "v0"),
            ([0.5, f64::INFINITY, 0.2, 1.0], "v0"),
            ([0.5, 1.0, 1.0, 1.0], "k"),
            ([0.5, 1.0, f64::NEG_INFINITY, 1.0], "k"),
            ([0.5, 1.0, f64::NAN, 1.0], "k"),
            ([0.5, 1.0, 0.2, 0.4], "e_max"),
            ([0.5, 1.0, 0.2, 1.1], "e_max"),
            ([0.5, 1.0, 0.2, f64::NAN], "e_max"),
        ] {
            let refused = AnyImpactLaw::named("SpeedDependentImpact", &values).unwrap();
            assert_eq!(refused.unwrap_err().name, wrong);
        }
    }
}
