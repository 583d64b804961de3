//! Does the view show the field's receivers as the sky's light makes them? What to calibrate where it does not.

mod advice;

use super::Table;
use super::view::Behind;
use crate::cli::relight::{light_of, relight_still};
use crate::cli::run::{has_what_measures, open_source};
use crate::clock::PostClock;
use crate::config::{Config, SkyKind};
use crate::exposure::{ExposureControl, ExposureMode};
use crate::failure::Failure;
use crate::painter::Painter;
use crate::painter::field::FieldPainter;
use crate::relight::FieldFile;
use crate::sky_source::SkyReading;
use crate::view::Still;
use crate::view::disagreement::Disagreement;
use crate::view::live::{ViewPicture, ViewSource};
use crate::weights::PatchWeights;
use advice::{Found, rows};
use std::path::Path;

/// What the rows are called by that cannot tell.
const WHAT: &str = "receivers";

/// Compares the view with the receivers in the light that it was taken in. What is found is advice: a post opens with any.
pub(super) fn receivers(config: &Config, behind: &mut Behind, table: &mut Table) {
    // A field that cannot be read has a line of its own.
    let Ok(file) = FieldFile::open(&config.field) else { return };
    measures(config, behind, &file, table);
    if config.additive || (behind.still.is_none() && behind.live.is_none()) {
        return;
    }
    match look(config, behind, &file) {
        Ok(found) => rows(config, &found, table),
        Err(why) => table.say(WHAT, format!("cannot tell how the view shows them: {why}")),
    }
}

/// What a post does not open without: receivers and a still's light, where its file counts on them.
fn measures(config: &Config, behind: &Behind, file: &FieldFile, table: &mut Table) {
    if let Err(refused) = has_what_measures(config, file) {
        table.add("exposure", Err::<((), String), _>(refused));
    }
    if let Some(path) = &config.view_light {
        let words = |()| ((), format!("{}: the light that the still was taken in", path.display()));
        table.add("light then", relights(path, behind, file).map(words));
    }
}

/// Relights the still behind the picture as a post does when it opens.
fn relights(path: &Path, behind: &Behind, file: &FieldFile) -> Result<(), Failure> {
    // A still that cannot be read has a line of its own.
    let Some(still) = behind.still.clone() else { return light_of(path, &file.field()).map(|_| ()) };
    let mut painter = FieldPainter::new(file.field(), still, 1);
    painter.show_receivers(file.receivers());
    painter.put_behind(behind.mask.clone());
    relight_still(&mut painter, path, &file.field())
}

fn look(config: &Config, behind: &mut Behind, file: &FieldFile) -> Result<Found, String> {
    let words = |error: &dyn std::fmt::Display| error.to_string();
    if file.receivers().is_none() {
        return Err("the field has none; mark the ground as relume = receiver and bake again".into());
    }
    let (weights, mut exposed_by) = light(config, behind, file)?;
    let mut painter = FieldPainter::new(file.field(), picture(behind, file)?, 0);
    painter.show_receivers(file.receivers());
    painter.put_behind(behind.mask.take());
    painter.relight(&weights, 1.0).map_err(|error| words(&error))?;
    let disagreement: Disagreement = painter.disagreement().map_err(|error| words(&error))?;
    // As the loop chooses it.
    if exposed_by.is_by_view() {
        exposed_by.see_gain(Some(disagreement.gain.gain));
    } else {
        exposed_by.see(painter.wanted_exposure());
    }
    let is_still = behind.live.is_none();
    Ok(Found { disagreement, shown: f64::from(exposed_by.factor()), is_relit: is_still && config.view_light.is_some() })
}

/// The light that the view was taken in, and the control of the exposure that the post shows.
fn light(config: &Config, behind: &Behind, file: &FieldFile) -> Result<(PatchWeights, ExposureControl), String> {
    let control = ExposureControl::new(config.exposure);
    if behind.live.is_none() {
        if let Some(path) = &config.view_light {
            let then = light_of(path, &file.field()).map_err(|failure| failure.to_string())?;
            return Ok((then, control));
        }
        if config.exposure != ExposureMode::View {
            return Err(
                "in which light the still was taken is not known; write view_light, or exposure.mode = \"view\" if it is \
                 today's"
                    .into(),
            );
        }
    }
    if config.sky == SkyKind::Simulated {
        return Err("sky = \"simulated\" is a model's light, not that of the sky over the view".into());
    }
    let made = std::fs::metadata(&config.field).and_then(|meta| meta.modified()).ok();
    let now = PostClock::start(config.clock, made).now(0);
    if !now.trusted {
        return Err("the clock is not trusted, and the sun's place comes from it".into());
    }
    let mut source = open_source(config, &file.field()).map_err(|failure| failure.to_string())?;
    let mut reading = SkyReading::default();
    source.read(now, &mut reading).map_err(|fault| format!("the sky gives no light: {fault}"))?;
    source.stop();
    Ok((reading.weights, control))
}

/// What the view shows now.
fn picture(behind: &mut Behind, file: &FieldFile) -> Result<Still, String> {
    let (width, height) = (file.field().width(), file.field().height());
    let mut newest = ViewPicture::default();
    match (&mut behind.live, &behind.still) {
        (Some(live), _) => {
            live.read(&mut newest).map_err(|error| error.to_string())?;
            Ok(Still { width, height, pixels_bgrx: newest.pixels_bgrx })
        }
        (None, Some(still)) => Ok(still.clone()),
        (None, None) => Ok(Still::black(width, height)),
    }
}
