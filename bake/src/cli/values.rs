//! Values of options.

use crate::material::Shading;
use lexopt::ValueExt;
use relume_firmware::glue::failure::Failure;
use std::ops::Range;

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

pub(super) fn percent(text: &str) -> Result<f64, Failure> {
    let value = text.strip_suffix('%').and_then(|number| number.parse::<f64>().ok()).map(|number| number / 100.0);
    value
        .filter(|value| (1e-4..=0.2).contains(value))
        .ok_or_else(|| Failure::bad(format!("--error {text}: write a percentage from 0.01% to 20%")))
}

/// `A..B`, not empty.
pub(super) fn range(text: &str) -> Result<Range<u32>, Failure> {
    let ends = text.split_once("..").and_then(|(a, b)| Some(a.trim().parse().ok()?..b.trim().parse().ok()?));
    ends.filter(|range| !range.is_empty())
        .ok_or_else(|| Failure::bad(format!("--tiles {text}: write FIRST..END, such as 0..100 for the first hundred")))
}
