//! Every job stops at once, keeps what it finished, and uses a bounded share of memory.
