use std::collections::BTreeMap;

use super::first_pair::Start;
use super::register::Refusal;
use super::state::Mapper;
use ostra_core::job::Stopped;

/// Points that an image must see to stay in the model.
const LEAST_POINTS: usize = 15;

impl Mapper<'_> {
    /// Places the images whose poses are given, with the points that they share.
    ///
    /// # Errors
    /// [`Stopped`]
    pub fn start_from_given(&mut self) -> Result<Option<Start>, Stopped> {
        let problem = self.problem;
        let given = || {
            problem
                .images
                .iter()
                .zip(0u32..)
                .filter_map(|(image, i)| Some((i, image.given?)))
        };
        if given().count() < 2 {
            return Ok(None);
        }
        given().for_each(|(image, pose)| self.place(image, pose));
        for (image, _) in given() {
            self.progress.check()?;
            self.triangulate_image(image);
        }
        self.adjust_all()?;
        Ok(Some(Start::Given))
    }

    /// Places one image after the other until none can be placed; gives why those left over were refused.
    ///
    /// # Errors
    /// [`Stopped`]
    pub fn grow(&mut self) -> Result<BTreeMap<u32, Refusal>, Stopped> {
        let mut refused: BTreeMap<u32, Refusal> = BTreeMap::new();
        let mut adjusted = self.size();
        let mut settled = false;
        loop {
            let open = (0..self.problem.images.len() as u32)
                .filter(|&image| self.is_open(image))
                .count();
            let placed = self.model.placed().count();
            self.progress.step(placed, placed + open)?;
            let before = refused
                .iter()
                .map(|(&image, refusal)| (image, refusal.seen))
                .collect();
            let Some(image) = self.candidates(&before).first().copied() else {
                if settled {
                    break;
                }
                self.adjust_all()?;
                self.drop_lost(&mut refused);
                (adjusted, settled) = (self.size(), true);
                continue;
            };
            if let Err(refusal) = self.register(image) {
                refused.insert(image, refusal);
                continue;
            }
            settled = false;
            self.triangulate_image(image);
            self.adjust_around(image)?;
            if self.has_grown(adjusted) {
                self.adjust_all()?;
                self.drop_lost(&mut refused);
                adjusted = self.size();
            }
        }
        self.adjust_finally()?;
        self.drop_lost(&mut refused);
        refused.retain(|&image, _| self.is_open(image));
        Ok(refused)
    }

    /// Images and points.
    fn size(&self) -> (usize, usize) {
        (self.model.placed().count(), self.model.points().count())
    }

    fn has_grown(&self, since: (usize, usize)) -> bool {
        let now = self.size();
        let grown =
            |now: usize, since: usize| now as f64 >= self.options.global_growth * since as f64;
        grown(now.0, since.0) || grown(now.1, since.1)
    }

    /// Takes out images that see next to nothing any more.
    fn drop_lost(&mut self, refused: &mut BTreeMap<u32, Refusal>) {
        let lost: Vec<u32> = self
            .model
            .placed()
            .filter(|&image| self.problem.images[image as usize].given.is_none())
            .filter(|&image| self.model.points_seen(image) < LEAST_POINTS)
            .collect();
        for image in lost {
            let agreeing = self.model.points_seen(image);
            self.displace(image);
            refused.insert(
                image,
                Refusal {
                    seen: self.supported(image),
                    agreeing,
                },
            );
        }
    }
}
