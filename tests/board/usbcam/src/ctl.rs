//! The command socket of the running camera: a line in, a line out.

use crate::device::Device;
use crate::faults::Order;
use crate::link::Plugged;
use crate::log::Log;
use crate::offer::Offer;
use crate::picture::Renderer;
use crate::stream::Sensor;
use relume::camera::synthetic::SyntheticSettings;
use std::io::{BufRead, BufReader, Write};
use std::os::unix::net::{UnixListener, UnixStream};
use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

/// What a failed order's answer begins with.
const FAILED: &str = "failed: ";

/// The camera and its cable.
pub struct Operator {
    device: Arc<Device>,
    sensor: SyntheticSettings,
    stamped: bool,
    plugged: Option<Plugged>,
}

impl Operator {
    /// An unplugged camera's operator.
    pub fn new(device: Device, sensor: SyntheticSettings, stamped: bool) -> Self {
        Operator { device: Arc::new(device), sensor, stamped, plugged: None }
    }

    /// Takes orders until the program is killed.
    ///
    /// # Errors
    /// What the system says of the socket.
    pub fn serve(&mut self, path: &Path) -> std::io::Result<()> {
        // A socket file outlives its program.
        let _ = std::fs::remove_file(path);
        for connection in UnixListener::bind(path)?.incoming() {
            // One caller that goes away early must not end the camera.
            let _ = connection.and_then(|connection| self.answer(connection));
        }
        Ok(())
    }

    fn answer(&mut self, mut connection: UnixStream) -> std::io::Result<()> {
        let mut line = String::new();
        BufReader::new(connection.try_clone()?).read_line(&mut line)?;
        let told = match line.parse::<Order>() {
            Ok(order) => self.obey(order, line.trim()).unwrap_or_else(|error| format!("{FAILED}{error}")),
            Err(error) => format!("{FAILED}{error}"),
        };
        writeln!(connection, "{told}")
    }

    /// Carries out an order and says how it went.
    ///
    /// # Errors
    /// Why it could not be, in one line.
    pub fn obey(&mut self, order: Order, text: &str) -> anyhow::Result<String> {
        if order == Order::Stat {
            return Ok(self.stat());
        }
        self.device.log.line(format_args!("order: {text}"));
        match order {
            Order::Plug => self.plug()?,
            Order::Cut => self.unplug(Plugged::cut)?,
            Order::Detach => self.unplug(Plugged::detach)?,
            Order::Time(unix_s) => self.device.sky.set_clock(unix_s, self.device.sky.clock().speed()),
            Order::Speed(speed) => self.device.sky.set_clock(self.device.sky.clock().now_unix_s(), speed),
            fault => self.set(fault),
        }
        self.device.tell();
        Ok("ok".into())
    }

    fn plug(&mut self) -> anyhow::Result<()> {
        if let Some(plugged) = self.plugged.take() {
            if self.device.lock().plugged {
                self.plugged = Some(plugged);
                anyhow::bail!("the camera is plugged in already");
            }
            // The kernel had unplugged it.
            plugged.cut(&self.device.log)?;
        }
        let sensor = Sensor::new(Renderer::new(self.sensor.clone()), self.stamped);
        self.plugged = Some(Plugged::plug(&self.device, sensor)?);
        Ok(())
    }

    fn unplug(&mut self, how: fn(Plugged, &Log) -> Result<(), crate::link::LinkError>) -> anyhow::Result<()> {
        let plugged = self.plugged.take().ok_or_else(|| anyhow::anyhow!("the camera is not plugged in"))?;
        Ok(how(plugged, &self.device.log)?)
    }

    fn set(&mut self, order: Order) {
        let mut state = self.device.lock();
        let faults = &mut state.faults;
        match order {
            Order::Latency(frames) => faults.latency = frames,
            Order::Error(frames) => faults.error_frames = frames,
            Order::Short(frames) => faults.short_frames = frames,
            Order::Freeze(time) => faults.frozen_until = Some(Instant::now() + time),
            Order::Stuck(on) => faults.stuck = on,
            Order::Black(on) => faults.black = on,
            Order::Noise(on) => faults.noise = on,
            Order::Delay(time) => faults.answer_delay = time,
            Order::Drop(percent) => faults.drop_percent = percent,
            Order::Refuse(code) => state.controls.refuse = code,
            Order::Auto => state.controls.force_automatic(),
            Order::Size(size) => {
                state.offer_at_plug = Some(Offer { sizes: vec![size], ..state.offer.clone() });
            }
            _ => {}
        }
    }

    fn stat(&self) -> String {
        let state = self.device.lock();
        let sky = relume::sun::format_utc(self.device.sky.clock().now_unix_s());
        format!(
            "plugged {} streaming {} frame {} sent {} size {} {} manual {} sky {sky} render {:.1} ms look {:.1} ms",
            state.plugged,
            state.streaming,
            state.frame,
            state.sent,
            state.size(),
            state.settings(),
            state.controls.is_manual(),
            state.render_time.as_secs_f64() * 1e3,
            self.device.sky.look_time().as_secs_f64() * 1e3,
        )
    }
}

/// Sends an order to a running camera; the answer, or why it failed.
///
/// # Errors
/// One line: no camera runs there, or what it said.
pub fn order(path: &Path, text: &str) -> anyhow::Result<String> {
    let connect = UnixStream::connect(path);
    let mut connection =
        connect.map_err(|error| anyhow::anyhow!("{}: {error}; is `usbcam run` running?", path.display()))?;
    writeln!(connection, "{text}")?;
    let mut line = String::new();
    BufReader::new(connection).read_line(&mut line)?;
    match line.trim().strip_prefix(FAILED) {
        Some(why) => anyhow::bail!("{why}"),
        None => Ok(line.trim().to_string()),
    }
}
