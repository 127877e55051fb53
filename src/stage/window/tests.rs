//! Tests of windows and tiles.

use super::*;
use crate::stage::Stage;
use nalgebra::Vector4;

fn tile(crop: [u32; 4], overscan: [u32; 4]) -> (Tile, Screen) {
    let stage = Stage::find("workbench").unwrap();
    let tile = Tile { crop, overscan, ..Tile::whole(&stage, 0, Stereo::Mono) };
    (tile, stage.screens[0].clone())
}

#[test]
fn a_whole_tile_shows_the_whole_screen() {
    let (tile, screen) = tile([0, 0, 1280, 1024], [0; 4]);
    for size in [[1280, 1024], [640, 1024], [37, 11]] {
        let visible = tile.visible(&screen, size).unwrap();
        assert_eq!(visible.rect, [0, 0, size[0], size[1]]);
        assert!(visible.on_screen.iter().zip([-1.0, 1.0, -1.0, 1.0]).all(|(a, b)| (a - b).abs() < 1e-12));
    }
}

/// A place of the room lands on the same pixel of the display, whatever is hidden about it.
#[test]
fn overscan_hides_pixels_and_moves_none() {
    let (tile, screen) = tile([0, 0, 1280, 1024], [16, 32, 8, 24]);
    let visible = tile.visible(&screen, [1280, 1024]).unwrap();
    assert_eq!(visible.rect, [16, 8, 1280 - 48, 1024 - 32]);
    for ndc in [[0.0, 0.0], [0.5, -0.7], [-0.9, 0.9]] {
        let clip = visible.clip_from_whole() * Vector4::new(ndc[0], ndc[1], 0.3, 1.0);
        let [x, y, width, height] = visible.rect.map(f64::from);
        let pixel = [x + (clip.x + 1.0) / 2.0 * width, y + (1.0 - clip.y) / 2.0 * height];
        let expected = [(ndc[0] + 1.0) / 2.0 * 1280.0, (1.0 - ndc[1]) / 2.0 * 1024.0];
        assert!((pixel[0] - expected[0]).abs() < 1e-9 && (pixel[1] - expected[1]).abs() < 1e-9);
        let back = visible.on_whole([clip.x, clip.y]);
        assert!((back[0] - ndc[0]).abs() < 1e-12 && (back[1] - ndc[1]).abs() < 1e-12);
    }
}

#[test]
fn the_lower_right_quarter_is_cropped() {
    let (tile, screen) = tile([640, 512, 640, 512], [0, 10, 0, 0]);
    let visible = tile.visible(&screen, [320, 256]).unwrap();
    assert_eq!(visible.rect, [0, 0, 315, 256]);
    let expected = [0.0, 1.0 - 2.0 * 10.0 / 1280.0, -1.0, 0.0];
    assert!(visible.on_screen.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-12), "{visible:?}");
}

#[test]
fn a_tile_of_which_all_is_hidden_shows_nothing() {
    let (tile, screen) = tile([0, 0, 1280, 1024], [1280, 0, 0, 0]);
    assert_eq!(tile.visible(&screen, [1280, 1024]), None);
    assert_eq!(self::tile([0, 0, 1280, 1024], [0; 4]).0.visible(&screen, [0, 4]), None);
}

#[test]
fn without_windows_of_its_own_a_stage_has_one_per_screen_or_per_eye() {
    let layout = Stage::find("workbench").unwrap().layout();
    let places: Vec<_> = layout.iter().map(|w| (w.name.as_str(), w.at.unwrap())).collect();
    assert_eq!(
        places,
        [
            ("table left", [0, 1024]),
            ("table right", [1280, 1024]),
            ("wall left", [0, 0]),
            ("wall right", [1280, 0])
        ]
    );
    let desktop = Stage::find("desktop").unwrap().layout();
    assert_eq!((desktop.len(), desktop[0].at, desktop[0].size), (1, None, [1280, 800]));
    let packed = Stage { stereo: Stereo::FramePacking, ..Stage::find("desktop").unwrap() }.layout();
    assert_eq!(packed[0].size, [1280, 1633]);
}

/// Screens of different heights: each stands under all that are above it.
#[test]
fn no_usual_window_lies_over_another() {
    let tops = |name: &str| -> Vec<(String, i32)> {
        let layout = Stage::find(name).unwrap().usual_layout();
        layout.into_iter().map(|window| (window.name, window.at.unwrap()[1])).collect()
    };
    let cave = tops("cave3");
    assert!(cave.contains(&("floor left and right".to_owned(), 1800)), "{cave:?}");
    for (name, _) in super::super::BUILT_IN {
        let layout = Stage::find(name).unwrap().usual_layout();
        for (i, a) in layout.iter().enumerate() {
            for b in &layout[..i] {
                let is_apart = |axis: usize| {
                    let ends = |window: &Window| {
                        let start = window.at.unwrap()[axis];
                        (start, start + window.size[axis] as i32)
                    };
                    ends(a).1 <= ends(b).0 || ends(b).1 <= ends(a).0
                };
                assert!(is_apart(0) || is_apart(1), "{name}: {} and {}", a.name, b.name);
            }
        }
    }
}

#[test]
fn places_beyond_any_desktop_are_refused() {
    let window = |at: &str| format!("[[window]]\nscreen = \"wall\"\nstereo = \"mono\"\nat = {at}\n");
    assert!(refusal(&window("[2147483647, 0]")).contains("it stands at (2147483647, 0): both must be"));
    assert!(refusal(&window("[0, -32769]")).contains("between -32768 and 32767"));
    assert!(with_windows(&window("[-32768, 32767]")).is_ok());
    let monitor = "[[monitor]]\nname = \"DP-1\"\nat = [0, 2147483647]\nsize = [1280, 1024]\n";
    assert!(refusal(monitor).contains("monitor `DP-1`: it stands at (0, 2147483647)"));
}

#[test]
fn tiles_grow_with_their_window_and_leave_no_gap() {
    let stage = Stage::find("workbench").unwrap();
    let part = |x, width| Tile { rect: [x, 0, width, 7], ..Tile::whole(&stage, 0, Stereo::Mono) };
    let window = Window {
        name: String::new(),
        monitor: None,
        at: None,
        fills: false,
        size: [10, 7],
        border: Border::None,
        tiles: vec![part(0, 3), part(3, 7)],
    };
    let [a, b] = [0, 1].map(|i| window.rect(&window.tiles[i], [25, 70]));
    assert_eq!((a, b), ([0, 0, 8, 70], [8, 0, 17, 70]));
}

/// The workbench with separate windows after its screens.
fn with_windows(windows: &str) -> Result<Stage, String> {
    let text = format!("{}\n{windows}", super::super::BUILT_IN[0].1);
    Stage::parse(&text, std::path::Path::new("bench.toml")).map_err(|error| error.to_string())
}

fn refusal(windows: &str) -> String {
    with_windows(windows).unwrap_err()
}

#[test]
fn a_window_of_one_screen_takes_its_size() {
    let stage = with_windows(
        "[[window]]\nscreen = \"wall\"\nstereo = \"side_by_side\"\nat = [-1280, 10]\n\
         [[window]]\nscreen = \"table\"\nstereo = \"right\"\nmonitor = \"DP-2\"\nborder = \"unmanaged\"\n",
    )
    .unwrap();
    let [wall, table] = &stage.layout()[..] else { panic!("two windows") };
    assert_eq!((wall.name.as_str(), wall.at, wall.size), ("window 1", Some([-1280, 10]), [2560, 1024]));
    assert_eq!((wall.tiles[0].screen, wall.border), (1, Border::None));
    let monitors = [("DP-1", 0), ("DP-2", 1920)].map(|(name, x)| Monitor {
        name: name.to_owned(),
        at: [x, 0],
        size: [1920, 1080],
    });
    assert_eq!(table.on_desktop(&monitors), Some(([1920, 0], [1920, 1080])));
    assert_eq!(table.on_desktop(&monitors[..1]), None);
    assert_eq!((table.border, table.tiles[0].stereo), (Border::Unmanaged, Stereo::Right));
}

/// Two projectors on one card: the desktop is one window high.
#[test]
fn one_window_shows_several_screens() {
    let stage = with_windows(
        "[[window]]\nname = \"projectors\"\nat = [0, 0]\nsize = [1280, 2048]\n\
         [[window.tile]]\nscreen = \"wall\"\nrect = [0, 0, 1280, 1024]\nstereo = \"top_bottom_half\"\n\
         [[window.tile]]\nscreen = \"table\"\nrect = [0, 1024, 1280, 1024]\nstereo = \"top_bottom_half\"\n\
         overscan = [8, 8, 4, 4]\ncrop = [0, 0, 1280, 512]\n",
    )
    .unwrap();
    let [projectors] = &stage.layout()[..] else { panic!("one window") };
    assert_eq!((projectors.tiles[0].rect, projectors.tiles[0].screen), ([0, 0, 1280, 1024], 1));
    assert_eq!((projectors.tiles[1].crop, projectors.tiles[1].overscan), ([0, 0, 1280, 512], [8, 8, 4, 4]));
}

#[test]
fn windows_that_cannot_be_are_refused_with_the_reason() {
    let window = |more: &str| format!("[[window]]\nstereo = \"left\"\nat = [0, 0]\n{more}");
    for (text, reason) in [
        (window(""), "which screen"),
        (window("screen = \"wal\""), "did you mean \"wall\""),
        (window("screen = \"wall\"\ncrop = [0, 0, 1281, 10]"), "1280 × 1024 pixels"),
        (window("screen = \"wall\"\ncrop = [0, 0, 0, 10]"), "1280 × 1024 pixels"),
        (window("screen = \"wall\"\noverscan = [640, 640, 0, 0]"), "hides all"),
        (window("screen = \"wall\"\nsize = [0, 10]"), "between 1 and 16384"),
        (window("screen = \"wall\"\nsiz = [1, 10]"), "did you mean `size`"),
        (window("screen = \"wall\"\nmonitor = -1"), "number, from 0"),
        (
            window("crop = [0, 0, 9, 9]\n[[window.tile]]\nscreen = \"wall\"\nrect = [0, 0, 9, 9]"),
            "belong into its tiles",
        ),
        ("[[window]]\nscreen = \"wall\"\n".to_owned(), "which eye"),
        ("[[window]]\nscreen = \"wall\"\nstereo = \"separate\"".to_owned(), "in one window or tile"),
        (
            "[[window]]\nsize = [10, 10]\n[[window.tile]]\nscreen = \"wall\"\nstereo = \"left\"\n\
             rect = [0, 0, 11, 10]"
                .to_owned(),
            "11 × 10",
        ),
        (
            "[[window]]\n[[window.tile]]\nscreen = \"wall\"\nstereo = \"left\"\nrect = [0, 0, 10, 10]\n\
             [[window.tile]]\nscreen = \"wall\"\nstereo = \"right\"\nrect = [9, 9, 10, 10]"
                .to_owned(),
            "overlap",
        ),
        (window("screen = \"wall\"\nname = \"a\"\n").repeat(2), "second window"),
    ] {
        let found = refusal(&text);
        assert!(found.contains(reason), "no `{reason}` in: {found}\n{text}");
    }
}
