//! Checks of the shared folders that real-data tests read.

use crate::data::{data_dir, models_dir};

fn every_data_set_has_a_readme() {
    let data = data_dir();
    for entry in std::fs::read_dir(data).unwrap() {
        let path = entry.unwrap().path();
        assert!(
            !path.is_dir() || path.join("README.md").is_file(),
            "{} has no README.md",
            path.display()
        );
    }
}

fn no_network_is_an_empty_file() {
    let models = models_dir();
    for entry in std::fs::read_dir(models).unwrap() {
        let path = entry.unwrap().path();
        assert!(
            path.metadata().unwrap().len() > 0,
            "{} is empty",
            path.display()
        );
    }
}

crate::registry::tests! {
    Data(&[]) => every_data_set_has_a_readme;
    Models => no_network_is_an_empty_file;
}
