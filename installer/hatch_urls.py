"""hatchling's hook: the project's addresses, of the repository that the release workflow runs in; none elsewhere."""

import os

from hatchling.metadata.plugin.interface import MetadataHookInterface


class Addresses(MetadataHookInterface):
    """Fills in `[project.urls]`."""

    def update(self, metadata: dict) -> None:
        """Source, issues, changes and documents of the repository, by the variables of the workflow."""
        server, name = os.environ.get("GITHUB_SERVER_URL"), os.environ.get("GITHUB_REPOSITORY")
        if not server or not name:
            metadata["urls"] = {}
            return
        home = f"{server}/{name}"
        metadata["urls"] = {
            "Homepage": home,
            "Source": home,
            "Issues": f"{home}/issues",
            "Changelog": f"{home}/blob/main/CHANGELOG.md",
            "Documentation": f"{home}/tree/main/docs",
        }
