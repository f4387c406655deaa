use super::super::heat::suppressed;
use super::super::superglue::Transport;

#[test]
fn keypoints_go_to_agreeing_ones_and_the_rest_stay_unmatched() {
    // Three of one image, two of the other; the third agrees with none.
    let agreement = [9.0, 0.0, 1.0, 8.0, 0.5, 0.2];
    let transport = Transport::new(&agreement, 2, 4.0, 100);
    assert_eq!(transport.mutual(0.2), [(0, 0), (1, 1)]);
    assert_eq!(
        Transport::new(&agreement, 2, 12.0, 100).mutual(0.2),
        [],
        "no pair agrees better"
    );
    let much = agreement.map(|value| 100.0 * value);
    assert_eq!(
        Transport::new(&much, 2, 400.0, 100).mutual(0.2),
        [(0, 0), (1, 1)],
        "nothing overflows"
    );
}

#[test]
fn column_has_one_partner() {
    let transport = Transport::new(&[6.0, 0.0, 5.0, 0.0], 2, 1.0, 100);
    assert_eq!(
        transport
            .mutual(0.0)
            .iter()
            .filter(|pair| pair.1 == 0)
            .count(),
        1
    );
}

#[test]
fn value_exceeded_only_by_a_suppressed_one_returns() {
    // Three heights, each within reach of the next: the middle one is suppressed, so the last
    // stays.
    let mut values = vec![0.1; 30];
    (values[5], values[8], values[11]) = (0.9, 0.8, 0.7);
    let kept = suppressed(&values, 30, 4);
    let kept: Vec<usize> = (0..30).filter(|&at| kept[at] && values[at] > 0.5).collect();
    assert_eq!(kept, [5, 11]);
}
