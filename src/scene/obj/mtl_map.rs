//! A `map_…` statement: options, then the name of a picture, which may have blanks.

use glam::{Affine2, Vec2};

/// The picture that a statement names, and how it is laid on the surface.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct MapLine {
    pub name: String,
    /// From the mesh's (u, v) to the picture's: first `-s`, then `-o`.
    pub transform: Affine2,
    /// `-clamp on`.
    pub clamped: bool,
    pub line: usize,
}

impl MapLine {
    /// `None` if no picture is named.
    pub(super) fn parse(line: usize, rest: &str) -> Option<MapLine> {
        let mut rest = rest.trim();
        let (mut scale, mut offset, mut clamped) = (Vec2::ONE, Vec2::ZERO, false);
        while rest.starts_with('-') {
            let (option, after) = word(rest);
            let values = match option.to_ascii_lowercase().as_str() {
                "-s" => take_numbers(after, 3, &mut scale),
                "-o" => take_numbers(after, 3, &mut offset),
                "-t" => take_numbers(after, 3, &mut Vec2::ZERO.clone()),
                "-mm" => take_numbers(after, 2, &mut Vec2::ZERO.clone()),
                "-bm" | "-boost" | "-texres" => take_numbers(after, 1, &mut Vec2::ZERO.clone()),
                "-clamp" => {
                    clamped = word(after).0.eq_ignore_ascii_case("on");
                    word(after).1
                }
                "-blendu" | "-blendv" | "-cc" | "-colorspace" | "-imfchan" | "-type" => {
                    word(after).1
                }
                // A name that begins with a hyphen.
                _ => break,
            };
            rest = values;
        }
        let name = rest.trim_matches('"').trim();
        let transform = Affine2::from_scale_angle_translation(scale, 0.0, offset);
        (!name.is_empty()).then(|| MapLine { name: name.to_owned(), transform, clamped, line })
    }
}

/// The first word and what follows it.
fn word(text: &str) -> (&str, &str) {
    let text = text.trim_start();
    let end = text.find(char::is_whitespace).unwrap_or(text.len());
    (&text[..end], text[end..].trim_start())
}

/// Puts up to `most` numbers into `values`, of which the third is of no use, and returns what follows.
fn take_numbers<'t>(text: &'t str, most: usize, values: &mut Vec2) -> &'t str {
    let mut rest = text;
    for k in 0..most {
        let (first, after) = word(rest);
        let Some(value) = first.parse::<f32>().ok().filter(|x| x.is_finite()) else { break };
        if k < 2 {
            values[k] = value;
        }
        rest = after;
    }
    rest
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(text: &str) -> MapLine {
        MapLine::parse(1, text).expect(text)
    }

    #[test]
    fn options_are_read_and_names_may_have_blanks() {
        let map = parse("-s 2 3 1 -o 0.5 0.25 0 -clamp on a picture.png");
        assert_eq!((map.name.as_str(), map.clamped), ("a picture.png", true));
        assert_eq!(map.transform.transform_point2(Vec2::ONE), Vec2::new(2.5, 3.25));
        let map = parse("-s 4 -o 1 x.png");
        assert_eq!(map.transform.transform_point2(Vec2::ONE), Vec2::new(5.0, 1.0));
    }

    #[test]
    fn options_without_a_use_are_skipped() {
        let all = "-blendu on -blendv off -boost 1.5 -mm 0 1 -t 1 1 1 -texres 512 -cc on -bm 0.2 \
                   -imfchan r -type sphere -colorspace sRGB";
        let map = parse(&format!("{all} -clamp off C:\\maps\\wood 1.jpg"));
        assert_eq!((map.name.as_str(), map.clamped), ("C:\\maps\\wood 1.jpg", false));
        assert_eq!(map.transform, Affine2::IDENTITY);
    }

    #[test]
    fn odd_lines_have_a_name_or_none() {
        assert_eq!(parse("-dash.png").name, "-dash.png");
        assert_eq!(parse("\"quoted name.png\"").name, "quoted name.png");
        for nothing in ["", "  ", "-s 1 1 1", "-clamp on", "\"\"", "-clamp"] {
            assert_eq!(MapLine::parse(1, nothing), None, "{nothing}");
        }
    }
}
