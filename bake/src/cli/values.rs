//! Values of options.

use crate::material::Shading;
use lexopt::ValueExt;
use relume_firmware::glue::failure::Failure;
use std::ops::{Range, RangeInclusive};
use std::time::Duration;

/// What `--error` and `--noise` may be, fractions.
pub(super) const ERRORS: RangeInclusive<f64> = 1e-4..=0.2;
pub(super) const NOISES: RangeInclusive<f64> = 1e-3..=1.0;

pub(super) fn text(parser: &mut lexopt::Parser) -> Result<String, Failure> {
    Ok(parser.value()?.string()?)
}

pub(super) fn number<T: std::str::FromStr>(parser: &mut lexopt::Parser, name: &str) -> Result<T, Failure> {
    let text = text(parser)?;
    text.parse().map_err(|_| Failure::bad(format!("{name} {text}: not a whole number in range")))
}

pub(super) fn size(text: &str) -> Result<(u32, u32), Failure> {
    let sides = text.split_once(['x', 'X']).and_then(|(w, h)| Some((w.parse().ok()?, h.parse().ok()?)));
    sides.ok_or_else(|| Failure::bad(format!("--size {text}: write WIDTHxHEIGHT in pixels, such as 1920x1080")))
}

pub(super) fn shading(text: &str) -> Result<Shading, Failure> {
    match text {
        "gltf" => Ok(Shading::Gltf),
        "lambert" => Ok(Shading::Lambert),
        other => Err(Failure::bad(format!("--materials {other}: say gltf or lambert"))),
    }
}

/// Two finite numbers with a comma between them.
pub(super) fn pair(text: &str) -> Option<[f64; 2]> {
    let (a, b) = text.split_once(',')?;
    let pair = [a.trim().parse().ok()?, b.trim().parse().ok()?];
    pair.iter().all(|value: &f64| value.is_finite()).then_some(pair)
}

/// Three finite numbers with commas between them.
pub(super) fn triple(text: &str) -> Option<[f64; 3]> {
    let numbers: Option<Vec<f64>> = text.split(',').map(|part| part.trim().parse().ok()).collect();
    let triple: [f64; 3] = numbers?.try_into().ok()?;
    triple.iter().all(|value| value.is_finite()).then_some(triple)
}

pub(super) fn sun(text: &str) -> Result<[f64; 2], Failure> {
    let advice = "write AZIMUTH,ALTITUDE in degrees, clockwise from north and above the horizon (altitude 0 to 90)";
    pair(text)
        .filter(|[_, altitude]| (0.0..=90.0).contains(altitude))
        .ok_or_else(|| Failure::bad(format!("--sun {text}: {advice}")))
}

pub(super) fn site(text: &str) -> Result<[f64; 2], Failure> {
    pair(text)
        .filter(|[latitude, longitude]| latitude.abs() <= 90.0 && longitude.abs() <= 180.0)
        .ok_or_else(|| Failure::bad(format!("--site {text}: write LATITUDE,LONGITUDE in degrees, such as 37.97,23.73")))
}

/// A percentage that option `name` was given, within `range` (fractions).
pub(super) fn percent(name: &str, text: &str, range: RangeInclusive<f64>) -> Result<f64, Failure> {
    let value = text.strip_suffix('%').and_then(|number| number.parse::<f64>().ok()).map(|number| number / 100.0);
    value.filter(|value| range.contains(value)).ok_or_else(|| {
        let [low, high] = [range.start(), range.end()].map(|end| 100.0 * end);
        Failure::bad(format!("{name} {text}: write a percentage from {low}% to {high}%"))
    })
}

/// A time with its unit: `90s`, `10m`, `1.5h`.
pub(super) fn duration(name: &str, text: &str) -> Result<Duration, Failure> {
    let units = [('s', 1.0), ('m', 60.0), ('h', 3600.0)];
    let number = |(unit, seconds): (char, f64)| Some(text.strip_suffix(unit)?.trim().parse::<f64>().ok()? * seconds);
    let seconds = units.into_iter().find_map(number).filter(|seconds| (1.0..1e7).contains(seconds));
    seconds
        .map(Duration::from_secs_f64)
        .ok_or_else(|| Failure::bad(format!("{name} {text}: write a time with its unit, such as 90s, 10m or 1.5h")))
}

/// `A..B`, not empty.
pub(super) fn range(text: &str) -> Result<Range<u32>, Failure> {
    let ends = text.split_once("..").and_then(|(a, b)| Some(a.trim().parse().ok()?..b.trim().parse().ok()?));
    ends.filter(|range| !range.is_empty())
        .ok_or_else(|| Failure::bad(format!("--tiles {text}: write FIRST..END, such as 0..100 for the first hundred")))
}
