//! Masks and labels as other programs write them.
