"""hatchling's hook: takes the offline manual into wheel and sdist where `python3 dev.py docs` has made it."""

from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface


class ManualHook(BuildHookInterface):
    """Adds build/site, which git does not know of."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Where it goes: into the package in a wheel, where it is in an sdist, so that its wheels have it too."""
        site = Path(self.root) / "build" / "site"
        if version != "editable" and (site / "index.html").is_file():
            goal = "spherecal/_resources/manual" if self.target_name == "wheel" else "build/site"
            build_data["force_include"][str(site)] = goal
