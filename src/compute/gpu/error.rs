/// Why a graphics card cannot be computed on; each says what the user can do.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum GpuError {
    /// No adapter at all.
    #[error(
        "no graphics card that can compute was found; install its driver (Vulkan, Metal or DirectX 12), or choose the \
         device 'cpu'"
    )]
    NoAdapter,
    /// Only adapters that compute on the processor, which are not wanted.
    #[error(
        "no graphics card was found, only '{name}', which computes on the processor; install a driver, or choose the \
         device 'cpu'"
    )]
    SoftwareOnly {
        /// What the best of them calls itself.
        name: String,
    },
    /// A driver that does not give a device with the limits that are needed.
    #[error(
        "'{name}' cannot be computed on ({what}); update its driver, or choose the device 'cpu'"
    )]
    Refused {
        /// What the adapter calls itself.
        name: String,
        /// What the driver said.
        what: String,
    },
    /// More data in one piece than a device takes.
    #[error(
        "{what} need {} MiB in one piece, and a graphics card takes {} MiB; make the input smaller, or choose the \
         device 'cpu'",
        bytes.div_ceil(1 << 20),
        limit >> 20
    )]
    TooLarge {
        /// What the data is.
        what: &'static str,
        /// Its size.
        bytes: u64,
        /// The largest size.
        limit: u64,
    },
    /// A program or a call that the device does not take, or memory that it does not have.
    #[error(
        "the graphics card failed ({what}); close other programs that use it, or choose the device 'cpu'"
    )]
    Failed {
        /// What the driver said.
        what: String,
    },
    /// The device is gone: unplugged, reset, its driver restarted.
    #[error("the graphics card was lost ({what}); start again, or choose the device 'cpu'")]
    Lost {
        /// What the driver said.
        what: String,
    },
    /// The device does not come to an end.
    #[error(
        "the graphics card gave no answer for {seconds} s; start again, or choose the device 'cpu'"
    )]
    NoAnswer {
        /// How long it was waited for.
        seconds: u64,
    },
}
