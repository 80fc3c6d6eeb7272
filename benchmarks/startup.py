"""How long a user waits: for `tacstrip --help`, `import tacstrip`, the first name used, a fit of ten strips.

Bytecode counts: `make setup` compiles it. To see the start without, remove every __pycache__ and set
PYTHONDONTWRITEBYTECODE.

Run: python benchmarks/startup.py
"""

from __future__ import annotations

import subprocess
import sys
from functools import partial

from _timing import median_seconds

RECONSTRUCT = (
    "import sys; from pathlib import Path; import tacstrip; "
    "readings = str(Path(tacstrip.__file__).parent / 'data' / 'demo_readings.csv'); "
    "sys.argv = ['tacstrip', 'reconstruct', 'prototype-crs-crs', readings, '--method', '{}']; "
    "from tacstrip.cli import main; main()"
)
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
    "tacstrip reconstruct, ten strips": RECONSTRUCT.format("polygon"),
    "tacstrip reconstruct --method profile": RECONSTRUCT.format("profile"),
}


def start(code: str) -> None:
    """Run code in a new interpreter; the demo's readings before calibration are no polygon, which is exit code 1."""
    done = subprocess.run([sys.executable, "-c", code], check=False, capture_output=True)
    assert done.returncode in (0, 1), done.stderr


def main() -> None:
    """Print the median of each."""
    for name, code in JOBS.items():
        print(f"{name:<52} {median_seconds(partial(start, code)):6.3f} s")


if __name__ == "__main__":
    main()
