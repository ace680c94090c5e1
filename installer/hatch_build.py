"""hatchling's hook: takes along resources, and what `python3 dev.py build` has made, offline manual and kernels."""

import os
import sys
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface


def _files(folder: Path, goal: str) -> dict[str, str]:
    """Where each file below a folder goes; the sources of translations stay behind."""
    files = (file for file in sorted(folder.rglob("*")) if file.is_file() and file.suffix != ".ts")
    return {str(file): f"{goal}/{file.relative_to(folder).as_posix()}" for file in files}


class BuiltFiles(BuildHookInterface):
    """Adds what lies outside the packages."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """The manual, in a wheel as part of the package; there the resources too, in a platform wheel the kernels."""
        if version == "editable":
            return
        root, wheel, taken = Path(self.root), self.target_name == "wheel", build_data["force_include"]
        if wheel:
            taken |= _files(root / "resources", "spherecal/_resources")
        taken |= _files(root / "build" / "site", "spherecal/_resources/manual" if wheel else "build/site")
        kernels = os.environ.get("SPHERECAL_WHEEL_KERNELS")  # the folder of installer/kernels.py
        if wheel and kernels:
            sys.path.insert(0, str(root / "installer"))
            from kernels import platform_tag

            taken[kernels] = "spherecal/_kernels"
            build_data["pure_python"] = False
            python = f"cp{sys.version_info.major}{sys.version_info.minor}"
            build_data["tag"] = f"{python}-{python}-{platform_tag(Path(kernels))}"
