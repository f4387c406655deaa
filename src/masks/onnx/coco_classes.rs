/// The classes of COCO in the order in which networks number them.
///
/// Lin et al.: "Microsoft COCO: Common Objects in Context", ECCV 2014.
pub(super) const CLASSES: [&str; 80] = [
    "person",
    "bicycle",
    "car",
    "motorcycle",
    "airplane",
    "bus",
    "train",
    "truck",
    "boat",
    "traffic light",
    "fire hydrant",
    "stop sign",
    "parking meter",
    "bench",
    "bird",
    "cat",
    "dog",
    "horse",
    "sheep",
    "cow",
    "elephant",
    "bear",
    "zebra",
    "giraffe",
    "backpack",
    "umbrella",
    "handbag",
    "tie",
    "suitcase",
    "frisbee",
    "skis",
    "snowboard",
    "sports ball",
    "kite",
    "baseball bat",
    "baseball glove",
    "skateboard",
    "surfboard",
    "tennis racket",
    "bottle",
    "wine glass",
    "cup",
    "fork",
    "knife",
    "spoon",
    "bowl",
    "banana",
    "apple",
    "sandwich",
    "orange",
    "broccoli",
    "carrot",
    "hot dog",
    "pizza",
    "donut",
    "cake",
    "chair",
    "couch",
    "potted plant",
    "bed",
    "dining table",
    "toilet",
    "tv",
    "laptop",
    "mouse",
    "remote",
    "keyboard",
    "cell phone",
    "microwave",
    "oven",
    "toaster",
    "sink",
    "refrigerator",
    "book",
    "clock",
    "vase",
    "scissors",
    "teddy bear",
    "hair drier",
    "toothbrush",
];

/// Returns the class that a phrase names.
///
/// The class name is matched in lower case, in singular or plural, with or without an article.
pub(super) fn class_of(phrase: &str) -> Option<usize> {
    let words = phrase
        .split_whitespace()
        .map(str::to_lowercase)
        .collect::<Vec<_>>()
        .join(" ");
    let plain = ["a ", "an ", "the "]
        .iter()
        .find_map(|article| words.strip_prefix(article))
        .unwrap_or(&words);
    let one = CLASSES.iter().position(|class| *class == plain);
    let many = || {
        CLASSES
            .iter()
            .position(|class| plurals(class).iter().any(|many| many == plain))
    };
    one.or_else(many)
}

fn plurals(class: &str) -> [String; 2] {
    let irregular = match class {
        "person" => Some("people".to_owned()),
        "sheep" | "skis" | "scissors" => Some(class.to_owned()),
        "mouse" => Some("mice".to_owned()),
        "knife" => Some("knives".to_owned()),
        _ => None,
    };
    [
        irregular.unwrap_or_else(|| format!("{class}s")),
        format!("{class}es"),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn phrases_match_class_names() {
        for (phrase, class) in [
            ("banana", "banana"),
            (" Two ", ""),
            ("The  Bananas", "banana"),
            ("potted plants", "potted plant"),
            ("benches", "bench"),
            ("a Person", "person"),
            ("people", "person"),
            ("panicle", ""),
            ("", ""),
        ] {
            assert_eq!(
                class_of(phrase).map_or("", |at| CLASSES[at]),
                class,
                "{phrase}"
            );
        }
    }
}
