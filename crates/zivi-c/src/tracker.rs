//! The twisting tracker: makes the mass follow a bouncing reference.

use zivi_core::control::{
    Approach, Gains, Port, TickStatus, TrackerState, TwistingTracker, Waypoint,
};
use zivi_core::{Branch, Lifted, Physical, Restitution};

use crate::code::{
    self, Code, ZIVI_E_BRANCH, ZIVI_E_PRESS, ZIVI_E_SHIFT, ZIVI_E_SIDE, ZIVI_E_STATE, ZIVI_OK,
};
use crate::config;

/// In `branch`: measurements are lifted to `s >= 0`, the default.
pub const ZIVI_BRANCH_POSITIVE: u32 = 0;
/// In `branch`: measurements are lifted to the preimage that is nearer to the reference.
pub const ZIVI_BRANCH_NEAREST: u32 = 1;

/// Settings of a tracker. A member that is zero takes its default.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct TrackerConfig {
    /// `sizeof(zivi_tracker_config)`.
    pub size: u32,
    /// `ZIVI_BRANCH_POSITIVE` or `ZIVI_BRANCH_NEAREST`.
    pub branch: u32,
    /// `ZIVI_TICK_LANDING` or `ZIVI_TICK_PAPER`.
    pub tick: u32,
    /// Horizon of the landing in periods, 1 + the periods of delay; by default 1.
    pub ahead: u32,
    /// 1: the measured velocity is taken half a period back in the air; 0: it is not.
    pub shift: u32,
    /// 0.
    pub reserved: u32,
    /// Gain on the sign of the position error (m/s^2).
    pub mu1: f64,
    /// Gain on the sign of the velocity error, 0 < mu2 < mu1 (m/s^2).
    pub mu2: f64,
    /// Sampling period (s), > 0.
    pub h: f64,
    /// Coefficient of restitution of the plant's wall, in (0, 1]; or give `kappa`.
    pub e: f64,
    /// `(1 - e)/(1 + e)`, in (0, 1), in place of `e`.
    pub kappa: f64,
    /// Coefficient of restitution of the reference's wall; by default the plant's.
    pub e_ref: f64,
    /// `(1 - e_ref)/(1 + e_ref)` in place of `e_ref`.
    pub kappa_ref: f64,
    /// A bound of the unknown force that the gains are checked against (m/s^2); by default none.
    pub bound: f64,
    /// Acceleration towards the wall of a mass at rest, at least `bound` (m/s^2); by default the
    /// law's own.
    pub press: f64,
    /// Periods that a step is planned over, >= 1; by default 1.
    pub horizon: f64,
    /// Measurements down to `-depth` are taken as 0, deeper ones refused (m); by default 0.1.
    pub depth: f64,
    /// Least control of the actuator (m/s^2); no limits while both are 0.
    pub u_min: f64,
    /// Largest control of the actuator (m/s^2).
    pub u_max: f64,
}

/// A tracker with its reference. Everything in it may be read, copied and logged; it is changed by
/// `zivi_tracker_*` alone.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Tracker {
    /// Gain on the sign of the position error (m/s^2).
    pub mu1: f64,
    /// Gain on the sign of the velocity error (m/s^2).
    pub mu2: f64,
    /// Sampling period (s).
    pub h: f64,
    /// Coefficient of restitution of the plant's wall.
    pub e: f64,
    /// `(1 - e)/(1 + e)`.
    pub kappa: f64,
    /// Coefficient of restitution of the reference's wall.
    pub e_ref: f64,
    /// `(1 - e_ref)/(1 + e_ref)`.
    pub kappa_ref: f64,
    /// Acceleration towards the wall of a mass at rest (m/s^2), 0 for the law's own.
    pub press: f64,
    /// Periods that a step is planned over.
    pub horizon: f64,
    /// How far behind the wall a measurement may lie (m).
    pub depth: f64,
    /// Least control (m/s^2).
    pub u_min: f64,
    /// Largest control (m/s^2).
    pub u_max: f64,
    /// The reference's transformed position (m).
    pub s_ref: f64,
    /// The reference's transformed velocity (m/s).
    pub v_ref: f64,
    /// The side of the wall on which the reference was last, +1 or -1.
    pub side: f64,
    /// The reference at the next sample: its distance from the wall (m).
    pub x_ref: f64,
    /// The reference's velocity (m/s).
    pub xdot_ref: f64,
    /// The last control (m/s^2).
    pub u: f64,
    /// Multiplier in `sgn s` of the last tick.
    pub lambda_s: f64,
    /// Multiplier in `sgn v`.
    pub lambda_v: f64,
    /// Multiplier in `sgn s_ref`.
    pub lambda_sr: f64,
    /// Multiplier in `sgn v_ref`.
    pub lambda_vr: f64,
    /// Multiplier in `sgn (s - s_ref)`.
    pub lambda_es: f64,
    /// Multiplier in `sgn (v - v_ref)`.
    pub lambda_ev: f64,
    /// Ticks since the last reset.
    pub ticks: u64,
    /// Bits of what was done to the last sample and control.
    pub status: u32,
    /// Iterations of the last tick.
    pub iterations: u32,
    /// How measurements are lifted.
    pub branch: u32,
    /// Horizon of the landing in periods, 0 for the tick of the paper.
    pub ahead: u32,
    /// Whether the measured velocity is taken half a period back in the air.
    pub shift: u32,
    /// 0.
    pub reserved: u32,
    /// Marks an initialised object.
    pub mark: u64,
}

/// In `mark` of a tracker that was initialised.
const MARK: u64 = 0x7a69_7669_7472_6163;

impl TrackerConfig {
    /// The size, and everything else 0.
    #[must_use]
    pub fn defaults() -> Self {
        Self { size: size_of::<Self>() as u32, ..Self::default() }
    }
}

/// A reference that is given, at one sample.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct GivenReference {
    /// Distance from the wall, >= 0 (m).
    pub x: f64,
    /// Velocity (m/s).
    pub xdot: f64,
    /// The side of the wall on which it is followed, +1 or -1: it changes with each impact of the
    /// reference. Only `ZIVI_BRANCH_NEAREST` looks at it.
    pub side: f64,
}

impl GivenReference {
    fn waypoint(self) -> Result<Waypoint, Code> {
        let Self { x, xdot, side } = self;
        let branch = match side {
            1.0 => Branch::Positive,
            -1.0 => Branch::Negative,
            _ => return Err(ZIVI_E_SIDE),
        };
        Ok(Waypoint { state: Physical { x, xdot }, branch })
    }
}

/// What is asked of the controller of the core.
enum Call {
    /// To accept the settings.
    Check,
    /// To start from this reference.
    Reset(Physical),
    /// To tick: the measurement, the force, the reference's force.
    Tick(Physical, f64, f64),
    /// To tick towards a given reference: at this sample, at the next one, its acceleration (NaN:
    /// not known).
    TickTo(Physical, f64, [GivenReference; 2], f64),
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
        let TrackerConfig { mu1, mu2, bound, press, .. } = *config;
        let ahead = config::ahead(config.tick, config.ahead)?;
        let horizon = if config.horizon == 0.0 { 1.0 } else { config.horizon };
        if press != 0.0 && (ahead == 0 || press < bound) {
            return Err(ZIVI_E_PRESS);
        }
        let wall = config::wall(config.e, config.kappa)?;
        let wall_ref = config::wall_ref(config.e_ref, config.kappa_ref, wall)?;
        Gains::new(mu1, mu2).map_err(code::of)?;
        if bound != 0.0 {
            Gains::for_tracking(mu1, mu2, bound, wall).map_err(code::of_gain)?;
        }
        let port = config::port(config.depth, config.u_min, config.u_max)?;
        let (walls, times) = ([wall, wall_ref], (ahead, horizon));
        match Self::fresh(config, walls, port, times).call(Call::Check) {
            ZIVI_OK => *self = Self::fresh(config, walls, port, times),
            code => return Err(code),
        }
        Ok(())
    }

    /// With these settings, the reference at rest. (Made twice and never copied: a copy would be a
    /// call of memcpy.)
    #[inline(always)]
    fn fresh(
        config: &TrackerConfig,
        [wall, wall_ref]: [Restitution; 2],
        port: Port,
        (ahead, horizon): (u32, f64),
    ) -> Self {
        let TrackerConfig { mu1, mu2, h, branch, press, shift, .. } = *config;
        let (u_min, u_max) = port.actuator();
        Self {
            mu1,
            mu2,
            h,
            e: wall.e(),
            kappa: wall.kappa(),
            e_ref: wall_ref.e(),
            kappa_ref: wall_ref.kappa(),
            press,
            horizon,
            depth: port.depth(),
            u_min,
            u_max,
            branch,
            ahead,
            shift,
            side: 1.0,
            mark: MARK,
            ..Self::default()
        }
    }

    /// Puts the reference at `x_ref` with velocity `xdot_ref` and forgets the last tick.
    pub fn reset(&mut self, x_ref: f64, xdot_ref: f64) -> Code {
        self.call(Call::Reset(Physical { x: x_ref, xdot: xdot_ref }))
    }

    /// The control for the period that starts with this measurement: [`Tracker::u`]. The reference
    /// advances by one period.
    pub fn step(&mut self, x: f64, xdot: f64, force: f64, force_ref: f64) -> Code {
        self.call(Call::Tick(Physical { x, xdot }, force, force_ref))
    }

    /// The same for a reference that is given at this sample and at the next one; `acceleration` is
    /// its own over the period, NaN if it is not known.
    pub fn step_to(
        &mut self,
        x: f64,
        xdot: f64,
        force: f64,
        reference: [GivenReference; 2],
        acceleration: f64,
    ) -> Code {
        self.call(Call::TickTo(Physical { x, xdot }, force, reference, acceleration))
    }

    /// The one place where the controller of the core is made, from the settings and the state.
    fn call(&mut self, call: Call) -> Code {
        match self.called(call) {
            Ok(code) | Err(code) => code,
        }
    }

    #[inline(always)]
    fn called(&mut self, call: Call) -> Result<Code, Code> {
        let mut core = self.core()?;
        self.ticks = match call {
            Call::Check => return Ok(ZIVI_OK),
            Call::Reset(reference) => {
                core.reset(reference).map_err(code::of)?;
                0
            }
            Call::Tick(measured, force, force_ref) => {
                core.tick(measured, force, force_ref).map_err(code::of)?;
                self.ticks.wrapping_add(1)
            }
            Call::TickTo(measured, force, [now, next], acceleration) => {
                let known = (!acceleration.is_nan()).then_some(acceleration);
                let (now, next) = (now.waypoint()?, next.waypoint()?);
                core.tick_to(measured, force, now, next, known).map_err(code::of)?;
                self.ticks.wrapping_add(1)
            }
        };
        let TrackerState { reference, side, u, signs, status, iterations } = core.state();
        let Physical { x, xdot } = core.reference();
        (self.s_ref, self.v_ref, self.side) = (reference.s, reference.v, side);
        (self.x_ref, self.xdot_ref, self.u) = (x, xdot, u);
        let [ls, lv, lsr, lvr, les, lev] = signs;
        (self.lambda_s, self.lambda_v, self.lambda_sr) = (ls, lv, lsr);
        (self.lambda_vr, self.lambda_es, self.lambda_ev) = (lvr, les, lev);
        (self.status, self.iterations) = (u32::from(status.bits()), iterations);
        Ok(code::of_status(status))
    }

    #[inline(always)] // taken apart: no copy of it is ever made
    fn core(&self) -> Result<TwistingTracker, Code> {
        if self.mark != MARK {
            return Err(ZIVI_E_STATE);
        }
        let wall = Restitution::from_both(self.e, self.kappa).map_err(code::of_restitution)?;
        let wall_ref = Restitution::from_both(self.e_ref, self.kappa_ref);
        let wall_ref = wall_ref.map_err(code::of_restitution)?;
        let gains = Gains::new(self.mu1, self.mu2).map_err(code::of)?;
        let approach = match self.branch {
            ZIVI_BRANCH_POSITIVE => Approach::Positive,
            ZIVI_BRANCH_NEAREST => Approach::Nearest,
            _ => return Err(ZIVI_E_BRANCH),
        };
        let port = config::port(self.depth, self.u_min, self.u_max)?;
        let bare = TwistingTracker::new(gains, self.h, wall, wall_ref, approach);
        let bare = bare.map_err(code::of)?.with_port(port);
        let landing = config::landing(self.ahead, self.h)?;
        let shift = match self.shift {
            0 => false,
            1 => true,
            _ => return Err(ZIVI_E_SHIFT),
        };
        let mut core = bare.with_landing(landing);
        if self.press != 0.0 {
            core = core.with_press(self.press, f64::NEG_INFINITY).map_err(code::of_gain)?;
        }
        core = core.with_horizon(self.horizon).map_err(code::of)?.with_shift(shift);
        let reference = Lifted { s: self.s_ref, v: self.v_ref };
        if !reference.is_finite() || self.side.abs() != 1.0 {
            return Err(ZIVI_E_STATE);
        }
        core.set_state(TrackerState {
            reference,
            side: self.side,
            u: self.u,
            signs: [0.0; 6], // of the last tick: they do not influence the next one
            status: TickStatus::default(),
            iterations: 0,
        });
        Ok(core)
    }
}
