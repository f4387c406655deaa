//! Settings of the C library's memory allocator, and the memory in use.

/// Cores per allocation arena.
#[cfg(all(target_os = "linux", target_env = "gnu"))]
const CORES_PER_ARENA: usize = 4;

/// Size in bytes from which a freed allocation is returned to the system at once.
#[cfg(all(target_os = "linux", target_env = "gnu"))]
const MAPPED_BYTES: i32 = 256 << 10;

/// Makes the allocator return freed memory to the system.
///
/// By default the GNU C library keeps up to eight arenas per core and raises the size from which it
/// returns memory with every large allocation. Freed images and clouds of earlier steps then add
/// half as much again to the memory in use. Must be called before other threads start.
#[cfg(all(target_os = "linux", target_env = "gnu"))]
#[expect(unsafe_code, reason = "the allocator has no safe interface for this")]
pub(super) fn return_freed_memory() {
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let arenas = i32::try_from((cores / CORES_PER_ARENA).max(1)).unwrap_or(i32::MAX);
    // SAFETY: `mallopt` takes two numbers by value and may be called at any time.
    unsafe {
        libc::mallopt(libc::M_ARENA_MAX, arenas);
        libc::mallopt(libc::M_MMAP_THRESHOLD, MAPPED_BYTES);
    }
}

/// Does nothing: the allocators of other systems return freed memory.
#[cfg(not(all(target_os = "linux", target_env = "gnu")))]
pub(super) fn return_freed_memory() {}

/// Returns the largest memory in use by this process so far, in bytes.
///
/// `None` where the system does not report it to programs without unsafe code.
pub(super) fn peak_bytes() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status
        .lines()
        .find_map(|line| line.strip_prefix("VmHWM:"))?;
    let kilobytes: u64 = line.trim().strip_suffix("kB")?.trim().parse().ok()?;
    Some(kilobytes * 1024)
}
