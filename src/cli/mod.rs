//! The command line: words → `Command`s, a Session driven to rest, progress lines, exit codes.
//!
//! May use: session, view, nouns of the lower rooms; `app` only to start the window.
//! Must not touch: anything that the window cannot do.
