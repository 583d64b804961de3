//! New light: taken from the sky, relit at an exposure that suits it, logged.

use super::Post;
use crate::clock::Moment;
use crate::failure::Failure;
use crate::health::WeightsState;
use crate::lightlog::LoggedLight;
use crate::sky_source::{SkyFault, SunSource};
use crate::view::gain::ViewGain;

impl Post<'_> {
    /// Asks the sky for new weights and keeps the old ones if there are none. True when there will be no more.
    pub(super) fn look(&mut self, moment: Moment) -> bool {
        match self.parts.sky.read(moment, &mut self.next) {
            Ok(false) => {}
            Ok(true) => {
                std::mem::swap(&mut self.held, &mut self.next);
                self.held_since_unix_s = Some(moment.unix_s);
                self.weights = WeightsState::Fresh;
                self.is_new = true;
            }
            Err(SkyFault::Ended) => return true,
            Err(SkyFault::Failed(reason)) => {
                self.sky_faults += 1;
                self.last_fault = Some(reason);
                if self.weights == WeightsState::Fresh {
                    self.weights = WeightsState::Held;
                }
            }
        }
        self.fade(moment);
        false
    }

    /// Light that was held for too long goes over to a model's.
    fn fade(&mut self, moment: Moment) {
        let (Some(fading), Some(since)) = (&mut self.fading, self.held_since_unix_s) else { return };
        if !self.weights.is_stale() {
            return fading.forget();
        }
        if let Some(share) = fading.step(&self.held.weights, since, moment, &mut self.next.weights) {
            std::mem::swap(&mut self.held.weights, &mut self.next.weights);
            self.held.sun = if self.held.weights.sun.is_some() { SunSource::Model } else { SunSource::None };
            (self.held.sun_share, self.held.times) = (None, None);
            self.held.exposures.clear();
            self.weights = if share < 1.0 { WeightsState::Fading } else { WeightsState::Modelled };
            self.is_new = true;
        }
    }

    /// New weights to the painter, with the exposure in use, and once more where they ask for another; logged light with the
    /// exposures it was relit with. Weights that do not fit are a fault of the sky: the picture stays.
    pub(super) fn relight(&mut self, moment: Moment) {
        let (mut used, mut passes) = ([0.0; 2], 0);
        while let Some(exposure) = self.next_exposure(passes) {
            self.balance();
            // The passes of one light have one sun: that is what the log tells.
            self.parts.painter.hold_sun(passes > 0);
            match self.parts.painter.relight(&self.balanced, exposure) {
                Ok(note) => self.note = note,
                Err(error) => return self.refuse(error),
            }
            used[passes] = exposure;
            passes += 1;
        }
        self.log(moment, &used[..passes]);
    }

    /// Brings the held weights into the view's colours.
    fn balance(&mut self) {
        self.balanced.set_tinted(&self.held.weights, self.exposure.colour());
    }

    /// Exposes as the view is exposed, where that is asked for and known. True when exposure or colour changed.
    pub(super) fn follow_view(&mut self) -> bool {
        if !self.exposure.is_by_view() {
            return false;
        }
        // What was relit has the colours in use already.
        let colour = self.exposure.colour();
        let seen = self.parts.painter.view_gain();
        self.view_gain =
            seen.map(|seen| ViewGain { gain: std::array::from_fn(|c| seen.gain[c] * f64::from(colour[c])), ..seen });
        self.exposure.see_gain(self.view_gain.map(|seen| seen.gain))
    }

    /// The exposure of a pass over new weights; `None` when they are done.
    fn next_exposure(&mut self, pass: usize) -> Option<f32> {
        match pass {
            2.. => None,
            _ if !self.held.exposures.is_empty() => self.held.exposures.get(pass).copied(),
            0 => Some(self.exposure.factor()),
            _ => {
                let changes = self.follow_view()
                    || self.exposure.is_auto() && self.exposure.see(self.parts.painter.wanted_exposure());
                self.exposure_changes += u64::from(changes);
                self.is_exposed_anew |= changes;
                changes.then(|| self.exposure.factor())
            }
        }
    }

    /// Weights that do not fit.
    fn refuse(&mut self, error: anyhow::Error) {
        self.sky_faults += 1;
        self.last_fault = Some(Failure::Runtime(error).to_string());
        self.weights = WeightsState::Held;
    }

    /// Notes the light in the log, if there is one. A full disk ends the log, not the picture.
    fn log(&mut self, moment: Moment, exposures: &[f32]) {
        let Some(log) = &mut self.light_log else { return };
        let weights = &self.balanced;
        // A sun that is still being traced is not in the picture.
        let sun = weights.sun.zip(self.parts.painter.sun_dir_world());
        let light = LoggedLight {
            frame: self.frames,
            unix_s: moment.unix_s,
            exposures: exposures.into(),
            radiance: (&weights.radiance).into(),
            sun: sun.map(|(sun, dir_world)| (dir_world, sun.irradiance)),
        };
        if let Err(error) = log.add(&light) {
            eprintln!("{error}");
            self.light_log = None;
        }
    }
}
