mod edits;
mod folder;
mod making;
mod steps;
