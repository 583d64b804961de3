//! The frames of a recorded exposure series, each looked at beside the others.

use crate::camera::replay::{Recorded, read_frame, read_list};
use crate::camera::{Codes, Frame};
use crate::failure::{Failure, OrFail};
use std::path::Path;

/// Exposures that differ by less are the same, natural log.
const SAME: f64 = 0.01;
/// Shares of the largest code between which a picture shows something, and how many codes it then has: two exposures may
/// both be black, or white with a dark rim, but not show one scene by the same codes.
const SHOWING: [f64; 2] = [0.02, 0.97];
const FEWEST_CODES: usize = 8;

/// Every frame of a folder, in the order of `frames.json`.
///
/// # Errors
/// Names the frame that cannot be read, has another size or depth than the first, or is the picture of another exposure.
pub(super) fn read_all(folder: &Path) -> Result<Vec<Frame>, Failure> {
    let list = read_list(folder).or_bad()?;
    let read = |(index, recorded): (usize, &_)| {
        let mut frame = Frame::default();
        read_frame(recorded, index as u64, &mut frame).map(|()| frame)
    };
    let frames: Vec<Frame> = list.iter().enumerate().map(read).collect::<Result<_, _>>().or_bad()?;
    check_shapes(&list, &frames)?;
    check_pictures(&list, &frames)?;
    Ok(frames)
}

fn check_shapes(list: &[Recorded], frames: &[Frame]) -> Result<(), Failure> {
    let shape = |frame: &Frame| (frame.width, frame.height, if frame.codes.max() > 255 { 16 } else { 8 });
    let Some(first) = frames.first().map(shape) else { return Ok(()) };
    match list.iter().zip(frames).find(|(_, frame)| shape(frame) != first) {
        None => Ok(()),
        Some((recorded, frame)) => {
            let ((width, height, bits), (w, h, first_bits)) = (shape(frame), first);
            Err(Failure::bad(format!(
                "{}: {width}x{height} pixels of {bits} bits, the first frame ({}) has {w}x{h} of {first_bits}; take it out \
                 of frames.json, or record the series again",
                recorded.path.display(),
                list[0].path.display()
            )))
        }
    }
}

/// A camera that shows an old picture under a new exposure would bend curve and radiance.
fn check_pictures(list: &[Recorded], frames: &[Frame]) -> Result<(), Failure> {
    for (later, frame) in frames.iter().enumerate() {
        let product = |frame: &Frame| frame.exposure.product_s();
        let is_other = |other: &Frame| (product(other) / product(frame)).ln().abs() > SAME;
        let is_copy = |other: &Frame| is_other(other) && other.codes == frame.codes && shows_something(frame);
        if let Some(earlier) = frames[..later].iter().position(is_copy) {
            let [a, b] = [earlier, later].map(|at| frames[at].exposure);
            return Err(Failure::bad(format!(
                "{}: the same picture as {}, though taken with {} s at gain {}, not {} s at gain {}; one of the two is not of \
                 its exposure: record the series again, or take it out of frames.json",
                list[later].path.display(),
                list[earlier].path.display(),
                b.exposure_s,
                b.gain,
                a.exposure_s,
                a.gain
            )));
        }
    }
    Ok(())
}

fn shows_something(frame: &Frame) -> bool {
    let max = f64::from(frame.codes.max());
    let mut seen = [false; 256];
    let mut see = |code: u16| {
        let share = f64::from(code) / max;
        if (SHOWING[0]..SHOWING[1]).contains(&share) {
            seen[(255.0 * share) as usize] = true;
        }
    };
    match &frame.codes {
        Codes::U8(codes) => codes.iter().for_each(|&code| see(code.into())),
        Codes::U16(codes) => codes.iter().for_each(|&code| see(code)),
    }
    seen.iter().filter(|&&seen| seen).count() >= FEWEST_CODES
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Grey steps, a frame of one code, and a folder that lists files with their times.
    fn folder(listed: &[(&str, f64)]) -> tempfile::TempDir {
        let folder = tempfile::tempdir().unwrap();
        let save = |name: &str, size: u32, code: fn(u32) -> u8| {
            let picture = image::RgbImage::from_fn(size, 32, |x, _| image::Rgb([code(x); 3]));
            picture.save(folder.path().join(name)).unwrap();
        };
        for name in ["a.png", "copy.png"] {
            save(name, 32, |x| 8 * x as u8);
        }
        save("brighter.png", 32, |x| (12 * x).min(255) as u8);
        ["white.png", "white2.png"].into_iter().for_each(|name| save(name, 32, |x| if x < 2 { 12 } else { 255 }));
        save("small.png", 16, |x| x as u8);
        image::ImageBuffer::from_fn(32, 32, |x, _| image::Rgb([x as u16 * 900; 3]))
            .save(folder.path().join("deep.png"))
            .unwrap();
        let entries: Vec<String> =
            listed.iter().map(|(file, time_s)| format!(r#"{{"file":"{file}","time_s":{time_s}}}"#)).collect();
        std::fs::write(folder.path().join("frames.json"), format!("[{}]", entries.join(","))).unwrap();
        folder
    }

    #[test]
    fn frames_that_do_not_belong_together_are_named() {
        for (listed, told) in [
            ([("a.png", 1.0), ("small.png", 2.0)], "small.png: 16x32 pixels of 8 bits"),
            ([("a.png", 1.0), ("deep.png", 2.0)], "deep.png: 32x32 pixels of 16 bits"),
            ([("a.png", 1.0), ("copy.png", 2.0)], "copy.png: the same picture as"),
        ] {
            let folder = folder(&listed);
            let error = read_all(folder.path()).unwrap_err().to_string();
            assert!(error.contains(told) && error.contains("a.png") && !error.contains('\n'), "{error}");
        }
    }

    #[test]
    fn frames_that_show_nothing_or_one_exposure_may_be_alike() {
        for listed in [
            [("a.png", 1.0), ("brighter.png", 1.5)],
            [("a.png", 1.0), ("copy.png", 1.0)],
            [("white.png", 1.0), ("white2.png", 2.0)],
        ] {
            let folder = folder(&listed);
            assert_eq!(read_all(folder.path()).unwrap().len(), 2);
        }
    }
}
