//! Integration tests: the window's panels, by accessible role and label.

#[cfg(test)]
#[path = "../support/mod.rs"]
#[expect(dead_code, reason = "only part of what the tests share is used here")]
mod support;

#[cfg(test)]
mod asking;
#[cfg(test)]
mod canvas;
#[cfg(test)]
mod desk;
#[cfg(test)]
mod dialogs;
#[cfg(test)]
mod doubt;
#[cfg(test)]
mod gallery;
#[cfg(test)]
mod instances;
#[cfg(test)]
mod keys;
#[cfg(test)]
mod matches;
#[cfg(test)]
mod measures;
#[cfg(test)]
mod panels;
#[cfg(test)]
mod scene;
#[cfg(test)]
mod select;
#[cfg(test)]
mod story;
#[cfg(test)]
mod timeline;
#[cfg(test)]
mod words;
