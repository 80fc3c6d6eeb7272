"""Time and memory of `tacstrip reproduce` as a whole process, on two workers.

Run: python benchmarks/reproduction.py [SEEDS ...]   (default: 20 and 200)
"""

from __future__ import annotations

import resource
import subprocess
import sys
import tempfile
import time

WORKERS = 2
# The command's own process and its workers are children of this one: the largest counts for each.
COMMAND = "from tacstrip.cli import main; main()"


def main() -> None:
    """Print one line per number of seeds."""
    for seeds in sys.argv[1:] or ["20", "200"]:
        with tempfile.TemporaryDirectory() as folder:
            words = ["reproduce", "--out", folder, "--seeds", seeds, "--workers", str(WORKERS)]
            start = time.perf_counter()
            subprocess.run([sys.executable, "-c", COMMAND, *words], check=True, capture_output=True)
            seconds = time.perf_counter() - start
        largest = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1024.0
        memory = f"largest process {largest:.0f} MB, {WORKERS + 1} at most {(WORKERS + 1) * largest:.0f} MB"
        print(f"{seconds:6.1f} s at {seeds} seeds (wanted: under 40 s at 20, under 240 s at 200)")
        print(f"         {memory} (wanted: under 500 MB)")


if __name__ == "__main__":
    main()
