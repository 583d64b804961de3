//! What a character is spelled with where no font has it: kin that reads the same, nothing, or `?`.

use super::letters::has_glyph;

/// Greek Extended (U+1F00 to U+1FFF) in today's one-accent spelling: breathings and the iota below fall away, every
/// accent becomes the acute.
const POLYTONIC: [&str; 16] = [
    "ααάάάάάάΑΑΆΆΆΆΆΆ",
    "εεέέέέ??ΕΕΈΈΈΈ??",
    "ηηήήήήήήΗΗΉΉΉΉΉΉ",
    "ιιίίίίίίΙΙΊΊΊΊΊΊ",
    "οοόόόό??ΟΟΌΌΌΌ??",
    "υυύύύύύύ?Υ?Ύ?Ύ?Ύ",
    "ωωώώώώώώΩΩΏΏΏΏΏΏ",
    "άάέέήήίίόόύύώώ??",
    "ααάάάάάάΑΑΆΆΆΆΆΆ",
    "ηηήήήήήήΗΗΉΉΉΉΉΉ",
    "ωωώώώώώώΩΩΏΏΏΏΏΏ",
    "ααάαά?άάΑΑΆΆΑ’ι’",
    "??ήηή?ήήΈΈΉΉΗ???",
    "ιιΐΐ??ίΐΙΙΊΊ????",
    "υυΰΰρρύΰΥΥΎΎΡ??`",
    "??ώωώ?ώώΌΌΏΏΩ´‘?",
];

/// Typographers' marks and single letters beside the encodings.
const KIN: &[(char, char)] = &[
    ('‐', '-'),
    ('‑', '-'),
    ('‒', '-'),
    ('–', '-'),
    ('—', '―'),
    ('−', '-'),
    ('‚', ','),
    ('‛', '‘'),
    ('‟', '“'),
    ('′', '\''),
    ('″', '"'),
    ('‹', '<'),
    ('›', '>'),
    ('•', '·'),
    ('⋅', '·'),
    ('†', '+'),
    ('⁄', '/'),
    ('ẞ', 'ß'),
    ('Ґ', 'Г'),
    ('ґ', 'г'),
];

/// The glyphs that stand for a character: mostly itself, three dots for an ellipsis, none for marks that combine or do
/// not show (soft hyphens, joiners). What no font has is `?`.
pub(super) fn spelled(c: char) -> impl Iterator<Item = char> {
    let glyph = match c {
        '…' => '.',
        _ if width(c) == 0 => ' ',
        _ => glyph_for(c).unwrap_or('?'),
    };
    core::iter::repeat_n(glyph, width(c))
}

/// How many glyphs stand for a character.
pub(super) fn width(c: char) -> usize {
    match c {
        '…' => 3,
        '\u{ad}' | '\u{300}'..='\u{36f}' | '\u{200b}'..='\u{200f}' | '\u{fe00}'..='\u{fe0f}' | '\u{feff}' => 0,
        _ => 1,
    }
}

/// Can the character be read, as itself or as its kin?
pub(super) fn is_readable(c: char) -> bool {
    width(c) != 1 || glyph_for(c).is_some()
}

fn glyph_for(c: char) -> Option<char> {
    let kin = match c {
        _ if has_glyph(c) => Some(c),
        // Spaces of all widths.
        '\t' | '\u{2000}'..='\u{200a}' | '\u{202f}' | '\u{205f}' => Some(' '),
        '\u{1f00}'..='\u{1fff}' => {
            let place = c as usize - 0x1f00;
            POLYTONIC[place / 16].chars().nth(place % 16).filter(|&base| base != '?')
        }
        _ => KIN.iter().find(|(from, _)| *from == c).map(|&(_, to)| to),
    };
    kin.filter(|&c| has_glyph(c))
}

#[cfg(test)]
mod tests {
    extern crate std;
    use super::*;
    use std::string::String;

    fn respelled(text: &str) -> String {
        text.chars().flat_map(spelled).collect()
    }

    #[test]
    fn what_the_fonts_have_is_left_alone() {
        for text in
            ["Tempel, 12 €", "Świątynia Łódź Žďár Győr", "Ναός της Αθηνάς", "Храм їжак Ђорђе №", "Diyarbakır İğ Ș ț"]
        {
            assert_eq!(respelled(text), text);
        }
    }

    #[test]
    fn polytonic_greek_is_spelled_with_one_accent() {
        // Today's own spelling of these words.
        for (old, new) in
            [("Ἀθῆναι", "Αθήναι"), ("ᾠδή", "ωδή"), ("Ὅμηρος", "Όμηρος"), ("Ῥόδος", "Ρόδος"), ("πρᾷος", "πράος")]
        {
            assert_eq!(respelled(old), new);
        }
    }

    #[test]
    fn marks_become_their_kin_and_strangers_a_question_mark() {
        assert_eq!(respelled("a–b…"), "a-b...");
        assert_eq!(respelled("e\u{301}a\u{ad}b\u{202f}m"), "eab m");
        assert_eq!(respelled("神殿 מקדש \u{7f}\u{3a2}"), "?? ???? ??");
        assert!(is_readable('ᾠ') && is_readable('…') && is_readable('\u{301}') && !is_readable('神'));
    }
}
