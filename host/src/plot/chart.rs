//! Charts: series over two axes, with a legend.

use embedded_graphics::pixelcolor::Rgb888;
use embedded_graphics::prelude::{Drawable, Point, Primitive, RgbColor, Size};
use embedded_graphics::primitives::{Circle, Line, PrimitiveStyle, Rectangle};
use embedded_graphics::text::Alignment;

use super::axis::{Axis, Span};
use super::canvas::{Canvas, LARGE, MEDIUM, OVERSAMPLE, SMALL, text_width};

const INK: Rgb888 = Rgb888::new(0x20, 0x20, 0x20);
const GRID: Rgb888 = Rgb888::new(0xe2, 0xe2, 0xe2);
/// Okabe and Ito's colours, which also colour-blind readers tell apart.
const COLORS: [Rgb888; 7] = [
    Rgb888::new(0x00, 0x72, 0xb2),
    Rgb888::new(0xd5, 0x5e, 0x00),
    Rgb888::new(0x00, 0x9e, 0x73),
    Rgb888::new(0xcc, 0x79, 0xa7),
    Rgb888::new(0xe6, 0x9f, 0x00),
    Rgb888::new(0x56, 0xb4, 0xe9),
    Rgb888::new(0x40, 0x40, 0x40),
];
const TOP: i32 = 34;
const RIGHT: i32 = 18;
const BOTTOM: i32 = 46;

/// How a series is drawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Style {
    /// Points joined in the order given.
    Line,
    /// Points alone.
    Scatter,
    /// Points, joined.
    LineAndMarkers,
    /// Joined, and filled down to the lower end of the axis.
    Area,
}

/// Named points of a chart.
#[derive(Clone, Debug)]
pub struct Series {
    name: String,
    points: Vec<(f64, f64)>,
    style: Style,
    color: Option<Rgb888>,
}

impl Series {
    /// Points `(x, y)` joined in the order given. A point that its axis cannot show breaks the line.
    pub fn line(name: impl Into<String>, points: Vec<(f64, f64)>) -> Self {
        Series { name: name.into(), points, style: Style::Line, color: None }
    }

    /// Points `(x, y)` alone.
    pub fn scatter(name: impl Into<String>, points: Vec<(f64, f64)>) -> Self {
        Series { style: Style::Scatter, ..Series::line(name, points) }
    }

    /// Joined points `(x, y)`, filled down to the lower end of the axis.
    pub fn area(name: impl Into<String>, points: Vec<(f64, f64)>) -> Self {
        Series { style: Style::Area, ..Series::line(name, points) }
    }

    /// The same line with a marker on every point.
    pub fn with_markers(mut self) -> Self {
        self.style = Style::LineAndMarkers;
        self
    }

    /// A colour of one's own instead of the next of the palette.
    pub fn with_color(mut self, red: u8, green: u8, blue: u8) -> Self {
        self.color = Some(Rgb888::new(red, green, blue));
        self
    }
}

/// A chart: title, two axes, series.
#[derive(Clone, Debug)]
pub struct Chart {
    title: String,
    x: Axis,
    y: Axis,
    series: Vec<Series>,
}

/// Where the plotted area lies on the canvas, pixels.
#[derive(Clone, Copy)]
struct Frame {
    left: i32,
    top: i32,
    width: i32,
    height: i32,
}

impl Chart {
    /// A chart without series.
    pub fn new(title: impl Into<String>, x: Axis, y: Axis) -> Self {
        Chart { title: title.into(), x, y, series: Vec::new() }
    }

    /// Adds a series; later ones are drawn over earlier ones.
    pub fn with(mut self, series: Series) -> Self {
        self.series.push(series);
        self
    }

    /// Draws the chart, `width x height` pixels (at least 160x120), on white.
    pub fn draw(&self, width: u32, height: u32) -> Canvas {
        let (width, height) = (width.clamp(160, 8192), height.clamp(120, 8192));
        let points = || self.series.iter().flat_map(|series| &series.points);
        let x = self.x.span(points().map(|point| point.0), (width / 90) as usize);
        let y = self.y.span(points().map(|point| point.1), (height / 60) as usize);
        let widest = y.ticks.iter().map(|tick| text_width(&tick.1, SMALL)).max().unwrap_or(0);
        let left = widest + 36;
        let frame = Frame { left, top: TOP, width: width as i32 - left - RIGHT, height: height as i32 - TOP - BOTTOM };
        let mut large = Canvas::new(width * OVERSAMPLE, height * OVERSAMPLE, Rgb888::WHITE);
        draw_grid(&mut large, frame, &x, &y);
        for (index, series) in self.series.iter().enumerate() {
            self.draw_series(&mut large, frame, &x, &y, series, self.color(index));
        }
        let mut canvas = large.reduced(OVERSAMPLE);
        self.draw_text(&mut canvas, frame, &x, &y);
        self.draw_legend(&mut canvas, frame, &x, &y);
        canvas
    }

    fn color(&self, index: usize) -> Rgb888 {
        self.series[index].color.unwrap_or(COLORS[index % COLORS.len()])
    }

    fn draw_series(&self, large: &mut Canvas, frame: Frame, x: &Span, y: &Span, series: &Series, color: Rgb888) {
        let place = |point: &(f64, f64)| {
            (self.x.shows(point.0) && self.y.shows(point.1)).then(|| frame.at(x.place(point.0), y.place(point.1)))
        };
        let places: Vec<Option<Point>> = series.points.iter().map(place).collect();
        let stroke = PrimitiveStyle::with_stroke(color, 2 * OVERSAMPLE);
        if series.style != Style::Scatter {
            for pair in places.windows(2) {
                if let [Some(from), Some(to)] = pair {
                    if series.style == Style::Area {
                        fill_below(large, frame, *from, *to, pale(color));
                    }
                    let Ok(()) = Line::new(*from, *to).into_styled(stroke).draw(large);
                }
            }
        }
        if matches!(series.style, Style::Scatter | Style::LineAndMarkers) {
            for at in places.into_iter().flatten() {
                let dot = Circle::with_center(at, 7 * OVERSAMPLE).into_styled(PrimitiveStyle::with_fill(color));
                let Ok(()) = dot.draw(large);
            }
        }
    }

    fn draw_text(&self, canvas: &mut Canvas, frame: Frame, x: &Span, y: &Span) {
        let (width, bottom) = (canvas.width() as i32, frame.top + frame.height);
        canvas.text(&self.title, (width / 2, TOP / 2), LARGE, INK, Alignment::Center);
        let middle = frame.left + frame.width / 2;
        canvas.text(&self.x.label, (middle, bottom + 33), MEDIUM, INK, Alignment::Center);
        for (value, text) in &x.ticks {
            let at = frame.left + (x.place(*value) * f64::from(frame.width)).round() as i32;
            canvas.text(text, (at, bottom + 11), SMALL, INK, Alignment::Center);
        }
        for (value, text) in &y.ticks {
            let at = bottom - (y.place(*value) * f64::from(frame.height)).round() as i32;
            canvas.text(text, (frame.left - 6, at), SMALL, INK, Alignment::Right);
        }
        let length = text_width(&self.y.label, MEDIUM).max(1);
        let mut label = Canvas::new(length as u32, 14, Rgb888::WHITE);
        label.text(&self.y.label, (0, 7), MEDIUM, INK, Alignment::Left);
        canvas.paste(&label.turned(), 6, (frame.top + (frame.height - length) / 2).max(0) as u32);
    }

    /// The legend goes into the corner with the fewest points.
    fn draw_legend(&self, canvas: &mut Canvas, frame: Frame, x: &Span, y: &Span) {
        let named: Vec<usize> = (0..self.series.len()).filter(|&index| !self.series[index].name.is_empty()).collect();
        let Some(longest) = named.iter().map(|&index| text_width(&self.series[index].name, SMALL)).max() else {
            return;
        };
        let size = Size::new(longest as u32 + 38, named.len() as u32 * 15 + 8);
        let corner = |right: bool, low: bool| {
            let left = if right { frame.left + frame.width - size.width as i32 - 8 } else { frame.left + 8 };
            let top = if low { frame.top + frame.height - size.height as i32 - 8 } else { frame.top + 8 };
            Rectangle::new(Point::new(left, top), size)
        };
        let corners = [corner(true, false), corner(false, false), corner(true, true), corner(false, true)];
        let crowd = |area: &Rectangle| {
            let points = self.series.iter().flat_map(|series| &series.points);
            let places = points.map(|point| frame.at(x.place(point.0), y.place(point.1)) / OVERSAMPLE as i32);
            places.filter(|&at| area.offset(6).contains(at)).count()
        };
        let Some(area) = corners.into_iter().min_by_key(crowd) else { return };
        let Ok(()) = area.into_styled(PrimitiveStyle::with_fill(Rgb888::WHITE)).draw(canvas);
        let Ok(()) = area.into_styled(PrimitiveStyle::with_stroke(GRID, 1)).draw(canvas);
        for (row, &index) in named.iter().enumerate() {
            let at = area.top_left + Point::new(8, row as i32 * 15 + 11);
            let swatch = Rectangle::new(at - Point::new(0, 1), Size::new(18, 3));
            let Ok(()) = swatch.into_styled(PrimitiveStyle::with_fill(self.color(index))).draw(canvas);
            canvas.text(&self.series[index].name, (at.x + 24, at.y), SMALL, INK, Alignment::Left);
        }
    }
}

impl Frame {
    /// Place on the large canvas of a point given as shares of the axes; held inside, so that lines end at the edge.
    fn at(&self, x: f64, y: f64) -> Point {
        let scale = f64::from(OVERSAMPLE);
        let across = f64::from(self.left) + x.clamp(0.0, 1.0) * f64::from(self.width);
        let down = f64::from(self.top + self.height) - y.clamp(0.0, 1.0) * f64::from(self.height);
        Point::new((across * scale).round() as i32, (down * scale).round() as i32)
    }
}

fn pale(color: Rgb888) -> Rgb888 {
    let mix = |code: u8| ((u16::from(code) + 3 * 255) / 4) as u8;
    Rgb888::new(mix(color.r()), mix(color.g()), mix(color.b()))
}

fn fill_below(large: &mut Canvas, frame: Frame, from: Point, to: Point, color: Rgb888) {
    let floor = (frame.top + frame.height) * OVERSAMPLE as i32;
    let (from, to) = if from.x <= to.x { (from, to) } else { (to, from) };
    for x in from.x..=to.x {
        let share = f64::from(x - from.x) / f64::from((to.x - from.x).max(1));
        let y = f64::from(from.y) + share * f64::from(to.y - from.y);
        let column = Rectangle::new(Point::new(x, y as i32), Size::new(1, (floor - y as i32).max(0) as u32));
        let Ok(()) = column.into_styled(PrimitiveStyle::with_fill(color)).draw(large);
    }
}

fn draw_grid(large: &mut Canvas, frame: Frame, x: &Span, y: &Span) {
    let thin = PrimitiveStyle::with_stroke(GRID, OVERSAMPLE);
    for (value, _) in &x.ticks {
        let at = x.place(*value);
        let Ok(()) = Line::new(frame.at(at, 0.0), frame.at(at, 1.0)).into_styled(thin).draw(large);
    }
    for (value, _) in &y.ticks {
        let at = y.place(*value);
        let Ok(()) = Line::new(frame.at(0.0, at), frame.at(1.0, at)).into_styled(thin).draw(large);
    }
    let axis = PrimitiveStyle::with_stroke(INK, OVERSAMPLE);
    for end in [(1.0, 0.0), (0.0, 1.0)] {
        let Ok(()) = Line::new(frame.at(0.0, 0.0), frame.at(end.0, end.1)).into_styled(axis).draw(large);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn count(canvas: &Canvas, color: Rgb888) -> usize {
        canvas.pixels().iter().filter(|pixel| **pixel == [color.r(), color.g(), color.b()]).count()
    }

    #[test]
    fn a_line_is_where_its_points_are() {
        let x = Axis::linear("x").with_range(0.0, 1.0);
        let y = Axis::log("y").with_range(0.01, 1.0);
        let chart = Chart::new("t", x, y).with(Series::line("", vec![(0.0, 0.1), (1.0, 0.1)]));
        let canvas = chart.draw(400, 300);
        let middle = TOP + (300 - TOP - BOTTOM) / 2;
        let pixels = canvas.pixels();
        let row = |y: i32| {
            (0..400).filter(move |x| {
                let pixel = pixels[(y * 400 + x) as usize];
                pixel[2] > pixel[0].saturating_add(60)
            })
        };
        assert!(row(middle).count() > 300, "half way up a logarithmic axis of two decades");
        assert_eq!(row(middle - 10).count() + row(middle + 10).count(), 0);
    }

    #[test]
    fn what_cannot_be_shown_is_left_out_and_nothing_panics() {
        let bad = vec![(f64::NAN, 1.0), (1.0, 0.0), (1.0, -3.0), (f64::INFINITY, 2.0), (1e300, 1e-300)];
        for style in [Series::line("a", bad.clone()), Series::scatter("b", bad.clone()), Series::area("c", bad)] {
            let chart = Chart::new("t", Axis::log("x"), Axis::log("y")).with(style);
            assert!(count(&chart.draw(0, 0), Rgb888::WHITE) > 1000);
        }
    }

    #[test]
    fn markers_and_areas_are_drawn() {
        let line = || Series::line("", vec![(0.0, 1.0), (1.0, 1.0)]).with_color(200, 0, 0);
        let draw = |series| {
            Chart::new("", Axis::linear(""), Axis::linear("").with_range(0.0, 2.0)).with(series).draw(300, 200)
        };
        let red = |canvas: &Canvas| count(canvas, Rgb888::new(200, 0, 0));
        assert!(red(&draw(line().with_markers())) > red(&draw(line())));
        let area = Series { style: Style::Area, ..line() };
        assert!(count(&draw(area), pale(Rgb888::new(200, 0, 0))) > 200 * 40);
    }
}
