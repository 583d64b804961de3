//! A frame as linear light: the mean of its three channels per pixel, in full-well fractions.

use crate::camera::{Codes, Frame};
use crate::response::Response;

/// Linearises frames of one camera; keeps its table from frame to frame.
#[derive(Debug)]
pub struct LinearGrey {
    response: Response,
    /// The format's largest code, and a third of the linear fraction per code and channel.
    table: (u16, Vec<[f32; 3]>),
}

impl LinearGrey {
    /// For frames of a camera with this response.
    pub fn new(response: Response) -> Self {
        LinearGrey { response, table: (0, Vec::new()) }
    }

    /// The frame's light per pixel, into a buffer that is reused.
    pub fn take(&mut self, frame: &Frame, light: &mut Vec<f32>) {
        let max = frame.codes.max();
        if self.table.0 != max {
            let share = |code: u16| f64::from(code) / f64::from(max);
            let thirds = |code| [0, 1, 2].map(|channel| self.response.fraction(share(code), channel) as f32 / 3.0);
            self.table = (max, (0..=max).map(thirds).collect());
        }
        let table = &self.table.1;
        let mean = |[r, g, b]: [usize; 3]| table[r][0] + table[g][1] + table[b][2];
        light.clear();
        match &frame.codes {
            Codes::U8(codes) => light.extend(codes.chunks_exact(3).map(|c| mean([c[0], c[1], c[2]].map(usize::from)))),
            Codes::U16(codes) => light.extend(codes.chunks_exact(3).map(|c| mean([c[0], c[1], c[2]].map(usize::from)))),
        }
    }
}
