//! Whose the memory is that a running post asks for, by the stacks that asked.

use crate::counting::sites::Site;
use crate::symbols::Symbols;
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::io;
use std::time::Duration;

/// Crates, and parts of the standard library, that answer for what they ask; what others ask is their caller's.
const ANSWERING: [(&str, &str); 17] = [
    ("relume", "relume"),
    ("relume_firmware", "relume"),
    ("drm", "drm"),
    ("drm_ffi", "drm"),
    ("gbm", "gbm"),
    ("v4l", "v4l"),
    ("rayon", "rayon"),
    ("rayon_core", "rayon"),
    ("crossbeam_deque", "rayon"),
    ("crossbeam_epoch", "rayon"),
    ("image", "picture decoder"),
    ("zune_jpeg", "picture decoder"),
    ("zune_core", "picture decoder"),
    ("png", "picture encoder"),
    ("std::thread", "std's threads"),
    ("std::sync::mpsc", "std's channels"),
    ("std::sync::mpmc", "std's channels"),
];
/// Whose it is when nobody on the stack answers.
const NOBODY: &str = "nobody named";
/// Functions in whose frames the state is put in words, for the file and the labels, or light is logged.
const WORDS: [&str; 6] = [
    "::post::telling::",
    "::Post>::tell",
    "relume::labels::",
    "relume::health::",
    "relume::lightlog::",
    "::LightLog>::",
];
/// What stands in for devices where there are none: pictures in files, and a sky camera that is computed.
const STAND_INS: [&str; 2] = ["relume::display::headless::", "relume::camera::synthetic::"];
/// Calls of a stack that are told, from the first that is not the allocator's.
const MOST_TOLD: usize = 14;

/// Whose a function is, of those that answer.
fn answering(function: &str) -> Option<&'static str> {
    let path = function.trim_start_matches(['<', '&', '[', '(', '*']);
    let path = ["mut ", "const ", "dyn "].iter().fold(path, |path, word| path.strip_prefix(word).unwrap_or(path));
    let is_in = |name: &str| path.strip_prefix(name).is_some_and(|rest| rest.is_empty() || rest.starts_with("::"));
    ANSWERING.iter().find(|(name, _)| is_in(name)).map(|&(_, origin)| origin)
}

/// The origin of a stack of functions, from the innermost; relume's own apart, where it puts the state in words or stands in for
/// a device.
fn origin(stack: &[&str]) -> &'static str {
    let has = |parts: &[&str]| stack.iter().any(|function| parts.iter().any(|part| function.contains(part)));
    match stack.iter().find_map(|function| answering(function)).unwrap_or(NOBODY) {
        "relume" if has(&WORDS) => "relume's words",
        "relume" if has(&STAND_INS) => "relume's stand-ins",
        origin => origin,
    }
}

/// The name of a thread, as the system tells it while the thread lives.
fn thread_name(thread: i32) -> String {
    let told = std::fs::read_to_string(format!("/proc/self/task/{thread}/comm"));
    told.map_or_else(|_| "one that ended".to_owned(), |name| name.trim().to_owned())
}

/// How often the sites asked for memory, in so many frames and in that time, as JSON: per origin, thread by thread, and by
/// stacks.
///
/// # Errors
/// When the program's own symbols cannot be read.
pub fn report(sites: &[Site], lost: u64, frames: u64, took: Duration) -> io::Result<String> {
    let symbols = Symbols::of_this_program()?;
    let mut origins: BTreeMap<(&str, String), u64> = BTreeMap::new();
    let mut stacks: Vec<(u64, Value)> = Vec::new();
    for site in sites {
        // A call returns behind itself.
        let functions: Vec<&str> = site.stack().iter().map(|&back| symbols.name(back.saturating_sub(1))).collect();
        let origin = origin(&functions);
        let thread = thread_name(site.thread);
        let own = |function: &&&str| !function.contains("relume_tests::counting") && !function.starts_with("__rust");
        let told: Vec<&&str> = functions.iter().filter(own).take(MOST_TOLD).collect();
        stacks.push((site.times, json!({"origin": origin, "thread": thread, "times": site.times, "stack": told})));
        *origins.entry((origin, thread)).or_default() += site.times;
    }
    stacks.sort_by_key(|&(times, _)| std::cmp::Reverse(times));
    let per_frame = |times: u64| times as f64 / frames.max(1) as f64;
    let origins = origins.into_iter();
    let origins: Vec<Value> = origins
        .map(|((origin, thread), times)| json!({"origin": origin, "thread": thread, "times": times, "per_frame": per_frame(times)}))
        .collect();
    let stacks: Vec<Value> = stacks.into_iter().map(|(_, stack)| stack).collect();
    let told =
        json!({"frames": frames, "seconds": took.as_secs_f64(), "lost": lost, "origins": origins, "stacks": stacks});
    Ok(format!("{told:#}\n"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_innermost_that_answers_has_asked() {
        let ours = "relume::post::Post::show";
        let stack = |names: &[&'static str]| origin(&[names, &[ours, "main"]].concat());
        assert_eq!(stack(&["alloc::vec::Vec<T>::push", "serde_json::to_string", "std::fs::write"]), "relume");
        assert_eq!(stack(&["<rayon_core::job::StackJob<L,F,R> as rayon_core::job::Job>::execute"]), "rayon");
        assert_eq!(stack(&["core::mem::swap", "<&mut drm::control::Events as X>::next"]), "drm");
        assert_eq!(stack(&["drmlike::f", "std::threads::f"]), "relume");
        assert_eq!(stack(&["std::thread::Builder::spawn"]), "std's threads");
        assert_eq!(
            stack(&["alloc::fmt::format", "relume::post::telling::<impl relume::post::Post>::health"]),
            "relume's words"
        );
        assert_eq!(
            stack(&["<relume::display::headless::Headless as relume::display::Display>::present"]),
            "relume's stand-ins"
        );
        assert_eq!(origin(&["main"]), NOBODY);
    }
}
