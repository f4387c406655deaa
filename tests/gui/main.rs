//! Integration tests: the window's panels, by accessible role and label.

mod canvas;
mod desk;
mod dialogs;
mod gallery;
mod keys;
mod panels;
