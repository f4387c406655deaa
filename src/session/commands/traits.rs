use std::path::Path;

use anyhow::Result;

use ostra_cloud::LabelledCloud;
use ostra_cloud::measure::{LengthUnit, MeasureOptions, measure, measure_angles, traits_csv};
use ostra_core::job::Progress;
use ostra_project::ExportRequest;
use ostra_project::store::replace;

/// Measures every label of a cloud and the angles asked for, and writes the table, lengths in the unit asked for or else in the scene's.
pub fn write(
    path: &Path,
    cloud: &LabelledCloud,
    request: &ExportRequest,
    of_scene: LengthUnit,
    progress: &Progress,
) -> Result<()> {
    let options = MeasureOptions {
        level: request.level,
        ground: request.ground,
        ..MeasureOptions::default()
    };
    let mut rows = measure(cloud, &options, progress)?;
    rows.extend(measure_angles(cloud, &request.angles, &options, progress)?);
    super::make_folder_of(path)?;
    replace(
        path,
        traits_csv(&rows, request.unit.unwrap_or(of_scene)).as_bytes(),
    )
}
