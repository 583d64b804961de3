//! The V4L2 requests that a camera needs, typed: all that is unsafe about them is here.
#![allow(unsafe_code)]

use std::ffi::c_int;
use std::fs::File;
use std::io;
use std::marker::PhantomData;
use std::os::fd::AsRawFd;
use v4l::v4l_sys as sys;
use v4l::v4l2::{self, vidioc};

/// Plain C data for which all zeros is a value.
///
/// # Safety
/// The type holds no references and no other types that zeros are not a value of.
pub(super) unsafe trait Plain: Sized {
    fn zeroed() -> Self {
        // SAFETY: what the trait promises.
        unsafe { std::mem::zeroed() }
    }
}

macro_rules! plain {
    ($($name:ty)*) => {
        $(
            // SAFETY: integers, and arrays, unions and structs of them; pointers among them are raw and may be null.
            unsafe impl Plain for $name {}
        )*
    };
}
plain!(c_int sys::v4l2_capability sys::v4l2_fmtdesc sys::v4l2_format sys::v4l2_pix_format sys::v4l2_requestbuffers sys::v4l2_buffer
       sys::v4l2_streamparm sys::v4l2_control sys::v4l2_queryctrl sys::v4l2_querymenu sys::v4l2_frmsizeenum sys::v4l2_frmivalenum
       sys::v4l2_event_subscription sys::v4l2_event sys::v4l2_ext_control sys::v4l2_ext_controls);

/// A request with an argument of type `T`.
pub(super) struct Request<T>(vidioc::_IOC_TYPE, PhantomData<fn(T)>);

impl<T> Request<T> {
    /// Checked when compiled: the request's number holds its argument's size.
    const fn new(number: vidioc::_IOC_TYPE) -> Self {
        assert!((number >> 16 & 0x3fff) as usize == size_of::<T>());
        Request(number, PhantomData)
    }

    /// Requests that the v4l crate does not list; `direction` is 1 to the kernel, 2 from it.
    const fn unlisted(direction: vidioc::_IOC_TYPE, number: vidioc::_IOC_TYPE) -> Self {
        let size = size_of::<T>() as vidioc::_IOC_TYPE;
        Request(direction << 30 | size << 16 | (b'V' as vidioc::_IOC_TYPE) << 8 | number, PhantomData)
    }
}

pub(super) const QUERYCAP: Request<sys::v4l2_capability> = Request::new(vidioc::VIDIOC_QUERYCAP);
pub(super) const ENUM_FMT: Request<sys::v4l2_fmtdesc> = Request::new(vidioc::VIDIOC_ENUM_FMT);
pub(super) const ENUM_FRAMESIZES: Request<sys::v4l2_frmsizeenum> = Request::new(vidioc::VIDIOC_ENUM_FRAMESIZES);
pub(super) const ENUM_FRAMEINTERVALS: Request<sys::v4l2_frmivalenum> = Request::new(vidioc::VIDIOC_ENUM_FRAMEINTERVALS);
pub(super) const REQBUFS: Request<sys::v4l2_requestbuffers> = Request::new(vidioc::VIDIOC_REQBUFS);
pub(super) const QUERYBUF: Request<sys::v4l2_buffer> = Request::new(vidioc::VIDIOC_QUERYBUF);
pub(super) const QBUF: Request<sys::v4l2_buffer> = Request::new(vidioc::VIDIOC_QBUF);
pub(super) const DQBUF: Request<sys::v4l2_buffer> = Request::new(vidioc::VIDIOC_DQBUF);
pub(super) const STREAMON: Request<c_int> = Request::new(vidioc::VIDIOC_STREAMON);
pub(super) const STREAMOFF: Request<c_int> = Request::new(vidioc::VIDIOC_STREAMOFF);
pub(super) const G_CTRL: Request<sys::v4l2_control> = Request::new(vidioc::VIDIOC_G_CTRL);
pub(super) const S_CTRL: Request<sys::v4l2_control> = Request::new(vidioc::VIDIOC_S_CTRL);
pub(super) const QUERYCTRL: Request<sys::v4l2_queryctrl> = Request::new(vidioc::VIDIOC_QUERYCTRL);
pub(super) const QUERYMENU: Request<sys::v4l2_querymenu> = Request::new(vidioc::VIDIOC_QUERYMENU);
pub(super) const DQEVENT: Request<sys::v4l2_event> = Request::unlisted(2, 89);
const SUBSCRIBE_EVENT: Request<sys::v4l2_event_subscription> = Request::unlisted(1, 90);
const G_FMT: Request<sys::v4l2_format> = Request::new(vidioc::VIDIOC_G_FMT);
const S_FMT: Request<sys::v4l2_format> = Request::new(vidioc::VIDIOC_S_FMT);
const G_PARM: Request<sys::v4l2_streamparm> = Request::new(vidioc::VIDIOC_G_PARM);
const G_EXT_CTRLS: Request<sys::v4l2_ext_controls> = Request::new(vidioc::VIDIOC_G_EXT_CTRLS);

/// Single-planar pictures from the device.
pub(super) const CAPTURE: u32 = sys::v4l2_buf_type_V4L2_BUF_TYPE_VIDEO_CAPTURE;
/// Buffers that the driver allocates.
pub(super) const MMAP: u32 = sys::v4l2_memory_V4L2_MEMORY_MMAP;
const SOURCE_CHANGE: u32 = 5;

/// Sends one request.
pub(super) fn ioctl<T: Plain>(file: &File, request: &Request<T>, argument: &mut T) -> io::Result<()> {
    loop {
        // SAFETY: the descriptor is open, and the kernel reads and writes as many bytes as the request's number says,
        // which is `T`'s size. Pointers inside `T` are null but for `get_64`'s, which lives through the call.
        let result = unsafe { v4l2::ioctl(file.as_raw_fd(), request.0, std::ptr::from_mut(argument).cast()) };
        match result {
            Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
            other => return other,
        }
    }
}

/// The format in use.
pub(super) fn pix_format(file: &File) -> io::Result<sys::v4l2_pix_format> {
    let mut format = sys::v4l2_format::zeroed();
    format.type_ = CAPTURE;
    ioctl(file, &G_FMT, &mut format)?;
    // SAFETY: for this type of buffer the union is a `v4l2_pix_format`.
    Ok(unsafe { format.fmt.pix })
}

/// Asks for a format; returns the one that the driver chose.
pub(super) fn set_pix_format(file: &File, pix: sys::v4l2_pix_format) -> io::Result<sys::v4l2_pix_format> {
    let mut format = sys::v4l2_format::zeroed();
    format.type_ = CAPTURE;
    format.fmt.pix = pix;
    ioctl(file, &S_FMT, &mut format)?;
    // SAFETY: for this type of buffer the union is a `v4l2_pix_format`.
    Ok(unsafe { format.fmt.pix })
}

/// How the driver codes YUV; newer than its `priv` field, which says whether it is there.
pub(super) fn ycbcr_encoding(pix: &sys::v4l2_pix_format) -> u32 {
    // SAFETY: both members of the union are a `u32`.
    unsafe { pix.__bindgen_anon_1.ycbcr_enc }
}

/// A size list's entry: `[width, height]`, or the smallest and the largest one.
pub(super) fn frame_size(size: &sys::v4l2_frmsizeenum) -> [[u32; 2]; 2] {
    if size.type_ == sys::v4l2_frmsizetypes_V4L2_FRMSIZE_TYPE_DISCRETE {
        // SAFETY: the type says which member the driver wrote.
        let discrete = unsafe { size.__bindgen_anon_1.discrete };
        return [[discrete.width, discrete.height]; 2];
    }
    // SAFETY: as above; continuous sizes are steps of 1.
    let steps = unsafe { size.__bindgen_anon_1.stepwise };
    [[steps.min_width, steps.min_height], [steps.max_width, steps.max_height]]
}

/// An interval list's entry: the time from frame to frame, or the least and the most, seconds.
pub(super) fn frame_intervals_s(entry: &sys::v4l2_frmivalenum) -> [f64; 2] {
    let seconds = |time: sys::v4l2_fract| f64::from(time.numerator) / f64::from(time.denominator);
    if entry.type_ == sys::v4l2_frmivaltypes_V4L2_FRMIVAL_TYPE_DISCRETE {
        // SAFETY: the type says which member the driver wrote.
        return [seconds(unsafe { entry.__bindgen_anon_1.discrete }); 2];
    }
    // SAFETY: as above; continuous intervals are steps of what the driver can.
    let steps = unsafe { entry.__bindgen_anon_1.stepwise };
    [seconds(steps.min), seconds(steps.max)]
}

/// Time from frame to frame, seconds, where the driver tells it.
pub(super) fn frame_interval_s(file: &File) -> Option<f64> {
    let mut parameters = sys::v4l2_streamparm::zeroed();
    parameters.type_ = CAPTURE;
    ioctl(file, &G_PARM, &mut parameters).ok()?;
    // SAFETY: for this type of buffer the union is a `v4l2_captureparm`.
    let time = unsafe { parameters.parm.capture.timeperframe };
    (time.numerator > 0 && time.denominator > 0).then(|| f64::from(time.numerator) / f64::from(time.denominator))
}

/// Where a queried buffer is mapped.
pub(super) fn buffer_offset(buffer: &sys::v4l2_buffer) -> u64 {
    // SAFETY: for this kind of memory the union is the offset; any bits are a `u32`.
    u64::from(unsafe { buffer.m.offset })
}

/// A control of 64 bits, which `G_CTRL` does not read.
pub(super) fn get_64(file: &File, id: u32) -> io::Result<i64> {
    let mut control = sys::v4l2_ext_control::zeroed();
    control.id = id;
    let mut controls = sys::v4l2_ext_controls::zeroed();
    controls.count = 1;
    controls.controls = &raw mut control;
    ioctl(file, &G_EXT_CTRLS, &mut controls)?;
    // SAFETY: the union's widest member; any bits are an `i64`.
    Ok(unsafe { control.__bindgen_anon_1.value64 })
}

/// Asks to be told when the source's format changes; drivers whose source cannot change refuse.
pub(super) fn subscribe_source_changes(file: &File) {
    let mut subscription = sys::v4l2_event_subscription::zeroed();
    subscription.type_ = SOURCE_CHANGE;
    let _ = ioctl(file, &SUBSCRIBE_EVENT, &mut subscription);
}

/// Whether the oldest event is a change of the source; `None` when there is no event.
pub(super) fn source_changed(file: &File) -> Option<bool> {
    let mut event = sys::v4l2_event::zeroed();
    ioctl(file, &DQEVENT, &mut event).ok()?;
    Some(event.type_ == SOURCE_CHANGE)
}
