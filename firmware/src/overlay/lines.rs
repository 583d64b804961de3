//! Text in lines: broken at spaces, and what does not fit ends with dots.

use super::spelling::{spelled, width};

const DOTS: &str = "...";

/// One line, a part of the text it came from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Line<'t> {
    text: &'t str,
    dots: &'static str,
}

impl Line<'_> {
    /// The glyphs to draw, from left to right.
    pub(super) fn glyphs(&self) -> impl Iterator<Item = char> {
        self.text.chars().chain(self.dots.chars()).flat_map(spelled)
    }

    /// How many glyphs there are.
    pub(super) fn columns(&self) -> usize {
        columns_of(self.text) + self.dots.len()
    }

    /// Was text left off?
    pub(super) fn is_cut(&self) -> bool {
        !self.dots.is_empty()
    }
}

/// A text in at most `most` lines of at most `columns` glyphs. Newlines break too.
#[derive(Clone, Copy, Debug)]
pub(super) struct Lines<'t> {
    rest: &'t str,
    columns: usize,
    most: usize,
}

impl<'t> Lines<'t> {
    pub(super) fn new(text: &'t str, columns: usize, most: usize) -> Self {
        Lines { rest: text.trim(), columns, most }
    }

    /// The same in the narrowest columns that take no more lines, so that none is left nearly empty.
    pub(super) fn balanced(text: &'t str, columns: usize, most: usize) -> Self {
        let wide = Lines::new(text, columns, most);
        let lines = wide.count();
        if lines < 2 || wide.last().is_some_and(|line| line.is_cut()) {
            return wide;
        }
        let fits = |columns: &usize| {
            let narrow = Lines::new(text, *columns, most);
            narrow.count() == lines && narrow.last().is_some_and(|line| !line.is_cut())
        };
        let columns = (columns_of(wide.rest) / lines..columns).find(fits).unwrap_or(columns);
        Lines { columns, ..wide }
    }
}

impl<'t> Iterator for Lines<'t> {
    type Item = Line<'t>;

    fn next(&mut self) -> Option<Line<'t>> {
        if self.rest.is_empty() || self.columns == 0 || self.most == 0 {
            return None;
        }
        self.most -= 1;
        let (end, next) = break_at(self.rest, self.columns);
        let (line, rest) = (self.rest[..end].trim_end(), self.rest[next..].trim_start());
        if rest.is_empty() || self.most > 0 {
            self.rest = rest;
            return Some(Line { text: line, dots: "" });
        }
        let whole = self.rest;
        self.rest = "";
        let dots = &DOTS[..DOTS.len().min(self.columns)];
        let kept = whole.find('\n').map_or(whole, |at| &whole[..at]);
        Some(Line { text: kept[..fitting(kept, self.columns - dots.len())].trim_end(), dots })
    }
}

pub(super) fn columns_of(text: &str) -> usize {
    text.chars().map(width).sum()
}

/// The length in bytes of the longest beginning that fits.
fn fitting(text: &str, columns: usize) -> usize {
    let mut left = columns;
    for (at, c) in text.char_indices() {
        match left.checked_sub(width(c)) {
            Some(rest) => left = rest,
            None => return at,
        }
    }
    text.len()
}

/// Where a line ends and where the next begins, in bytes. A word that is longer than a line is broken; some progress is
/// always made.
fn break_at(text: &str, columns: usize) -> (usize, usize) {
    let fits = fitting(text, columns);
    if let Some(newline) = text[..fits].find('\n') {
        return (newline, newline + 1);
    }
    let after = text[fits..].chars().next();
    if after.is_none_or(|c| c == ' ' || c == '\n') {
        return (fits, fits);
    }
    match text[..fits].rfind(' ') {
        Some(space) => (space, space + 1),
        None if fits == 0 => (0, after.map_or(0, char::len_utf8)),
        None => (fits, fits),
    }
}

#[cfg(test)]
mod tests {
    extern crate std;
    use super::*;
    use std::string::String;
    use std::vec::Vec;

    fn lines(text: &str, columns: usize, most: usize) -> Vec<String> {
        let lines: Vec<_> = Lines::new(text, columns, most).collect();
        assert!(lines.iter().all(|line| line.columns() <= columns && line.glyphs().count() == line.columns()));
        lines.iter().map(|line| line.glyphs().collect()).collect()
    }

    #[test]
    fn lines_break_at_spaces_and_the_rest_is_dots() {
        assert_eq!(lines("as it stood in the year", 11, 3), ["as it stood", "in the year"]);
        assert_eq!(lines("as it stood in the year", 10, 2), ["as it", "stood i..."]);
        assert_eq!(lines("  ναός  τῆς Ἀθηνᾶς ", 8, 2), ["ναός", "τής Α..."]);
        assert_eq!(lines("one\ntwo three", 20, 2), ["one", "two three"]);
        assert_eq!(lines("one\ntwo three", 20, 1), ["one..."]);
        assert_eq!(lines("exactly", 7, 1), ["exactly"]);
        assert_eq!(lines("unbreakable", 4, 3), ["unbr", "eaka", "ble"]);
        assert_eq!(lines("a b", 2, 1), [".."]);
        assert_eq!(lines("a…b", 2, 2), ["a", ".."]);
        assert!(lines("a", 0, 1).is_empty() && lines("a", 1, 0).is_empty() && lines(" \n ", 5, 2).is_empty());
    }

    #[test]
    fn balanced_lines_are_near_each_other_and_still_as_few() {
        let text = "The temple of the deified emperor as it stood in the year 120, seen from the north";
        let columns: Vec<usize> = Lines::balanced(text, 70, 2).map(|line| line.columns()).collect();
        assert_eq!(columns.len(), 2);
        assert!(columns[0].abs_diff(columns[1]) < 10, "{columns:?}");
        assert_eq!(Lines::balanced("short", 70, 2).count(), 1);
        assert!(Lines::balanced(text, 30, 2).last().unwrap().is_cut());
    }
}
