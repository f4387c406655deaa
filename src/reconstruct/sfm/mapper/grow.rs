//! Growing of models one after the other, each from its first pair, image by image.

use std::collections::BTreeMap;

use glam::DVec2;

use super::MapperOptions;
use super::first_pair::ModelStart;
use super::register::Refusal;
use super::state::Mapper;
use crate::sfm::{Correspondences, IntrinsicsPrior, MapProblem, SparseModel};
use ostra_core::job::{Progress, Stopped};

/// One model, and why images that match something in it are not part of it.
#[derive(Debug, Clone)]
pub struct Mapped {
    /// The model.
    pub model: SparseModel,
    /// How it was started.
    pub start: ModelStart,
    /// Images that were tried and refused.
    pub refused: BTreeMap<u32, Refusal>,
    /// How much the matches between its images contradict its cameras, 0–1.
    pub contradiction: f64,
    /// Whether the run was stopped before every image had been tried.
    pub stopped: bool,
}

impl Mapped {
    /// Sorts models: the one with given poses first, then those with most images.
    pub(super) fn sort(models: &mut [Self]) {
        models.sort_by_key(|mapped| {
            (
                mapped.start != ModelStart::Given,
                std::cmp::Reverse(mapped.model.placed().count()),
            )
        });
    }
}

/// Focal lengths, relative to the guess, from which a start is tried if nothing is known of a camera.
const FOCAL_FACTORS: [f64; 5] = [1.0, 0.7, 1.4, 0.5, 2.0];

/// Most first pairs that are tried for a model.
const FIRST_PAIRS: usize = 4;
/// Number of images that a model has when its first pair is judged.
const JUDGED_IMAGES: usize = 8;
/// A model with fewer images only shows that its first pair agrees with itself.
const LEAST_JUDGED_IMAGES: usize = 3;
/// Contradiction up to which a first pair is kept without trying others.
///
/// On eight sets of photos and renderings, good first pairs had 0.002–0.037. A reversed one had 0.36,
/// other poor ones 0.15–0.44.
const CONSISTENT: f64 = 0.05;

/// Runs incremental structure from motion and returns the models.
///
/// Images are placed one after the other; the remaining ones form further models as long as that is
/// possible. The largest model comes first; if poses are given, the model that contains them does
/// (Schönberger & Frahm, "Structure-from-Motion Revisited", CVPR 2016). When stopped, it returns
/// what it has.
///
/// # Errors
/// [`Stopped`] before anything was placed.
pub fn map(
    problem: &MapProblem,
    options: &MapperOptions,
    progress: &Progress,
) -> Result<Vec<Mapped>, Stopped> {
    let links = Correspondences::new(problem);
    let growth = Growth {
        problem,
        links: &links,
        options,
        progress,
    };
    let mut closed = vec![false; problem.images.len()];
    let mut models: Vec<Mapped> = Vec::new();
    loop {
        let mapped = match growth.best_start(&closed) {
            Ok(Some(mapped)) => mapped,
            Err(stopped) if models.is_empty() => return Err(stopped),
            Ok(None) | Err(Stopped) => break,
        };
        for image in mapped.model.placed() {
            closed[image as usize] = true;
        }
        models.push(mapped);
    }
    Mapped::sort(&mut models);
    Ok(models)
}

/// Input that the models of a run share.
struct Growth<'a> {
    problem: &'a MapProblem,
    links: &'a Correspondences,
    options: &'a MapperOptions,
    progress: &'a Progress,
}

impl Growth<'_> {
    /// Builds one model of the images that are not `closed`.
    ///
    /// If a camera is unknown and fewer than half of the possible images are placed, several initial
    /// focal lengths are tried and the best model is kept.
    fn best_start(&self, closed: &[bool]) -> Result<Option<Mapped>, Stopped> {
        let Self {
            problem,
            options,
            progress,
            ..
        } = *self;
        let linked = |image: u32| {
            problem
                .pairs
                .iter()
                .any(|pair| pair.images.contains(&image))
        };
        let could = (0..problem.images.len() as u32)
            .filter(|&image| !closed[image as usize] && linked(image))
            .count();
        let unknown = problem
            .cameras
            .iter()
            .any(|camera| camera.source == IntrinsicsPrior::Guessed);
        let mut best: Option<Mapped> = None;
        for factor in FOCAL_FACTORS {
            let grown = match self.one_model(closed, factor) {
                Err(stopped) if best.is_none() => return Err(stopped),
                grown => grown.ok().flatten(),
            };
            let placed = |mapped: &Option<Mapped>| {
                mapped
                    .as_ref()
                    .map_or(0, |mapped| mapped.model.placed().count())
            };
            if placed(&grown) > placed(&best) {
                best = grown;
            }
            if !unknown || 2 * placed(&best) >= could || progress.check().is_err() {
                break;
            }
        }
        if let Some(best) = &mut best {
            best.stopped |= progress.check().is_err();
        }
        let (images, points) = (options.min_model_images, options.min_model_points);
        Ok(best.filter(|Mapped { model, .. }| {
            model.placed().count() >= images && model.points().count() >= points
        }))
    }

    /// Builds one model from guessed focal lengths that are multiplied by `factor`.
    fn one_model(&self, closed: &[bool], factor: f64) -> Result<Option<Mapped>, Stopped> {
        let mut mapper = self.mapper(closed, factor);
        let first = !closed.contains(&true);
        let given = if first {
            mapper.start_from_given()?
        } else {
            None
        };
        let begun = match given {
            Some(start) => Some(Begun {
                mapper,
                start,
                refused: BTreeMap::new(),
            }),
            None => self.begin_with_pair(closed, factor)?,
        };
        Ok(begun.map(Begun::grow))
    }

    /// Returns an empty model of the images that are not `closed`.
    fn mapper(&self, closed: &[bool], factor: f64) -> Mapper<'_> {
        let mut mapper = Mapper::new(self.problem, self.links, self.options, self.progress);
        mapper.closed = closed.to_vec();
        for (camera, known) in self.problem.cameras.iter().enumerate() {
            if known.source == IntrinsicsPrior::Guessed && factor != 1.0 {
                mapper.model.cameras[camera].focal_px *= DVec2::splat(factor);
                mapper.cast_rays(camera);
            }
        }
        mapper
    }

    /// Begins a model with a first pair whose images agree with further ones.
    ///
    /// Two images alone can agree with a wrong geometry, in which relief and motion are reversed.
    /// Further images can still be placed then, but their matches contradict each other. Other first
    /// pairs are tried in that case, and the one with the least contradiction is kept.
    fn begin_with_pair(&self, closed: &[bool], factor: f64) -> Result<Option<Begun<'_>>, Stopped> {
        // Images that a further first pair should not contain, and those that it may not.
        let (mut seen, mut used) = (closed.to_vec(), closed.to_vec());
        let mut best: Option<(f64, Begun<'_>)> = None;
        for _ in 0..FIRST_PAIRS {
            let mut mapper = self.mapper(closed, factor);
            let start = match mapper.start_from_pair([&seen, &used]) {
                Err(stopped) if best.is_none() => return Err(stopped),
                start => start.ok().flatten(),
            };
            let Some(start) = start else { break };
            if let ModelStart::Pair { images, .. } = start {
                for image in images {
                    used[image as usize] = true;
                    mapper.focal_known[self.problem.images[image as usize].camera] = true;
                }
            }
            let mut refused = BTreeMap::new();
            let stopped = mapper.begin(&mut refused, JUDGED_IMAGES).is_err();
            let mut contradiction = mapper.contradiction();
            if mapper.size().images < LEAST_JUDGED_IMAGES {
                contradiction += 1.0;
            }
            for image in mapper.model.placed() {
                seen[image as usize] = true;
            }
            if best
                .as_ref()
                .is_none_or(|(least, _)| contradiction < *least)
            {
                let begun = Begun {
                    mapper,
                    start,
                    refused,
                };
                best = Some((contradiction, begun));
            }
            if stopped || contradiction <= CONSISTENT {
                break;
            }
        }
        Ok(best.map(|(_, begun)| begun))
    }
}

/// A model that is being grown from its start.
struct Begun<'a> {
    mapper: Mapper<'a>,
    start: ModelStart,
    refused: BTreeMap<u32, Refusal>,
}

impl Begun<'_> {
    /// Grows the model until no image can be placed, or the run is stopped.
    fn grow(mut self) -> Mapped {
        let grown = self.mapper.grow(self.refused);
        let stopped = grown.is_err();
        Mapped {
            contradiction: self.mapper.contradiction(),
            model: self.mapper.model,
            start: self.start,
            refused: grown.unwrap_or_default(),
            stopped,
        }
    }
}

/// Number of images and points of a model.
#[derive(Clone, Copy)]
struct ModelSize {
    images: usize,
    points: usize,
}

/// Images that see fewer points than this are removed from the model.
const LEAST_POINTS: usize = 15;

impl Mapper<'_> {
    /// Places the images whose poses are given, and creates the points that they share.
    ///
    /// # Errors
    /// [`Stopped`]
    pub fn start_from_given(&mut self) -> Result<Option<ModelStart>, Stopped> {
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
        Ok(Some(ModelStart::Given))
    }

    /// Places one image after the other until none can be placed; returns why the remaining ones were refused.
    ///
    /// # Errors
    /// [`Stopped`]
    pub fn grow(
        &mut self,
        mut refused: BTreeMap<u32, Refusal>,
    ) -> Result<BTreeMap<u32, Refusal>, Stopped> {
        self.place_all(&mut refused, false)?;
        self.finish(&mut refused)?;
        Ok(refused)
    }

    /// Places images until the model has `limit` of them or none can be placed, and adjusts it.
    ///
    /// # Errors
    /// [`Stopped`]
    pub fn begin(
        &mut self,
        refused: &mut BTreeMap<u32, Refusal>,
        limit: usize,
    ) -> Result<(), Stopped> {
        while self.size().images < limit {
            let Some(image) = self.next_image(refused) else {
                break;
            };
            self.add_image(image, refused)?;
        }
        self.adjust_all()?;
        self.drop_lost(refused);
        Ok(())
    }

    /// Returns the image to be placed next.
    fn next_image(&self, refused: &BTreeMap<u32, Refusal>) -> Option<u32> {
        let before = refused
            .iter()
            .map(|(&image, refusal)| (image, refusal.seen))
            .collect();
        self.candidates(&before).first().copied()
    }

    /// Places an image with the points that it sees; returns whether it could be placed.
    fn add_image(
        &mut self,
        image: u32,
        refused: &mut BTreeMap<u32, Refusal>,
    ) -> Result<bool, Stopped> {
        if let Err(refusal) = self.register(image) {
            refused.insert(image, refusal);
            return Ok(false);
        }
        self.triangulate_image(image);
        self.adjust_around(image)?;
        Ok(true)
    }

    /// Places further images in a finished model, which is adjusted again only if there are any.
    ///
    /// `refused` holds the images that were tried in vain.
    ///
    /// # Errors
    /// [`Stopped`]
    pub fn place_more(
        &mut self,
        mut refused: BTreeMap<u32, Refusal>,
    ) -> Result<BTreeMap<u32, Refusal>, Stopped> {
        let before = self.size().images;
        self.place_all(&mut refused, true)?;
        if self.size().images > before {
            self.finish(&mut refused)?;
        }
        Ok(refused)
    }

    fn finish(&mut self, refused: &mut BTreeMap<u32, Refusal>) -> Result<(), Stopped> {
        self.adjust_finally()?;
        self.drop_lost(refused);
        refused.retain(|&image, _| self.is_open(image));
        Ok(())
    }

    /// Places images until none can be placed; `settled` says that the model is adjusted.
    fn place_all(
        &mut self,
        refused: &mut BTreeMap<u32, Refusal>,
        mut settled: bool,
    ) -> Result<(), Stopped> {
        let mut adjusted = self.size();
        loop {
            let open = (0..self.problem.images.len() as u32)
                .filter(|&image| self.is_open(image))
                .count();
            let placed = self.model.placed().count();
            self.progress.step(placed, placed + open)?;
            let Some(image) = self.next_image(refused) else {
                if settled {
                    return Ok(());
                }
                self.adjust_all()?;
                self.drop_lost(refused);
                (adjusted, settled) = (self.size(), true);
                continue;
            };
            if !self.add_image(image, refused)? {
                continue;
            }
            settled = false;
            if self.has_grown(adjusted) {
                self.adjust_all()?;
                self.drop_lost(refused);
                adjusted = self.size();
            }
        }
    }

    fn size(&self) -> ModelSize {
        ModelSize {
            images: self.model.placed().count(),
            points: self.model.points().count(),
        }
    }

    /// Returns whether the model has grown enough since the last adjustment for another one.
    fn has_grown(&self, since: ModelSize) -> bool {
        let now = self.size();
        let growth = if self.is_large() {
            self.options.large_growth
        } else {
            self.options.global_growth
        };
        let grown = |now: usize, since: usize| now as f64 >= growth * since as f64;
        grown(now.images, since.images) || grown(now.points, since.points)
    }

    /// Removes images that see almost no points any more.
    pub fn drop_lost(&mut self, refused: &mut BTreeMap<u32, Refusal>) {
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
