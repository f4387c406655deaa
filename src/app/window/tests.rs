use std::fs;

use super::*;
use ostra_masks::LabelId;
use ostra_project::review::Review;

fn window() -> Window {
    let shell = Shell::new(Prefs::default(), None);
    Window::with(shell, Recent::default(), &Context::default())
}

fn target(path: &Path, may_replace: bool) -> RecipeTarget {
    RecipeTarget {
        path: path.to_owned(),
        may_replace,
    }
}

#[test]
fn recipe_replaces_a_changed_file_only_if_the_user_agreed() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("recipe.json");
    let mut window = window();
    window.save_recipe(&target(&path, false));
    let recipe = fs::read_to_string(&path).unwrap();
    window.save_recipe(&target(&path, false));
    assert!(window.shell.view.notices.shown().is_empty(), "unchanged");

    fs::write(&path, "notes of the user").unwrap();
    window.save_recipe(&target(&path, false));
    assert_eq!(fs::read_to_string(&path).unwrap(), "notes of the user");
    assert!(!window.shell.view.notices.shown().is_empty());

    window.save_recipe(&target(&path, true));
    assert_eq!(fs::read_to_string(&path).unwrap(), recipe);
}

#[test]
fn counts_of_a_closed_project_are_dropped() {
    let mut window = window();
    window.shell.view.frames.review.confirmed = 3;
    let before = window.revision;
    window.take(Event::Closed);
    assert_eq!(window.shell.view.frames.review, Review::default());
    assert_ne!(window.revision, before, "and counted again");
}

#[test]
fn prompt_without_effect_is_reported_until_something_changes() {
    let mut window = window();
    let text = "The click changed nothing: 'leaf' is here already";
    window.take(Event::Unchanged {
        frame: 0,
        label: LabelId(1),
        text: text.into(),
    });
    assert_eq!(window.shell.view.note, text);
    let reported = |window: &Window| format!("{:?}", window.shell.view.answer).contains(text);
    assert!(reported(&window));
    window.take(Event::Changed);
    assert!(!reported(&window));
}

#[test]
fn project_opens_at_the_frame_that_was_shown_last() {
    let mut window = window();
    let [a, b] = ["/projects/a", "/projects/b"].map(PathBuf::from);
    let shown = |window: &mut Window, root: &PathBuf| {
        window.take(Event::Opened(root.clone()));
        window.shell.view.frame
    };
    assert_eq!(shown(&mut window, &a), 0);
    window.shell.view.frame = 7;
    window.follow_view();
    assert_eq!(shown(&mut window, &b), 0);
    window.follow_view();
    assert_eq!(shown(&mut window, &a), 7);
    window.take(Event::Closed);
    window.follow_view();
    assert_eq!(shown(&mut window, &a), 7, "nothing was shown in between");
}

#[test]
fn options_of_an_interrupted_reconstruction_return_to_the_form() {
    let mut window = window();
    let request = ostra_project::ReconstructRequest {
        every: 4,
        pairs: vec![[0, 12], [3, 40]],
        ..Default::default()
    };
    window.shell.view.set_reconstruction(&request);
    assert_eq!(window.shell.view.reconstruct.every, 4);
    assert_eq!(window.shell.view.pairs_text, "0,12 3,40");
}
