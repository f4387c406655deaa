use std::collections::BTreeMap;

/// Words in file names that say what a picture holds, not which one it is.
const ROLE_WORDS: [&str; 5] = ["color", "colour", "rgb", "image", "depth"];

/// Which depth belongs to which picture: for each picture the index of its depth.
#[derive(Debug, PartialEq, Eq)]
pub(super) struct Pairs {
    /// One entry a picture.
    pub depth_of: Vec<Option<usize>>,
    used: Vec<bool>,
}

impl Pairs {
    /// No pairs among so many pictures and depths.
    pub fn none(pictures: usize, depths: usize) -> Self {
        Self {
            depth_of: vec![None; pictures],
            used: vec![false; depths],
        }
    }

    /// How many pictures have a depth.
    pub fn count(&self) -> usize {
        self.depth_of.iter().flatten().count()
    }

    /// Pairs the two unless one of them has a partner.
    pub fn join(&mut self, picture: usize, depth: usize) {
        if self.depth_of[picture].is_none() && !self.used[depth] {
            self.depth_of[picture] = Some(depth);
            self.used[depth] = true;
        }
    }

    /// Pairs what has the same key, where only one picture and one depth have it.
    fn join_by_key(
        &mut self,
        pictures: &[&str],
        depths: &[&str],
        key: impl Fn(&str) -> Option<String>,
    ) {
        let (pictures, depths) = (unique_by_key(pictures, &key), unique_by_key(depths, &key));
        for (key, picture) in pictures {
            if let (Some(picture), Some(Some(depth))) = (picture, depths.get(&key)) {
                self.join(picture, *depth);
            }
        }
    }
}

/// Adds pairs by name: first by the path without its ending, then without the words that tell colour from depth,
/// then by the number in the file name.
pub(super) fn pair_by_name(pairs: &mut Pairs, pictures: &[&str], depths: &[&str]) {
    pairs.join_by_key(pictures, depths, |name| Some(without_ending(name).into()));
    pairs.join_by_key(pictures, depths, |name| {
        Some(without_role(without_ending(name)))
    });
    let position = [Position::Last, Position::First]
        .into_iter()
        .max_by_key(|position| {
            let mut trial = Pairs::none(pictures.len(), depths.len());
            trial.join_by_key(pictures, depths, |name| {
                number_in_file_name(name, *position)
            });
            (trial.count(), *position == Position::Last)
        });
    let position = position.unwrap_or(Position::Last);
    pairs.join_by_key(pictures, depths, |name| {
        Some(format!(
            "{}/{}",
            folder_of(name),
            number_in_file_name(name, position)?
        ))
    });
    pairs.join_by_key(pictures, depths, |name| number_in_file_name(name, position));
}

/// Which number of a file name counts.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Position {
    First,
    Last,
}

fn unique_by_key(
    names: &[&str],
    key: impl Fn(&str) -> Option<String>,
) -> BTreeMap<String, Option<usize>> {
    let mut by_key = BTreeMap::new();
    for (index, name) in names.iter().enumerate() {
        if let Some(key) = key(name) {
            by_key
                .entry(key)
                .and_modify(|one| *one = None)
                .or_insert(Some(index));
        }
    }
    by_key
}

/// The name up to the last dot of its last part.
pub(super) fn without_ending(name: &str) -> &str {
    let file = name.rfind('/').map_or(0, |slash| slash + 1);
    name[file..]
        .rfind('.')
        .map_or(name, |dot| &name[..file + dot])
}

fn folder_of(name: &str) -> &str {
    name.rfind('/').map_or("", |slash| &name[..slash])
}

fn file_of(name: &str) -> &str {
    name.rfind('/').map_or(name, |slash| &name[slash + 1..])
}

/// Whether a word of the file name is `depth`.
pub(super) fn says_depth(name: &str) -> bool {
    words_of(without_ending(name)).any(|word| word.eq_ignore_ascii_case("depth"))
}

fn words_of(name: &str) -> impl Iterator<Item = &str> {
    file_of(name).split(['.', '_', '-'])
}

/// The name without the words that tell colour from depth, e.g. `frame-7.color` → `frame-7`.
pub(super) fn without_role(name: &str) -> String {
    let is_role = |word: &&str| {
        ROLE_WORDS
            .iter()
            .any(|role| word.eq_ignore_ascii_case(role))
    };
    let words: Vec<&str> = words_of(name).filter(|word| !is_role(word)).collect();
    format!("{}/{}", folder_of(name), words.join("-"))
}

/// A number of the file name without leading zeros, as text, so that it can have any length.
fn number_in_file_name(name: &str, position: Position) -> Option<String> {
    let stem = file_of(without_ending(name));
    let mut runs = stem
        .split(|c: char| !c.is_ascii_digit())
        .filter(|run| !run.is_empty());
    let run = match position {
        Position::First => runs.next(),
        Position::Last => runs.next_back(),
    }?;
    let number = run.trim_start_matches('0');
    Some(if number.is_empty() {
        "0".into()
    } else {
        number.into()
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pair(pictures: &[&str], depths: &[&str]) -> Vec<Option<usize>> {
        let mut pairs = Pairs::none(pictures.len(), depths.len());
        pair_by_name(&mut pairs, pictures, depths);
        pairs.depth_of
    }

    #[test]
    fn by_name_without_ending() {
        assert_eq!(
            pair(&["a/x.jpg", "a/y.jpg", "b/x.jpg"], &["a/x.png", "b/x.png"]),
            [Some(0), None, Some(1)]
        );
    }

    #[test]
    fn by_name_without_the_words_color_and_depth() {
        let pictures = ["frame-000000.color.png", "frame-000001.color.png"];
        assert_eq!(
            pair(
                &pictures,
                &["frame-000001.depth.png", "frame-000000.depth.png"]
            ),
            [Some(1), Some(0)]
        );
    }

    #[test]
    fn by_number_with_other_padding() {
        assert_eq!(
            pair(&["9.jpg", "10.jpg", "11.jpg"], &["d009.png", "d010.png"]),
            [Some(0), Some(1), None]
        );
        assert_eq!(
            pair(&["98.jpg", "100.jpg"], &["098.png", "100.png"]),
            [Some(0), Some(1)]
        );
    }

    #[test]
    fn by_the_first_number_where_a_time_follows() {
        let depths = ["0000001-000000000040.png", "0000002-000000033407.png"];
        assert_eq!(
            pair(
                &["0000001-000000000000.jpg", "0000002-000000033369.jpg"],
                &depths
            ),
            [Some(0), Some(1)]
        );
    }

    #[test]
    fn an_ambiguous_number_pairs_nothing() {
        assert_eq!(
            pair(&["left_1.jpg", "right_1.jpg"], &["d1.png"]),
            [None, None]
        );
        assert_eq!(
            pair(&["a/img1.jpg", "b/img1.jpg"], &["b/d1.png", "a/d1.png"]),
            [Some(1), Some(0)]
        );
    }
}
