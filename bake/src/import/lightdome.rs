//! `.lp` files of light domes: first line the number of pictures N, then N lines `name x y z`, the direction towards the
//! light with x right, y up in the picture and z towards the camera, which are the world's axes here.
//!
//! Names may have spaces; they count from the file's folder. Where a name is a path of the machine it was written on, its
//! last part counts. Empty lines and lines that begin with `#` are left out.

use super::fault::ImportError;
use super::source::{LightPicture, Side, Source, unit};
use std::path::{Path, PathBuf};

pub(super) fn open(file: &Path) -> Result<Source, ImportError> {
    let bytes = std::fs::read(file).map_err(|error| ImportError::file(file, error))?;
    let text = String::from_utf8(bytes).map_err(|_| ImportError::file(file, "not UTF-8 text; save it as UTF-8"))?;
    let mut source = Source::new(file, "light dome", Side::FirstOf([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0]]));
    let folder = file.parent().unwrap_or(Path::new(""));
    let told = |line: usize, fault: String| ImportError::Line { file: file.to_owned(), line, fault };
    let mut count: Option<usize> = None;
    for (index, line) in text.trim_start_matches('\u{feff}').lines().enumerate() {
        let line = line.trim();
        if line.is_empty() || line.starts_with('#') {
            continue;
        }
        if count.is_none() {
            let number =
                line.parse().map_err(|_| told(index + 1, format!("`{line}` is not the number of pictures")))?;
            count = Some(number);
            continue;
        }
        let (name, dir_world) = parse(line).map_err(|fault| told(index + 1, fault))?;
        let picture = find(folder, name);
        if source.pictures.iter().any(|other| other.file == picture) {
            return Err(told(index + 1, format!("{name} is named a second time")));
        }
        source.pictures.push(LightPicture {
            file: picture,
            dir_world,
            solid_angle_sr: None,
            irradiance: Some([1.0; 3]),
        });
    }
    let found = source.pictures.len();
    match count {
        None => Err(ImportError::file(file, "empty; the first line of a .lp file is its number of pictures")),
        Some(0) => Err(ImportError::file(file, "has no pictures")),
        Some(count) if count != found => {
            Err(ImportError::file(file, format!("the first line says {count} pictures, but {found} follow")))
        }
        Some(_) => source.check_files(),
    }
}

/// Name and unit direction of a line.
fn parse(line: &str) -> Result<(&str, [f64; 3]), String> {
    let mut rest = line;
    let mut dir = [0.0f64; 3];
    for value in dir.iter_mut().rev() {
        let cut = rest.trim_end().rfind(char::is_whitespace).ok_or("write: name x y z")?;
        let field = rest[cut..].trim();
        *value = field.parse().map_err(|_| format!("`{field}` is not a number; write: name x y z"))?;
        rest = &rest[..cut];
    }
    let name = rest.trim().trim_matches('"');
    if name.is_empty() {
        return Err("the picture's name is missing; write: name x y z".to_owned());
    }
    Ok((name, unit(dir)?))
}

/// The picture of that name: as it stands, with the other system's separators, or its last part alone.
fn find(folder: &Path, name: &str) -> PathBuf {
    let plain = name.replace('\\', "/");
    let last = plain.rsplit('/').next().unwrap_or(name);
    let tried = [folder.join(name), folder.join(&plain), folder.join(last)];
    tried.iter().find(|file| file.is_file()).unwrap_or(&tried[0]).clone()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_are_names_and_directions() {
        assert_eq!(parse("a b  c.jpg\t0 0 2").unwrap(), ("a b  c.jpg", [0.0, 0.0, 1.0]));
        assert_eq!(parse("\"x y.png\" 0.6 -0.8 0").unwrap(), ("x y.png", [0.6, -0.8, 0.0]));
        assert_eq!(parse("img 1.tif 1e0 0 0").unwrap().0, "img 1.tif");
        for (line, told) in [
            ("a.jpg 0 0", "write: name"),
            ("a.jpg 0 0 z", "`z`"),
            ("0 0 1", "name x y z"),
            ("a.jpg 0 0 0", "points nowhere"),
            ("a.jpg 0 nan 1", "not finite"),
            ("a.jpg 0 0 inf", "not finite"),
        ] {
            let fault = parse(line).unwrap_err();
            assert!(fault.contains(told), "{line}: {fault}");
        }
    }
}
