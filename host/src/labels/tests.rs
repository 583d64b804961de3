use super::*;

const SIZE: (usize, usize) = (512, 384);
/// Noon of a midsummer day in Rome.
const NOON: Moment = Moment { unix_s: 1_782_040_200.0, trusted: true };

fn labels(extra: &str) -> Labels {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("POST.toml");
    let text = format!(
        "{extra}\nfield = 'a'\nsky = 'simulated'\n[site]\nlatitude = 41.9\nlongitude = 12.5\n[display]\nkind = 'headless'\nfolder = '.'\n"
    );
    std::fs::write(&file, text).unwrap();
    Labels::new(&Config::load(&file).unwrap(), SIZE)
}

fn news(state: &str) -> News<'_> {
    News { moment: NOON, state, held_s: None, sun: None }
}

/// Looks east.
const CAMERA: CameraRecord = CameraRecord {
    position: [5.0, 2.0, 1.0],
    target: [9.0, 2.0, 1.0],
    up: [0.0, 1.0, 0.0],
    fov_y_deg: 45.0,
    north_deg: 0.0,
    lens: None,
};

#[test]
fn the_badge_tells_what_is_wrong_and_for_how_long() {
    let mut labels = labels("");
    let mut badge = |state, held_s| {
        labels.tell(&News { held_s, ..news(state) });
        labels.badge.clone()
    };
    assert_eq!(badge("ok", None), "");
    let state = "sky fails, last weights held: camera unplugged; clock not trusted, no sun shown";
    assert_eq!(badge(state, Some(12.9)), "sky fails, last weights held 12 s; clock not trusted, no sun shown");
    assert_eq!(badge("sky fails: why", Some(60.0)), "sky fails 1 min");
    assert_eq!(badge("sky fails", Some(7199.0)), "sky fails 1 h");
    assert_eq!(badge("sky fails", Some(3e5)), "sky fails 3 days");
    assert_eq!(badge("no sky yet: it gave nothing", None), "no sky yet");
}

#[test]
fn only_what_changed_is_drawn_and_what_has_gone_leaves_no_trace() {
    let clean: Vec<u32> = (0..SIZE.0 * SIZE.1).map(|k| (k as u32 * 77) & 0x00ff_ffff).collect();
    let (mut labels, mut shown) = (labels("title = 'The yard'"), clean.clone());
    let draw = |labels: &mut Labels, shown: &mut Vec<u32>, mut damage: Damage| {
        let before = shown.clone();
        labels.draw(&clean, shown, &mut damage).unwrap();
        let mut marked = vec![false; shown.len()];
        for (rows, columns) in damage.areas() {
            rows.for_each(|row| marked[row * SIZE.0 + columns.start..row * SIZE.0 + columns.end].fill(true));
        }
        assert!((0..shown.len()).all(|k| marked[k] || shown[k] == before[k]), "written, but not marked");
        damage.count()
    };
    let none = || Damage::none(SIZE.0, SIZE.1);
    assert!(labels.tell(&news("ok")), "words that were never drawn");
    assert!(draw(&mut labels, &mut shown, none()) > 0 && shown != clean);
    let without_badge = shown.clone();
    assert!(!labels.tell(&news("ok")));
    assert_eq!(draw(&mut labels, &mut shown, none()), 0);

    assert!(labels.tell(&news("sky fails")));
    let longer = draw(&mut labels, &mut shown, none());
    assert!(longer > 0 && shown != without_badge);
    assert!(!labels.tell(&news("sky fails")));
    assert!(labels.tell(&news("no sky")), "a shorter badge");
    assert_eq!(draw(&mut labels, &mut shown, none()), longer, "the area of the longer one before");
    assert!(labels.tell(&news("ok")));
    draw(&mut labels, &mut shown, none());
    assert!(shown == without_badge);

    // The picture is copied anew under the words, as far as one tile.
    let mut tile = none();
    tile.mark_area(SIZE.1 - 4..SIZE.1, 0..4);
    for (rows, columns) in tile.areas() {
        rows.for_each(|row| {
            let place = row * SIZE.0 + columns.start..row * SIZE.0 + columns.end;
            shown[place.clone()].copy_from_slice(&clean[place]);
        });
    }
    assert!(shown != without_badge);
    draw(&mut labels, &mut shown, tile);
    assert!(shown == without_badge);
}

#[test]
fn the_compass_comes_with_the_set_up_and_takes_the_sun_from_time_and_place() {
    let mut labels = labels("");
    labels.tell(&news("ok"));
    assert_eq!(labels.compass, None);
    labels.set_up(&CAMERA);
    assert!(labels.tell(&news("ok")));
    assert_eq!(labels.badge, "ok");
    // The sun culminates in the south at 90 - latitude + the earth's tilt, 71.5 degrees.
    let at_noon = |sun| Some(Compass::new(0.0, [1.0, 0.0, 0.0], sun));
    let within = |azimuth_deg| labels.compass == at_noon(Some([azimuth_deg as f32, 71.5]));
    assert!((176..=184).any(within), "{:?}", labels.compass);
    let untrusted = Moment { trusted: false, ..NOON };
    labels.tell(&News { moment: untrusted, ..news("ok") });
    assert_eq!(labels.compass, at_noon(None));
    let sun = Some(SunPosition { azimuth_deg: 100.0, altitude_deg: 20.0 });
    labels.tell(&News { moment: untrusted, sun, ..news("ok") });
    assert_eq!(labels.compass, at_noon(Some([100.0, 20.0])));
}
