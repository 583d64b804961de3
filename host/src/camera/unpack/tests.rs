use super::*;
use crate::camera::Codes;

fn layout(format: PixelFormat, width: usize, height: usize, stride: usize) -> Layout {
    Layout { format, width, height, stride, coding: YuvCoding::default() }
}

fn unpacked(layout: Layout, bytes: &[u8]) -> Frame {
    let mut frame = Frame::default();
    Unpacker::new(layout).unwrap().unpack(bytes, &mut frame).unwrap();
    assert_eq!((frame.width, frame.height), layout.output_size());
    assert_eq!(frame.codes.len(), frame.width * frame.height * 3);
    frame
}

fn codes_u8(layout: Layout, bytes: &[u8]) -> Vec<u8> {
    match unpacked(layout, bytes).codes {
        Codes::U8(codes) => codes,
        Codes::U16(_) => panic!("16-bit codes"),
    }
}

fn codes_u16(layout: Layout, bytes: &[u8]) -> Vec<u16> {
    match unpacked(layout, bytes).codes {
        Codes::U16(codes) => codes,
        Codes::U8(_) => panic!("8-bit codes"),
    }
}

/// Limited BT.601: red is Y 81, U 90, V 240 -> 254.44, -0.48, -0.97; white Y 235; black Y 16; Y 126 is 128.08.
#[test]
fn yuyv_with_padded_rows_and_an_odd_width() {
    let bytes =
        [[81, 90, 81, 240, 235, 128, 0, 128, 9, 9, 9].as_slice(), &[16, 128, 126, 128, 126, 128, 0, 128, 9, 9, 9]]
            .concat();
    let expected = [[254, 0, 0, 254, 0, 0, 255, 255, 255], [0, 0, 0, 128, 128, 128, 128, 128, 128]].concat();
    assert_eq!(codes_u8(layout(PixelFormat::Yuyv, 3, 2, 11), &bytes), expected);
    // The last row's padding may be missing.
    assert_eq!(codes_u8(layout(PixelFormat::Yuyv, 3, 2, 11), &bytes[..19]), expected);
}

#[test]
fn uyvy_has_the_same_values_elsewhere() {
    let bytes = [90, 81, 240, 81, 128, 235, 128, 16];
    let expected = [254, 0, 0, 254, 0, 0, 255, 255, 255, 0, 0, 0];
    assert_eq!(codes_u8(layout(PixelFormat::Uyvy, 4, 1, 8), &bytes), expected);
}

/// Full BT.601: 76, 85, 255 is 254.05, 0.10, -0.20. Limited BT.709: green is 173, 42, 26 -> -0.05, 255.50, 1.14.
#[test]
fn the_drivers_range_and_matrix_count() {
    let coded = |range, matrix, bytes: [u8; 4]| {
        let coding = YuvCoding { range, matrix };
        codes_u8(Layout { coding, ..layout(PixelFormat::Yuyv, 2, 1, 4) }, &bytes)[..3].to_vec()
    };
    assert_eq!(coded(Range::Full, Matrix::Bt601, [76, 85, 76, 255]), [254, 0, 0]);
    assert_eq!(coded(Range::Full, Matrix::Bt601, [235, 128, 16, 128]), [235, 235, 235]);
    assert_eq!(coded(Range::Limited, Matrix::Bt709, [173, 42, 173, 26]), [0, 255, 1]);
    assert_eq!(coded(Range::Limited, Matrix::Bt601, [173, 42, 173, 26])[0], 20);
}

/// R = Y + 2 (1 - Kr) V, B = Y + 2 (1 - Kb) U, Y = Kr R + Kg G + Kb B, Y over 219 and U, V over 224 when limited.
#[test]
fn every_yuv_value_is_the_formulas() {
    let shares = [
        (Matrix::Bt601, 0.299, 0.114),
        (Matrix::Bt709, 0.2126, 0.0722),
        (Matrix::Bt2020, 0.2627, 0.0593),
        (Matrix::Smpte240m, 0.212, 0.087),
    ];
    for (matrix, kr, kb) in shares {
        for range in [Range::Limited, Range::Full] {
            let (black, luma, chroma) = if range == Range::Full { (0.0, 255.0, 255.0) } else { (16.0, 219.0, 224.0) };
            let factors = yuv::ToRgb::new(YuvCoding { range, matrix });
            for (y, u, v) in (0..4096).map(|i| ((i * 97 % 256) as u8, (i * 41 % 256) as u8, (i * 29 / 5 % 256) as u8)) {
                let (luminance, blue) = ((f64::from(y) - black) / luma, (f64::from(u) - 128.0) / chroma);
                let red = luminance + 2.0 * (1.0 - kr) * (f64::from(v) - 128.0) / chroma;
                let blue = luminance + 2.0 * (1.0 - kb) * blue;
                let green = (luminance - kr * red - kb * blue) / (1.0 - kr - kb);
                let mut out = [0; 3];
                factors.pair([y, y], [u, v], &mut out);
                for (code, exact) in out.into_iter().zip([red, green, blue]) {
                    let exact = (255.0 * exact).clamp(0.0, 255.0);
                    assert!((f64::from(code) - exact).abs() < 0.51, "{matrix:?} {range:?} {y} {u} {v}: {code} {exact}");
                }
            }
        }
    }
}

#[test]
fn nv12_shares_chroma_between_rows() {
    // 3x3 with stride 5: three rows of Y, two of U V.
    let bytes = [
        [81, 81, 235, 7, 7].as_slice(),
        &[81, 81, 16, 7, 7],
        &[126, 126, 126, 7, 7],
        &[90, 240, 128, 128, 7],
        &[128, 128, 128, 128],
    ]
    .concat();
    let expected = [
        [254, 0, 0, 254, 0, 0, 255, 255, 255].as_slice(),
        &[254, 0, 0, 254, 0, 0, 0, 0, 0],
        &[128, 128, 128, 128, 128, 128, 128, 128, 128],
    ]
    .concat();
    assert_eq!(codes_u8(layout(PixelFormat::Nv12, 3, 3, 5), &bytes), expected);
}

#[test]
fn grey_and_deep_grey() {
    let bytes = [1, 2, 99, 3, 4];
    let expected = [1, 1, 1, 2, 2, 2, 3, 3, 3, 4, 4, 4];
    assert_eq!(codes_u8(layout(PixelFormat::Grey(Sample::Bits8), 2, 2, 3), &bytes), expected);
    let bytes = [0x34, 0x12, 0xff, 0xff];
    let expected = [0x1234, 0x1234, 0x1234, 65535, 65535, 65535];
    assert_eq!(codes_u16(layout(PixelFormat::Grey(Sample::Low(16)), 2, 1, 4), &bytes), expected);
    // 10 bits in two bytes: 0x3ff is white; 0x201 = 10_0000_0001 -> 1000_0000_0110_0000.
    let bytes = [0xff, 0x03, 0x01, 0x02];
    let expected = [65535, 65535, 65535, 0x8060, 0x8060, 0x8060];
    assert_eq!(codes_u16(layout(PixelFormat::Grey(Sample::Low(10)), 2, 1, 4), &bytes), expected);
}

/// The high bits repeated below: v x 65535 / (2^n - 1) within one 16-bit step of the sample.
#[test]
fn packed_samples_are_taken_apart_as_mipi_says() {
    let grey = |sample, bytes: &[u8], width| -> Vec<u16> {
        let codes = codes_u16(layout(PixelFormat::Grey(sample), width, 1, bytes.len()), bytes);
        codes.chunks_exact(3).map(|pixel| pixel[0]).collect()
    };
    // Low pairs 0b_11_10_01_00: samples 0x00*4+0, 0x80*4+1, 0x40*4+2, 0xff*4+3.
    let samples = [0u32, 0x201, 0x102, 0x3ff];
    let got = grey(Sample::Packed10, &[0x00, 0x80, 0x40, 0xff, 0b1110_0100], 4);
    for (got, sample) in got.into_iter().zip(samples) {
        assert_eq!(u32::from(got >> 6), sample);
        assert!((f64::from(got) - f64::from(sample) * 65535.0 / 1023.0).abs() < 1.0, "{got} {sample}");
    }
    // Low halves 0xba: samples 0x12a, 0xfeb.
    let got = grey(Sample::Packed12, &[0x12, 0xfe, 0xba], 2);
    for (got, sample) in got.into_iter().zip([0x12au32, 0xfeb]) {
        assert_eq!(u32::from(got >> 4), sample);
        assert!((f64::from(got) - f64::from(sample) * 65535.0 / 4095.0).abs() < 1.0, "{got} {sample}");
    }
    // A width that ends inside a group.
    assert_eq!(grey(Sample::Packed10, &[0xff, 0x80, 0, 0, 0b0000_0111], 2), [65535, 0x8060]);
}

#[test]
fn mosaics_of_every_depth_come_out_halved() {
    // One cell, red 0x3ff, greens 0x200 and 0x100, blue 0, in three packings; clip is far above the greens.
    let cell = |format, stride, bytes: &[u8]| codes_u16(layout(format, 2, 2, stride), bytes);
    let (green, other) = (0x8020, 0x4010);
    let expected = [65535, (green + other) / 2, 0];
    let packed = [0xff, 0x80, 0, 0, 0b0011, 0x40, 0x00, 0, 0, 0];
    assert_eq!(cell(PixelFormat::Bayer(BayerOrder::Rggb, Sample::Packed10), 5, &packed), expected);
    let low = [0xff, 0x03, 0x00, 0x02, 0x00, 0x01, 0, 0];
    assert_eq!(cell(PixelFormat::Bayer(BayerOrder::Rggb, Sample::Low(10)), 4, &low), expected);
    let upside_down = [0, 0, 0x00, 0x02, 0x00, 0x01, 0xff, 0x03];
    assert_eq!(cell(PixelFormat::Bayer(BayerOrder::Bggr, Sample::Low(10)), 4, &upside_down), expected);
    // 8 bits, odd size, padded rows: the last column and row have no cell.
    let bytes = [[10, 20, 30, 40, 5, 0], [60, 50, 80, 70, 5, 0], [1, 2, 3, 4, 5, 0]].concat();
    let rggb = layout(PixelFormat::Bayer(BayerOrder::Rggb, Sample::Bits8), 5, 3, 6);
    assert_eq!(codes_u8(rggb, &bytes), [10, 40, 50, 30, 60, 70]);
}

fn jpeg(width: u32, height: u32, colour: image::ExtendedColorType, pixel: &[u8]) -> Vec<u8> {
    let mut bytes = Vec::new();
    let pixels = pixel.repeat((width * height) as usize);
    let mut encoder = image::codecs::jpeg::JpegEncoder::new_with_quality(&mut bytes, 95);
    encoder.encode(&pixels, width, height, colour).unwrap();
    bytes
}

#[test]
fn jpeg_pictures_in_colour_and_grey_with_padding_behind() {
    let mut bytes = jpeg(16, 8, image::ExtendedColorType::Rgb8, &[200, 100, 50]);
    bytes.extend([0; 64]);
    let whole = layout(PixelFormat::Jpeg, 16, 8, 0);
    for pixel in codes_u8(whole, &bytes).chunks_exact(3) {
        assert!(pixel.iter().zip([200, 100, 50]).all(|(&a, b)| i32::from(a).abs_diff(b) <= 3), "{pixel:?}");
    }
    let bytes = jpeg(16, 8, image::ExtendedColorType::L8, &[77]);
    assert_eq!(codes_u8(whole, &bytes), [77; 16 * 8 * 3]);
}

#[test]
fn what_is_no_picture_is_refused() {
    let mut frame = Frame::default();
    let mut yuyv = Unpacker::new(layout(PixelFormat::Yuyv, 4, 2, 8)).unwrap();
    assert_eq!(yuyv.unpack(&[0; 15], &mut frame), Err(UnpackError::TooShort { got: 15, needed: 16 }));
    let stride = Unpacker::new(layout(PixelFormat::Yuyv, 5, 2, 10)).unwrap_err();
    assert_eq!(stride, UnpackError::Stride { width: 5, stride: 10 });
    assert!(Unpacker::new(layout(PixelFormat::Bayer(BayerOrder::Rggb, Sample::Bits8), 1, 1, 4)).is_err());
    let mut jpegs = Unpacker::new(layout(PixelFormat::Jpeg, 16, 8, 0)).unwrap();
    let bytes = jpeg(8, 16, image::ExtendedColorType::Rgb8, &[1, 2, 3]);
    assert_eq!(jpegs.unpack(&bytes, &mut frame), Err(UnpackError::Size { got: (8, 16), agreed: (16, 8) }));
    let bytes = jpeg(16, 8, image::ExtendedColorType::Rgb8, &[1, 2, 3]);
    assert!(matches!(jpegs.unpack(&bytes[..bytes.len() - 2], &mut frame), Err(UnpackError::Jpeg(_))));
    assert!(matches!(jpegs.unpack(b"\xff\xd8 no picture \xff\xd9", &mut frame), Err(UnpackError::Jpeg(_))));
    assert!(matches!(jpegs.unpack(b"", &mut frame), Err(UnpackError::Jpeg(_))));
}

#[test]
fn four_character_codes_are_v4l2s_and_raw_ones_come_first() {
    assert_eq!(formats::from_fourcc(*b"pRAA"), Some(PixelFormat::Bayer(BayerOrder::Rggb, Sample::Packed10)));
    assert_eq!(formats::from_fourcc(*b"BA81"), Some(PixelFormat::Bayer(BayerOrder::Bggr, Sample::Bits8)));
    assert_eq!(formats::from_fourcc(*b"BA10"), Some(PixelFormat::Bayer(BayerOrder::Grbg, Sample::Low(10))));
    assert_eq!(formats::from_fourcc(*b"H264"), None);
    assert_eq!(formats::best(&[*b"H264", *b"MJPG", *b"GREY", *b"YUYV"]), Some((*b"YUYV", PixelFormat::Yuyv)));
    assert_eq!(formats::best(&[*b"YUYV", *b"RGGB", *b"pRAA"]).unwrap().0, *b"pRAA");
    assert_eq!(formats::best(&[*b"H264"]), None);
    assert_eq!(formats::name(*b"Y16 "), "Y16 ");
    assert_eq!([formats::from_name("Y16"), formats::from_name("pRAA")], [*b"Y16 ", *b"pRAA"]);
}
