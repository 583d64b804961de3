//! Where the sun stands: time and place to azimuth and altitude, and these to directions in the world.
//!
//! Positions are NREL's Solar Position Algorithm (Reda & Andreas 2004) with refraction of a standard atmosphere.
//! Azimuth is in degrees clockwise from true north, altitude in degrees above the horizon.

use solar_positioning::time::JulianDate;
use solar_positioning::{Location, RefractionCorrection, SolarPositions, delta_t};

/// Seconds of a day.
const DAY_S: f64 = 86_400.0;
/// Julian date of 1970-01-01T00:00:00Z.
const UNIX_EPOCH_JD: f64 = 2_440_587.5;

/// A place on the earth.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Place {
    /// Degrees north of the equator, -90 to 90.
    pub latitude_deg: f64,
    /// Degrees east of Greenwich, -180 to 180.
    pub longitude_deg: f64,
}

/// Where the sun stands.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SunPosition {
    /// Degrees clockwise from true north.
    pub azimuth_deg: f64,
    /// Degrees above the horizon, as seen through a standard atmosphere.
    pub altitude_deg: f64,
}

/// Why a sun position could not be found.
#[derive(Debug, thiserror::Error)]
pub enum SunError {
    /// Time or place lies outside what the ephemeris knows.
    #[error("latitude {latitude_deg}, longitude {longitude_deg}, time {unix_s} s: {reason}")]
    Ephemeris {
        /// Latitude asked for.
        latitude_deg: f64,
        /// Longitude asked for.
        longitude_deg: f64,
        /// Time asked for, unix seconds.
        unix_s: f64,
        /// What the ephemeris said.
        reason: String,
    },
    /// The text is no time in UTC.
    #[error("`{0}` is not a time; write UTC as 2026-06-21T12:00:00Z")]
    Time(String),
}

/// The sun's position at a time (unix seconds, UTC) and place.
///
/// # Errors
/// [`SunError::Ephemeris`] for a place that is not on the earth or a time far out of history.
pub fn sun_position(unix_s: f64, place: Place) -> Result<SunPosition, SunError> {
    let refuse = |reason: solar_positioning::Error| SunError::Ephemeris {
        latitude_deg: place.latitude_deg,
        longitude_deg: place.longitude_deg,
        unix_s,
        reason: reason.to_string(),
    };
    let year = 1970.0 + unix_s / (365.2425 * DAY_S);
    let delta = delta_t::estimate(year).map_err(refuse)?;
    let time = JulianDate::new(UNIX_EPOCH_JD + unix_s / DAY_S, delta).map_err(refuse)?;
    let location = Location { latitude: place.latitude_deg, longitude: place.longitude_deg };
    let refraction = Some(RefractionCorrection::standard());
    let found = SolarPositions::new().at_from_julian(time, location, 0.0, refraction).map_err(refuse)?;
    Ok(SunPosition { azimuth_deg: found.azimuth(), altitude_deg: found.elevation_angle() })
}

/// Unit direction towards an azimuth and altitude; `north_deg` is where north lies, in degrees from -Z towards +X.
pub fn dir_world(position: SunPosition, north_deg: f64) -> [f32; 3] {
    let (sin, cos) = (position.azimuth_deg + north_deg).to_radians().sin_cos();
    let (up, level) = position.altitude_deg.to_radians().sin_cos();
    [(level * sin) as f32, up as f32, (-level * cos) as f32]
}

/// Azimuth (0 to 360) and altitude of a direction; the inverse of [`dir_world`].
pub fn position_of(dir_world: [f32; 3], north_deg: f64) -> SunPosition {
    let [x, y, z] = dir_world.map(f64::from);
    let azimuth_deg = (x.atan2(-z).to_degrees() - north_deg).rem_euclid(360.0);
    SunPosition { azimuth_deg, altitude_deg: y.atan2(x.hypot(z)).to_degrees() }
}

/// Unix seconds of an RFC 3339 time in UTC or with a numeric offset: `2026-06-21T12:00:00Z`, `...12:00:00.5+02:00`.
///
/// # Errors
/// [`SunError::Time`] for anything else.
pub fn parse_utc(text: &str) -> Result<f64, SunError> {
    parse_time(text).ok_or_else(|| SunError::Time(text.into()))
}

fn digits(text: &str, from: usize, to: usize) -> Option<i64> {
    let part = text.get(from..to)?;
    part.bytes().all(|b| b.is_ascii_digit()).then(|| part.parse().ok()).flatten()
}

fn parse_time(text: &str) -> Option<f64> {
    let marks = [(4, b'-'), (7, b'-'), (13, b':'), (16, b':')];
    let bytes = text.as_bytes();
    let well_marked = marks.iter().all(|&(at, mark)| bytes.get(at) == Some(&mark));
    if !well_marked || !matches!(bytes.get(10), Some(b'T' | b't' | b' ')) {
        return None;
    }
    let (year, month, day) = (digits(text, 0, 4)?, digits(text, 5, 7)?, digits(text, 8, 10)?);
    let (hour, minute, second) = (digits(text, 11, 13)?, digits(text, 14, 16)?, digits(text, 17, 19)?);
    let leap = year % 4 == 0 && (year % 100 != 0 || year % 400 == 0);
    let length = [31, if leap { 29 } else { 28 }, 31, 30, 31, 30, 31, 31, 30, 31, 30, 31];
    let longest = *length.get(usize::try_from(month - 1).ok()?)?;
    if !(1..=longest).contains(&day) || hour > 23 || minute > 59 || second > 60 {
        return None;
    }
    let mut rest = text.get(19..)?;
    let mut fraction = 0.0;
    if rest.starts_with('.') {
        let end = rest[1..].find(|c: char| !c.is_ascii_digit()).map_or(rest.len(), |at| at + 1);
        fraction = if end > 1 { rest[..end].parse().ok()? } else { return None };
        rest = &rest[end..];
    }
    let offset_s = match rest {
        "Z" | "z" => 0,
        _ => {
            let sign = if rest.starts_with('+') {
                1
            } else if rest.starts_with('-') {
                -1
            } else {
                return None;
            };
            let (hours, minutes) = (digits(rest, 1, 3)?, digits(rest, 4, 6)?);
            let fits = rest.len() == 6 && rest.as_bytes()[3] == b':' && hours < 24 && minutes < 60;
            if fits { sign * (hours * 3600 + minutes * 60) } else { return None }
        }
    };
    let seconds = days_from_civil(year, month, day) * 86_400 + hour * 3600 + minute * 60 + second - offset_s;
    Some(seconds as f64 + fraction)
}

/// Days since 1970-01-01 of a Gregorian date (Hinnant, *chrono-compatible low-level date algorithms*).
fn days_from_civil(year: i64, month: i64, day: i64) -> i64 {
    let year = if month <= 2 { year - 1 } else { year };
    let era = year.div_euclid(400);
    let year_of_era = year.rem_euclid(400);
    let day_of_year = (153 * ((month + 9) % 12) + 2) / 5 + day - 1;
    era * 146_097 + year_of_era * 365 + year_of_era / 4 - year_of_era / 100 + day_of_year - 719_468
}

/// `YYYY-MM-DDTHH:MM:SSZ` of a time in unix seconds, rounded down to the second.
pub fn format_utc(unix_s: f64) -> String {
    let whole = unix_s.floor() as i64;
    let (days, second) = (whole.div_euclid(86_400), whole.rem_euclid(86_400));
    let shifted = days + 719_468;
    let (era, day_of_era) = (shifted.div_euclid(146_097), shifted.rem_euclid(146_097));
    let year_of_era = (day_of_era - day_of_era / 1460 + day_of_era / 36_524 - day_of_era / 146_096) / 365;
    let day_of_year = day_of_era - (365 * year_of_era + year_of_era / 4 - year_of_era / 100);
    let month_from_march = (5 * day_of_year + 2) / 153;
    let day = day_of_year - (153 * month_from_march + 2) / 5 + 1;
    let month = (month_from_march + 2) % 12 + 1;
    let year = year_of_era + era * 400 + i64::from(month <= 2);
    let (hour, minute, second) = (second / 3600, second / 60 % 60, second % 60);
    format!("{year:04}-{month:02}-{day:02}T{hour:02}:{minute:02}:{second:02}Z")
}

/// Angle between two unit directions, degrees, from their chord: accurate where it is small.
pub fn angle_deg(a: [f32; 3], b: [f32; 3]) -> f64 {
    let chord: f64 = a.iter().zip(&b).map(|(a, b)| (f64::from(*a) - f64::from(*b)).powi(2)).sum::<f64>().sqrt();
    (2.0 * (0.5 * chord).min(1.0).asin()).to_degrees()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equals_the_published_spa_example() {
        // Reda & Andreas, NREL/TP-560-34302, appendix A.5: zenith 50.11162, azimuth 194.34024; there at 820 mbar and 11 C,
        // where refraction is 0.004 degrees less than in the standard atmosphere.
        let unix_s = parse_utc("2003-10-17T12:30:30-07:00").unwrap();
        let place = Place { latitude_deg: 39.742476, longitude_deg: -105.1786 };
        let sun = sun_position(unix_s, place).unwrap();
        assert!((90.0 - sun.altitude_deg - 50.11162).abs() < 0.006, "{sun:?}");
        assert!((sun.azimuth_deg - 194.34024).abs() < 1e-3, "{sun:?}");
    }

    #[test]
    fn times_are_read_and_written() {
        assert_eq!(parse_utc("1970-01-01T00:00:00Z").unwrap(), 0.0);
        assert_eq!(parse_utc("2000-03-01T00:00:00Z").unwrap(), 951_868_800.0);
        assert_eq!(parse_utc("2003-10-17T19:30:30.25Z").unwrap(), 1_066_419_030.25);
        assert_eq!(parse_utc("2003-10-17T21:30:30+02:00").unwrap(), 1_066_419_030.0);
        for text in ["1969-12-31T23:59:59Z", "2000-02-29T12:00:01Z", "2026-11-22T17:14:42Z", "2100-01-01T00:00:00Z"] {
            assert_eq!(format_utc(parse_utc(text).unwrap()), text);
        }
        for bad in [
            "",
            "noon",
            "2026-02-29T00:00:00Z",
            "2026-01-01",
            "2026-01-01T25:00:00Z",
            "2026-01-01T00:00:00",
            "2026-13-01T00:00:00Z",
            "2026-01-01T00:00:00+2",
            "2026-01-01T00:00:00.Z",
            "é026-01-01T00:00:00Z",
        ] {
            assert!(parse_utc(bad).is_err(), "{bad}");
        }
    }

    #[test]
    fn directions_follow_north() {
        let at = |azimuth_deg, altitude_deg, north| dir_world(SunPosition { azimuth_deg, altitude_deg }, north);
        let close = |a: [f32; 3], b: [f32; 3]| a.iter().zip(b).all(|(x, y)| (x - y).abs() < 1e-6);
        assert!(close(at(0.0, 0.0, 0.0), [0.0, 0.0, -1.0]));
        assert!(close(at(90.0, 0.0, 0.0), [1.0, 0.0, 0.0]));
        assert!(close(at(180.0, 0.0, 0.0), [0.0, 0.0, 1.0]));
        assert!(close(at(0.0, 0.0, 90.0), [1.0, 0.0, 0.0]));
        assert!(close(at(77.0, 90.0, 12.0), [0.0, 1.0, 0.0]));
        let back = position_of(at(211.0, 33.0, 25.0), 25.0);
        assert!((back.azimuth_deg - 211.0).abs() < 1e-4 && (back.altitude_deg - 33.0).abs() < 1e-4);
    }

    #[test]
    fn impossible_places_are_refused() {
        assert!(sun_position(0.0, Place { latitude_deg: 91.0, longitude_deg: 0.0 }).is_err());
        assert!(sun_position(f64::NAN, Place { latitude_deg: 1.0, longitude_deg: 0.0 }).is_err());
    }
}
