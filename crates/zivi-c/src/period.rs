//! What has to be before a tick, and periods without a sample.

use zivi_core::control::TrackerState;
use zivi_core::{Lifted, Real};

use crate::code::{Code, Refusal, ZIVI_E_STATE, ZIVI_OK};
use crate::seal::Sealed;
use crate::{GivenReference, Regulator, Tracker};

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
        // the signs of the last tick are held, too
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
