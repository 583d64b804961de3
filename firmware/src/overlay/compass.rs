//! The installer's compass: where the view looks, where north lies and where the sun stands.

use super::letters::{Face, Faces};
use super::paint::{BLACK, Ink, ORANGE, PALE, Paint, VERMILLION, WHITE, YELLOW};
use super::shapes::Place;
use core::fmt::Write;
use embedded_graphics::geometry::{Point, Size};
use embedded_graphics::primitives::Rectangle;
use libm::{asinf, atan2f, cosf, roundf, sinf, sqrtf};

/// Letters of the longest line.
const COLUMNS: u32 = 24;
const LINES: u32 = 4;
/// The ring's radius, of half the dial's side.
const RING: f32 = 0.78;
const WINDS: [&str; 8] = ["N", "NE", "E", "SE", "S", "SW", "W", "NW"];

/// Directions in whole degrees, so that two are equal when they look the same. Azimuths are clockwise from true north.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Compass {
    view_azimuth_deg: i32,
    view_altitude_deg: i32,
    sun: Option<(i32, i32)>,
}

impl Compass {
    /// `north_deg`: where north lies, degrees from -Z towards +X. `forward_world`: where the view looks, of any length.
    /// `sun_azimuth_altitude_deg`: where the sun stands, if that is known.
    pub fn new(north_deg: f32, forward_world: [f32; 3], sun_azimuth_altitude_deg: Option<[f32; 2]>) -> Self {
        let [x, y, z] = forward_world;
        let length = sqrtf(x * x + y * y + z * z).max(f32::MIN_POSITIVE);
        Compass {
            view_azimuth_deg: full_turn(atan2f(x, -z).to_degrees() - north_deg),
            view_altitude_deg: roundf(asinf((y / length).clamp(-1.0, 1.0)).to_degrees()) as i32,
            sun: sun_azimuth_altitude_deg.map(|[azimuth, altitude]| (full_turn(azimuth), roundf(altitude) as i32)),
        }
    }

    /// Degrees clockwise from where the view looks, 0 to 359.
    fn bearing(&self, azimuth_deg: i32) -> i32 {
        (azimuth_deg - self.view_azimuth_deg).rem_euclid(360)
    }

    fn line(&self, number: u32) -> Text {
        let mut text = Text::default();
        let view = self.view_azimuth_deg;
        let written = match (number, self.sun) {
            (0, _) => write!(text, "view  {view}° {}, {}", wind(view), Tilt(self.view_altitude_deg)),
            (1, _) => write!(text, "north {}", Aside(self.bearing(0))),
            (2, None) => write!(text, "sun   not known"),
            (2, Some((azimuth, altitude))) => write!(text, "sun   {azimuth}° {}, {}", wind(azimuth), Tilt(altitude)),
            (3, Some((azimuth, _))) => write!(text, "      {}", Aside(self.bearing(azimuth))),
            _ => Ok(()),
        };
        // A line that is full keeps what it has.
        written.map_or(text, |()| text)
    }
}

fn full_turn(degrees: f32) -> i32 {
    (roundf(degrees) as i32).rem_euclid(360)
}

fn wind(azimuth_deg: i32) -> &'static str {
    WINDS[((azimuth_deg * 2 + 45) / 90) as usize % 8]
}

/// Degrees clockwise from where the view looks, in words.
struct Aside(i32);

impl core::fmt::Display for Aside {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self.0 {
            0 => f.write_str("straight ahead"),
            180 => f.write_str("behind"),
            right @ 1..180 => write!(f, "{right}° right"),
            left => write!(f, "{}° left", 360 - left),
        }
    }
}

/// Degrees above the horizon, in words.
struct Tilt(i32);

impl core::fmt::Display for Tilt {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self.0 {
            0 => f.write_str("level"),
            up @ 1.. => write!(f, "{up}° up"),
            down => write!(f, "{}° down", -down),
        }
    }
}

/// A short line without allocation.
#[derive(Clone, Copy, Default)]
struct Text {
    bytes: [u8; 32],
    length: usize,
}

impl Text {
    fn as_str(&self) -> &str {
        core::str::from_utf8(&self.bytes[..self.length]).unwrap_or_default()
    }
}

impl Write for Text {
    fn write_str(&mut self, part: &str) -> core::fmt::Result {
        let end = self.length + part.len();
        self.bytes.get_mut(self.length..end).ok_or(core::fmt::Error)?.copy_from_slice(part.as_bytes());
        self.length = end;
        Ok(())
    }
}

#[derive(Clone, Copy, Debug)]
pub(super) struct Layout {
    compass: Compass,
    face: Face,
    area: Rectangle,
    /// Side of the dial's square, px.
    dial: u32,
}

impl Layout {
    /// At the top in the middle; nothing where there is no room.
    pub(super) fn new(size: Size, faces: Faces, compass: &Compass) -> Self {
        let face = faces.title;
        let cell = face.cell();
        let dial = (size.height * 2 / 7).max(5 * cell.height);
        let plate = Size::new(dial + (COLUMNS + 2) * cell.width, dial);
        let corner = Point::new((size.width as i32 - plate.width as i32) / 2, (cell.width) as i32);
        let fits = corner.x >= 0 && corner.y as u32 + plate.height <= size.height;
        Layout { compass: *compass, face, dial, area: Rectangle::new(corner, if fits { plate } else { Size::zero() }) }
    }

    pub(super) fn area(&self) -> Rectangle {
        self.area
    }

    pub(super) fn draw(&self, paint: &mut Paint<'_, '_>) {
        if !paint.shows(&self.area) {
            return;
        }
        paint.plate(&self.area, self.dial as f32 / 12.0);
        self.draw_dial(paint);
        let cell = self.face.cell();
        let x = self.area.top_left.x + (self.dial + cell.width) as i32;
        let y = self.area.top_left.y + (self.dial - LINES * cell.height) as i32 / 2;
        for number in 0..LINES {
            let ink = if number == 1 {
                ORANGE
            } else if number >= 2 {
                YELLOW
            } else {
                WHITE
            };
            let at = Point::new(x, y + (number * cell.height) as i32);
            paint.write(self.face, at, self.compass.line(number).as_str().chars(), ink);
        }
    }

    /// Up is where the view looks.
    fn draw_dial(&self, paint: &mut Paint<'_, '_>) {
        let half = self.dial as f32 / 2.0;
        let middle = (self.area.top_left.x as f32 + half, self.area.top_left.y as f32 + half);
        let (radius, thin) = (RING * half, (0.03 * half).max(2.0));
        let at = |degrees: i32, reach: f32| polar(middle, degrees, reach * half);
        paint.ring(middle, radius, thin, PALE);
        for azimuth in (0..360).step_by(30) {
            let degrees = self.compass.bearing(azimuth);
            paint.stroke(at(degrees, RING - 0.07), at(degrees, RING), thin, PALE);
        }
        paint.triangle([at(0, RING + 0.02), at(-7, 0.97), at(7, 0.97)], WHITE);
        self.draw_needle(paint, middle, half);
        for (k, wind) in WINDS.iter().step_by(2).enumerate() {
            let ink = if k == 0 { ORANGE } else { PALE };
            self.letter(paint, at(self.compass.bearing(90 * k as i32), 0.49), wind, ink);
        }
        if let Some((azimuth, altitude)) = self.compass.sun {
            draw_sun(paint, middle, self.compass.bearing(azimuth), altitude, half);
        }
    }

    /// Points north.
    fn draw_needle(&self, paint: &mut Paint<'_, '_>, middle: Place, half: f32) {
        let north = self.compass.bearing(0);
        let at = |degrees: i32, reach: f32| polar(middle, degrees, reach * half);
        paint.triangle([at(north, 0.33), at(north - 90, 0.1), at(north + 90, 0.1)], VERMILLION);
        paint.triangle([at(north + 180, 0.33), at(north - 90, 0.1), at(north + 90, 0.1)], PALE);
    }

    fn letter(&self, paint: &mut Paint<'_, '_>, middle: Place, letter: &str, ink: Ink) {
        let cell = self.face.cell();
        let corner =
            Point::new((middle.0 - cell.width as f32 / 2.0) as i32, (middle.1 - cell.height as f32 / 2.0) as i32);
        paint.write(self.face, corner, letter.chars(), ink);
    }
}

/// A disc with rays on the ring; hollow below the horizon.
fn draw_sun(paint: &mut Paint<'_, '_>, middle: Place, degrees: i32, altitude_deg: i32, half: f32) {
    let thick = (0.035 * half).max(2.0);
    let sun = polar(middle, degrees, RING * half);
    paint.disc(sun, 0.2 * half, BLACK);
    for ray in (0..360).step_by(45) {
        paint.stroke(polar(sun, ray, 0.14 * half), polar(sun, ray, 0.175 * half), thick, YELLOW);
    }
    if altitude_deg > 0 {
        paint.disc(sun, 0.1 * half, YELLOW);
    } else {
        paint.ring(sun, 0.09 * half, thick, YELLOW);
    }
}

/// A place at an angle clockwise from up.
fn polar(middle: Place, degrees: i32, reach: f32) -> Place {
    let angle = (degrees as f32).to_radians();
    (middle.0 + reach * sinf(angle), middle.1 - reach * cosf(angle))
}

#[cfg(test)]
mod tests {
    extern crate std;
    use super::*;

    fn lines(compass: &Compass) -> [std::string::String; 4] {
        [0, 1, 2, 3].map(|number| compass.line(number).as_str().into())
    }

    #[test]
    fn directions_are_told_in_words() {
        let compass = Compass::new(0.0, [1.0, 1.0, 1.0], Some([181.4, 43.6]));
        assert_eq!(
            lines(&compass),
            ["view  135° SE, 35° up", "north 135° left", "sun   181° S, 44° up", "      46° right"]
        );
        let compass = Compass::new(-359.9, [0.0, 0.0, -1.0], Some([180.2, -12.0]));
        assert_eq!(
            lines(&compass),
            ["view  0° N, level", "north straight ahead", "sun   180° S, 12° down", "      behind"]
        );
        let compass = Compass::new(0.0, [0.0; 3], None);
        assert_eq!(lines(&compass)[2..], ["sun   not known", ""]);
        let longest = Compass::new(0.0, [-0.5, -3.0, -0.4], Some([337.0, -88.0]));
        assert!(lines(&longest).iter().all(|line| line.chars().count() <= COLUMNS as usize), "{:?}", lines(&longest));
    }
}
