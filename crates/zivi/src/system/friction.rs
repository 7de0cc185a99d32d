//! Dry friction: forces along directions in which a system slips, or sticks.
//!
//! ```text
//! w_c = B_c q' + beta_c      f_c = -mu_c lambda_i sigma_c  at a gap i,   f_c = -L_c sigma_c  in a joint
//! slip: sigma_c = sign w_c      stick: w_c = 0, |f_c| <= mu_s,c lambda_i,  |f_c| <= L_s,c
//! ```
//!
//! A channel `c` is one such direction. The tangent `B_c` of a gap must have the scale of its
//! gradient: where the gap is a distance both are unit vectors pulled back.

/// A direction of friction.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Channel {
    /// The gap whose contact force presses, at most one channel each; none for a joint or a guide.
    pub gap: Option<usize>,
    /// The tangential restitution in impacts, from 0 to 1.
    pub e_t: f64,
}

/// The law of impacts with friction.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum FrictionalImpact {
    /// `0 <= P_N perp g+ + e g- >= 0`, `-P_T in mu P_N Sign(w+ + e_t w-)`: Moreau's form.
    #[default]
    Newton,
    /// Compression, then restitution of the impulse.
    Poisson,
    /// Restitution of the work of compression; one contact.
    Stronge,
}

/// The friction of a system.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Friction {
    /// Those of the gaps first, in their order.
    pub channels: Vec<Channel>,
    /// The law of impacts at gaps with friction.
    pub law: FrictionalImpact,
    /// Where no motion in contact is possible: an impact without a collision, instead of an end.
    pub impact_without_collision: bool,
}

impl Friction {
    /// None.
    #[must_use]
    pub fn none() -> &'static Self {
        static NONE: Friction = Friction {
            channels: Vec::new(),
            law: FrictionalImpact::Newton,
            impact_without_collision: false,
        };
        &NONE
    }
}
