//! Setting the scale changes every result together.
