//! DRM cards, their connectors and modes.

use super::{Card, Connector, advice};
use crate::display::kms::{Card as Node, connector_name};
use drm::Device as _;
use drm::control::{Device as _, ModeTypeFlags, connector};
use std::path::Path;

pub(super) fn list() -> Vec<Card> {
    Node::all().iter().map(|path| describe(path)).collect()
}

fn describe(path: &Path) -> Card {
    let mut card = Card {
        path: path.display().to_string(),
        driver: "unknown driver".into(),
        gbm: None,
        connectors: Vec::new(),
        problem: None,
    };
    let node = match Node::open(path) {
        Ok(node) => node,
        Err(error) => {
            card.problem = Some(advice(path, &error));
            return card;
        }
    };
    if let Ok(driver) = node.get_driver() {
        card.driver = driver.name().to_string_lossy().into_owned();
    }
    match node.resource_handles() {
        Ok(resources) => {
            let handles = resources.connectors().iter();
            card.connectors = handles.filter_map(|&handle| connector(&node, handle)).collect();
        }
        // A card that only computes has no connectors and refuses the question.
        Err(error) => card.problem = Some(format!("{} drives no display: {error}", path.display())),
    }
    card.gbm = gbm::Device::new(node).ok().map(|device| device.backend_name().to_string());
    card
}

fn connector(node: &Node, handle: connector::Handle) -> Option<Connector> {
    let info = node.get_connector(handle, true).ok()?;
    let mut modes: Vec<_> = info.modes().to_vec();
    modes.sort_by_key(|mode| !mode.mode_type().contains(ModeTypeFlags::PREFERRED));
    let name = |mode: &drm::control::Mode| format!("{}x{}@{}", mode.size().0, mode.size().1, mode.vrefresh());
    Some(Connector {
        name: connector_name(&info),
        connected: info.state() == connector::State::Connected,
        modes: modes.iter().map(name).collect(),
    })
}
