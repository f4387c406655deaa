"""What the scripts of other programs share; it comes before each of them."""

import time
from pathlib import Path


def timed(steps, step, work):
    begun = time.perf_counter()
    result = work()
    steps.append({"step": step, "seconds": time.perf_counter() - begun})
    return result


def peak_memory_bytes():
    """Returns the largest memory in use so far, or None where the system does not report it."""
    try:
        for line in Path("/proc/self/status").read_text().splitlines():
            if line.startswith("VmHWM:"):
                return int(line.split()[1]) * 1024
    except OSError:
        pass
    return None
