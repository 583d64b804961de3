//! A live view: the pictures of a second camera, of the field's size.

use super::curve::ViewCurve;
use super::fit::Fit;
use crate::camera::{Camera, CameraError, Frame};
use crate::newest::{Newest, SILENCE, Told};
use std::sync::atomic::AtomicBool;
use std::time::{Duration, Instant};

/// One picture of the view.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ViewPicture {
    /// `0x00RRGGBB` sRGB, row 0 at the top, of the field's size.
    pub pixels_bgrx: Vec<u32>,
    /// When the camera took it, where that is known.
    pub taken: Option<Instant>,
}

/// Something that shows what is behind the picture.
pub trait ViewSource {
    /// The newest picture, exchanged for `into`, which is reused; false if there is nothing newer than the last one.
    ///
    /// # Errors
    /// [`CameraError`]; the post holds what it had, and asks again with the next frame.
    fn read(&mut self, into: &mut ViewPicture) -> Result<bool, CameraError>;

    /// The post ends: a thread of its own may, too.
    fn stop(&mut self) {}
}

/// A camera's pictures, each waited for.
pub struct CameraView {
    name: String,
    camera: Box<dyn Camera>,
    frame: Frame,
    fit: Fit,
}

impl CameraView {
    /// A view of `size` = width and height by `camera`, which faults call `name`.
    pub fn new(name: &str, camera: Box<dyn Camera>, size: (usize, usize)) -> Self {
        CameraView { name: name.into(), camera, frame: Frame::default(), fit: Fit::new(size) }
    }

    /// Takes the camera's pictures by its own curve; without one they count as sRGB.
    #[must_use]
    pub fn with_curve(mut self, curve: Option<ViewCurve>) -> Self {
        self.fit = self.fit.with_curve(curve);
        self
    }
}

impl ViewSource for CameraView {
    fn read(&mut self, into: &mut ViewPicture) -> Result<bool, CameraError> {
        self.camera.frame(&mut self.frame)?;
        let refused =
            |error: super::fit::ShapeError| CameraError::Device { path: self.name.clone(), what: error.to_string() };
        self.fit.fit(&self.frame, &mut into.pixels_bgrx).map_err(refused)?;
        into.taken = self.frame.taken();
        Ok(true)
    }
}

/// The newest picture of a view that has a thread of its own.
pub struct BackgroundView {
    name: String,
    newest: Newest<ViewPicture, CameraError>,
}

impl BackgroundView {
    /// Starts taking pictures, one in `pace` at most.
    ///
    /// # Errors
    /// When the system has no thread to give.
    pub fn start(mut view: CameraView, pace: Duration) -> std::io::Result<Self> {
        let name = view.name.clone();
        let take = move |_: u64, picture: &mut ViewPicture| view.read(picture);
        let newest = Newest::start("view", take, |error| matches!(error, CameraError::Ended), pace)?;
        Ok(BackgroundView { name, newest })
    }

    /// Waits for the first picture or fault, no longer than `limit`, and not on when `stop` is set.
    pub fn wait(&mut self, limit: Duration, stop: &AtomicBool) {
        self.newest.wait(limit, stop);
    }
}

impl ViewSource for BackgroundView {
    fn read(&mut self, into: &mut ViewPicture) -> Result<bool, CameraError> {
        match self.newest.take(into) {
            Told::New => Ok(true),
            Told::Nothing => Ok(false),
            Told::Fault(fault) => Err(fault),
            Told::Silence { has_ended } => {
                let what = if has_ended { "its thread has ended" } else { "it hangs" };
                let what = format!("{what}: nothing came for {} s", SILENCE.as_secs());
                Err(CameraError::Device { path: self.name.clone(), what })
            }
        }
    }

    fn stop(&mut self) {
        self.newest.stop();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::fault::{Fault, FaultyCamera};
    use crate::camera::reopen::{Patience, Reopening};
    use crate::camera::{CameraLimits, Exposure};

    /// Each picture is its number, from `next` on.
    struct Numbered {
        next: u8,
        size: (usize, usize),
    }

    impl Camera for Numbered {
        fn limits(&self) -> CameraLimits {
            CameraLimits::nothing_to_set(self.size)
        }
        fn request(&mut self, exposure: Exposure) -> Result<Exposure, CameraError> {
            Ok(exposure)
        }
        fn frame(&mut self, into: &mut Frame) -> Result<(), CameraError> {
            into.codes_u8(self.size.0, self.size.1).fill(self.next);
            self.next += 1;
            Ok(())
        }
    }

    #[test]
    fn every_picture_comes_when_each_is_waited_for() {
        let mut view = CameraView::new("fake", Box::new(Numbered { next: 1, size: (4, 2) }), (4, 2));
        let mut picture = ViewPicture::default();
        for number in 1..4u32 {
            assert!(view.read(&mut picture).unwrap());
            assert_eq!(picture.pixels_bgrx, [0x01_0101 * number; 8]);
        }
        let mut view = CameraView::new("fake", Box::new(Numbered { next: 1, size: (4, 4) }), (4, 2));
        let error = view.read(&mut picture).unwrap_err().to_string();
        assert!(error.starts_with("fake: gives 4x4 pixels"), "{error}");
    }

    #[test]
    fn a_lost_camera_is_told_opened_again_and_goes_on() {
        let mut next = 0;
        let open = move || {
            next += 10;
            let camera = Numbered { next, size: (4, 2) };
            Ok(FaultyCamera::new(camera, vec![(2..u64::MAX, Fault::Lost)]))
        };
        let patience = Patience { retry: Duration::from_millis(20), call: Duration::from_millis(5) };
        let camera = Reopening::waiting(open, CameraLimits::nothing_to_set((4, 2)), patience);
        let view = CameraView::new("fake", Box::new(camera), (4, 2));
        let mut view = BackgroundView::start(view, Duration::from_millis(1)).unwrap();
        let (mut picture, mut losses, begun) = (ViewPicture::default(), 0, Instant::now());
        // Two cameras later.
        while picture.pixels_bgrx.first().is_none_or(|&word| word < 0x1e_1e1e) {
            assert!(begun.elapsed() < Duration::from_secs(60), "{picture:?}");
            match view.read(&mut picture) {
                Err(error) => losses += u32::from(matches!(error, CameraError::Lost)),
                Ok(_) => std::thread::sleep(Duration::from_millis(1)),
            }
        }
        assert!(losses >= 2, "{losses}");
    }
}
