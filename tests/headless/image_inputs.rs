//! Images, depth maps, cameras and folders as other programs and systems leave them.
