//! The twisting tracker: makes the mass follow a bouncing reference.

use crate::code::{
    self, Code, Refusal, Sealed, Word, ZIVI_E_BRANCH, ZIVI_E_PRESS, ZIVI_E_SHIFT, ZIVI_E_SIDE,
    ZIVI_E_STATE, ZIVI_OK,
};
use crate::config::{
    self, GainCondition, Given, ZIVI_GIVEN_E_REF, ZIVI_GIVEN_HORIZON, ZIVI_GIVEN_KAPPA_REF,
    ZIVI_GIVEN_PRESS,
};
use crate::Regulator;
use zivi_core::control::{
    checked_horizon, Approach, Gains, Landing, Port, ReferencePeriod, TickStatus, TrackerSettings,
    TrackerState, TwistingTracker, Waypoint,
};
use zivi_core::{Branch, Lifted, Physical, Real, Restitution};

/// In `branch`: measurements are lifted to `s >= 0`, the default.
pub const ZIVI_BRANCH_POSITIVE: u32 = 0;
/// In `branch`: measurements are lifted to the preimage that is nearer to the reference.
pub const ZIVI_BRANCH_NEAREST: u32 = 1;

/// The valid bits of a tracker's `given`.
const GIVEN: u32 = config::CONTROLLER
    | ZIVI_GIVEN_E_REF
    | ZIVI_GIVEN_KAPPA_REF
    | ZIVI_GIVEN_PRESS
    | ZIVI_GIVEN_HORIZON;

/// Settings of a tracker. A member that is zero has its default value, unless its bit
/// of `given` is set.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct TrackerConfig {
    /// `sizeof(zivi_tracker_config)`.
    pub size: u32,
    /// `ZIVI_BRANCH_POSITIVE` or `ZIVI_BRANCH_NEAREST`.
    pub branch: u32,
    /// `ZIVI_TICK_LANDING` or `ZIVI_TICK_PAPER`.
    pub tick: u32,
    /// Horizon of the contact-establishing law in periods, 1 + the periods of delay; by default 1.
    pub ahead: u32,
    /// 1: in free flight the measured velocity is shifted back by half a period; 0: it is not.
    pub shift: u32,
    /// `ZIVI_GIVEN_...`: the members whose value 0 is intended and replaces the default.
    pub given: u32,
    /// Gain on the sign of the position error (m/s^2).
    pub mu1: Real,
    /// Gain on the sign of the velocity error, 0 < mu2 < mu1 (m/s^2).
    pub mu2: Real,
    /// Sampling period (s), > 0.
    pub h: Real,
    /// Coefficient of restitution of the plant's wall, in (0, 1]; or set `kappa`.
    pub e: Real,
    /// `(1 - e)/(1 + e)`, in (0, 1), in place of `e`.
    pub kappa: Real,
    /// Coefficient of restitution of the reference's wall; by default the plant's.
    pub e_ref: Real,
    /// `(1 - e_ref)/(1 + e_ref)` in place of `e_ref`.
    pub kappa_ref: Real,
    /// A bound of the unknown force that the gains are checked against (m/s^2); by default none.
    pub bound: Real,
    /// Acceleration towards the wall of a mass at rest, at least `bound` (m/s^2); by default the
    /// law's own.
    pub press: Real,
    /// Dead zone of the contact-establishing law, a bound of the velocity error (m/s); by default 0.
    pub quiet: Real,
    /// Periods that a step is planned over, >= 1; by default 1.
    pub horizon: Real,
    /// Measurements down to `-depth` are replaced by 0, deeper ones are rejected (m); by default 0.1.
    pub depth: Real,
    /// Least control of the actuator (m/s^2); unlimited while both are 0.
    pub u_min: Real,
    /// Largest control of the actuator (m/s^2).
    pub u_max: Real,
}

/// A tracker with its reference. Everything in it may be read, copied and logged; it is changed by
/// `zivi_tracker_*` alone.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Tracker {
    /// Gain on the sign of the position error (m/s^2).
    pub mu1: Real,
    /// Gain on the sign of the velocity error (m/s^2).
    pub mu2: Real,
    /// Sampling period (s).
    pub h: Real,
    /// Coefficient of restitution of the plant's wall.
    pub e: Real,
    /// `(1 - e)/(1 + e)`.
    pub kappa: Real,
    /// Coefficient of restitution of the reference's wall.
    pub e_ref: Real,
    /// `(1 - e_ref)/(1 + e_ref)`.
    pub kappa_ref: Real,
    /// Acceleration towards the wall of a mass at rest (m/s^2), infinite for the law's own.
    pub press: Real,
    /// Dead zone of the contact-establishing law (m/s).
    pub quiet: Real,
    /// Periods that a step is planned over.
    pub horizon: Real,
    /// Largest penetration of a valid measurement (m).
    pub depth: Real,
    /// Least control (m/s^2).
    pub u_min: Real,
    /// Largest control (m/s^2).
    pub u_max: Real,
    /// How measurements are lifted.
    pub branch: u32,
    /// Horizon of the contact-establishing law in periods, 0 for the update of the paper.
    pub ahead: u32,
    /// Whether the measured velocity is shifted back by half a period in free flight.
    pub shift: u32,
    /// 0.
    pub reserved: u32,
    /// The reference's transformed position (m).
    pub s_ref: Real,
    /// The reference's transformed velocity (m/s).
    pub v_ref: Real,
    /// The side of the wall on which the reference was last, +1 or -1.
    pub side: Real,
    /// The reference at the next sample: its distance from the wall (m).
    pub x_ref: Real,
    /// The reference's velocity (m/s).
    pub xdot_ref: Real,
    /// The last control (m/s^2).
    pub u: Real,
    /// Selection of `sgn s` in the last update, in [-1, 1].
    pub lambda_s: Real,
    /// Selection of `sgn v`.
    pub lambda_v: Real,
    /// Selection of `sgn s_ref`.
    pub lambda_sr: Real,
    /// Selection of `sgn v_ref`.
    pub lambda_vr: Real,
    /// Selection of `sgn (s - s_ref)`.
    pub lambda_es: Real,
    /// Selection of `sgn (v - v_ref)`.
    pub lambda_ev: Real,
    /// Updates since the last reset.
    pub ticks: u64,
    /// Bits of the changes to the last sample (clamped) and control (saturated).
    pub status: u32,
    /// Iterations of the last update.
    pub iterations: u32,
    /// Checksum of the settings, which reveals a damaged or uninitialised object.
    pub seal: u64,
}

// SAFETY: `mu1` to `reserved`
unsafe impl Sealed for Tracker {
    const SETTINGS: usize = core::mem::offset_of!(Tracker, s_ref) / size_of::<Word>();
    const KIND: u64 = 0x7a69_7669_7472_6163;

    fn seal(&self) -> u64 {
        self.seal
    }
}

const _: () = {
    use core::mem::offset_of;
    #[cfg(not(feature = "single"))]
    assert!(size_of::<Tracker>() == 240 && size_of::<TrackerConfig>() == 136);
    assert!(offset_of!(Tracker, s_ref) == size_of::<Word>() * <Tracker as Sealed>::SETTINGS);
    #[cfg(not(feature = "single"))]
    assert!(offset_of!(Tracker, x_ref) == 144 && offset_of!(Tracker, u) == 160);
    #[cfg(not(feature = "single"))]
    assert!(offset_of!(Tracker, ticks) == 216 && offset_of!(Tracker, iterations) == 228);
};

impl TrackerConfig {
    /// The size and a horizon of 1; all other members are 0. (All zeros would be a call of memset.)
    #[must_use]
    pub fn defaults() -> Self {
        Self { size: size_of::<Self>() as u32, horizon: 1.0, ..Self::default() }
    }
}

/// A reference that is given, at one sample.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct GivenReference {
    /// Distance from the wall, >= 0 (m).
    pub x: Real,
    /// Velocity (m/s).
    pub xdot: Real,
    /// The side of the wall on which it is followed, +1 or -1: it changes with each impact of the
    /// reference. Only `ZIVI_BRANCH_NEAREST` uses it.
    pub side: Real,
}

impl GivenReference {
    pub(crate) fn waypoint(self) -> Result<Waypoint, Refusal> {
        let Self { x, xdot, side } = self;
        let branch = match side {
            1.0 => Branch::Positive,
            -1.0 => Branch::Negative,
            _ => return Err(Refusal(ZIVI_E_SIDE)),
        };
        Ok(Waypoint { state: Physical { x, xdot }, branch })
    }
}

/// Motion of a given reference over a period `h`; `acceleration` is that of the reference, NaN if it is
/// unknown.
#[cold]
#[inline(never)]
fn course_between(
    restitution: Restitution,
    h: Real,
    force: Real,
    (now, next): (&GivenReference, &GivenReference),
    acceleration: Real,
) -> Result<ReferencePeriod, Refusal> {
    let acceleration = (!acceleration.is_nan()).then_some(acceleration);
    let waypoints = [now.waypoint()?, next.waypoint()?];
    Ok(ReferencePeriod::between((restitution, h), force, waypoints, acceleration)?)
}

impl Tracker {
    /// Checks the settings; the reference starts at rest.
    pub fn init(&mut self, config: &TrackerConfig) -> Code {
        match self.configured(config) {
            Ok(()) => ZIVI_OK,
            Err(code) => code,
        }
    }

    fn configured(&mut self, config: &TrackerConfig) -> Result<(), Code> {
        config::checked_size::<TrackerConfig>(config.size)?;
        let TrackerConfig { mu1, mu2, h, bound, e, kappa, tick, ahead, quiet, .. } = *config;
        let given = Given::checked(config.given, GIVEN)?;
        let (landing, walls) = ((tick, ahead, quiet), (e, kappa));
        let (restitution, ahead) =
            config::law(GainCondition::Track, given, (mu1, mu2), bound, h, walls, landing)?;
        let TrackerConfig { branch, shift, .. } = *config;
        let press = match given.said(ZIVI_GIVEN_PRESS, config.press) {
            Some(press) if ahead == 0 || press < bound || !press.is_finite() => {
                return Err(ZIVI_E_PRESS);
            }
            said => said.unwrap_or(Real::INFINITY),
        };
        let (e_ref, kappa_ref) = (config.e_ref, config.kappa_ref);
        let restitution_ref = config::restitution_ref(given, e_ref, kappa_ref, restitution)?;
        let port = config::port(given, config.depth, config.u_min, config.u_max)?;
        approach(branch).ok_or(ZIVI_E_BRANCH)?;
        if shift > 1 {
            return Err(ZIVI_E_SHIFT);
        }
        let horizon = given.or(ZIVI_GIVEN_HORIZON, config.horizon, 1.0);
        checked_horizon(horizon, h).map_err(code::of)?;
        let (u_min, u_max) = port.actuator();
        *self = Self {
            mu1,
            mu2,
            h,
            e: restitution.e(),
            kappa: restitution.kappa(),
            e_ref: restitution_ref.e(),
            kappa_ref: restitution_ref.kappa(),
            press,
            quiet,
            horizon,
            depth: port.depth(),
            u_min,
            u_max,
            branch,
            ahead,
            shift,
            side: 1.0,
            u: port.clipped(0.0),
            ..Self::default()
        };
        self.seal = self.seal_of_settings();
        Ok(())
    }

    /// Puts the reference at `x_ref` with velocity `xdot_ref` and forgets the last update.
    pub fn reset(&mut self, x_ref: Real, xdot_ref: Real) -> Code {
        match self.placed(Physical { x: x_ref, xdot: xdot_ref }) {
            Ok(()) => ZIVI_OK,
            Err(code) => code,
        }
    }

    fn placed(&mut self, reference: Physical) -> Result<(), Code> {
        self.intact()?;
        let mut core = self.core();
        core.reset(reference).map_err(code::of)?;
        self.remember(&core);
        self.u = Port::trusted(self.depth, (self.u_min, self.u_max)).clipped(0.0);
        self.ticks = 0;
        Ok(())
    }

    /// The control for the period that starts with this measurement: [`Tracker::u`]. The reference
    /// advances by one period.
    pub fn step(&mut self, x: Real, xdot: Real, force: Real, force_ref: Real) -> Code {
        self.tick(Physical { x, xdot }, force, force_ref, None)
    }

    /// The same for a reference that is given at this sample and at the next one; `acceleration` is
    /// its own over the period, NaN if it is unknown.
    pub fn step_to(
        &mut self,
        x: Real,
        xdot: Real,
        force: Real,
        [now, next]: [GivenReference; 2],
        acceleration: Real,
    ) -> Code {
        self.tick(Physical { x, xdot }, force, acceleration, Some((&now, &next)))
    }

    /// A control update for the tracker's own reference under the force `drive`, or for a given one with this
    /// acceleration.
    pub(crate) fn tick(
        &mut self,
        measured: Physical,
        force: Real,
        drive: Real,
        given: Option<(&GivenReference, &GivenReference)>,
    ) -> Code {
        match self.ticked(measured, force, drive, given) {
            Ok(code) | Err(code) => code,
        }
    }

    #[inline(always)]
    fn ticked(
        &mut self,
        measured: Physical,
        force: Real,
        drive: Real,
        given: Option<(&GivenReference, &GivenReference)>,
    ) -> Result<Code, Code> {
        self.followable()?;
        // each half of the update constructs the controller: it loads only the members that it needs
        let planned = self.core().plan(measured, force, |core| {
            let Some(given) = given else { return Ok(core.own_period(drive)) };
            let (restitution, h) = (core.reference_step().restitution(), core.h());
            Ok(core.given_period(course_between(restitution, h, force, given, drive)?))
        });
        let planned = planned.map_err(|Refusal(code)| code)?;
        let mut core = self.core();
        core.follow(&planned).map_err(code::of)?;
        self.remember(&core);
        self.ticks = self.ticks.wrapping_add(1);
        Ok(code::of_status(core.state().status))
    }

    /// The controller of the core with the settings that were checked, in this state.
    #[inline(always)] // taken apart: no copy of it is ever made
    pub(crate) fn core(&self) -> TwistingTracker {
        let settings = TrackerSettings {
            gains: Gains::trusted(self.mu1, self.mu2),
            h: self.h,
            restitution: Restitution::trusted(self.e, self.kappa),
            restitution_ref: Restitution::trusted(self.e_ref, self.kappa_ref),
            approach: approach(self.branch).unwrap_or_default(),
            landing: (self.ahead > 0).then(|| Landing::trusted(self.ahead, self.h, self.quiet)),
            press: self.press.is_finite().then_some(self.press),
            horizon: self.horizon,
            shift: self.shift != 0,
            port: Port::trusted(self.depth, (self.u_min, self.u_max)),
        };
        let state = TrackerState {
            reference: Lifted { s: self.s_ref, v: self.v_ref },
            side: self.side,
            u: self.u,
            signs: [0.0; 6], // of the last update: they do not influence the next one
            status: TickStatus::default(),
            iterations: 0,
        };
        TwistingTracker::trusted(settings, state)
    }

    #[inline(always)]
    pub(crate) fn remember(&mut self, core: &TwistingTracker) {
        let TrackerState { reference, side, u, signs, status, iterations } = core.state();
        let Physical { x, xdot } = core.reference();
        (self.s_ref, self.v_ref, self.side) = (reference.s, reference.v, side);
        (self.x_ref, self.xdot_ref, self.u) = (x, xdot, u);
        let [ls, lv, lsr, lvr, les, lev] = signs;
        (self.lambda_s, self.lambda_v, self.lambda_sr) = (ls, lv, lsr);
        (self.lambda_vr, self.lambda_es, self.lambda_ev) = (lvr, les, lev);
        (self.status, self.iterations) = (u32::from(status.bits()), iterations);
    }
}

/// The approach with this number.
#[inline]
fn approach(branch: u32) -> Option<Approach> {
    match branch {
        ZIVI_BRANCH_POSITIVE => Some(Approach::Positive),
        ZIVI_BRANCH_NEAREST => Some(Approach::Nearest),
        _ => None,
    }
}

// Checks before an update, and periods without a sample.

impl Tracker {
    /// Whether it is intact, and its reference a state.
    #[inline(always)]
    pub(crate) fn followable(&self) -> Result<(), Code> {
        self.intact()?;
        let reference = Lifted { s: self.s_ref, v: self.v_ref };
        if !reference.is_finite() || self.side.abs() != 1.0 {
            return Err(ZIVI_E_STATE);
        }
        Ok(())
    }

    /// A period without a sample: the control is held, the reference moves on by a period under the
    /// force `force_ref`, or to `next`, if it is given.
    #[inline(never)]
    pub fn miss(&mut self, force_ref: Real, next: Option<&GivenReference>) -> Code {
        match self.held(force_ref, next) {
            Ok(()) => ZIVI_OK,
            Err(Refusal(code)) => code,
        }
    }

    fn held(&mut self, force_ref: Real, next: Option<&GivenReference>) -> Result<(), Refusal> {
        self.followable().map_err(Refusal)?;
        let mut core = self.core();
        // the signs of the last update are held as well
        let Self { lambda_s, lambda_v, lambda_sr, lambda_vr, lambda_es, lambda_ev, .. } = *self;
        let signs = [lambda_s, lambda_v, lambda_sr, lambda_vr, lambda_es, lambda_ev];
        core.set_state(TrackerState { signs, ..core.state() });
        match next {
            None => core.miss(force_ref)?,
            Some(next) => core.miss_to(next.waypoint()?)?,
        };
        self.remember(&core);
        self.ticks = self.ticks.wrapping_add(1);
        Ok(())
    }
}

impl Regulator {
    /// A period without a sample: the control is held.
    pub fn miss(&mut self) -> Code {
        if let Err(code) = self.intact() {
            return code;
        }
        self.ticks = self.ticks.wrapping_add(1);
        self.status = 0;
        ZIVI_OK
    }
}
