use std::cmp::Ordering;

/// Natural order of names: runs of digits compare as numbers (`2` before `10`), the rest by character, folder by
/// folder along `/`. Names that differ in nothing but leading zeros follow in byte order, so that only equal names
/// compare equal.
pub fn natural_order(a: &str, b: &str) -> Ordering {
    let parts = a
        .split('/')
        .zip(b.split('/'))
        .map(|(a, b)| compare_parts(a, b));
    let depth = || a.split('/').count().cmp(&b.split('/').count());
    parts
        .fold(Ordering::Equal, Ordering::then)
        .then_with(depth)
        .then_with(|| a.cmp(b))
}

fn compare_parts(a: &str, b: &str) -> Ordering {
    let (mut a, mut b) = (a, b);
    while let (Some(first_a), Some(first_b)) = (a.chars().next(), b.chars().next()) {
        let order = if first_a.is_ascii_digit() && first_b.is_ascii_digit() {
            compare_numbers(take_digits(&mut a), take_digits(&mut b))
        } else {
            (a, b) = (&a[first_a.len_utf8()..], &b[first_b.len_utf8()..]);
            first_a.cmp(&first_b)
        };
        if order.is_ne() {
            return order;
        }
    }
    a.len().cmp(&b.len())
}

fn take_digits<'a>(text: &mut &'a str) -> &'a str {
    let end = text
        .find(|c: char| !c.is_ascii_digit())
        .unwrap_or(text.len());
    let (digits, rest) = text.split_at(end);
    *text = rest;
    digits
}

/// Compares numbers of any length without parsing them.
fn compare_numbers(a: &str, b: &str) -> Ordering {
    let (a, b) = (a.trim_start_matches('0'), b.trim_start_matches('0'));
    a.len().cmp(&b.len()).then_with(|| a.cmp(b))
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn numbers_count_and_folders_stay_together() {
        let mut names = [
            "10.png",
            "9.png",
            "a/2.png",
            "a-b/1.png",
            "a/10.png",
            "img_2b.png",
            "img_02a.png",
            "B.png",
        ];
        names.sort_by(|a, b| natural_order(a, b));
        assert_eq!(
            names,
            [
                "9.png",
                "10.png",
                "B.png",
                "a/2.png",
                "a/10.png",
                "a-b/1.png",
                "img_02a.png",
                "img_2b.png"
            ]
        );
    }

    #[test]
    fn numbers_longer_than_any_integer() {
        let (a, b) = (
            format!("1{}.png", "0".repeat(40)),
            format!("2{}.png", "0".repeat(39)),
        );
        assert_eq!(natural_order(&b, &a), Ordering::Less);
        assert_eq!(natural_order("007", "7"), Ordering::Less);
        assert_eq!(natural_order("7", "7"), Ordering::Equal);
    }

    proptest! {
        #[test]
        fn it_is_a_total_order(a in "[a0-1/é]{0,6}", b in "[a0-1/é]{0,6}", c in "[a0-1/é]{0,6}") {
            prop_assert_eq!(natural_order(&a, &b), natural_order(&b, &a).reverse());
            prop_assert_eq!(natural_order(&a, &b).is_eq(), a == b);
            if natural_order(&a, &b).is_le() && natural_order(&b, &c).is_le() {
                prop_assert!(natural_order(&a, &c).is_le());
            }
        }
    }
}
