use super::super::descriptor::SUPPORT;
use super::super::extractor::Content;
use super::super::{SiftOptions, extract_sift};
use super::{painted, strewn};

const BAR: usize = 40;

/// Returns an image of random spots with black bars left and right.
fn barred(width: usize, height: usize) -> Vec<f32> {
    let mut grey = painted(&strewn(300, width, height), width, height);
    for row in grey.chunks_exact_mut(width) {
        row[..BAR].fill(0.0);
        row[width - BAR..].fill(3.0 / 255.0);
    }
    grey
}

#[test]
fn features_stay_away_from_black_bars() {
    let (width, height) = (320, 200);
    let features = extract_sift(
        &barred(width, height),
        width,
        height,
        None,
        &SiftOptions::default(),
    );
    assert!(features.keypoints.len() > 50);
    for keypoint in &features.keypoints {
        let reach = SUPPORT * keypoint.scale_px;
        assert!(
            keypoint.at_px.x - reach >= BAR as f32
                && keypoint.at_px.x + reach <= (width - BAR) as f32
        );
    }
    let near_top = features
        .keypoints
        .iter()
        .any(|keypoint| keypoint.at_px.y < SUPPORT * keypoint.scale_px);
    assert!(near_top, "a side without a bar must lose nothing");
}

#[test]
fn bars_are_found_on_every_side() {
    let (width, height) = (320, 200);
    let grey = barred(width, height);
    let content = Content::of(&grey, width, height);
    assert_eq!(content.columns, (40.0, 280.0));
    assert_eq!(content.rows, (f32::NEG_INFINITY, f32::INFINITY));
    let lying: Vec<f32> = (0..width * height)
        .map(|k| grey[k % height * width + k / height])
        .collect();
    assert_eq!(Content::of(&lying, height, width).rows, (40.0, 280.0));
}

#[test]
fn dark_background_is_no_bar() {
    let (width, height) = (120, 100);
    let mut grey = vec![0.0; width * height];
    for y in 45..55 {
        grey[y * width + 30..y * width + 80].fill(0.7);
    }
    let everywhere = (f32::NEG_INFINITY, f32::INFINITY);
    assert_eq!(
        Content::of(&grey, width, height),
        Content {
            columns: everywhere,
            rows: everywhere
        }
    );
    let black = vec![0.0; width * height];
    assert_eq!(
        Content::of(&black, width, height),
        Content {
            columns: everywhere,
            rows: everywhere
        }
    );
}
