use super::{PixelState, close_blind};
use ostra_masks::{LabelId, LabelMask};

/// Runs `close_blind` on an image drawn with letters.
///
/// `c` is selected, `o` is another point and a blank is unknown. Digits are the labels of the mask.
fn closed(pixels: &[&str], labels: &[&str]) -> Vec<String> {
    let kind = |letter: u8| match letter {
        b'c' => PixelState::Chosen,
        b'o' => PixelState::Other,
        _ => PixelState::Blind,
    };
    let mut found: Vec<PixelState> = pixels
        .iter()
        .flat_map(|row| row.bytes())
        .map(kind)
        .collect();
    let ids = labels
        .iter()
        .flat_map(|row| row.bytes())
        .map(|digit| LabelId(u16::from(digit - b'0')))
        .collect();
    let (width, height) = (pixels[0].len() as u32, pixels.len() as u32);
    close_blind(&mut found, &LabelMask { width, height, ids });
    let letter = |pixel: &PixelState| match pixel {
        PixelState::Chosen => 'c',
        PixelState::Other => 'o',
        PixelState::Blind => ' ',
    };
    found
        .chunks(width as usize)
        .map(|row| row.iter().map(letter).collect())
        .collect()
}

#[test]
fn unknown_pixels_follow_the_nearest_of_their_label() {
    assert_eq!(closed(&["c  o"], &["1111"]), ["cc o"]);
    assert_eq!(
        closed(&["c  o"], &["1121"]),
        ["cc o"],
        "one of another label does not"
    );
    assert_eq!(closed(&["c   "], &["2111"]), ["c   "]);
}

#[test]
fn enclosed_unlabelled_holes_are_closed() {
    let ring = [
        "ccccccccc",
        "c       c",
        "c       c",
        "c       c",
        "c       c",
        "c       c",
        "ccccccccc",
    ];
    let labels = [
        "111111111",
        "100000001",
        "100000001",
        "100000001",
        "100000001",
        "100000001",
        "111111111",
    ];
    assert!(closed(&ring, &labels).iter().all(|row| row == "ccccccccc"));
    let (mut open, mut unlabelled) = (ring, labels);
    (open[3], unlabelled[3]) = ("c        ", "100000000");
    assert_eq!(closed(&open, &unlabelled), open);
    let mut around = ring;
    around[3] = "c   o   c";
    assert_eq!(
        closed(&around, &labels),
        around,
        "what sees something else stays"
    );
}
