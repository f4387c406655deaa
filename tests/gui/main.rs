//! Integration tests of the window's panels, found by accessible role and label.

#[cfg(test)]
#[path = "../support/data.rs"]
#[expect(
    dead_code,
    reason = "the accuracy tests use the rest of what the tests share"
)]
mod data;
#[cfg(test)]
#[path = "../support/generated_page.rs"]
mod generated_page;

#[cfg(test)]
mod accessibility;
#[cfg(test)]
mod answers;
#[cfg(test)]
mod book;
#[cfg(test)]
mod camera_models;
#[cfg(test)]
mod canvas;
#[cfg(test)]
mod conflicts;
#[cfg(test)]
mod counts;
#[cfg(test)]
mod desk;
#[cfg(test)]
mod dialogs;
#[cfg(test)]
mod frames;
#[cfg(test)]
mod gallery;
#[cfg(test)]
mod inspector;
#[cfg(test)]
mod instances;
#[cfg(test)]
mod keys;
#[cfg(test)]
mod labels;
#[cfg(test)]
mod layout;
#[cfg(test)]
mod matches;
#[cfg(test)]
mod measures;
#[cfg(test)]
mod menus;
#[cfg(test)]
mod networks;
#[cfg(test)]
mod opening;
#[cfg(test)]
mod panels;
#[cfg(test)]
mod playback;
#[cfg(test)]
mod preferences;
#[cfg(test)]
mod running;
#[cfg(test)]
mod scene;
#[cfg(test)]
mod scene_content;
#[cfg(test)]
mod select;
#[cfg(test)]
mod story;
#[cfg(test)]
mod text_prompts;
#[cfg(test)]
mod timeline;
#[cfg(test)]
mod tone;
