//! How the C library hands memory out.

/// Cores for each arena of memory.
#[cfg(all(target_os = "linux", target_env = "gnu"))]
const CORES_PER_ARENA: usize = 4;

/// Allocations from here on are given back to the system as soon as they are freed, bytes.
#[cfg(all(target_os = "linux", target_env = "gnu"))]
const MAPPED_BYTES: i32 = 256 << 10;

/// Lets memory that is freed go back to the system. The GNU C library would keep up to eight arenas for each core, and raise
/// the size from which on it gives memory back with every large allocation: images and clouds of earlier steps then take
/// half as much again as is in use. Must be called before other threads are started.
#[cfg(all(target_os = "linux", target_env = "gnu"))]
#[expect(unsafe_code, reason = "there is no other way to set it from within")]
pub(super) fn return_what_is_freed() {
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let arenas = i32::try_from((cores / CORES_PER_ARENA).max(1)).unwrap_or(i32::MAX);
    // SAFETY: `mallopt` takes two numbers by value and may be called at any time.
    unsafe {
        libc::mallopt(libc::M_ARENA_MAX, arenas);
        libc::mallopt(libc::M_MMAP_THRESHOLD, MAPPED_BYTES);
    }
}

/// Other systems give memory back by themselves.
#[cfg(not(all(target_os = "linux", target_env = "gnu")))]
pub(super) fn return_what_is_freed() {}
