/// Folders that systems, network storage and photo programs put next to the user's files, in lower case.
const SYSTEM_FOLDERS: [&str; 16] = [
    "@eadir",
    "@tmp",
    "@recycle",
    "@recently-snapshot",
    "@sharebin",
    "@synoeastream",
    "#recycle",
    "#snapshot",
    "lost+found",
    "__macosx",
    "$recycle.bin",
    "recycler",
    "system volume information",
    "thumbs.db",
    "network trash folder",
    "temporary items",
];

/// How the names of files begin that network storage makes of an image, in lower case.
const THUMBNAIL_STARTS: [&str; 4] = [
    "synophoto_thumb",
    "synophoto_film",
    "synofile_thumb",
    "synovideo_",
];

/// Returns whether a file or folder of this name belongs to the system or to network storage, not to the user.
#[must_use]
pub fn is_system_file(name: &str) -> bool {
    let name = name.to_ascii_lowercase();
    SYSTEM_FOLDERS.contains(&name.as_str())
        || THUMBNAIL_STARTS.iter().any(|start| name.starts_with(start))
}
