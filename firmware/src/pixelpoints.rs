//! The 16 points at which a pixel looks at the scene: one set for every pixel, for the bake and for the live sun.
//!
//! Point `s` lies in cell (`s % 4`, `s / 4`) of the pixel's 4 x 4 cells; besides, every sixteenth of the pixel's width
//! and every sixteenth of its height holds one point, so that edges of any slope near to level or plumb step in
//! sixteenths. (A (0,2)-net in base 2, which is what Hammersley's first 16 points are.)

/// Number of points.
pub const PIXEL_POINTS: usize = 16;

/// Point `s` (0..16) in the pixel: right and down from its upper left corner, px.
pub const fn pixel_point(s: usize) -> [f32; 2] {
    // The two bits of a cell's place across, turned round, are its step down, and the other way about.
    const TURNED: [f32; 4] = [0.0, 2.0, 1.0, 3.0];
    let (column, row) = (s % 4, s / 4 % 4);
    let (right, down) = (TURNED[row], TURNED[column]);
    [0.25 * column as f32 + (right + 0.5) / 16.0, 0.25 * row as f32 + (down + 0.5) / 16.0]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_cell_column_and_row_holds_one_point() {
        let (mut cells, mut columns, mut rows) = (0u16, 0u16, 0u16);
        for s in 0..PIXEL_POINTS {
            let [x, y] = pixel_point(s);
            assert_eq!((4.0 * x) as usize + 4 * (4.0 * y) as usize, s);
            cells |= 1 << s;
            columns |= 1 << (16.0 * x) as usize;
            rows |= 1 << (16.0 * y) as usize;
        }
        assert_eq!((cells, columns, rows), (u16::MAX, u16::MAX, u16::MAX));
    }
}
