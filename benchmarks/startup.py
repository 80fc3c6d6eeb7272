"""How long a user waits before anything happens: `tacstrip --help`, `import tacstrip`, the first name used.

Run: python benchmarks/startup.py
"""

from __future__ import annotations

import subprocess
import sys
from functools import partial

from _timing import median_seconds

JOBS = {
    "python -c pass": "pass",
    "import numpy (for comparison)": "import numpy",
    "import tacstrip                  (wanted: 0.3 s)": "import tacstrip",
    "ts.Sensor, ts.simulate, ts.vertex_reconstruction": (
        "import tacstrip as ts; ts.Sensor, ts.simulate, ts.vertex_reconstruction"
    ),
    "tacstrip --help                  (wanted: 0.3 s)": (
        "import sys; sys.argv = ['tacstrip', '--help']; from tacstrip.cli import main; main()"
    ),
}


def start(code: str) -> None:
    """Run code in a new interpreter."""
    subprocess.run([sys.executable, "-c", code], check=True, capture_output=True)


def main() -> None:
    """Print the median of each."""
    for name, code in JOBS.items():
        print(f"{name:<52} {median_seconds(partial(start, code)):6.3f} s")


if __name__ == "__main__":
    main()
