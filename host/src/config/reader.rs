//! Typed, range-checked access to a TOML file whose every key must be known.

use std::ops::RangeInclusive;
use std::path::{Path, PathBuf};
use toml::{Table, Value};

/// What is wrong with a configuration file: one line that names file, key, value and what would be right.
#[derive(Debug, thiserror::Error)]
#[error("{}: {what}", file.display())]
pub struct ConfigError {
    /// The configuration file.
    pub file: PathBuf,
    /// Key, value and what to do.
    pub what: String,
}

/// A parsed file, read by dotted key.
pub(super) struct Reader {
    file: PathBuf,
    root: Table,
}

impl Reader {
    /// Reads the file and refuses every key that is not among `known` (dotted: `site.latitude`).
    pub(super) fn open(file: &Path, known: &[&str]) -> Result<Self, ConfigError> {
        let fault = |what: String| ConfigError { file: file.to_path_buf(), what };
        let text = std::fs::read_to_string(file).map_err(|e| fault(format!("cannot be read: {e}")))?;
        let root = text.parse::<Table>().map_err(|e| fault(syntax(&text, &e)))?;
        let reader = Reader { file: file.to_path_buf(), root };
        reader.refuse_unknown(&reader.root, "", known)?;
        Ok(reader)
    }

    fn refuse_unknown(&self, table: &Table, prefix: &str, known: &[&str]) -> Result<(), ConfigError> {
        for (key, value) in table {
            let path = if prefix.is_empty() { key.clone() } else { format!("{prefix}.{key}") };
            let is_table = known.iter().any(|k| k.starts_with(&format!("{path}.")));
            match value {
                Value::Table(inner) if is_table => self.refuse_unknown(inner, &path, known)?,
                _ if is_table => return Err(self.fault(format!("{path} must be a table: write [{path}]"))),
                _ if known.contains(&path.as_str()) => {}
                _ => {
                    let tables: Vec<&str> = known.iter().filter_map(|k| k.split_once('.')).map(|(t, _)| t).collect();
                    let nearest = nearest_key(&path, if value.is_table() { &tables } else { known });
                    return Err(self.fault(format!("unknown key {path}; did you mean {nearest}?")));
                }
            }
        }
        Ok(())
    }

    pub(super) fn fault(&self, what: String) -> ConfigError {
        ConfigError { file: self.file.clone(), what }
    }

    pub(super) fn has_table(&self, name: &str) -> bool {
        self.root.contains_key(name)
    }

    /// Is there a value for this key?
    pub(super) fn has(&self, path: &str) -> bool {
        self.get(path).is_some()
    }

    fn get(&self, path: &str) -> Option<&Value> {
        let mut parts = path.split('.');
        let first = self.root.get(parts.next()?)?;
        parts.try_fold(first, |value, part| value.as_table()?.get(part))
    }

    fn wrong(&self, path: &str, value: &Value, must: &str) -> ConfigError {
        let mut shown = value.to_string();
        if shown.chars().count() > 60 {
            shown = shown.chars().take(60).chain("...".chars()).collect();
        }
        self.fault(format!("{path} = {shown}: must be {must}"))
    }

    pub(super) fn text(&self, path: &str, most: usize) -> Result<Option<String>, ConfigError> {
        let Some(value) = self.get(path) else { return Ok(None) };
        match value.as_str() {
            Some(text) if text.chars().count() <= most => Ok(Some(text.to_string())),
            _ => Err(self.wrong(path, value, &format!("text in quotes, at most {most} characters"))),
        }
    }

    /// A path, taken relative to the configuration file's folder.
    pub(super) fn path(&self, path: &str) -> Result<Option<PathBuf>, ConfigError> {
        let Some(value) = self.get(path) else { return Ok(None) };
        match value.as_str() {
            Some(text) if !text.is_empty() => Ok(Some(self.file.parent().unwrap_or(Path::new("")).join(text))),
            _ => Err(self.wrong(path, value, "a path in quotes")),
        }
    }

    pub(super) fn number(&self, path: &str, range: RangeInclusive<f64>) -> Result<Option<f64>, ConfigError> {
        let Some(value) = self.get(path) else { return Ok(None) };
        let number = value.as_float().or_else(|| value.as_integer().map(|i| i as f64));
        match number {
            Some(number) if range.contains(&number) => Ok(Some(number)),
            _ => Err(self.wrong(path, value, &format!("a number from {} to {}", range.start(), range.end()))),
        }
    }

    pub(super) fn whole(&self, path: &str, range: RangeInclusive<u64>) -> Result<Option<u64>, ConfigError> {
        let Some(value) = self.get(path) else { return Ok(None) };
        match value.as_integer().and_then(|i| u64::try_from(i).ok()) {
            Some(number) if range.contains(&number) => Ok(Some(number)),
            _ => Err(self.wrong(path, value, &format!("a whole number from {} to {}", range.start(), range.end()))),
        }
    }

    /// Width and height, such as `"1280x960"`.
    pub(super) fn size(&self, path: &str) -> Result<Option<(usize, usize)>, ConfigError> {
        let Some(value) = self.get(path) else { return Ok(None) };
        let parts = value.as_str().and_then(|text| text.split_once('x'));
        match parts.and_then(|(width, height)| Some((width.parse().ok()?, height.parse().ok()?))) {
            Some((width @ 1..=16384, height @ 1..=16384)) => Ok(Some((width, height))),
            _ => Err(self.wrong(path, value, "such as \"1280x960\"")),
        }
    }

    pub(super) fn choice<T: Copy>(&self, path: &str, choices: &[(&str, T)]) -> Result<Option<T>, ConfigError> {
        let Some(value) = self.get(path) else { return Ok(None) };
        let given = value.as_str().unwrap_or_default();
        if let Some((_, choice)) = choices.iter().find(|(name, _)| *name == given) {
            return Ok(Some(*choice));
        }
        let names: Vec<String> = choices.iter().map(|(name, _)| format!("\"{name}\"")).collect();
        let must = match choices {
            [_] => names.concat(),
            _ => format!("one of {}", names.join(", ")),
        };
        Err(self.wrong(path, value, &must))
    }

    /// A moment as Unix seconds: a TOML date-time or an RFC 3339 text, either with its offset from UTC.
    pub(super) fn moment(&self, path: &str) -> Result<Option<f64>, ConfigError> {
        let Some(value) = self.get(path) else { return Ok(None) };
        let text = match value {
            Value::Datetime(moment) => moment.to_string(),
            Value::String(text) => text.clone(),
            _ => String::new(),
        };
        let must = "a time with its offset from UTC, such as 2026-06-21T04:00:00Z or 2026-06-21T06:00:00+02:00";
        crate::sun::parse_utc(&text).map(Some).map_err(|_| self.wrong(path, value, must))
    }
}

/// `line 3: expected ...`, without the excerpt that TOML errors print over several lines.
fn syntax(text: &str, error: &toml::de::Error) -> String {
    let message = error.message().replace('\n', ", ");
    match error.span().and_then(|span| text.get(..span.start)) {
        Some(before) => format!("line {}: not valid TOML: {message}", before.matches('\n').count() + 1),
        None => format!("not valid TOML: {message}"),
    }
}

/// The known key nearest to an unknown one: by its last part first, so that a key in the wrong table is found too.
fn nearest_key<'k>(path: &str, known: &[&'k str]) -> &'k str {
    let last = |key: &str| key.rsplit('.').next().unwrap_or_default().to_string();
    let distance = |key: &&&str| {
        let by_name = strsim::damerau_levenshtein(&last(path), &last(key));
        (by_name, strsim::damerau_levenshtein(path, key))
    };
    known.iter().min_by_key(distance).copied().unwrap_or_default()
}
