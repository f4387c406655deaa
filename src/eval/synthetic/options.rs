use serde::{Deserialize, Serialize};

use ostra_cloud::SceneError;

/// The kind of a synthetic scene.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum SceneKind {
    /// A rice tiller in a pot in front of a wall of posters.
    #[default]
    Tiller,
    /// A car and a figure of stacked bricks with six wheels, in front of the same wall.
    Bricks,
}

/// How the views of a synthetic scene follow each other.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ViewPath {
    /// One camera goes along the rows to and fro.
    #[default]
    ToAndFro,
    /// Each row is the path of a camera of its own, as if the scene turned before fixed cameras. The
    /// names begin with a letter of the camera.
    CameraPerRow,
}

/// Options of a synthetic scene and its cameras.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SceneOptions {
    /// Kind of scene.
    pub scene: SceneKind,
    /// Number of views along the arc, 1–10 000.
    pub views: usize,
    /// Rows of views, 1–100: arcs one above the other, with the views divided among them.
    pub rows: usize,
    /// Angle by which a row looks down more than the row below it, 0–40 degrees. All rows
    /// together may span at most 50 degrees.
    pub row_step_deg: f64,
    /// How the views follow each other.
    pub path: ViewPath,
    /// Image width, 16–8192 pixels.
    pub width: u32,
    /// Image height, 16–8192 pixels.
    pub height: u32,
    /// Angle of the arc at the specimen, 0–300 degrees.
    pub arc_deg: f64,
    /// Distance of the cameras from the centre of the specimen, 0.5–3 metres.
    pub distance_m: f64,
    /// Seed of shape, texture, arrangement and sensor noise.
    pub seed: u64,
    /// Sensor noise; `None` gives exact colour and depth.
    pub noise: Option<SensorNoise>,
}

impl Default for SceneOptions {
    fn default() -> Self {
        Self {
            scene: SceneKind::Tiller,
            views: 24,
            rows: 1,
            row_step_deg: 1.5,
            path: ViewPath::default(),
            width: 480,
            height: 640,
            arc_deg: 120.0,
            distance_m: 0.9,
            seed: 1,
            noise: None,
        }
    }
}

impl SceneOptions {
    /// Checks that every number is in its range.
    ///
    /// # Errors
    /// Returns [`SceneError::Request`] with the first number that is out of range.
    pub fn check(&self) -> Result<(), SceneError> {
        let row_span_deg = self.row_step_deg * self.rows.saturating_sub(1) as f64;
        let ranges = [
            ("number of views", self.views as f64, 1.0, 10_000.0),
            ("number of rows", self.rows as f64, 1.0, 100.0),
            ("angle between rows", self.row_step_deg, 0.0, 40.0),
            ("angle of all rows", row_span_deg, 0.0, 50.0),
            ("image width", f64::from(self.width), 16.0, 8192.0),
            ("image height", f64::from(self.height), 16.0, 8192.0),
            ("arc in degrees", self.arc_deg, 0.0, 300.0),
            ("camera distance in metres", self.distance_m, 0.5, 3.0),
        ];
        let noise = self
            .noise
            .as_ref()
            .map_or_else(Vec::new, SensorNoise::ranges);
        for (what, value, low, high) in ranges.into_iter().chain(noise) {
            if !(low..=high).contains(&value) {
                return Err(SceneError::Request(format!(
                    "the {what} is {value}; choose {low} to {high}"
                )));
            }
        }
        Ok(())
    }
}

/// Noise model of an RGB-D sensor.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct SensorNoise {
    /// Standard deviation of depth at the nearest distance, 0–0.02 metres.
    pub depth_base_m: f64,
    /// Growth of that deviation with the square of `depth − 0.4 m`, 0–0.02 per metre.
    ///
    /// Form and defaults of both are from Nguyen, Izadi, Lovell, "Modeling Kinect Sensor Noise for
    /// Improved 3D Reconstruction and Tracking", 3DIMPVT 2012.
    pub depth_growth: f64,
    /// Depth difference of neighbours above which a pixel is at an edge, 0.001–1 metres.
    pub edge_m: f64,
    /// Share of the edge pixels with a depth between front and back, 0–1.
    pub flying: f64,
    /// Share of the edge pixels without depth, 0–1.
    pub missing: f64,
    /// Quantization step of depth, 0.0001–0.01 metres.
    pub step_m: f64,
    /// Standard deviation of each colour channel, 0–50 of 255.
    pub color_sigma: f64,
}

impl Default for SensorNoise {
    fn default() -> Self {
        Self {
            depth_base_m: 0.0012,
            depth_growth: 0.0019,
            edge_m: 0.02,
            flying: 0.15,
            missing: 0.25,
            step_m: 0.001,
            color_sigma: 2.5,
        }
    }
}

impl SensorNoise {
    /// Returns each number with its name and range.
    fn ranges(&self) -> Vec<(&'static str, f64, f64, f64)> {
        vec![
            ("depth noise in metres", self.depth_base_m, 0.0, 0.02),
            ("growth of depth noise", self.depth_growth, 0.0, 0.02),
            ("depth edge in metres", self.edge_m, 0.001, 1.0),
            ("share of flying pixels", self.flying, 0.0, 1.0),
            ("share of missing pixels", self.missing, 0.0, 1.0),
            ("depth step in metres", self.step_m, 0.0001, 0.01),
            ("colour noise", self.color_sigma, 0.0, 50.0),
        ]
    }
}
