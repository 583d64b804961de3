//! Which socket and mode the picture goes to.

use super::KmsConfig;
use super::card::Card;
use super::trouble::Trouble;
use crate::display::config::{ModeWish, Rotation};
use drm::control::{Device as _, Mode, ModeTypeFlags, PlaneType, ResourceHandle, connector, crtc, plane, property};

/// What is known of a mode when one is chosen.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct ModeFacts {
    pub(super) size: (usize, usize),
    pub(super) refresh_hz: u32,
    pub(super) preferred: bool,
}

impl ModeFacts {
    pub(super) fn of(mode: &Mode) -> Self {
        let (width, height) = mode.size();
        ModeFacts {
            size: (width.into(), height.into()),
            refresh_hz: mode.vrefresh(),
            preferred: mode.mode_type().contains(ModeTypeFlags::PREFERRED),
        }
    }
}

/// The number of the mode to use for a picture that takes `need` pixels: the one that was asked for; else the preferred
/// one; else, where the picture does not fit that, the smallest that it fits.
pub(super) fn choose_mode(modes: &[ModeFacts], wish: Option<ModeWish>, need: (usize, usize)) -> Option<usize> {
    let fits = |mode: &ModeFacts| mode.size.0 >= need.0 && mode.size.1 >= need.1;
    if let Some(wish) = wish {
        let asked = |mode: &ModeFacts| {
            mode.size == (wish.width, wish.height) && wish.refresh_hz.is_none_or(|hz| hz == mode.refresh_hz)
        };
        return modes.iter().position(asked);
    }
    let preferred = modes.iter().position(|mode| mode.preferred && fits(mode));
    let smallest = || {
        let fitting = modes.iter().enumerate().filter(|(_, mode)| fits(mode));
        fitting.min_by_key(|(_, mode)| (mode.size.0 * mode.size.1, u32::MAX - mode.refresh_hz)).map(|(at, _)| at)
    };
    preferred.or_else(smallest)
}

/// What a card shows on.
#[derive(Clone, Debug)]
pub(super) struct Output {
    pub(super) connector: connector::Handle,
    /// Such as `HDMI-A-1`.
    pub(super) name: String,
    pub(super) crtc: crtc::Handle,
    pub(super) mode: Mode,
    /// How the panel is built in, turned back.
    pub(super) orientation: Rotation,
    /// That it is not the socket asked for.
    pub(super) note: Option<String>,
}

/// A connector's name as the kernel writes it.
pub fn connector_name(info: &connector::Info) -> String {
    format!("{}-{}", info.interface().as_str(), info.interface_id())
}

/// What is known of a socket when one is chosen.
#[derive(Clone, Copy, Debug)]
pub(super) struct SocketFacts<'a> {
    pub(super) name: &'a str,
    pub(super) plugged: bool,
}

/// The number of the socket to use: the one asked for, else the first with a display. Where the one asked for does not exist,
/// its name may have changed with a driver that was loaded again or a new kernel: the only display of its kind, or the only
/// one at all, is the one that was meant.
///
/// # Errors
/// Why there is none; `card` is what the words call the card.
pub(super) fn choose_socket(card: &str, sockets: &[SocketFacts<'_>], wanted: Option<&str>) -> Result<usize, Trouble> {
    let plugged = |at: &usize| sockets[*at].plugged;
    let Some(wanted) = wanted else {
        return (0..sockets.len()).find(plugged).ok_or_else(|| Trouble::Unplugged(card.into()));
    };
    if let Some(at) = sockets.iter().position(|socket| socket.name == wanted) {
        return Some(at).filter(plugged).ok_or_else(|| Trouble::Unplugged(wanted.into()));
    }
    let kind = |name: &str| name.rsplit_once('-').map(|(kind, _)| kind.to_string());
    let all: Vec<usize> = (0..sockets.len()).filter(plugged).collect();
    let alike: Vec<usize> = all.iter().copied().filter(|&at| kind(sockets[at].name) == kind(wanted)).collect();
    let names = sockets.iter().map(|socket| socket.name).collect::<Vec<_>>().join(" ");
    match (&alike[..], &all[..]) {
        (&[only], _) | (_, &[only]) => Ok(only),
        (_, []) => Err(Trouble::Unplugged(format!("{card}, which has no {wanted}; it has {names}"))),
        _ => Err(Trouble::Unfit(format!("{card} has no connector {wanted}; it has {names}"))),
    }
}

/// Finds the socket and mode that the post's file asks for; asks all monitors, which takes long.
///
/// # Errors
/// What is not there, with what is.
pub(super) fn choose_output(card: &Card, config: &KmsConfig, picture: (usize, usize)) -> Result<Output, Trouble> {
    let path = card.path().display().to_string();
    let resources = card.resource_handles().map_err(|_| Trouble::NoDisplay(card.path().to_path_buf()))?;
    let infos = resources.connectors().iter().filter_map(|&handle| card.get_connector(handle, true).ok());
    let infos: Vec<connector::Info> = infos.collect();
    let names: Vec<String> = infos.iter().map(connector_name).collect();
    let facts = infos.iter().zip(&names).map(|(info, name)| SocketFacts {
        name,
        plugged: info.state() == connector::State::Connected && !info.modes().is_empty(),
    });
    let wanted = config.connector.as_deref();
    let at = choose_socket(&path, &facts.collect::<Vec<_>>(), wanted)?;
    let (info, name) = (&infos[at], names[at].clone());
    let note = wanted.filter(|&wanted| wanted != name);
    let note = note.map(|wanted| format!("no connector {wanted} any more; {name} is used, the display that is there"));
    let orientation = orientation(card, info.handle());
    let need = config.rotation.and(orientation).turned(picture);
    let facts: Vec<ModeFacts> = info.modes().iter().map(ModeFacts::of).collect();
    let mode = fitting_mode(&name, &facts, config.mode, need)?;
    let crtc = free_crtc(card, &resources, &infos, info)
        .ok_or_else(|| Trouble::Unfit(format!("{path} has nothing to drive {name} with")))?;
    Ok(Output { connector: info.handle(), name, crtc, mode: info.modes()[mode], orientation, note })
}

/// The number of the mode to use on the socket `name`; see [`choose_mode`].
///
/// # Errors
/// [`Trouble::Unfit`] with the modes that there are.
pub(super) fn fitting_mode(
    name: &str,
    modes: &[ModeFacts],
    wish: Option<ModeWish>,
    need: (usize, usize),
) -> Result<usize, Trouble> {
    choose_mode(modes, wish, need).ok_or_else(|| Trouble::Unfit(no_mode(name, wish, need, modes)))
}

fn no_mode(name: &str, wish: Option<ModeWish>, need: (usize, usize), modes: &[ModeFacts]) -> String {
    let mut offered: Vec<String> =
        modes.iter().map(|mode| format!("{}x{}@{}", mode.size.0, mode.size.1, mode.refresh_hz)).collect();
    offered.dedup();
    let offered = offered.join(" ");
    match wish {
        Some(wish) => format!("{name} has no mode {wish}; it has {offered}"),
        None => format!("{name} has no mode for {}x{} pixels; it has {offered}", need.0, need.1),
    }
}

/// The CRTC that drives a connector now, else one that may: rather one that drives no other connector, even an empty one,
/// whose console it may still show.
fn free_crtc(
    card: &Card,
    resources: &drm::control::ResourceHandles,
    infos: &[connector::Info],
    info: &connector::Info,
) -> Option<crtc::Handle> {
    let driver =
        |info: &connector::Info| info.current_encoder().and_then(|handle| card.get_encoder(handle).ok()?.crtc());
    if let Some(now) = driver(info) {
        return Some(now);
    }
    let busy: Vec<crtc::Handle> = infos.iter().filter_map(driver).collect();
    let encoders = info.encoders().iter().filter_map(|&handle| card.get_encoder(handle).ok());
    let may: Vec<_> = encoders.flat_map(|encoder| resources.filter_crtcs(encoder.possible_crtcs())).collect();
    may.iter().find(|crtc| !busy.contains(crtc)).or(may.first()).copied()
}

/// How the kernel says that the panel is built in, turned back.
fn orientation(card: &Card, connector: connector::Handle) -> Rotation {
    turned_back(property(card, connector, "panel orientation").map(|(_, value)| value))
}

/// The rotation that undoes a connector's "panel orientation": which of the panel's sides is at the top of its casing, and so
/// where in the memory the picture's top belongs. Values of the kernel's `drm_connector_enum_panel_orientation`.
fn turned_back(orientation: Option<u64>) -> Rotation {
    match orientation {
        // Upside Down.
        Some(1) => Rotation::Half,
        // Left Side Up.
        Some(2) => Rotation::ThreeQuarters,
        // Right Side Up.
        Some(3) => Rotation::Quarter,
        _ => Rotation::None,
    }
}

/// An object's property of this name, and its value.
pub(super) fn property<T: ResourceHandle>(card: &Card, object: T, name: &str) -> Option<(property::Handle, u64)> {
    let properties = card.get_properties(object).ok()?;
    let named =
        |handle: property::Handle| card.get_property(handle).is_ok_and(|p| p.name().to_bytes() == name.as_bytes());
    properties.iter().find(|(handle, _)| named(**handle)).map(|(handle, value)| (*handle, *value))
}

/// The planes that show on a CRTC: the primary one, and those that should not.
pub(super) fn planes(card: &Card, crtc: crtc::Handle) -> Option<(plane::Handle, Vec<plane::Handle>)> {
    let resources = card.resource_handles().ok()?;
    let (mut primary, mut others) = (None, Vec::new());
    for handle in card.plane_handles().ok()? {
        let Ok(info) = card.get_plane(handle) else { continue };
        if !resources.filter_crtcs(info.possible_crtcs()).contains(&crtc) {
            continue;
        }
        match property(card, handle, "type").map(|(_, kind)| kind) {
            Some(kind) if kind == PlaneType::Primary as u64 && primary.is_none() => primary = Some(handle),
            _ if info.crtc() == Some(crtc) => others.push(handle),
            _ => {}
        }
    }
    Some((primary?, others))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::damage::Damage;
    use crate::display::Frame;
    use crate::display::pack::{PixelFormat, Placement};

    fn modes() -> Vec<ModeFacts> {
        let mode = |width, height, refresh_hz, preferred| ModeFacts { size: (width, height), refresh_hz, preferred };
        vec![
            mode(1280, 720, 60, true),
            mode(1920, 1080, 50, false),
            mode(1920, 1080, 60, false),
            mode(640, 480, 75, false),
        ]
    }

    #[test]
    fn the_wish_comes_first_then_the_preferred_mode_then_what_fits() {
        let wish = |text: &str| Some(text.parse::<ModeWish>().unwrap());
        assert_eq!(choose_mode(&modes(), wish("1920x1080@60"), (1, 1)), Some(2));
        assert_eq!(choose_mode(&modes(), wish("1920x1080"), (1, 1)), Some(1));
        assert_eq!(choose_mode(&modes(), wish("800x600"), (1, 1)), None);
        assert_eq!(choose_mode(&modes(), None, (640, 480)), Some(0));
        assert_eq!(choose_mode(&modes(), None, (1600, 900)), Some(2));
        assert_eq!(choose_mode(&modes(), None, (4000, 900)), None);
    }

    #[test]
    fn a_socket_whose_name_has_changed_is_found_when_only_one_can_be_meant() {
        let facts = |list: &[(&'static str, bool)]| {
            list.iter().map(|&(name, plugged)| SocketFacts { name, plugged }).collect::<Vec<_>>()
        };
        let chosen = |list: &[(&'static str, bool)], wanted| choose_socket("card0", &facts(list), wanted);
        let pair = [("HDMI-A-1", false), ("HDMI-A-2", true)];
        assert_eq!(chosen(&pair, None), Ok(1));
        assert_eq!(chosen(&pair, Some("HDMI-A-2")), Ok(1));
        assert_eq!(chosen(&pair, Some("HDMI-A-1")), Err(Trouble::Unplugged("HDMI-A-1".into())), "not its neighbour");
        assert_eq!(chosen(&[("Virtual-2", true)], Some("Virtual-1")), Ok(0));
        assert_eq!(chosen(&[("DP-1", true), ("HDMI-A-3", true), ("HDMI-A-4", false)], Some("HDMI-A-1")), Ok(1));
        assert_eq!(chosen(&[("DP-1", false), ("DSI-1", true)], Some("HDMI-A-1")), Ok(1));
        let both = chosen(&[("HDMI-A-3", true), ("HDMI-A-4", true)], Some("HDMI-A-1"));
        assert_eq!(both.unwrap_err().to_string(), "card0 has no connector HDMI-A-1; it has HDMI-A-3 HDMI-A-4");
        assert!(matches!(chosen(&[("HDMI-A-3", false)], Some("HDMI-A-1")), Err(Trouble::Unplugged(_))));
    }

    /// A picture of 3x2 pixels, 1 2 3 over 4 5 6, in the memory of a panel that it fills.
    fn on_panel(orientation: Option<u64>) -> Vec<Vec<u32>> {
        let (pixels, damage) = ([1, 2, 3, 4, 5, 6], Damage::whole(3, 2));
        let frame = Frame { width: 3, height: 2, pixels_bgrx: &pixels, number: 0, damage: &damage };
        let rotation = turned_back(orientation);
        let panel = rotation.turned((3, 2));
        let placement = Placement::centred((3, 2), panel, rotation, PixelFormat::Xrgb8888, panel.0).unwrap();
        let mut memory = vec![0; 6];
        damage.areas().for_each(|area| placement.write(&frame, area, &mut memory));
        memory.chunks(panel.0).map(<[u32]>::to_vec).collect()
    }

    #[test]
    fn the_pictures_top_is_at_the_side_of_the_panel_that_is_up() {
        let upright = vec![vec![1, 2, 3], vec![4, 5, 6]];
        assert_eq!((on_panel(None), on_panel(Some(0))), (upright.clone(), upright));
        assert_eq!(on_panel(Some(1)), [[6, 5, 4], [3, 2, 1]], "upside down: the bottom is up");
        // The first column of the memory is the panel's left side. Up there, the panel's bottom is the viewer's left.
        assert_eq!(on_panel(Some(2)), [[3, 6], [2, 5], [1, 4]], "left side up: the first row is the first column");
        assert_eq!(on_panel(Some(3)), [[4, 1], [5, 2], [6, 3]], "right side up: the first row is the last column");
    }
}
