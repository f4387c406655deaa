use super::plane::Plane;

/// Hypotheses and costs of a picture, the pixels of each colour of the checkerboard apart, so that one colour can be
/// worked on while the other is read.
#[derive(Debug, Clone)]
pub struct Field {
    /// Columns of the picture.
    pub width: usize,
    /// Rows of the picture.
    pub height: usize,
    /// Red, then black.
    pub colors: [Color; 2],
}

/// The pixels of one colour, `⌈width / 2⌉` a row.
#[derive(Debug, Clone)]
pub struct Color {
    /// The best hypothesis so far.
    pub planes: Vec<Plane>,
    /// Its cost, 0–2.
    pub costs: Vec<f32>,
}

impl Field {
    /// A field of one hypothesis everywhere that costs most.
    pub fn new(width: usize, height: usize) -> Self {
        let count = width.div_ceil(2) * height;
        let color = Color {
            planes: vec![Plane::default(); count],
            costs: vec![super::ncc::WORST; count],
        };
        Self {
            width,
            height,
            colors: [color.clone(), color],
        }
    }

    /// Pixels of one colour in a row.
    #[inline(always)]
    pub fn half(&self) -> usize {
        self.width.div_ceil(2)
    }

    /// The hypothesis and cost of a pixel.
    pub fn at(&self, x: usize, y: usize) -> (Plane, f32) {
        let color = &self.colors[(x + y) % 2];
        let at = y * self.half() + x / 2;
        (color.planes[at], color.costs[at])
    }

    /// Puts a hypothesis and its cost.
    pub fn set(&mut self, x: usize, y: usize, plane: Plane, cost: f32) {
        let at = y * self.half() + x / 2;
        let color = &mut self.colors[(x + y) % 2];
        (color.planes[at], color.costs[at]) = (plane, cost);
    }
}
