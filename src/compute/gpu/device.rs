use std::fmt;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

/// Time after which a device that does not finish a submission counts as hung.
const PATIENCE: Duration = Duration::from_secs(120);

/// Whether an adapter that computes on the processor is acceptable.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Software {
    /// Acceptable if there is no graphics card.
    Allowed,
    /// Not acceptable.
    Refused,
}

/// A compute device with the limits that every adapter supports.
///
/// Errors of the driver are stored and returned by the next call that can fail.
pub struct Device {
    pub(super) device: wgpu::Device,
    pub(super) queue: wgpu::Queue,
    name: String,
    is_software: bool,
    fault: Arc<Mutex<Option<GpuError>>>,
}

impl Device {
    /// Opens the best adapter.
    ///
    /// Discrete graphics cards come first, then integrated ones, then others. This may take
    /// seconds.
    ///
    /// # Errors
    /// [`GpuError::NoAdapter`], [`GpuError::SoftwareOnly`] or [`GpuError::Refused`].
    pub fn open(software: Software) -> Result<Self, GpuError> {
        let instance = wgpu::Instance::default();
        let adapters = pollster::block_on(instance.enumerate_adapters(wgpu::Backends::all()));
        let best = adapters
            .into_iter()
            .min_by_key(|adapter| rank(adapter.get_info().device_type));
        let adapter = best.ok_or(GpuError::NoAdapter)?;
        let info = adapter.get_info();
        let is_software = info.device_type == wgpu::DeviceType::Cpu;
        if is_software && software == Software::Refused {
            return Err(GpuError::SoftwareOnly { name: info.name });
        }
        let descriptor = wgpu::DeviceDescriptor {
            label: Some("compute"),
            ..Default::default()
        };
        let (device, queue) =
            pollster::block_on(adapter.request_device(&descriptor)).map_err(|error| {
                GpuError::Refused {
                    name: info.name.clone(),
                    what: error.to_string(),
                }
            })?;
        let fault = Arc::new(Mutex::new(None));
        listen(&device, &fault);
        Ok(Self {
            device,
            queue,
            name: info.name,
            is_software,
            fault,
        })
    }

    /// Returns the name of the adapter.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Returns whether the adapter computes on the processor.
    #[must_use]
    pub fn is_software(&self) -> bool {
        self.is_software
    }

    /// Waits until a submission and all earlier ones have finished.
    pub(super) fn wait_for(&self, submission: wgpu::SubmissionIndex) -> Result<(), GpuError> {
        let wait = wgpu::PollType::Wait {
            submission_index: Some(submission),
            timeout: Some(PATIENCE),
        };
        let polled = self.device.poll(wait);
        self.check()?;
        match polled {
            Ok(_) => Ok(()),
            Err(wgpu::PollError::Timeout) => Err(GpuError::NoAnswer {
                seconds: PATIENCE.as_secs(),
            }),
            Err(error) => Err(GpuError::Failed {
                what: error.to_string(),
            }),
        }
    }

    /// Returns the driver's first error since the device was opened.
    ///
    /// Results computed after an error are invalid.
    pub(super) fn check(&self) -> Result<(), GpuError> {
        let fault = self.fault.lock().unwrap_or_else(PoisonError::into_inner);
        fault.clone().map_or(Ok(()), Err)
    }
}

impl fmt::Debug for Device {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Device")
            .field("name", &self.name)
            .field("is_software", &self.is_software)
            .finish()
    }
}

fn rank(kind: wgpu::DeviceType) -> u8 {
    match kind {
        wgpu::DeviceType::DiscreteGpu => 0,
        wgpu::DeviceType::IntegratedGpu => 1,
        wgpu::DeviceType::VirtualGpu => 2,
        wgpu::DeviceType::Other => 3,
        wgpu::DeviceType::Cpu => 4,
    }
}

/// Stores the first error; without these callbacks, wgpu panics.
fn listen(device: &wgpu::Device, fault: &Arc<Mutex<Option<GpuError>>>) {
    let keep = |fault: &Mutex<Option<GpuError>>, error: GpuError| {
        fault
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .get_or_insert(error);
    };
    let (failed, lost) = (Arc::clone(fault), Arc::clone(fault));
    device.on_uncaptured_error(Arc::new(move |error: wgpu::Error| {
        keep(
            &failed,
            GpuError::Failed {
                what: error.to_string(),
            },
        );
    }));
    device.set_device_lost_callback(move |reason, what| {
        // Dropping the device also calls this callback.
        if reason != wgpu::DeviceLostReason::Destroyed {
            keep(&lost, GpuError::Lost { what });
        }
    });
}

/// Errors of computing on a graphics card; each message states what the user can do.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum GpuError {
    /// There is no adapter.
    #[error(
        "no graphics card that can compute was found; install its driver (Vulkan, Metal or DirectX 12), or choose the \
         device 'cpu'"
    )]
    NoAdapter,
    /// Only adapters that compute on the processor exist, and these are not acceptable.
    #[error(
        "no graphics card was found, only '{name}', which computes on the processor; install a driver, or choose the \
         device 'cpu'"
    )]
    SoftwareOnly {
        /// Name of the best of them.
        name: String,
    },
    /// The driver does not provide a device with the required limits.
    #[error(
        "'{name}' cannot be computed on ({what}); update its driver, or choose the device 'cpu'"
    )]
    Refused {
        /// Name of the adapter.
        name: String,
        /// Message of the driver.
        what: String,
    },
    /// The data is larger than a device accepts in one buffer.
    #[error(
        "{what} need {} MiB in one buffer, and a graphics card takes {} MiB; make the input smaller, or choose the \
         device 'cpu'",
        bytes.div_ceil(1 << 20),
        limit >> 20
    )]
    TooLarge {
        /// Name of the data.
        what: &'static str,
        /// Size in bytes.
        bytes: u64,
        /// Maximum size in bytes.
        limit: u64,
    },
    /// The device rejected a program or a call, or ran out of memory.
    #[error(
        "the graphics card failed ({what}); close other programs that use it, or choose the device 'cpu'"
    )]
    Failed {
        /// Message of the driver.
        what: String,
    },
    /// The device is gone: unplugged, reset, or its driver was restarted.
    #[error("the graphics card was lost ({what}); start again, or choose the device 'cpu'")]
    Lost {
        /// Message of the driver.
        what: String,
    },
    /// The device does not finish its work.
    #[error(
        "the graphics card gave no answer for {seconds} s; start again, or choose the device 'cpu'"
    )]
    NoAnswer {
        /// Waiting time in seconds.
        seconds: u64,
    },
}
