use super::mismatch;
use ostra_masks::{LabelId, LabelMask};

#[test]
fn wrong_labels_and_lost_parts_conflict_but_displaced_borders_do_not() {
    let (width, height) = (40, 30);
    let block = |mask: &mut LabelMask,
                 columns: std::ops::Range<usize>,
                 rows: std::ops::Range<usize>,
                 id: u16| {
        for y in rows {
            columns
                .clone()
                .for_each(|x| mask.ids[y * width + x] = LabelId(id));
        }
    };
    let mut voted = LabelMask::empty(width as u32, height as u32);
    block(&mut voted, 2..20, 2..20, 1);
    block(&mut voted, 20..38, 2..20, 2);
    let mut mask = voted.clone();
    block(&mut mask, 19..21, 2..20, 1);
    assert!(mismatch(&mask, &voted).is_empty());
    block(&mut mask, 26..34, 8..14, 1);
    block(&mut mask, 5..12, 5..12, 0);
    let shown = mismatch(&mask, &voted);
    assert_eq!(shown.area(), 8 * 6 + 7 * 7);
    assert!(shown.at(26, 8) && shown.at(33, 13) && shown.at(5, 5) && shown.at(11, 11));
}
