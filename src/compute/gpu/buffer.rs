use bytemuck::{AnyBitPattern, NoUninit};

use super::device::{Device, GpuError};

/// Maximum size of one binding that every adapter supports, in bytes.
const LARGEST: u64 = 128 << 20;

/// Device memory that programs read and write.
#[derive(Debug)]
pub struct Buffer {
    pub(super) buffer: wgpu::Buffer,
}

impl Buffer {
    /// Returns the size in bytes.
    #[must_use]
    pub fn bytes(&self) -> u64 {
        self.buffer.size()
    }
}

impl Device {
    /// Creates a buffer of zeros for `count` elements.
    ///
    /// `what` names the data in errors, in the plural.
    ///
    /// # Errors
    /// [`GpuError::TooLarge`] above 128 MiB, or the driver's error.
    pub fn zeros<T>(&self, what: &'static str, count: usize) -> Result<Buffer, GpuError> {
        let usage = wgpu::BufferUsages::STORAGE
            | wgpu::BufferUsages::COPY_DST
            | wgpu::BufferUsages::COPY_SRC;
        self.buffer(what, count as u64 * size_of::<T>() as u64, usage)
    }

    /// Creates a buffer from a slice; see [`Self::zeros`].
    ///
    /// # Errors
    /// As [`Self::zeros`].
    pub fn upload<T: NoUninit>(
        &self,
        what: &'static str,
        values: &[T],
    ) -> Result<Buffer, GpuError> {
        let buffer = self.zeros::<T>(what, values.len())?;
        self.write(&buffer, 0, values)?;
        Ok(buffer)
    }

    /// Creates a uniform buffer from a value.
    ///
    /// # Errors
    /// Returns the driver's error.
    pub fn uniform<T: NoUninit>(&self, what: &'static str, value: &T) -> Result<Buffer, GpuError> {
        let usage = wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST;
        let buffer = self.buffer(what, size_of::<T>() as u64, usage)?;
        self.write(&buffer, 0, std::slice::from_ref(value))?;
        Ok(buffer)
    }

    /// Writes a slice, starting at element `first`.
    ///
    /// Work that is submitted later sees the new values; earlier work does not.
    ///
    /// # Errors
    /// Returns the driver's error.
    pub fn write<T: NoUninit>(
        &self,
        buffer: &Buffer,
        first: usize,
        values: &[T],
    ) -> Result<(), GpuError> {
        let bytes = bytemuck::cast_slice(values);
        self.queue
            .write_buffer(&buffer.buffer, first as u64 * size_of::<T>() as u64, bytes);
        self.check()
    }

    /// Reads the first `count` elements after all submitted work has finished.
    ///
    /// # Errors
    /// Returns the driver's error.
    pub fn read<T: AnyBitPattern>(
        &self,
        buffer: &Buffer,
        count: usize,
    ) -> Result<Vec<T>, GpuError> {
        let bytes = count as u64 * size_of::<T>() as u64;
        let usage = wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST;
        let copy = self.buffer("results", bytes, usage)?.buffer;
        let mut encoder = self
            .device
            .create_command_encoder(&wgpu::CommandEncoderDescriptor {
                label: Some("read"),
            });
        encoder.copy_buffer_to_buffer(&buffer.buffer, 0, &copy, 0, bytes);
        let submission = self.queue.submit([encoder.finish()]);
        self.check()?;
        // `get_mapped_range` reports a failed mapping.
        copy.map_async(wgpu::MapMode::Read, .., |_| ());
        self.wait_for(submission)?;
        let mapped = copy
            .get_mapped_range(..)
            .map_err(|error| GpuError::Failed {
                what: error.to_string(),
            })?;
        Ok(mapped
            .chunks_exact(size_of::<T>())
            .map(bytemuck::pod_read_unaligned)
            .collect())
    }

    fn buffer(
        &self,
        what: &'static str,
        bytes: u64,
        usage: wgpu::BufferUsages,
    ) -> Result<Buffer, GpuError> {
        if bytes > LARGEST {
            return Err(GpuError::TooLarge {
                what,
                bytes,
                limit: LARGEST,
            });
        }
        // Bindings must not be empty, and copy sizes must be multiples of four.
        let size = bytes.max(16).next_multiple_of(4);
        let label = Some(what);
        let buffer = self.device.create_buffer(&wgpu::BufferDescriptor {
            label,
            size,
            usage,
            mapped_at_creation: false,
        });
        self.check()?;
        Ok(Buffer { buffer })
    }
}
