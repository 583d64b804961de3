//! What came of the study, as figures and in words.

use std::path::Path;

use serde::Serialize;

use super::DAYS;
use super::judge::Judgement;

/// One moment.
#[derive(Clone, Debug, Serialize)]
pub(super) struct Moment {
    pub(super) day: &'static str,
    pub(super) time_utc: String,
    pub(super) sun_altitude_deg: f64,
    /// Share of the view's channel values that are clipped.
    pub(super) clipped: f64,
    /// Against the built-in path tracer.
    #[serde(flatten)]
    pub(super) own: Compared,
    /// Against another renderer, whose picture of the real site the post had, too.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) outside: Option<Compared>,
    /// The two renderers' pictures of the site with its temple.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) renderers: Option<Judgement>,
}

/// What the post shows against what a renderer draws.
#[derive(Clone, Debug, Serialize)]
pub(super) struct Compared {
    /// With the light that the sky camera measured.
    pub(super) camera: Judgement,
    /// With the light of the true sky: what is left is not the sky camera's.
    pub(super) true_sky: Judgement,
    /// What chance leaves in the truth itself: two path traces whose mean it is, each against the other, halved; of pixels
    /// and of 4 x 4 pixels, medians.
    pub(super) noise: f64,
    pub(super) noise_of_blocks: f64,
    /// The view's gain that the post uses under the true sky, over the true one.
    pub(super) gain_error: [f64; 3],
}

/// What came of it.
#[derive(Clone, Debug, Serialize)]
pub(super) struct Report {
    /// How far the view camera, measured by marks on its still, shows places from where they are, px of the picture: rms and the
    /// largest.
    pub(super) reprojection_px: [f64; 2],
    /// Colour differences, CIE DE2000, of covered pixels and of receivers in shadow or reflected light.
    pub(super) moments: Vec<Moment>,
    /// Median and 95th percentile of the moments' medians and 95th percentiles, and the worst of both.
    pub(super) median: [f64; 2],
    pub(super) high: [f64; 2],
    /// The same of 4 x 4 pixels.
    pub(super) median_of_blocks: [f64; 2],
    pub(super) high_of_blocks: [f64; 2],
}

impl Report {
    pub(super) fn of(moments: Vec<Moment>, reprojection_px: [f64; 2]) -> Self {
        let of = |pick: fn(&Judgement) -> f64| middle_and_worst(moments.iter().map(|moment| pick(&moment.own.camera)));
        Report {
            reprojection_px,
            median: of(|j| j.median),
            high: of(|j| j.high),
            median_of_blocks: of(|j| j.median_of_blocks),
            high_of_blocks: of(|j| j.high_of_blocks),
            moments,
        }
    }

    pub(super) fn words(&self, out: &Path) -> String {
        let ([median, high], [median_of_blocks, high_of_blocks]) =
            ([self.median, self.high], [self.median_of_blocks, self.high_of_blocks]);
        let outside: Vec<(&str, &Compared)> =
            self.moments.iter().filter_map(|moment| Some((moment.day, moment.outside.as_ref()?))).collect();
        let own: Vec<(&str, &Compared)> = self.moments.iter().map(|moment| (moment.day, &moment.own)).collect();
        let clipped = self.moments.iter().map(|moment| moment.clipped).fold(0.0, f64::max);
        format!(
            "the view camera by 12 marks on its still: off by {:.2} px rms, {:.2} at most; clipped: {:.1} % of a view at most\n\
             colour differences (DE2000) of covered pixels and shadowed receivers: median {:.2} (worst moment {:.2}), 95 % {:.2} \
             ({:.2}); of 4x4 pixels {:.2} ({:.2}), {:.2} ({:.2})\n\
             {}{}{}: standing.json, standing.png, flicker.html\n",
            self.reprojection_px[0],
            self.reprojection_px[1],
            100.0 * clipped,
            median[0],
            median[1],
            high[0],
            high[1],
            median_of_blocks[0],
            median_of_blocks[1],
            high_of_blocks[0],
            high_of_blocks[1],
            days_in_words(&own),
            self.outside_in_words(&outside),
            out.display()
        )
    }

    fn outside_in_words(&self, outside: &[(&str, &Compared)]) -> String {
        if outside.is_empty() {
            return String::new();
        }
        let of = |pick: fn(&Judgement) -> f64| middle_and_worst(outside.iter().map(|(_, found)| pick(&found.camera)));
        let apart = |pick: fn(&Judgement) -> f64| {
            middle_and_worst(self.moments.iter().filter_map(|moment| moment.renderers.as_ref()).map(pick))
        };
        let ([median, high], [apart, blocks]) =
            ([of(|j| j.median), of(|j| j.high)], [apart(|j| j.median), apart(|j| j.median_of_blocks)]);
        format!(
            "against the other renderer: median {:.2} (worst moment {:.2}), 95 % {:.2} ({:.2}); the two renderers differ by {:.2}, of \
             4x4 pixels by {:.2}\n{}",
            median[0],
            median[1],
            high[0],
            high[1],
            apart[0],
            blocks[0],
            days_in_words(outside)
        )
    }
}

/// Of figures, one per moment.
fn middle_and_worst(figures: impl Iterator<Item = f64>) -> [f64; 2] {
    let mut all: Vec<f64> = figures.collect();
    all.sort_by(f64::total_cmp);
    [all[all.len() / 2], all[all.len() - 1]]
}

/// The worst of each day.
fn days_in_words(moments: &[(&str, &Compared)]) -> String {
    let of_day = |day: &str| {
        let own = || moments.iter().filter(move |moment| moment.0 == day).map(|moment| moment.1);
        let worst = |pick: &dyn Fn(&Compared) -> f64| own().map(pick).fold(0.0, f64::max);
        format!(
            "{day}: {} moments; worst median {:.2}, worst 95 % {:.2}; under the true sky {:.2}, {:.2}; of 4x4 pixels {:.2}, {:.2}; \
             noise of the truth {:.2}, of 4x4 pixels {:.2}; gain off by {:.1} % at most\n",
            own().count(),
            worst(&|m| m.camera.median),
            worst(&|m| m.camera.high),
            worst(&|m| m.true_sky.median),
            worst(&|m| m.true_sky.high),
            worst(&|m| m.camera.median_of_blocks),
            worst(&|m| m.camera.high_of_blocks),
            worst(&|m| m.noise),
            worst(&|m| m.noise_of_blocks),
            100.0 * worst(&|m| m.gain_error.iter().fold(0.0, |most, error| error.abs().max(most)))
        )
    };
    let days = DAYS.iter().map(|(day, ..)| *day).filter(|day| moments.iter().any(|moment| moment.0 == *day));
    days.map(of_day).collect()
}
