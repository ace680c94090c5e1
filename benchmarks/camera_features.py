"""Our features against the description files of real cameras: `python -m benchmarks.camera_features FOLDER`.

Prints a table: by which name each camera has each feature, `-` where it has none.
"""

import sys
from pathlib import Path

from spherecal_cameras.genicam.features import NAMES, NodeFeatures

# What a set-up writes beside our features, or the window offers.
OTHERS = ("ActionDeviceKey", "ActionGroupKey", "ActionGroupMask", "DeviceIndicatorMode", "UserSetSelector")


def names_of(file: Path) -> dict[str, str | None]:
    """The name that a description has for each of our features, None where it has none."""
    from genicam import genapi

    text = file.read_text(encoding="utf-8", errors="replace")  # some have a line of their finder's before it
    nodes = genapi.NodeMap()
    nodes.load_xml_from_string(text[text.find("<?xml") if "<?xml" in text else text.index("<RegisterDescription") :])
    features = NodeFeatures(nodes, offline=True)
    return {feature: features.name(feature) for feature in NAMES} | {name: features.first((name,)) for name in OTHERS}


def table(folder: Path) -> list[str]:
    """The table's lines in Markdown: a row for each feature, by how many files have each of its names."""
    found = {file.stem: names_of(file) for file in sorted(folder.glob("*.xml"))}
    lines = [f"| feature | of {len(found)} files | names |", "|---|---|---|"]
    for feature in (*NAMES, *OTHERS):
        by_name: dict[str, list[str]] = {}
        for camera, names in found.items():
            if (name := names[feature]) is not None:
                by_name.setdefault(name, []).append(camera)
        count = sum(map(len, by_name.values()))
        shown = ", ".join(f"`{name}` {len(cameras)}" for name, cameras in sorted(by_name.items())) or "-"
        lines.append(f"| {feature} | {count} | {shown} |")
    return lines


if __name__ == "__main__":
    print("\n".join(table(Path(sys.argv[1]))))
