//! The camera of a captured sky: real, simulated or replayed.

use crate::camera::plausible::Plausible;
use crate::camera::replay::ReplayCamera;
use crate::camera::synthetic::{Glare, SyntheticCamera, SyntheticSettings};
use crate::camera::{Camera, Exposure};
use crate::config::{Config, SkyKind};
use crate::lens::Lens;

/// A camera of the sky, and what is known of it besides.
pub enum Device {
    /// Simulated, under a simulated sky.
    Synthetic(Box<SyntheticCamera>),
    /// Frames that were captured before, and the exposures of one series of them.
    Replay(ReplayCamera, Vec<Exposure>),
    /// Real; its pictures are looked at before they are used.
    Live(Box<Plausible<Box<dyn Camera>>>),
}

impl Device {
    /// A real camera that is open.
    pub fn live(camera: Box<dyn Camera>) -> Self {
        Device::Live(Box::new(Plausible::new(camera)))
    }

    /// The simulated or the replayed camera that the post's file asks for; `north_deg`: where north lies, from -Z towards +X.
    ///
    /// # Errors
    /// What is wrong with the files that it names, in one line.
    pub fn open(config: &Config, north_deg: f64) -> anyhow::Result<Self> {
        if let (SkyKind::Replay, Some(folder)) = (config.sky, &config.camera.frames) {
            let camera = ReplayCamera::open(folder, false)?;
            let series = camera.series();
            return Ok(Device::Replay(camera, series));
        }
        let Some(site) = config.site else { anyhow::bail!("{}: [site] is missing", config.file.display()) };
        let lens = config.camera.lens.as_ref().map(|path| Lens::load(path)).transpose()?;
        let mut settings = SyntheticSettings {
            place: site.place,
            north_deg,
            atmosphere: super::simulated::atmosphere(site, config.weather),
            ..SyntheticSettings::default()
        };
        if let Some((width, height)) = lens.as_ref().and_then(Lens::size) {
            (settings.width, settings.height) = (width, height);
        }
        settings.lens = lens;
        settings.glare = Glare::usual(settings.width);
        Ok(Device::Synthetic(Box::new(SyntheticCamera::new(settings))))
    }

    /// The camera.
    pub fn camera(&mut self) -> &mut dyn Camera {
        match self {
            Device::Synthetic(camera) => camera.as_mut(),
            Device::Replay(camera, _) => camera,
            Device::Live(camera) => camera.as_mut(),
        }
    }

    /// The camera, for what is there at this time, unix seconds.
    pub fn at(&mut self, unix_s: f64) -> &mut dyn Camera {
        self.set_time(unix_s);
        self.camera()
    }

    /// Tells a simulated camera the time of its next frame, unix seconds; others have their own.
    pub fn set_time(&mut self, unix_s: f64) {
        if let Device::Synthetic(camera) = self {
            camera.set_time(unix_s);
        }
    }
}
