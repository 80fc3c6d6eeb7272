"""The compiled core: which build of it this machine runs, if any. Nothing is ever compiled here.

`TACSTRIP_CORE` asks for a certain one: `numpy` (none), `baseline`, `v3`, or the path of a library.
"""

from __future__ import annotations

import ctypes
import functools
import os
import sys
from pathlib import Path
from typing import Any

from tacstrip.core.sources import fingerprint
from tacstrip.errors import OptionError

FOLDER = Path(__file__).parent
SUFFIX = ".dll" if sys.platform == "win32" else ".so"
BASELINE, V3 = (FOLDER / f"{level}{SUFFIX}" for level in ("baseline", "v3"))
VERSION = 17  # TACSTRIP_VERSION of core.h


def library() -> ctypes.CDLL | None:
    """Return the compiled core, or None where NumPy has to do.

    Returns
    -------
    CDLL or None
        The same one at every call.

    Raises
    ------
    OptionError
        `TACSTRIP_CORE` asks for one that is not there or does not run here.
    """
    return _chosen()[0]


def description() -> str:
    """Say which core is in use: compiler and level of the instruction set, or NumPy and why."""
    return _chosen()[1]


@functools.cache
def _chosen() -> tuple[ctypes.CDLL | None, str]:
    asked = os.environ.get("TACSTRIP_CORE", "")
    if asked == "numpy":
        return None, "NumPy, as TACSTRIP_CORE asks"
    if asked:
        return _asked(asked)
    if not BASELINE.exists():
        return None, "NumPy, none was built"
    try:
        core = _load(BASELINE)
        if V3.exists() and core.tacstrip_core_v3_runs():
            core = _load(V3)
    except OSError as error:
        import logging  # late, for its import takes longer than all else here

        logging.getLogger("tacstrip").warning("the compiled core is not used, NumPy is slower: %s", error)
        return None, f"NumPy, as the compiled one is not used: {error}"
    return core, _text(core.tacstrip_core_built)


def _asked(name: str) -> tuple[ctypes.CDLL, str]:
    file = {"baseline": BASELINE, "v3": V3}.get(name, Path(name))
    try:
        if not file.exists():
            raise OSError(f"there is no {file}")
        if file == V3 and not _load(BASELINE).tacstrip_core_v3_runs():
            raise OSError("this processor does not run it")
        core = _load(file)
    except OSError as error:
        raise OptionError(
            f"TACSTRIP_CORE={name}: {error}; unset it, or take numpy, baseline, v3 or the path of a library"
        ) from error
    return core, _text(core.tacstrip_core_built)


def _load(file: Path) -> ctypes.CDLL:
    """Load a library and hold it against this package; OSError says what is wrong with it."""
    core = ctypes.CDLL(str(file))
    try:
        version = core.tacstrip_core_version()
        built_from = _text(core.tacstrip_core_fingerprint)
    except AttributeError as error:
        raise OSError(f"{file} is not the compiled core of tacstrip") from error
    if version != VERSION:
        raise OSError(f"{file} is of version {version}, not {VERSION}: install tacstrip again")
    if (sources := fingerprint(FOLDER)) and built_from != sources:
        raise OSError(f"{file} was built from other sources: run `make setup`")
    return core


def _text(function: Any) -> str:
    function.restype = ctypes.c_char_p
    told: bytes = function()
    return told.decode()
