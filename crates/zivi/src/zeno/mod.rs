//! Where impacts accumulate: infinitely many of them in a finite time.
//!
//! ```text
//! t_n = t_inf - C_1 e^n - C_2 e^(2n) - ...      z_n = z_inf + Z_1 e^n + Z_2 e^(2n) + ...
//! ```
//!
//! The map from one impact to the next has the multiplier `e` across `u = 0`, on which it is the
//! identity: so the powers are known, and extrapolation removes one after the other. This module is
//! independent of the bouncing system. A mass above a wall has times alone, mechanisms have states
//! along with them.
//!
//! * `chain`: impacts at decreasing speeds, and the extrapolated Zeno point.
//! * `table`: extrapolation of times and states.
//! * `rates`: their derivatives.
//! * `fit`: series in those powers through impacts of an impact sequence.
//! * `arc`: one flight.
//! * `tail`: the flights between the last of them and that point; `stored` their numbers.

pub(crate) mod arc;
pub(crate) mod chain;
pub(crate) mod table;
pub(crate) mod tail;

pub use tail::Tail;
