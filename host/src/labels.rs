//! What stands over the picture: title and caption, the staff's badge, and the installer's compass (`--setup`).

use crate::clock::Moment;
use crate::config::Config;
use crate::damage::Damage;
use crate::health::WELL;
use crate::sun::{Place, SunPosition, sun_position};
use embedded_graphics::geometry::Size;
use embedded_graphics::primitives::Rectangle;
use relume_firmware::composite::ViewPixels;
use relume_firmware::field::CameraRecord;
use relume_firmware::overlay::{Badge, Compass, Labels as Shown, Overlay, Words};
use relume_firmware::surface::{Surface, SurfaceError};
use std::fmt::Write;
use std::ops::Range;

/// What the labels are told from time to time.
#[derive(Clone, Copy, Debug)]
pub struct News<'a> {
    /// The post's time.
    pub moment: Moment,
    /// The state as in `health.json`: `ok`, or what is not, as `what: why`, several with `; ` between them.
    pub state: &'a str,
    /// For how long old weights have been held, seconds; `None` while fresh ones come.
    pub held_s: Option<f64>,
    /// The sun that shines in the picture, if there is one.
    pub sun: Option<SunPosition>,
}

/// The labels of one post. Once the longest badge was shown, nothing is allocated.
#[derive(Debug)]
pub struct Labels {
    overlay: Overlay,
    size: (usize, usize),
    title: String,
    caption: String,
    place: Option<Place>,
    /// The view's camera, while the post is set up.
    setup: Option<CameraRecord>,
    badge: String,
    newer_badge: String,
    compass: Option<Compass>,
    /// Words, badge, compass: to be drawn anew?
    stale: [bool; 3],
    /// Where they stand in the picture shown.
    areas: [Rectangle; 3],
}

impl Labels {
    /// Labels for pictures of `size` pixels, with nothing told yet.
    pub fn new(config: &Config, size: (usize, usize)) -> Self {
        Labels {
            overlay: Overlay::new(Size::new(size.0 as u32, size.1 as u32)),
            size,
            title: config.title.clone(),
            caption: config.caption.clone(),
            place: config.site.map(|site| site.place),
            setup: None,
            badge: String::new(),
            newer_badge: String::new(),
            compass: None,
            stale: [true; 3],
            areas: [Rectangle::zero(); 3],
        }
    }

    /// From now on shows the badge even when all is well, and a compass for the view of `camera`.
    pub fn set_up(&mut self, camera: &CameraRecord) {
        self.setup = Some(*camera);
    }

    /// Takes news; true when labels must be drawn for them.
    pub fn tell(&mut self, news: &News<'_>) -> bool {
        self.newer_badge.clear();
        if self.setup.is_some() || news.state != WELL {
            write_badge(&mut self.newer_badge, news);
        }
        let compass = self.setup.map(|camera| self.compass(&camera, news));
        self.stale[1] |= self.newer_badge != self.badge;
        self.stale[2] |= compass != self.compass;
        std::mem::swap(&mut self.newer_badge, &mut self.badge);
        self.compass = compass;
        self.stale.contains(&true)
    }

    /// The sun stands where time and place put it, covered or not; without them, where the picture has it.
    fn compass(&self, camera: &CameraRecord, news: &News<'_>) -> Compass {
        let place = self.place.filter(|_| news.moment.trusted);
        let sun = place.and_then(|place| sun_position(news.moment.unix_s, place).ok()).or(news.sun);
        let forward_world = std::array::from_fn(|k| camera.target[k] - camera.position[k]);
        let sun = sun.map(|sun| [sun.azimuth_deg as f32, sun.altitude_deg as f32]);
        Compass::new(camera.north_deg, forward_world, sun)
    }

    /// Draws the labels that are stale, and those that `damage` touches, over `shown`: the clean picture as far as it is
    /// damaged, else that of the frame before with its labels. Marks what it writes.
    ///
    /// # Errors
    /// When `shown` has fewer pixels than the labels' size.
    pub fn draw(&mut self, clean: &[u32], shown: &mut [u32], damage: &mut Damage) -> Result<(), SurfaceError> {
        let labels = Shown {
            words: Words { title: &self.title, caption: &self.caption },
            badge: (!self.badge.is_empty()).then(|| Badge { well: self.badge == WELL, text: &self.badge }),
            compass: self.compass,
        };
        let (width, height) = self.size;
        let mut surface = Surface::new(shown, width, height, width)?;
        let under = ViewPixels { pixels_xrgb: clean, stride: width };
        let areas = self.overlay.areas(&labels);
        for (k, area) in areas.into_iter().enumerate() {
            let has_moved = area != self.areas[k];
            let area = both(self.areas[k], area);
            let (rows, columns) = ranges(&area);
            if self.stale[k] || damage.touches(rows.clone(), columns.clone()) {
                // Drawing covers its own area; what it has left must be put right.
                if has_moved {
                    self.overlay.restore(under, &mut surface, &area);
                }
                self.overlay.draw(&labels, under, &mut surface, &area);
                damage.mark_area(rows, columns);
            }
        }
        (self.areas, self.stale) = (areas, [false; 3]);
        Ok(())
    }
}

/// Rows and columns of a rectangle on the picture.
fn ranges(area: &Rectangle) -> (Range<usize>, Range<usize>) {
    let span = |first: i32, length: u32| {
        let first = first.max(0) as usize;
        first..first + length as usize
    };
    (span(area.top_left.y, area.size.height), span(area.top_left.x, area.size.width))
}

/// The rectangle around two, either of which may be nothing.
fn both(a: Rectangle, b: Rectangle) -> Rectangle {
    match (a.bottom_right(), b.bottom_right()) {
        (None, _) => b,
        (_, None) => a,
        (Some(end), Some(other)) => {
            Rectangle::with_corners(a.top_left.component_min(b.top_left), end.component_max(other))
        }
    }
}

/// What is wrong, without why, and for how long: `sky fails, last weights held 12 s`.
fn write_badge(badge: &mut String, news: &News<'_>) {
    for (k, fault) in news.state.split("; ").enumerate() {
        badge.push_str(if k == 0 { "" } else { "; " });
        badge.push_str(fault.split(':').next().unwrap_or_default());
        if let (0, Some(held_s)) = (k, news.held_s) {
            let (span, unit) = match held_s {
                ..60.0 => (held_s, "s"),
                ..3600.0 => (held_s / 60.0, "min"),
                ..172_800.0 => (held_s / 3600.0, "h"),
                _ => (held_s / 86_400.0, "days"),
            };
            // Writing to a string cannot fail.
            let _ = write!(badge, " {:.0} {unit}", span.floor());
        }
    }
}

#[cfg(test)]
mod tests;
