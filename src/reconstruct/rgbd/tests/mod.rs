//! A synthetic room, recorded by hand.

mod aligning;
mod calibrating;
mod recording;
mod room;
