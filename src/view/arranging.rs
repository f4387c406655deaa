use std::sync::mpsc::{Receiver, SendError, Sender, TryRecvError, channel};
use std::sync::{Arc, Weak};

use super::arrangement::Arrangement;
use ostra_cloud::LabelledCloud;

/// Points that are shown until all are arranged.
const SAMPLE: usize = 65_536;

/// A cloud with its arrangement.
pub(super) type Arranged = (Arc<LabelledCloud>, Arc<Arrangement>);

/// A cloud that is being arranged in the background, an even sample of it first. When this is dropped, the work ends at
/// its next step.
pub(super) struct Arranging {
    arrived: Receiver<Arc<Arrangement>>,
    _wanted: Arc<()>,
}

/// What an [`Arranging`] has to give.
pub(super) enum Arrival {
    /// A sample or all.
    Some(Arc<Arrangement>),
    /// Nothing now.
    NotYet,
    /// Nothing any more.
    Over,
}

impl Arranging {
    /// Begins; the arrangement `before` serves again if its points lie in the same places.
    pub fn begin(cloud: Arc<LabelledCloud>, before: Option<Arranged>) -> Self {
        let (sender, arrived) = channel();
        let wanted = Arc::new(());
        let is_wanted = Arc::downgrade(&wanted);
        // An error says that nobody waits any more.
        beside_jobs(move || arrange(&cloud, before, &sender, &is_wanted).unwrap_or_default());
        Self {
            arrived,
            _wanted: wanted,
        }
    }

    /// What has come since.
    pub fn next(&self) -> Arrival {
        match self.arrived.try_recv() {
            Ok(arrangement) => Arrival::Some(arrangement),
            Err(TryRecvError::Empty) => Arrival::NotYet,
            Err(TryRecvError::Disconnected) => Arrival::Over,
        }
    }
}

/// Works on threads of its own, half as many as the machine's: in the pool of the program's jobs it would stand behind them.
pub(super) fn beside_jobs(work: impl FnOnce() + Send + 'static) {
    let threads = std::thread::available_parallelism().map_or(1, |all| all.get().div_ceil(2));
    match rayon::ThreadPoolBuilder::new().num_threads(threads).build() {
        Ok(pool) => pool.spawn(work),
        Err(_) => rayon::spawn(work),
    }
}

fn arrange(
    cloud: &LabelledCloud,
    before: Option<Arranged>,
    sender: &Sender<Arc<Arrangement>>,
    wanted: &Weak<()>,
) -> Result<(), SendError<Arc<Arrangement>>> {
    if let Some((_, arrangement)) = before.filter(|(other, _)| other.positions == cloud.positions) {
        return sender.send(arrangement);
    }
    if cloud.len() > SAMPLE {
        sender.send(Arc::new(Arrangement::of_sample(&cloud.positions, SAMPLE)))?;
    }
    let order = Arrangement::z_order(&cloud.positions);
    if wanted.strong_count() == 0 {
        return Ok(());
    }
    sender.send(Arc::new(Arrangement::along(&cloud.positions, order)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;

    fn all_that_comes(arranging: &Arranging) -> Vec<Arc<Arrangement>> {
        let mut came = Vec::new();
        loop {
            match arranging.next() {
                Arrival::Some(arrangement) => came.push(arrangement),
                Arrival::NotYet => std::thread::yield_now(),
                Arrival::Over => return came,
            }
        }
    }

    fn row(points: usize) -> Arc<LabelledCloud> {
        Arc::new(LabelledCloud::from_positions(
            (0..points).map(|i| Vec3::X * i as f32).collect(),
        ))
    }

    #[test]
    fn a_sample_comes_first_and_the_same_places_are_arranged_once() {
        let large = row(SAMPLE + 1000);
        let came = all_that_comes(&Arranging::begin(Arc::clone(&large), None));
        assert_eq!(
            came.iter().map(|one| one.len()).collect::<Vec<_>>(),
            [SAMPLE, SAMPLE + 1000]
        );
        let recolored = Arc::new(LabelledCloud {
            colors: vec![[1, 2, 3]; large.len()],
            ..(*large).clone()
        });
        let again = all_that_comes(&Arranging::begin(
            recolored,
            Some((large, Arc::clone(&came[1]))),
        ));
        assert!(again.len() == 1 && Arc::ptr_eq(&again[0], &came[1]));
        let small = all_that_comes(&Arranging::begin(
            row(100),
            Some((row(101), Arc::clone(&came[1]))),
        ));
        assert_eq!(small.iter().map(|one| one.len()).collect::<Vec<_>>(), [100]);
    }

    #[test]
    fn dropped_work_lets_its_cloud_go() {
        let cloud = row(200_000);
        drop(Arranging::begin(Arc::clone(&cloud), None));
        let ended = (0..50_000_000).any(|_| {
            std::thread::yield_now();
            Arc::strong_count(&cloud) == 1
        });
        assert!(ended, "nobody else holds the cloud in the end");
    }
}
