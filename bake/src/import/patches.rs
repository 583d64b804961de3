//! The patch set of imported lights, and which picture each patch has.

use super::cells::solid_angles_sr;
use super::fault::ImportError;
use super::source::{LightPicture, Side, Source};
use relume_firmware::patches::{Listed, ListedPatch, MAX_PATCHES, PatchSet};

/// Lights this little behind a plane (about a degree) are still before it.
const SLACK: f64 = 0.02;

/// A set and, per patch, the number of its picture.
pub(super) struct Lights {
    pub(super) set: PatchSet,
    pub(super) pictures: Vec<usize>,
}

impl Lights {
    /// The lights of a source.
    ///
    /// # Errors
    /// [`ImportError`] for too many lights, or two in one direction.
    pub(super) fn of(source: &Source) -> Result<Self, ImportError> {
        let pictures = &source.pictures;
        if !(1..=MAX_PATCHES).contains(&pictures.len()) {
            return Err(ImportError::TooMany { file: source.place.clone(), count: pictures.len() });
        }
        if let Some(set) = source.known {
            return Ok(Lights { set, pictures: (0..set.len()).collect() });
        }
        refuse_twins(source)?;
        let horizon = horizon_of(source);
        let dirs: Vec<[f64; 3]> = pictures.iter().map(|picture| picture.dir_world).collect();
        let cells = solid_angles_sr(&dirs, horizon);
        // Sky and ground are told apart by it: those above come first, else in their own order.
        let mut order: Vec<usize> = (0..pictures.len()).collect();
        order.sort_by_key(|&row| (dirs[row][1] as f32) < 0.0);
        let patch = |&row: &usize| ListedPatch {
            dir_world: dirs[row].map(|c| c as f32),
            solid_angle_sr: pictures[row].solid_angle_sr.unwrap_or(cells[row]) as f32,
            row: row as u16,
        };
        let patches: Vec<ListedPatch> = order.iter().map(patch).collect();
        let list = Listed::new(&patches, horizon.map(|axis| axis.map(|c| c as f32)));
        let list = list.map_err(|_| {
            let behind = order.iter().find(|&&row| pictures[row].solid_angle_sr.is_none() && cells[row] < 1e-6);
            let name = name_of(&pictures[behind.copied().unwrap_or(0)]);
            ImportError::file(
                &source.place,
                format!("the light of {name} is behind the horizon; give it a solid angle"),
            )
        })?;
        Ok(Lights { set: PatchSet::of_list(list), pictures: order })
    }
}

fn horizon_of(source: &Source) -> Option<[f64; 3]> {
    let before = |axis: &[f64; 3]| {
        let height = |picture: &LightPicture| picture.dir_world.iter().zip(axis).map(|(d, a)| d * a).sum::<f64>();
        source.pictures.iter().all(|picture| height(picture) >= -SLACK)
    };
    match source.side {
        Side::Around => None,
        Side::Before(axis) => Some(axis),
        Side::FirstOf(axes) => axes.into_iter().find(before),
    }
}

fn refuse_twins(source: &Source) -> Result<(), ImportError> {
    for (index, picture) in source.pictures.iter().enumerate() {
        let near = |other: &&LightPicture| {
            let apart = other.dir_world.iter().zip(picture.dir_world).map(|(a, b)| (a - b).powi(2)).sum::<f64>();
            apart < 1e-10
        };
        if let Some(other) = source.pictures[..index].iter().find(near) {
            let (first, second) = (name_of(other), name_of(picture));
            return Err(ImportError::SameDirection { file: source.place.clone(), first, second });
        }
    }
    Ok(())
}

/// A picture's name in its folder.
pub(super) fn name_of(picture: &LightPicture) -> String {
    picture.file.file_name().unwrap_or_default().to_string_lossy().into_owned()
}
