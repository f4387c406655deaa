use std::sync::Arc;

use egui::{Color32, ComboBox, FontId, Pos2, Rect, Stroke, Ui, Vec2};

use super::canvas::CanvasMap;
use super::{Action, ViewState};
use ostra_frames::{Frame, FrameStore};
use ostra_session::Drawings;
use ostra_view::{Layer, LayerPicture, draw_layer, ramp};

/// Depth and the like, drawn as pictures on a worker thread, by frame number.
pub type Layers = Drawings<(usize, Layer), Drawn>;

/// The picture, `None` where the frame has no such layer, or why it cannot be read.
pub type Drawn = Result<Option<LayerPicture>, String>;

/// Draws layers of `frames` from what `store` loads.
#[must_use]
pub fn layers_of(
    frames: Arc<Vec<Frame>>,
    store: Arc<FrameStore>,
    notify: impl Fn() + Send + Sync + 'static,
) -> Layers {
    let draw = move |&(number, layer): &(usize, Layer)| match frames.get(number) {
        Some(frame) => draw_layer(layer, frame, &store).map_err(|error| error.to_string()),
        None => Ok(None),
    };
    Layers::new(draw, notify)
}

/// The choice of what is shown of a frame.
pub(super) fn layer_ui(ui: &mut Ui, view: &mut ViewState) {
    let tip = view.prefs.shortcuts.tip(ui.ctx(), Action::NextLayer);
    let choice = ComboBox::from_id_salt("layer")
        .selected_text(view.layer.text())
        .width(92.0)
        .show_ui(ui, |ui| {
            for layer in Layer::ALL {
                ui.selectable_value(&mut view.layer, layer, layer.text());
            }
        });
    choice
        .response
        .on_hover_text(tip)
        .accessible_name("Shown layer");
}

/// What the colours of the ramp stand for, in the picture's lower left corner, under a title.
pub(super) fn legend(ui: &Ui, map: &CanvasMap, title: &str, range: [f32; 2]) {
    const SIZE: Vec2 = Vec2::new(14.0, 120.0);
    const TITLE: f32 = 20.0;
    let painter = ui.painter_at(map.pane);
    let corner = map.pane.left_bottom() + Vec2::new(14.0, -14.0);
    let bar = Rect::from_min_size(corner - Vec2::new(0.0, SIZE.y), SIZE);
    let title = painter.layout_no_wrap(title.into(), FontId::proportional(12.0), Color32::WHITE);
    let back = bar
        .expand2(Vec2::new(8.0, 10.0))
        .with_min_y(bar.min.y - TITLE - 10.0);
    let back = back.with_max_x(bar.max.x + 62.0).union(Rect::from_min_size(
        back.min,
        title.size() + Vec2::splat(16.0),
    ));
    painter.rect_filled(back, 4.0, Color32::from_black_alpha(170));
    painter.galley(
        bar.left_top() - Vec2::new(0.0, TITLE),
        title,
        Color32::WHITE,
    );
    for step in 0..SIZE.y as usize {
        let [r, g, b] = ramp(step as f32 / SIZE.y);
        let y = bar.max.y - step as f32 - 0.5;
        painter.hline(
            bar.x_range(),
            y,
            Stroke::new(1.0, Color32::from_rgb(r, g, b)),
        );
    }
    for share in [0.0, 0.5, 1.0] {
        let value = range[0] + share * (range[1] - range[0]);
        let galley =
            painter.layout_no_wrap(short(value), FontId::proportional(12.0), Color32::WHITE);
        let at = Pos2::new(
            bar.max.x + 6.0,
            bar.max.y - share * SIZE.y - galley.size().y / 2.0,
        );
        painter.galley(at, galley, Color32::WHITE);
    }
}

/// Three significant digits.
fn short(value: f32) -> String {
    let digits = if value == 0.0 {
        0
    } else {
        2 - value.abs().log10().floor() as i32
    };
    format!("{value:.*}", digits.clamp(0, 9) as usize)
}

#[cfg(test)]
mod tests {
    use super::short;

    #[test]
    fn numbers_have_three_digits() {
        let texts = [0.0, 0.51234, 5.1234, 51.234, 512.34, 5123.4].map(short);
        assert_eq!(texts, ["0", "0.512", "5.12", "51.2", "512", "5123"]);
    }
}
