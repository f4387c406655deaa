//! Exports never replace sources, and other programs can read them.
