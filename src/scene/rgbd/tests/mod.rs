//! A made room, recorded by hand.

mod aligning;
mod recording;
mod room;
