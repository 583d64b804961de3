//! The controls of a real node.

use super::{ControlRange, Controls};
use crate::camera::v4l2::ioctl::{self, Plain, ioctl};
use std::fs::File;
use std::io;
use std::sync::Arc;
use v4l::v4l_sys as sys;

const DISABLED_OR_READ_ONLY: u32 = sys::V4L2_CTRL_FLAG_DISABLED | sys::V4L2_CTRL_FLAG_READ_ONLY;

/// A node's controls, asked one by one.
pub(in crate::camera::v4l2) struct DeviceControls(pub Arc<File>);

impl Controls for DeviceControls {
    fn query(&self, id: u32) -> io::Result<ControlRange> {
        let mut query = sys::v4l2_queryctrl::zeroed();
        query.id = id;
        ioctl(&self.0, &ioctl::QUERYCTRL, &mut query)?;
        Ok(ControlRange {
            min: i64::from(query.minimum),
            max: i64::from(query.maximum),
            step: i64::from(query.step),
            default: i64::from(query.default_value),
            writable: query.flags & DISABLED_OR_READ_ONLY == 0,
        })
    }

    fn offers(&self, id: u32, entry: i64) -> bool {
        let mut menu = sys::v4l2_querymenu::zeroed();
        (menu.id, menu.index) = (id, entry as u32);
        ioctl(&self.0, &ioctl::QUERYMENU, &mut menu).is_ok()
    }

    fn get(&self, id: u32) -> io::Result<i64> {
        let mut control = sys::v4l2_control { id, value: 0 };
        match ioctl(&self.0, &ioctl::G_CTRL, &mut control) {
            Ok(()) => Ok(i64::from(control.value)),
            // The pixel rate has 64 bits, which this request refuses.
            Err(error) => ioctl::get_64(&self.0, id).map_err(|_| error),
        }
    }

    fn set(&mut self, id: u32, value: i64) -> io::Result<()> {
        let value = i32::try_from(value).map_err(|_| io::Error::from(io::ErrorKind::InvalidInput))?;
        let mut control = sys::v4l2_control { id, value };
        ioctl(&self.0, &ioctl::S_CTRL, &mut control)
    }
}
