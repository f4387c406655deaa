//! Projected coordinates keep millimetres.
