//! The frame shown is the frame asked for, for every codec and container.
