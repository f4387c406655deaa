//! Projects of strangers, damaged projects, read-only folders, moved data: nothing outside the folder is touched, nothing is lost.
