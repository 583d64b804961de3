//! Offline tool of Relume: scene -> response -> tiles -> field file.
mod accessor;
pub mod camera;
pub mod demo_scene;
pub mod environment;
pub mod fragments;
pub mod geometry;
mod gltf_file;
mod path;
pub mod response;
pub mod scene;
mod strata;
pub mod sun;
pub mod texture;
pub mod viewpoint;
pub mod cutout;
pub mod progress;
pub mod stack;
