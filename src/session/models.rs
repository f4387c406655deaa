use std::path::PathBuf;

use anyhow::Result;

use crate::engine::nn::{Added, Catalogue, CheckedFile, Fetched, Row, add, check, install, list, models_folder};

/// Every network that is known, and whether it is installed.
///
/// # Errors
/// When the system tells no data folder.
pub fn list_models() -> Result<Vec<Row>> {
    Ok(list(&Catalogue::bundled()?, &models_folder()?))
}

/// Takes a network (or ONNX Runtime) from files into our data folder, after checking it.
///
/// # Errors
/// When the name is unknown, a file is not what it should be, or cannot be copied.
pub fn add_model(name: &str, files: &[PathBuf]) -> Result<Vec<Added>> {
    Ok(add(&Catalogue::bundled()?, &models_folder()?, name, files)?)
}

/// Loads an installed network and tells what it takes and gives.
///
/// # Errors
/// When it is not installed, does not load or has another interface.
pub fn check_model(name: &str) -> Result<Vec<CheckedFile>> {
    Ok(check(&Catalogue::bundled()?, &models_folder()?, name)?)
}

/// Gets a network (or ONNX Runtime) from the net into our data folder and checks it; `told` hears how far it is and whether
/// to go on. What a broken download left is continued.
///
/// # Errors
/// When the name is unknown, it has no address, a download fails, or a file is not what it should be.
pub fn install_model(name: &str, told: &mut dyn FnMut(Fetched<'_>) -> bool) -> Result<Vec<Added>> {
    Ok(install(&Catalogue::bundled()?, &models_folder()?, name, told)?)
}
