//! The day: moments from dawn to dusk, each seen, relit, composited and measured.

use std::time::{Duration, Instant};

use relume_firmware::patches::PatchSet;

use super::backdrop;
use super::compare::relative_rmse;
use super::eye::{Eye, Seen};
use super::site::{SIZE, Site};
use crate::exact::Stack;
use crate::exposure::{ExposureControl, ExposureMode, automatic};
use crate::failure::{Failure, OrFail};
use crate::plot::Canvas;
use crate::relight::{FrameCounters, Framebuffer, Picture, Relighter, View};
use crate::skymodel::{Atmosphere, SkyModel};
use crate::sun::{SunPosition, sun_position};
use crate::weights::PatchWeights;

/// 2 October 2026, 00:00 in Athens (UTC + 3).
const MIDNIGHT_UNIX_S: f64 = 1_790_888_400.0;
const DAY_S: f64 = 86_400.0;
/// Haze of a fine day.
pub(super) const TURBIDITY: f32 = 3.0;
/// Pictures are made while the sun stands higher than this.
const FIRST_LIGHT_DEG: f64 = -5.0;
/// The eye does not make a dusk as bright as a noon: brightness shown ~ brightness to this power.
const DIMMING: f64 = 0.10;
/// The run under drifting clouds: first moment (hours), pictures, seconds between them.
const DRIFT: (f64, usize, f64) = (14.0, 40, 4.0);

/// In that run a new view comes with every so many pictures; a tile that shows some of it must then be drawn again.
const RENEWAL: usize = 10;

/// The sun's shadows are traced anew when it has moved by a fifth of its disc.
const SUN_STEP_DEG: f64 = 0.1;

/// One picture and what is known of it.
pub(super) struct Moment {
    pub unix_s: f64,
    pub sun: SunPosition,
    pub truth: SkyModel,
    pub weights: PatchWeights,
    pub exposure: f32,
    pub picture: Canvas,
    pub counters: FrameCounters,
    /// Sun and sky into coefficients, and tiles into pixels.
    pub relight_time: Duration,
    pub draw_time: Duration,
    /// Relative RMSE of the sky's light against the exact sum; none in the run under drifting clouds.
    pub error: Option<f64>,
    /// Horizontal irradiance as the camera measured it, relative to the true one, minus 1.
    pub irradiance_off: f64,
}

impl Moment {
    /// Hours since midnight.
    pub fn hour(&self) -> f64 {
        (self.unix_s - MIDNIGHT_UNIX_S) / 3600.0
    }

    /// `HH:MM`.
    pub fn clock(&self) -> String {
        let minutes = (self.hour() * 60.0).round() as i64;
        format!("{:02}:{:02}", minutes / 60, minutes % 60)
    }
}

/// Runs moments one after the other, as a post does.
pub(super) struct Day<'s> {
    site: &'s Site,
    stack: &'s Stack,
    eye: Eye,
    patches: PatchSet,
    /// What is on the display.
    relighter: Relighter<'s>,
    framebuffer: Framebuffer,
    view: View,
    control: ExposureControl,
    /// Measures without disturbing what was drawn last.
    meter: Relighter<'s>,
    balance: [f32; 3],
    noon: f64,
}

/// The air of the day: fine, with some cloud.
fn atmosphere() -> Atmosphere {
    Atmosphere {
        turbidity: TURBIDITY,
        cloud_cover: 0.30,
        cloud_seed: 5,
        cloud_drift_per_s: 0.0015,
        ..Atmosphere::default()
    }
}

fn luminance(rgb: [f32; 3]) -> f64 {
    f64::from(crate::map::luminance(rgb))
}

impl<'s> Day<'s> {
    /// Prepares a day over a baked site.
    pub fn new(site: &'s Site, stack: &'s Stack) -> Result<Self, Failure> {
        let field = site.file.field();
        let patches = *field.patch_set();
        let (width, height) = (SIZE.0 as usize, SIZE.1 as usize);
        let noon_s = MIDNIGHT_UNIX_S + 13.2 * 3600.0;
        let clear = Atmosphere { cloud_cover: 0.0, ..atmosphere() };
        let noon = SkyModel::at(clear, noon_s, Site::place(), 0.0).or_runtime()?.horizontal_irradiance();
        let mut relighter = Relighter::new(field, 0);
        relighter.set_sun_step_deg(SUN_STEP_DEG);
        let mut eye = Eye::new(Site::place(), atmosphere(), patches, MIDNIGHT_UNIX_S - DAY_S)?;
        // The sky camera stands there since the day before and knows what its lens scatters.
        for half_hour in 0..48 {
            eye.look(MIDNIGHT_UNIX_S - DAY_S + f64::from(half_hour) * 1800.0)?;
        }
        Ok(Day {
            site,
            stack,
            eye,
            patches,
            relighter,
            framebuffer: Framebuffer::new(width, height),
            view: View::new(width, height, Vec::new()),
            control: ExposureControl::new(ExposureMode::Auto),
            meter: Relighter::new(field, 0),
            // White is what a white sheet on the ground sends back at noon.
            balance: noon.map(|channel| (luminance(noon) / f64::from(channel)) as f32),
            noon: luminance(noon),
        })
    }

    /// A moment every half hour while there is light, with its error.
    pub fn half_hours(&mut self) -> Result<Vec<Moment>, Failure> {
        let mut moments = Vec::new();
        for half_hour in 0..48 {
            let unix_s = MIDNIGHT_UNIX_S + f64::from(half_hour) * 1800.0;
            if sun_position(unix_s, Site::place()).or_runtime()?.altitude_deg > FIRST_LIGHT_DEG {
                moments.push(self.moment(unix_s, None, true)?);
            }
        }
        self.measure(&mut moments)?;
        Ok(moments)
    }

    /// Pictures in quick succession, the exposure as at the nearest half hour.
    pub fn drift(&mut self, hours: &[Moment]) -> Result<Vec<Moment>, Failure> {
        let (start_h, pictures, step_s) = DRIFT;
        let near = |moment: &&Moment| ((moment.hour() - start_h).abs() * 60.0) as i64;
        let exposure = hours.iter().min_by_key(near).map(|moment| moment.exposure);
        let at = |index: usize| MIDNIGHT_UNIX_S + start_h * 3600.0 + index as f64 * step_s;
        (0..pictures).map(|index| self.moment(at(index), exposure, index % RENEWAL == 0)).collect()
    }

    fn moment(&mut self, unix_s: f64, exposure: Option<f32>, renew: bool) -> Result<Moment, Failure> {
        let renew_exposure = exposure.is_none();
        let Seen { weights, truth, sun } = self.eye.look(unix_s)?;
        let seen = weights.horizontal_irradiance(&self.patches)[1];
        let irradiance_off = seen / f64::from(truth.horizontal_irradiance()[1]) - 1.0;
        let weights = self.balanced(weights);
        let started = Instant::now();
        self.relighter.set_weights(&weights, exposure.unwrap_or(1.0)).or_runtime()?;
        let relight_time = started.elapsed();
        let exposure = match exposure {
            Some(exposure) => exposure,
            None => self.exposed(&weights, &truth)?,
        };
        let gains = self.balance.map(|gain| gain * exposure);
        let (width, height) = (self.framebuffer.width, self.framebuffer.height);
        if renew {
            self.view = View::new(width, height, backdrop::paint(&truth, &self.site.camera, SIZE, gains));
        }
        let started = Instant::now();
        let mut counters = self.relighter.draw(&self.view, &mut self.framebuffer);
        // A half hour's weights are given twice, for the exposure; the sun was traced the first time.
        counters.sun_traced |= counters.sun_up && renew_exposure;
        let draw_time = started.elapsed();
        let picture = Canvas::from_xrgb(SIZE.0, SIZE.1, &self.framebuffer.pixels);
        Ok(Moment {
            unix_s,
            sun,
            truth,
            weights,
            exposure,
            picture,
            counters,
            relight_time,
            draw_time,
            error: None,
            irradiance_off,
        })
    }

    /// Weights as a camera balanced for daylight shows them.
    fn balanced(&self, mut weights: PatchWeights) -> PatchWeights {
        let balance = self.balance;
        let scale = |rgb: &mut [f32; 3]| rgb.iter_mut().zip(balance).for_each(|(value, gain)| *value *= gain);
        weights.radiance.iter_mut().for_each(scale);
        if let Some(sun) = &mut weights.sun {
            scale(&mut sun.irradiance);
        }
        weights
    }

    /// The weights of the true sky, balanced like those that were seen.
    pub fn true_weights(&self, truth: &SkyModel) -> PatchWeights {
        self.balanced(truth.weights(&self.patches))
    }

    /// What one measures of the true sky with the balance of the pictures.
    pub fn balance(&self) -> [f32; 3] {
        self.balance
    }

    /// Chooses the exposure for the relighter's newest weights and gives it to the relighter.
    fn exposed(&mut self, weights: &PatchWeights, truth: &SkyModel) -> Result<f32, Failure> {
        let picture = self.relighter.radiance();
        let dim = (luminance(truth.horizontal_irradiance()) / self.noon).min(1.0).powf(DIMMING);
        let most = backdrop::most_exposure(truth, &self.site.camera, SIZE);
        self.control.see(automatic(&picture.rgb, &picture.alpha).map(|wanted| (wanted * dim).min(most)));
        let exposure = self.control.factor();
        self.relighter.set_weights(weights, exposure).or_runtime()?;
        Ok(exposure)
    }

    /// The linear picture of any weights.
    pub fn radiance(&mut self, weights: &PatchWeights) -> Result<Picture, Failure> {
        self.meter.set_weights(weights, 1.0).or_runtime()?;
        Ok(self.meter.radiance())
    }

    /// Relative RMSE of the sky's light against the exact sum over the stack, for all moments in one pass over it.
    fn measure(&mut self, moments: &mut [Moment]) -> Result<(), Failure> {
        let sky = |moment: &Moment| PatchWeights { radiance: moment.weights.radiance.clone(), sun: None };
        let skies: Vec<PatchWeights> = moments.iter().map(sky).collect();
        let places = self.stack.covered();
        let exact = self.stack.sums(&skies, places).or_runtime()?;
        for ((moment, sky), exact) in moments.iter_mut().zip(&skies).zip(&exact) {
            let found = self.radiance(sky)?;
            let found: Vec<[f32; 3]> = places.iter().map(|&at| found.rgb[at as usize]).collect();
            moment.error = Some(relative_rmse(&found, exact));
        }
        Ok(())
    }
}
