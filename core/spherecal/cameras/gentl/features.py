"""The features of a GenICam camera by the names that makers and ages give them; a missing one is normal."""

from collections.abc import Iterable
from typing import Any

# Ours -> theirs, the standard's present name first. Older Allied Vision and Basler cameras say ...Abs or ...Raw.
NAMES: dict[str, tuple[str, ...]] = {
    "exposure": ("ExposureTime", "ExposureTimeAbs", "ExposureTimeRaw"),
    "gain": ("Gain", "GainAbs", "GainRaw"),
    "pixel format": ("PixelFormat",),
    "trigger mode": ("TriggerMode",),
    "trigger source": ("TriggerSource",),
    "software trigger": ("TriggerSoftware",),
    "frame rate": ("AcquisitionFrameRate", "AcquisitionFrameRateAbs"),
    "frame rate limit": ("AcquisitionFrameRateEnable", "AcquisitionFrameRateEnabled", "AcquisitionFrameRateMode"),
    "packet size": ("GevSCPSPacketSize",),
    "packet delay": ("GevSCPD",),
    "frame delay": ("GevSCFTD",),
    "temperature": ("DeviceTemperature", "TemperatureAbs"),
    "width": ("Width",),
    "height": ("Height",),
    "left": ("OffsetX",),
    "top": ("OffsetY",),
    "time stamp latch": ("TimestampLatch", "GevTimestampControlLatch"),
    "latched time": ("TimestampLatchValue", "GevTimestampValue"),
    "time stamp rate": ("GevTimestampTickFrequency",),
}

_READABLE = ("RO", "RW")
_WRITEABLE = ("WO", "RW")


class FeatureError(Exception):
    """A feature that is there but cannot be read or written now; the text says why."""


class NodeFeatures:
    """The features of one node map; nodes are looked up once.

    `offline` takes a description without a camera, whose nodes have no access mode.
    """

    def __init__(self, node_map: Any, offline: bool = False) -> None:
        self._map = node_map
        self._offline = offline
        self._nodes: dict[str, Any] = {}

    def name(self, feature: str) -> str | None:
        """The camera's own name of one of our features, None if it has none."""
        return self.first(NAMES[feature])

    def first(self, names: Iterable[str]) -> str | None:
        """The first of these names that the camera implements."""
        return next((name for name in names if self.node(name) is not None), None)

    def node(self, name: str) -> Any | None:
        """The node of this exact name; None where it does not exist, holds no value or is not implemented."""
        if name not in self._nodes:
            self._nodes[name] = self._find(name)
        return self._nodes[name]

    def _find(self, name: str) -> Any | None:
        try:
            if not self._map.has_node(name):
                return None
            node = self._map.get_node(name)
        except Exception:  # a lost camera raises what it likes
            return None
        if not (hasattr(type(node), "value") or hasattr(type(node), "execute")):  # asking the node itself would read
            return None  # a category of that name
        return node if self._offline or self.access(node) != "NI" else None

    def access(self, node: Any) -> str:
        """NI (not implemented), NA (not available), WO, RO or RW."""
        from genicam import genapi

        try:
            mode = node.get_access_mode()
        except Exception:
            return "NA"
        names = {genapi.EAccessMode.NI: "NI", genapi.EAccessMode.WO: "WO", genapi.EAccessMode.RO: "RO"}
        return "RW" if mode == genapi.EAccessMode.RW else names.get(mode, "NA")

    def read(self, name: str | None) -> Any | None:
        """The value of a node by its exact name; None where it cannot be read."""
        node = self.node(name) if name else None
        if node is None or self.access(node) not in _READABLE:
            return None
        try:
            return node.value
        except Exception:
            return None

    def number(self, feature: str) -> float | None:
        """The value of one of our features as a number."""
        value = self.read(self.name(feature))
        return float(value) if isinstance(value, int | float) else None

    def choices(self, name: str) -> tuple[str, ...]:
        """What an enumeration offers now."""
        node = self.node(name)
        try:
            return tuple(node.symbolics) if node is not None else ()
        except Exception:
            return ()

    def write(self, name: str, value: Any) -> Any:
        """Write a node, numbers brought into its range and step; the value that it then has, or FeatureError."""
        node = self.node(name)
        if node is None:
            raise FeatureError("the camera does not have it")
        if self.access(node) not in _WRITEABLE:
            raise FeatureError("cannot be changed now")
        try:
            fitted = _fit(node, value)
            if self.access(node) == "RW" and _same(node.value, fitted):
                return node.value
            node.value = fitted
            return node.value
        except Exception as error:
            raise FeatureError(plain(error)) from error

    def execute(self, name: str) -> None:
        """Run a command; FeatureError if it cannot be run."""
        node = self.node(name)
        if node is None:
            raise FeatureError("the camera does not have it")
        try:
            node.execute()
        except Exception as error:
            raise FeatureError(plain(error)) from error


def _fit(node: Any, value: Any) -> Any:
    if isinstance(value, bool | str) or not hasattr(node, "min"):
        return value
    low, high = node.min, node.max
    if isinstance(low, int):
        step = max(int(getattr(node, "inc", 1) or 1), 1)
        whole = min(max(round(value), low), high)
        return low + (whole - low) // step * step
    return min(max(float(value), low), high)


def _same(a: Any, b: Any) -> bool:
    return type(a) is type(b) and bool(a == b)


def plain(error: BaseException) -> str:
    """An exception of genicam in one line: what the driver says, else genicam's own words without file and line."""
    text = " ".join(str(error).split())
    said = text.partition("(Message from the source: ")[2].rpartition(") (ID: ")[0].strip(" .")
    if said:
        return said
    for marker in (" : ", "GenTL exception: "):
        text = text.rsplit(marker, 1)[0] if marker == " : " and "(file" in text else text.removeprefix(marker)
    text = text.split(" (file ", 1)[0].strip(" .")
    return text or type(error).__name__


def error_id(error: BaseException) -> int | None:
    """The GenTL code that genicam writes into its texts, `(ID: -1010)`."""
    _, found, rest = str(error).rpartition("(ID: ")
    digits = rest.split(")", 1)[0]
    return int(digits) if found and digits.lstrip("-").isdigit() else None
