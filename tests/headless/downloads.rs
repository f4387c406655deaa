//! Nothing unverified is installed or run.
