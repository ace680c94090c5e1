"""hatchling's hook: takes along what `python3 dev.py build` has made, the offline manual and the compiled kernels."""

import os
import sys
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

# Never asked for by the pages offline: for a browser's debugger, and a page for servers.
_NOT_TAKEN = (".map", "404.html", "sitemap.xml", "sitemap.xml.gz")


class BuiltFiles(BuildHookInterface):
    """Adds what git does not know of."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """The manual, in a wheel as part of the package; in a platform wheel the kernels as well."""
        if version == "editable":
            return
        wheel = self.target_name == "wheel"
        site = Path(self.root) / "build" / "site"
        goal = "spherecal/_resources/manual" if wheel else "build/site"
        if (site / "index.html").is_file():
            for file in sorted(site.rglob("*")):
                if file.is_file() and not file.name.endswith(_NOT_TAKEN):
                    build_data["force_include"][str(file)] = f"{goal}/{file.relative_to(site).as_posix()}"
        kernels = os.environ.get("SPHERECAL_WHEEL_KERNELS")  # the folder of installer/kernels.py
        if wheel and kernels:
            sys.path.insert(0, str(Path(self.root) / "installer"))
            from kernels import platform_tag

            build_data["force_include"][kernels] = "spherecal/_kernels"
            build_data["pure_python"] = False
            python = f"cp{sys.version_info.major}{sys.version_info.minor}"
            build_data["tag"] = f"{python}-{python}-{platform_tag(Path(kernels))}"
