//! A virtual USB sky camera: the kernel's own UVC driver in front, `relume`'s synthetic sensor behind.
//!
//! It speaks the device's side of USB/IP over a socket pair, one end of which the kernel's virtual host controller holds.
//! Exposure, gain and white balance that a driver sets really change the frames that follow, after a number of frames.

pub mod cli;
pub mod codes;
pub mod controls;
pub mod ctl;
pub mod descriptors;
pub mod device;
mod endpoint0;
pub mod faults;
pub mod link;
pub mod log;
pub mod offer;
pub mod optics;
pub mod payload;
pub mod picture;
pub mod settings;
pub mod sky;
pub mod stream;
pub mod usbip;
pub mod vhci;
pub mod yuyv;
