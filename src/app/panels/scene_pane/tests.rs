use super::*;
use ostra_view::Bounds;

#[test]
fn clip_box_and_both_eyes_follow_the_scale() {
    let mut pane = ScenePane::new(None);
    let (min, max) = (Vec3::ZERO, Vec3::ONE);
    pane.through = Some(Orbit::framing(&Bounds { min, max }, Vec3::Z, Vec3::NEG_Y));
    pane.orbit = pane.through;
    pane.framed.extent = Some(Bounds { min, max });
    let before = pane.orbit.unwrap();
    pane.scale_by(0.25);
    let extent = pane.framed.extent.unwrap();
    assert_eq!((extent.min, extent.max), (0.25 * min, 0.25 * max));
    assert_eq!(pane.orbit, pane.through);
    assert_eq!(pane.orbit.unwrap().distance, 0.25 * before.distance);
}

#[test]
fn nothing_of_the_previous_project_remains() {
    let (mut pane, rect) = (
        ScenePane::new(None),
        Rect::from_x_y_ranges(0.0..=9.0, 0.0..=9.0),
    );
    let (min, max) = (Vec3::ZERO, Vec3::ONE);
    pane.through = Some(Orbit::framing(&Bounds { min, max }, Vec3::Z, Vec3::NEG_Y));
    pane.orbit = pane.through;
    let at = Some(rect.left_top());
    assert!(pane.inspected_place.turn_away(rect, None, Vec3::X, at));
    pane.clear();
    assert_eq!((pane.orbit, pane.through), (None, None));
    assert_eq!(pane.inspected_place, InspectedPlace::default());
}
