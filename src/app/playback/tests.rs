use std::collections::BTreeMap;

use egui::{Modifiers, PointerButton, Pos2};

use super::*;
use ostra_frames::Orientation;
use ostra_project::review::CheckReason;

fn frame(image: ImageSource) -> Frame {
    Frame {
        name: String::new(),
        width: 4,
        height: 3,
        image,
        depth: None,
        camera: None,
    }
}

fn photos(count: usize) -> Vec<Frame> {
    let photo = |_| {
        frame(ImageSource::File {
            path: "/p.jpg".into(),
            orientation: Orientation(1),
        })
    };
    (0..count).map(photo).collect()
}

/// Returns images of a video of eight frames per second.
fn video(count: usize) -> Vec<Frame> {
    let image = |index: usize| {
        frame(ImageSource::Video {
            path: "/v.mp4".into(),
            index: index as u64,
            time_s: index as f64 / 8.0,
        })
    };
    (0..count).map(image).collect()
}

fn list<'a>(frames: &'a [Frame], review: &'a Review) -> PlayList<'a> {
    PlayList {
        frames,
        range: (0, frames.len() - 1),
        prefs: PlaybackPrefs::default(),
        review,
    }
}

/// Plays from the first frame and returns the frame shown at each time.
fn played(list: &PlayList<'_>, times: &[f64]) -> (Vec<usize>, bool) {
    let mut playback = Playback::default();
    let mut shown = playback.start(0.0, list, list.range.0);
    let mut show = |now: &f64| {
        shown = playback.advance(*now, list, shown, |_| true);
        shown
    };
    let frames = times.iter().map(&mut show).collect();
    (frames, playback.is_playing())
}

const QUARTERS: [f64; 6] = [0.0, 0.25, 0.5, 0.75, 1.0, 1.25];

#[test]
fn photos_and_videos_have_their_speed() {
    let none = Review::default();
    let (photos, video) = (photos(40), video(40));
    let mut list = list(&photos, &none);
    assert_eq!(played(&list, &QUARTERS).0, [0, 1, 2, 3, 4, 5]);
    list.prefs.speed = PlaySpeed::Quarter;
    assert_eq!(played(&list, &QUARTERS).0, [0, 0, 0, 0, 1, 1]);
    list.frames = &video;
    list.prefs.speed = PlaySpeed::Full;
    assert_eq!(played(&list, &QUARTERS).0, [0, 2, 4, 6, 8, 10]);
    list.prefs.speed = PlaySpeed::Half;
    assert_eq!(played(&list, &QUARTERS).0, [0, 1, 2, 3, 4, 5]);
    list.prefs.speed = PlaySpeed::Quarter;
    assert_eq!(played(&list, &QUARTERS).0, [0, 0, 1, 1, 2, 2]);
}

#[test]
fn sparse_frames_of_a_video_do_not_take_their_whole_time() {
    let none = Review::default();
    let mut frames = video(4);
    for (frame, time) in frames.iter_mut().zip([0.0, 60.0, 120.0, 180.0]) {
        if let ImageSource::Video { time_s, .. } = &mut frame.image {
            *time_s = time;
        }
    }
    let shown = played(&list(&frames, &none), &[0.0, 0.5, 1.0]).0;
    assert_eq!(shown, [0, 1, 2]);
}

#[test]
fn playback_loops_over_the_range_or_ends() {
    let none = Review::default();
    let photos = photos(9);
    let mut list = list(&photos, &none);
    list.range = (2, 4);
    let (frames, is_playing) = played(&list, &QUARTERS);
    assert_eq!((frames, is_playing), (vec![2, 3, 4, 2, 3, 4], true));
    list.prefs.loops = false;
    let (frames, is_playing) = played(&list, &QUARTERS);
    assert_eq!((frames, is_playing), (vec![2, 3, 4, 4, 4, 4], false));
    let mut playback = Playback::default();
    assert_eq!(playback.start(0.0, &list, 3), 3);
    assert_eq!(
        playback.start(0.0, &list, 4),
        2,
        "from the end to the start"
    );
    assert_eq!(playback.start(0.0, &list, 8), 2, "outside the range");
    assert_eq!(list.coming(3), [4]);
    list.prefs.loops = true;
    assert_eq!(list.coming(3), [4, 2]);
}

#[test]
fn playback_stops_at_every_frame_to_check_and_goes_on_from_there() {
    let (photos, video) = (photos(40), video(40));
    let to_check = BTreeMap::from([(3, vec![CheckReason::Stale]), (4, vec![CheckReason::Stale])]);
    let review = Review {
        to_check,
        ..Review::default()
    };
    for frames in [&photos, &video] {
        let mut list = list(frames, &review);
        assert!(played(&list, &QUARTERS).1, "only if the user wants it");
        list.prefs.stops = true;
        let mut playback = Playback::default();
        let mut shown = playback.start(0.0, &list, 0);
        for now in QUARTERS {
            shown = playback.advance(now, &list, shown, |_| true);
        }
        assert_eq!((shown, playback.is_playing()), (3, false));
        shown = playback.start(2.0, &list, shown);
        assert_eq!(shown, 3);
        for now in QUARTERS {
            shown = playback.advance(2.0 + now, &list, shown, |_| true);
        }
        assert_eq!((shown, playback.is_playing()), (4, false));
    }
}

#[test]
fn frames_that_are_not_ready_are_waited_for_and_then_shown_for_their_time() {
    let none = Review::default();
    let (photos, video) = (photos(40), video(40));
    // A quarter of a second later a photo is over, and two images of the video.
    for (frames, last) in [(&photos, 2), (&video, 3)] {
        let list = list(frames, &none);
        let mut playback = Playback::default();
        let mut shown = playback.start(0.0, &list, 0);
        for now in [0.25, 0.5, 5.0] {
            shown = playback.advance(now, &list, shown, |frame| frame < 1);
            assert_eq!(shown, 0, "the number is that of the image");
        }
        shown = playback.advance(5.0625, &list, shown, |frame| frame < 9);
        assert_eq!(shown, 1, "nothing is left out after waiting");
        shown = playback.advance(5.09375, &list, shown, |frame| frame < 9);
        assert_eq!(shown, 1);
        shown = playback.advance(5.25, &list, shown, |frame| frame < 9);
        assert_eq!(shown, last);
    }
}

#[test]
fn window_that_is_drawn_slowly_leaves_out_images_of_a_video_but_no_photo() {
    let none = Review::default();
    let (photos, video) = (photos(40), video(40));
    assert_eq!(
        played(&list(&photos, &none), &[2.0, 2.125, 2.25, 2.375]).0,
        [1, 2, 2, 3]
    );
    let shown = played(&list(&video, &none), &[9.0, 9.125]).0;
    assert_eq!(shown, [5, 6], "at most half a second at once");
}

#[test]
fn another_frame_pauses_and_a_press_is_taken_until_it_ends() {
    let none = Review::default();
    let photos = photos(9);
    let list = list(&photos, &none);
    let mut playback = Playback::default();
    playback.start(0.0, &list, 0);
    assert_eq!(playback.advance(0.25, &list, 7, |_| true), 7);
    assert!(!playback.is_playing());
    assert!(!playback.takes_press(true, true), "nothing is played");
    playback.start(0.0, &list, 0);
    assert!(!playback.takes_press(false, true));
    assert!(playback.takes_press(true, true) && !playback.is_playing());
    assert!(playback.takes_press(false, true));
    assert!(
        playback.takes_press(false, false),
        "the click comes with the release"
    );
    assert!(!playback.takes_press(false, false));
    playback.start(0.0, &list, 0);
    assert!(playback.takes_press(true, false), "a tap within one frame");
    assert!(
        !playback.takes_press(true, true),
        "the next press is not taken"
    );
}

#[test]
fn tap_of_the_key_plays_but_a_drag_with_it_does_not() {
    let shortcuts = Shortcuts::default();
    let key = |pressed| Event::Key {
        key: Key::Space,
        physical_key: None,
        pressed,
        repeat: false,
        modifiers: Modifiers::NONE,
    };
    let button = Event::PointerButton {
        pos: Pos2::ZERO,
        button: PointerButton::Primary,
        pressed: true,
        modifiers: Modifiers::NONE,
    };
    let mut playback = Playback::default();
    let mut follow = |events: &[Event]| playback.follow_key(events, &shortcuts, true);
    assert!(!follow(&[key(true)]));
    assert!(follow(&[key(false)]));
    assert!(!follow(&[key(false)]), "released once");
    assert!(follow(&[key(true), key(false)]));
    assert!(!follow(&[key(true)]) && !follow(&[button]) && !follow(&[key(false)]));
    assert!(!playback.follow_key(&[key(true), key(false)], &shortcuts, false));
}
