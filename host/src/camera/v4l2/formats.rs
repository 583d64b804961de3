//! Which picture a camera is asked for, and what it then gives.

use super::V4l2Settings;
use super::ioctl::{self, Plain};
use super::node::Node;
use crate::camera::CameraError;
use crate::camera::unpack::formats::{best, from_fourcc, is_shown, name};
use crate::camera::unpack::{Layout, Matrix, PixelFormat, Range, YuvCoding};
use v4l::v4l_sys as sys;

/// Pixels of a picture, at most, when no size is asked for: more measure the sky no better.
const ENOUGH_PIXELS: u64 = 2_100_000;
/// Says in a format's `priv` that the fields behind it are meant.
const EXTENDED: u32 = 0xfeed_cafe;

/// What the driver agreed to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Agreed {
    pub fourcc: [u8; 4],
    pub layout: Layout,
    /// Time from frame to frame, seconds, where the driver tells it.
    pub interval_s: Option<f64>,
}

/// Chooses and sets format and size.
pub(super) fn agree(node: &Node, settings: &V4l2Settings) -> Result<Agreed, CameraError> {
    let offered = usable(offered(node), settings.manual).map_err(|what| node.refused(what))?;
    let (fourcc, format) = choose(&offered, settings.fourcc).map_err(|what| node.refused(what))?;
    let current = ioctl::pix_format(&node.file).map_err(|error| node.setup_fault("tells no format", &error))?;
    let sizes = sizes(node, fourcc);
    let [width, height] =
        settings.size.or(settings.near_size).or_else(|| enough(&sizes)).unwrap_or([current.width, current.height]);
    let pix = sys::v4l2_pix_format {
        width,
        height,
        pixelformat: u32::from_le_bytes(fourcc),
        field: sys::v4l2_field_V4L2_FIELD_NONE,
        // An old stride would be asked for again, and granted.
        bytesperline: 0,
        sizeimage: 0,
        ..sys::v4l2_pix_format::zeroed()
    };
    let pix = ioctl::set_pix_format(&node.file, sys::v4l2_pix_format { priv_: EXTENDED, ..pix })
        .map_err(|error| node.setup_fault("refuses its format", &error))?;
    if pix.pixelformat != u32::from_le_bytes(fourcc) {
        return Err(node.refused(format!(
            "gives {} instead of {}; name another pixel format",
            name(pix.pixelformat.to_le_bytes()),
            name(fourcc)
        )));
    }
    if let Some([width, height]) = settings.size
        && [pix.width, pix.height] != [width, height]
    {
        let (got_width, got_height) = (pix.width, pix.height);
        return Err(node.refused(format!(
            "gives {got_width}x{got_height} instead of {width}x{height}; `relume devices` lists its sizes"
        )));
    }
    Ok(Agreed { fourcc, layout: layout(&pix, format), interval_s: ioctl::frame_interval_s(&node.file) })
}

/// Whether the node still has the format agreed on.
pub(super) fn still_stands(node: &Node, agreed: &Agreed) -> bool {
    ioctl::pix_format(&node.file).is_ok_and(|pix| {
        pix.pixelformat == u32::from_le_bytes(agreed.fourcc) && layout(&pix, agreed.layout.format) == agreed.layout
    })
}

fn offered(node: &Node) -> Vec<[u8; 4]> {
    let entry = |index: u32| {
        let mut description = sys::v4l2_fmtdesc::zeroed();
        (description.index, description.type_) = (index, ioctl::CAPTURE);
        ioctl::ioctl(&node.file, &ioctl::ENUM_FMT, &mut description).ok()?;
        Some(description.pixelformat.to_le_bytes())
    };
    (0..256).map_while(entry).collect()
}

/// Of the formats offered, those for the purpose: to measure light any, to be looked at those made for it.
fn usable(offered: Vec<[u8; 4]>, to_measure: bool) -> Result<Vec<[u8; 4]>, String> {
    let shown = |code: &&[u8; 4]| to_measure || from_fourcc(**code).is_some_and(is_shown);
    let usable: Vec<[u8; 4]> = offered.iter().filter(shown).copied().collect();
    if usable.is_empty() && !offered.is_empty() {
        let list = offered.iter().map(|&code| name(code)).collect::<Vec<_>>().join(" ");
        return Err(format!("has no format for a view (YUYV UYVY NV12 MJPG); it has {list}"));
    }
    Ok(usable)
}

/// The format asked for, else the best one offered.
fn choose(offered: &[[u8; 4]], asked: Option<[u8; 4]>) -> Result<([u8; 4], PixelFormat), String> {
    let list = || offered.iter().map(|&code| name(code)).collect::<Vec<_>>().join(" ");
    match asked {
        Some(code) if !offered.contains(&code) => Err(format!("has no format {}; it has {}", name(code), list())),
        Some(code) => {
            let format =
                from_fourcc(code).ok_or_else(|| format!("{} cannot be unpacked; it has {}", name(code), list()));
            Ok((code, format?))
        }
        None => best(offered).ok_or_else(|| format!("has no format that can be unpacked; it has {}", list())),
    }
}

/// Smallest and largest size of each entry.
fn sizes(node: &Node, fourcc: [u8; 4]) -> Vec<[[u32; 2]; 2]> {
    let entry = |index: u32| {
        let mut size = sys::v4l2_frmsizeenum::zeroed();
        (size.index, size.pixel_format) = (index, u32::from_le_bytes(fourcc));
        ioctl::ioctl(&node.file, &ioctl::ENUM_FRAMESIZES, &mut size).ok()?;
        Some(ioctl::frame_size(&size))
    };
    (0..256).map_while(entry).collect()
}

/// Least and most frames a second that the node offers with a format and size, where it tells.
pub(super) fn rates_hz(node: &Node, fourcc: [u8; 4], [width, height]: [u32; 2]) -> Option<[f64; 2]> {
    let entry = |index: u32| {
        let mut interval = sys::v4l2_frmivalenum::zeroed();
        (interval.index, interval.pixel_format) = (index, u32::from_le_bytes(fourcc));
        (interval.width, interval.height) = (width, height);
        ioctl::ioctl(&node.file, &ioctl::ENUM_FRAMEINTERVALS, &mut interval).ok()?;
        Some(ioctl::frame_intervals_s(&interval))
    };
    span_hz((0..256).map_while(entry))
}

/// Least and most frames a second of a list of intervals in seconds; drivers leave some of them 0 / 0.
fn span_hz(intervals_s: impl Iterator<Item = [f64; 2]>) -> Option<[f64; 2]> {
    let told = intervals_s.flatten().filter(|seconds| seconds.is_finite() && *seconds > 0.0).map(f64::recip);
    told.map(|hz| [hz; 2]).reduce(|span, [hz, _]| [span[0].min(hz), span[1].max(hz)])
}

/// The largest listed size that is not more than enough, else the smallest; ranges of sizes are nobody's choice.
fn enough(sizes: &[[[u32; 2]; 2]]) -> Option<[u32; 2]> {
    let pixels = |size: &[u32; 2]| u64::from(size[0]) * u64::from(size[1]);
    let listed: Vec<[u32; 2]> = sizes.iter().filter(|[least, most]| least == most).map(|&[size, _]| size).collect();
    let fitting = listed.iter().filter(|size| pixels(size) <= ENOUGH_PIXELS).max_by_key(|size| pixels(size));
    fitting.or_else(|| listed.iter().min_by_key(|size| pixels(size))).copied()
}

fn layout(pix: &sys::v4l2_pix_format, format: PixelFormat) -> Layout {
    let extended = pix.priv_ == EXTENDED;
    let (quantization, encoding) = if extended { (pix.quantization, ioctl::ycbcr_encoding(pix)) } else { (0, 0) };
    Layout {
        format,
        width: pix.width as usize,
        height: pix.height as usize,
        stride: pix.bytesperline as usize,
        coding: coding(pix.colorspace, quantization, encoding),
    }
}

/// What the driver's fields mean; 0 in them is the colour space's default (the kernel's `V4L2_MAP_..._DEFAULT`).
fn coding(colorspace: u32, quantization: u32, encoding: u32) -> YuvCoding {
    let range = match quantization {
        sys::v4l2_quantization_V4L2_QUANTIZATION_FULL_RANGE => Range::Full,
        sys::v4l2_quantization_V4L2_QUANTIZATION_LIM_RANGE => Range::Limited,
        _ if colorspace == sys::v4l2_colorspace_V4L2_COLORSPACE_JPEG => Range::Full,
        _ => Range::Limited,
    };
    let matrix = match encoding {
        sys::v4l2_ycbcr_encoding_V4L2_YCBCR_ENC_601 | sys::v4l2_ycbcr_encoding_V4L2_YCBCR_ENC_XV601 => Matrix::Bt601,
        sys::v4l2_ycbcr_encoding_V4L2_YCBCR_ENC_709 | sys::v4l2_ycbcr_encoding_V4L2_YCBCR_ENC_XV709 => Matrix::Bt709,
        sys::v4l2_ycbcr_encoding_V4L2_YCBCR_ENC_BT2020 | sys::v4l2_ycbcr_encoding_V4L2_YCBCR_ENC_BT2020_CONST_LUM => {
            Matrix::Bt2020
        }
        sys::v4l2_ycbcr_encoding_V4L2_YCBCR_ENC_SMPTE240M => Matrix::Smpte240m,
        _ => match colorspace {
            sys::v4l2_colorspace_V4L2_COLORSPACE_REC709 | sys::v4l2_colorspace_V4L2_COLORSPACE_DCI_P3 => Matrix::Bt709,
            sys::v4l2_colorspace_V4L2_COLORSPACE_BT2020 => Matrix::Bt2020,
            sys::v4l2_colorspace_V4L2_COLORSPACE_SMPTE240M => Matrix::Smpte240m,
            _ => Matrix::Bt601,
        },
    };
    YuvCoding { range, matrix }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn zeros_mean_the_colour_spaces_default() {
        // From linux/videodev2.h: SRGB 8, JPEG 7, REC709 3, SMPTE240M 2, BT2020 10; full 1, limited 2; 601 1, 709 2.
        let coded = |range, matrix| YuvCoding { range, matrix };
        assert_eq!(coding(8, 0, 0), coded(Range::Limited, Matrix::Bt601));
        assert_eq!(coding(7, 0, 0), coded(Range::Full, Matrix::Bt601));
        assert_eq!(coding(3, 0, 0), coded(Range::Limited, Matrix::Bt709));
        assert_eq!(coding(2, 1, 0), coded(Range::Full, Matrix::Smpte240m));
        assert_eq!(coding(10, 2, 0), coded(Range::Limited, Matrix::Bt2020));
        assert_eq!(coding(8, 1, 2), coded(Range::Full, Matrix::Bt709));
        assert_eq!(coding(3, 2, 1), coded(Range::Limited, Matrix::Bt601));
    }

    #[test]
    fn rates_span_all_intervals_that_say_something() {
        assert_eq!(span_hz([[0.04; 2], [0.2; 2], [0.125; 2]].into_iter()), Some([5.0, 25.0]));
        assert_eq!(span_hz([[0.02, 1.0]].into_iter()), Some([1.0, 50.0]), "a range");
        assert_eq!(span_hz([[f64::NAN, 0.04], [0.0; 2]].into_iter()), Some([25.0, 25.0]));
        assert_eq!(span_hz(std::iter::empty()), None);
        assert_eq!(crate::camera::v4l2::asked::words([5.0, 25.0]), "5..25");
        assert_eq!(crate::camera::v4l2::asked::words([30.0, 30.0]), "30");
    }

    #[test]
    fn a_view_takes_no_raw_formats() {
        let offered = vec![*b"RG10", *b"GREY", *b"MJPG", *b"YUYV"];
        assert_eq!(usable(offered.clone(), true).unwrap(), offered);
        let usable_in_view = usable(offered, false).unwrap();
        assert_eq!(usable_in_view, [*b"MJPG", *b"YUYV"]);
        assert_eq!(choose(&usable_in_view, None).unwrap().0, *b"YUYV");
        assert!(usable(vec![*b"RG10"], false).unwrap_err().contains("for a view"));
    }

    #[test]
    fn the_format_is_the_one_asked_for_or_the_best() {
        let offered = [*b"MJPG", *b"YUYV", *b"H264"];
        assert_eq!(choose(&offered, None).unwrap().0, *b"YUYV");
        assert_eq!(choose(&offered, Some(*b"MJPG")).unwrap(), (*b"MJPG", PixelFormat::Jpeg));
        assert_eq!(choose(&offered, Some(*b"NV12")).unwrap_err(), "has no format NV12; it has MJPG YUYV H264");
        assert_eq!(choose(&offered, Some(*b"H264")).unwrap_err(), "H264 cannot be unpacked; it has MJPG YUYV H264");
        assert!(choose(&[*b"H264"], None).is_err());
    }

    #[test]
    fn the_largest_size_that_is_not_too_much_is_taken() {
        let listed = |sizes: &[[u32; 2]]| sizes.iter().map(|&size| [size, size]).collect::<Vec<_>>();
        let webcam = listed(&[[640, 480], [1920, 1080], [1280, 720], [3840, 2160]]);
        assert_eq!(enough(&webcam), Some([1920, 1080]));
        assert_eq!(enough(&listed(&[[4056, 3040], [3840, 2160]])), Some([3840, 2160]));
        assert_eq!(enough(&[[[16, 16], [1920, 1080]]]), None);
        assert_eq!(enough(&[]), None);
    }
}
