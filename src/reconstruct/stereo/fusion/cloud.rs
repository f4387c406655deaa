use glam::Vec3;

use ostra_geometry::Camera;

/// A pixel that made a point.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Contributor {
    /// Which of the cloud's views.
    pub view: u32,
    /// The pixel of that view's raster, row by row.
    pub pixel: u32,
}

/// A view that gave points.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FusedView {
    /// Frame number.
    pub frame: usize,
    /// The raster that its depth lies on, without distortion.
    pub raster: Camera,
    /// The frame's own camera.
    pub camera: Camera,
}

/// Points and the very pixels that made each. All vectors but `offsets` and `contributors` have a value per point.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct DenseCloud {
    /// Positions in world units.
    pub positions: Vec<Vec3>,
    /// Unit normals towards the cameras; zero = unknown.
    pub normals: Vec<Vec3>,
    /// sRGB.
    pub colors: Vec<[u8; 3]>,
    /// First contributor of each point, then the number of all.
    pub offsets: Vec<u32>,
    /// The pixels that made the points, those of a point together; each pixel once.
    pub contributors: Vec<Contributor>,
    /// The views, as contributors number them.
    pub views: Vec<FusedView>,
}

impl DenseCloud {
    /// Number of points.
    #[must_use]
    pub fn len(&self) -> usize {
        self.positions.len()
    }

    /// Whether there are no points.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.positions.is_empty()
    }

    /// The pixels that made a point.
    #[must_use]
    pub fn contributors(&self, point: usize) -> &[Contributor] {
        &self.contributors[self.offsets[point] as usize..self.offsets[point + 1] as usize]
    }

    /// Column and row of the frame's picture that a contributor lies in; `None` outside it.
    #[must_use]
    pub fn frame_pixel(&self, contributor: Contributor) -> Option<(u32, u32)> {
        let view = &self.views[contributor.view as usize];
        let (x, y) = (
            contributor.pixel % view.raster.width,
            contributor.pixel / view.raster.width,
        );
        let at_px = glam::DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5);
        let at_px = view
            .camera
            .project(view.raster.unproject(at_px).extend(1.0))?;
        view.camera
            .contains(at_px)
            .then_some((at_px.x as u32, at_px.y as u32))
    }
}
