use std::collections::VecDeque;
use std::fs::{self, File, OpenOptions};
use std::io::{Seek, SeekFrom, Write};
use std::path::Path;
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::time::{Duration, Instant};

use ureq::Agent;

use super::error::NnError;
use super::transfer::{self, Answer, BROKEN_OFF, ByteRange, Message, TransferEnd};
use super::unfinished::{Stretch, Unfinished, UnfinishedPaths};

/// Only unit tests may use plain HTTP.
const HTTPS_ONLY: bool = !cfg!(test);
/// Interval between two calls of the progress callback.
///
/// Ctrl+C gives the command line 100 ms to record what is there.
const PROGRESS_INTERVAL: Duration = Duration::from_millis(20);
/// Interval between two records of what is there, for a process that is killed.
const RECORD_INTERVAL: Duration = Duration::from_secs(1);
/// Maximum number of chunks that wait for the disk.
const WAITING_CHUNKS: usize = 8;
/// Maximum number of ranges that are fetched at the same time.
const CONNECTIONS: usize = 4;
/// Size of the first range, in bytes. A file that is not larger takes one request.
const FIRST_BYTES: u64 = 4 << 20;
/// Limits of the size of the other ranges, in bytes.
///
/// A range costs a request, with redirects two. Near the end, a slow connection alone fetches the
/// rest of its range.
const RANGE_BYTES: (u64, u64) = (4 << 20, 64 << 20);
/// Number of ranges of a file whose ranges are within these limits.
const RANGES: u64 = 16;

/// A file to download.
pub(super) struct DownloadRequest<'a> {
    pub url: &'a str,
    pub into: &'a Path,
    /// Maximum size, bytes.
    pub limit: u64,
    /// Whether the caller compares the content with a known digest.
    ///
    /// Without one, bytes of several requests are only put together if the server states that they
    /// are of the same version.
    pub has_known_digest: bool,
}

/// Downloads a file without verifying it.
///
/// Only HTTPS is allowed, redirects included; the environment's proxy is used. A server that answers
/// requests for ranges sends several at the same time; otherwise, the file comes in one stream.
/// `progress` receives the number of bytes present and returns whether to continue. An interrupted or
/// stopped download stays next to `into` as `NAME.part` with a record of the ranges that are there,
/// and the next call continues it.
///
/// # Errors
/// [`NnError::Fetch`] if the address does not answer or the download is stopped, or
/// [`NnError::Io`].
pub(super) fn fetch(
    request: &DownloadRequest<'_>,
    progress: &mut dyn FnMut(u64) -> bool,
) -> Result<(), NnError> {
    let download = Download {
        request,
        paths: UnfinishedPaths::of(request.into),
    };
    let mut way = match download.unfinished() {
        Some(record) => Way::Continue(record),
        None => Way::Ranges,
    };
    loop {
        let next = way.next();
        match download.run(way, progress)? {
            Outcome::Complete => break,
            Outcome::Unusable => download.discard()?,
        }
        way = next
            .ok_or_else(|| download.failed("the server's answers contradict each other".into()))?;
        if !progress(0) {
            return Err(download.stopped());
        }
    }
    fs::rename(&download.paths.data, request.into).map_err(|reason| NnError::Io {
        path: request.into.to_owned(),
        reason,
    })?;
    download.discard()
}

/// How the file is requested.
enum Way {
    /// What is missing of an earlier download.
    Continue(Unfinished),
    /// In ranges, if the server has them.
    Ranges,
    OneStream,
}

impl Way {
    /// Returns the way to take if the answers to this one do not fit together.
    fn next(&self) -> Option<Self> {
        match self {
            Self::Continue(_) => Some(Self::Ranges),
            Self::Ranges => Some(Self::OneStream),
            Self::OneStream => None,
        }
    }
}

/// How a run without error ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Outcome {
    Complete,
    /// The server refuses ranges, or its answers are not parts of the same file.
    Unusable,
}

/// One download.
struct Download<'a> {
    request: &'a DownloadRequest<'a>,
    paths: UnfinishedPaths,
}

impl Download<'_> {
    /// Returns the record of an earlier download that can be continued.
    fn unfinished(&self) -> Option<Unfinished> {
        let record = Unfinished::read(&self.paths, self.request.url)?;
        self.may_join(&record).then_some(record)
    }

    /// Returns whether bytes of several requests may be put together.
    fn may_join(&self, record: &Unfinished) -> bool {
        self.request.has_known_digest || record.version.is_exact()
    }

    fn run(&self, way: Way, progress: &mut dyn FnMut(u64) -> bool) -> Result<Outcome, NnError> {
        let mut run = Run::new(self);
        let outcome = run.begin(way).and_then(|()| run.follow(progress));
        if outcome.is_err() {
            // The error itself is what the user has to know.
            let _ = run.save();
        }
        outcome
    }

    fn discard(&self) -> Result<(), NnError> {
        self.paths.discard().map_err(|reason| self.io_error(reason))
    }

    fn failed(&self, what: String) -> NnError {
        NnError::Fetch {
            url: self.request.url.to_owned(),
            what,
            is_stopped: false,
        }
    }

    fn stopped(&self) -> NnError {
        NnError::Fetch {
            url: self.request.url.to_owned(),
            what: "stopped".to_owned(),
            is_stopped: true,
        }
    }

    fn io_error(&self, reason: std::io::Error) -> NnError {
        NnError::Io {
            path: self.paths.data.clone(),
            reason,
        }
    }
}

/// Transfers of a download. Each fetches one stretch of the file, whose number is its id.
struct Run<'a> {
    download: &'a Download<'a>,
    agent: Agent,
    sender: SyncSender<(usize, Message)>,
    messages: Receiver<(usize, Message)>,
    /// Number of running transfers.
    active: usize,
    /// Stretches that no transfer fetches yet.
    waiting: VecDeque<usize>,
    /// What is there; `None` before the first answer.
    record: Option<Unfinished>,
    /// Whether bytes were written since the last record.
    is_unsaved: bool,
    /// The file that receives the bytes; open as long as there is a record.
    file: Option<File>,
}

impl<'a> Run<'a> {
    fn new(download: &'a Download<'a>) -> Self {
        let (sender, messages) = sync_channel(WAITING_CHUNKS);
        Self {
            download,
            agent: transfer::agent(HTTPS_ONLY),
            sender,
            messages,
            active: 0,
            waiting: VecDeque::new(),
            record: None,
            is_unsaved: false,
            file: None,
        }
    }

    fn begin(&mut self, way: Way) -> Result<(), NnError> {
        match way {
            Way::Continue(record) => {
                self.file = Some(self.open(false)?);
                let missing = record.stretches.iter().enumerate();
                self.waiting = missing
                    .filter(|(_, stretch)| !stretch.is_complete())
                    .map(|(id, _)| id)
                    .collect();
                self.record = Some(record);
                self.start_waiting()
            }
            Way::Ranges => self.start(
                0,
                ByteRange {
                    start: 0,
                    end: Some(FIRST_BYTES),
                },
            ),
            Way::OneStream => self.start(0, ByteRange::ALL),
        }
    }

    /// Receives messages until all transfers have ended.
    fn follow(&mut self, progress: &mut dyn FnMut(u64) -> bool) -> Result<Outcome, NnError> {
        let (mut reported, mut saved) = (Instant::now(), Instant::now());
        while self.active > 0 {
            if let Ok((id, message)) = self.messages.recv_timeout(PROGRESS_INTERVAL)
                && !self.take(id, message)?
            {
                return Ok(Outcome::Unusable);
            }
            if reported.elapsed() >= PROGRESS_INTERVAL {
                if !progress(self.bytes()) {
                    return Err(self.download.stopped());
                }
                reported = Instant::now();
            }
            if saved.elapsed() >= RECORD_INTERVAL {
                self.save()?;
                saved = Instant::now();
            }
        }
        progress(self.bytes());
        Ok(Outcome::Complete)
    }

    /// Returns whether the answers so far are parts of the same file.
    fn take(&mut self, id: usize, message: Message) -> Result<bool, NnError> {
        match message {
            Message::Started(answer) => return self.take_answer(id, answer),
            Message::Chunk(bytes) => return self.take_bytes(id, &bytes),
            Message::Ended(TransferEnd::RangeRefused) => return Ok(false),
            Message::Ended(TransferEnd::Complete) if self.is_short(id) => {
                self.take_failure(id, BROKEN_OFF.to_owned())?;
            }
            Message::Ended(TransferEnd::Complete) => {
                self.active -= 1;
                self.start_waiting()?;
            }
            Message::Ended(TransferEnd::Failed(what)) => self.take_failure(id, what)?,
        }
        Ok(true)
    }

    fn is_short(&self, id: usize) -> bool {
        let stretch = self.record.as_ref().map(|record| &record.stretches[id]);
        stretch.is_none_or(|stretch| stretch.end.is_some() && !stretch.is_complete())
    }

    /// Leaves the rest of a stretch to the other transfers; fails if there is none.
    ///
    /// A server that refuses many connections at the same time thus gets fewer.
    fn take_failure(&mut self, id: usize, what: String) -> Result<(), NnError> {
        self.active -= 1;
        if self.active == 0 {
            return Err(self.download.failed(what));
        }
        self.waiting.push_back(id);
        Ok(())
    }

    fn take_answer(&mut self, id: usize, answer: Answer) -> Result<bool, NnError> {
        let Some(record) = &self.record else {
            return self.take_first_answer(answer);
        };
        if !answer.is_range && record.stretches.len() == 1 {
            return self.take_first_answer(answer);
        }
        let stretch = &record.stretches[id];
        let is_same_size = match (answer.size, record.size) {
            (Some(found), Some(expected)) => found == expected,
            _ => true,
        };
        let fits = answer.is_range
            && answer.start == stretch.at
            && (stretch.end.is_none() || answer.end == stretch.end)
            && is_same_size
            && answer.version == record.version;
        self.check_length(answer.end.unwrap_or(0))?;
        Ok(fits)
    }

    /// Divides the file into stretches, and starts the transfers of those that do not follow.
    fn take_first_answer(&mut self, answer: Answer) -> Result<bool, NnError> {
        self.check_length(answer.size.or(answer.end).unwrap_or(0))?;
        let stretches = match (answer.is_range, answer.size) {
            (false, size) => vec![Stretch::new(0, size)],
            (true, Some(size)) => ranges(size),
            (true, None) => return Ok(false),
        };
        let record = Unfinished {
            url: self.download.request.url.to_owned(),
            size: answer.size,
            version: answer.version,
            stretches,
        };
        let first = &record.stretches[0];
        let follows = answer.start == 0 && answer.end == first.end;
        let is_divided = record.stretches.len() > 1;
        if !follows || (is_divided && !self.download.may_join(&record)) {
            return Ok(false);
        }
        self.file = None;
        self.download.discard()?;
        self.file = Some(self.open(true)?);
        self.waiting = (1..record.stretches.len()).collect();
        self.record = Some(record);
        self.is_unsaved = true;
        self.save()?;
        self.start_waiting()?;
        Ok(true)
    }

    /// Writes bytes of a stretch to their place.
    fn take_bytes(&mut self, id: usize, bytes: &[u8]) -> Result<bool, NnError> {
        let (Some(record), Some(file)) = (&mut self.record, &mut self.file) else {
            return Ok(false);
        };
        let stretch = &mut record.stretches[id];
        let (at, end) = (stretch.at, stretch.at + bytes.len() as u64);
        if stretch.end.is_some_and(|last| end > last) {
            return Ok(false);
        }
        let limit = self.download.request.limit;
        if end <= limit {
            file.seek(SeekFrom::Start(at))
                .and_then(|_| file.write_all(bytes))
                .map_err(|reason| self.download.io_error(reason))?;
            stretch.at = end;
            self.is_unsaved = true;
        }
        self.check_length(end)?;
        Ok(true)
    }

    /// Rejects a file that is longer than expected, and deletes it.
    fn check_length(&mut self, bytes: u64) -> Result<(), NnError> {
        let limit = self.download.request.limit;
        if bytes <= limit {
            return Ok(());
        }
        self.record = None;
        self.file = None;
        self.download.discard()?;
        Err(self.download.failed(format!(
            "it is longer than the {limit} bytes that are expected"
        )))
    }

    fn start_waiting(&mut self) -> Result<(), NnError> {
        while self.active < CONNECTIONS
            && let Some(record) = &self.record
            && let Some(id) = self.waiting.pop_front()
        {
            let Stretch { at, end, .. } = record.stretches[id];
            // Some servers know only ranges to the end of the file.
            let end = end.filter(|_| end != record.size);
            self.start(id, ByteRange { start: at, end })?;
        }
        Ok(())
    }

    fn start(&mut self, id: usize, range: ByteRange) -> Result<(), NnError> {
        let url = self.download.request.url;
        transfer::start(&self.agent, url, range, id, &self.sender)
            .map_err(|error| self.download.failed(error.to_string()))?;
        self.active += 1;
        Ok(())
    }

    fn open(&self, is_new: bool) -> Result<File, NnError> {
        let mut options = OpenOptions::new();
        options.write(true).create(is_new).truncate(is_new);
        let opened = options.open(&self.download.paths.data);
        opened.map_err(|reason| self.download.io_error(reason))
    }

    /// Records what is there. The bytes are written to the disk first.
    fn save(&mut self) -> Result<(), NnError> {
        if let (true, Some(record), Some(file)) = (self.is_unsaved, &self.record, &self.file) {
            file.sync_data()
                .and_then(|()| record.write(&self.download.paths))
                .map_err(|reason| self.download.io_error(reason))?;
            self.is_unsaved = false;
        }
        Ok(())
    }

    fn bytes(&self) -> u64 {
        self.record.as_ref().map_or(0, Unfinished::bytes)
    }
}

/// Divides a file into the ranges to request.
fn ranges(size: u64) -> Vec<Stretch> {
    let first = size.min(FIRST_BYTES);
    let (least, most) = RANGE_BYTES;
    let length = (size / RANGES).clamp(least, most);
    let mut found = vec![Stretch::new(0, Some(first))];
    let mut start = first;
    while start < size {
        let end = size.min(start.saturating_add(length));
        found.push(Stretch::new(start, Some(end)));
        start = end;
    }
    found
}
