//! The shared folders that real-data tests read.

use crate::support::{data_dir, models_dir};

#[test]
fn each_data_set_says_what_it_is() {
    let Some(data) = data_dir() else { return };
    for entry in std::fs::read_dir(data).unwrap() {
        let path = entry.unwrap().path();
        assert!(
            !path.is_dir() || path.join("README.md").is_file(),
            "{} has no README.md",
            path.display()
        );
    }
}

#[test]
fn no_network_is_an_empty_file() {
    let Some(models) = models_dir() else { return };
    for entry in std::fs::read_dir(models).unwrap() {
        let path = entry.unwrap().path();
        assert!(
            path.metadata().unwrap().len() > 0,
            "{} is empty",
            path.display()
        );
    }
}
