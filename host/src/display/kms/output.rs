//! Which socket and mode the picture goes to.

use super::KmsConfig;
use super::card::Card;
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
}

/// A connector's name as the kernel writes it.
pub fn connector_name(info: &connector::Info) -> String {
    format!("{}-{}", info.interface().as_str(), info.interface_id())
}

impl Output {
    /// Finds the socket and mode that the post's file asks for.
    ///
    /// # Errors
    /// What is not there, in one line with what is.
    pub(super) fn find(card: &Card, config: &KmsConfig, picture: (usize, usize)) -> Result<Self, String> {
        let path = card.path().display();
        let resources = card.resource_handles().map_err(|error| format!("{path} drives no display: {error}"))?;
        let infos = resources.connectors().iter().filter_map(|&handle| card.get_connector(handle, true).ok());
        let infos: Vec<connector::Info> = infos.collect();
        let names: Vec<String> = infos.iter().map(connector_name).collect();
        let asked = |name: &String| config.connector.as_ref().is_none_or(|wanted| wanted == name);
        if !names.iter().any(asked) {
            let wanted = config.connector.as_deref().unwrap_or_default();
            return Err(format!("{path} has no connector {wanted}; it has {}", names.join(" ")));
        }
        let plugged = infos.iter().zip(&names).find(|(info, name)| {
            asked(name) && info.state() == connector::State::Connected && !info.modes().is_empty()
        });
        let (info, name) = plugged.ok_or_else(|| match &config.connector {
            Some(wanted) => format!("nothing is plugged into {wanted}"),
            None => format!("nothing is plugged into {path}"),
        })?;
        let orientation = orientation(card, info.handle());
        let need = config.rotation.and(orientation).turned(picture);
        let facts: Vec<ModeFacts> = info.modes().iter().map(ModeFacts::of).collect();
        let at = choose_mode(&facts, config.mode, need).ok_or_else(|| no_mode(name, config.mode, need, &facts))?;
        let crtc =
            free_crtc(card, &resources, info).ok_or_else(|| format!("{path} has nothing to drive {name} with"))?;
        Ok(Output { connector: info.handle(), name: name.clone(), crtc, mode: info.modes()[at], orientation })
    }
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

/// The CRTC that drives a connector now, else one that may.
fn free_crtc(card: &Card, resources: &drm::control::ResourceHandles, info: &connector::Info) -> Option<crtc::Handle> {
    let now = info.current_encoder().and_then(|handle| card.get_encoder(handle).ok()?.crtc());
    let may = || {
        let encoders = info.encoders().iter().filter_map(|&handle| card.get_encoder(handle).ok());
        encoders.flat_map(|encoder| resources.filter_crtcs(encoder.possible_crtcs())).next()
    };
    now.or_else(may)
}

/// How the kernel says that the panel is built in, turned back.
fn orientation(card: &Card, connector: connector::Handle) -> Rotation {
    // Normal, Upside Down, Left Side Up, Right Side Up (drm_connector.c).
    match property(card, connector, "panel orientation").map(|(_, value)| value) {
        Some(1) => Rotation::Half,
        Some(2) => Rotation::Quarter,
        Some(3) => Rotation::ThreeQuarters,
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
}
