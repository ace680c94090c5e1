"""The features of a GenICam camera by the names that makers and ages give them; a missing one is normal."""

import re
import time
import tomllib
from collections.abc import Iterable
from contextlib import suppress
from typing import Any

from spherecal.base.resources import resource_path

TABLE: dict[str, Any] = tomllib.loads(resource_path("genicam.toml").read_text(encoding="utf-8"))
NAMES: dict[str, tuple[str, ...]] = {ours: tuple(theirs) for ours, theirs in TABLE["features"].items()}

# Words for yes and no where one camera has a switch, another an enumeration, and makers differ in its entries.
_YES = ("On", "True", "Yes", "Enable", "Enabled", "1")
_NO = ("Off", "False", "No", "Disable", "Disabled", "None", "Manual", "0")

_READABLE = ("RO", "RW")
_WRITEABLE = ("WO", "RW")


class FeatureError(Exception):
    """A feature that is there but cannot be read or written now; the text says why."""


class NodeFeatures:
    """The features of one node map; nodes are looked up once."""

    def __init__(self, node_map: Any, offline: bool = False) -> None:
        self._map = node_map
        self._offline = offline
        self._nodes: dict[str, Any] = {}
        self._implemented: set[str] = set()

    def name(self, feature: str) -> str | None:
        """The camera's own name of one of our features, None if it has none."""
        return self.first(NAMES[feature])

    def first(self, names: Iterable[str]) -> str | None:
        """The first of these names that the camera implements; None where it has none."""
        return next((name for name in names if self.node(name) is not None), None)

    def node(self, name: str) -> Any | None:
        """The node of this exact name; None where it does not exist, has no value or is not implemented."""
        if name not in self._nodes:
            self._nodes[name] = self._find(name)
        node = self._nodes[name]
        if node is None or self._offline or name in self._implemented:
            return node
        if self.access(node) == "NI":  # may depend on another feature: asked again next time
            return None
        self._implemented.add(name)
        return node

    def _find(self, name: str) -> Any | None:
        try:
            if not self._map.has_node(name):
                return None
            node = self._map.get_node(name)
        except Exception:  # a lost camera raises what it likes
            return None
        valued = hasattr(type(node), "value") or hasattr(type(node), "execute")  # asking the node itself would read
        return node if valued else None  # else a category of that name

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
        """The value of one of our features as a number; None where it cannot be read or is none."""
        value = self.read(self.name(feature))
        return float(value) if isinstance(value, int | float) else None

    def unit(self, name: str) -> str:
        """The unit of a number by its exact name, in small letters; empty where the camera does not say."""
        return _text_of(self.node(name), "unit").strip().lower()

    def limit(self, name: str, which: str) -> float | None:
        """The present limit of a number; None where it has none."""
        try:
            value = getattr(self.node(name), which, None)
        except Exception:
            return None
        return value if isinstance(value, int | float) else None

    def whole(self, name: str) -> bool:
        """Whether a feature is a whole number."""
        return isinstance(self.limit(name, "min"), int)

    def choices(self, name: str) -> tuple[str, ...]:
        """The entries that an enumeration offers now; empty where it cannot be read."""
        node = self.node(name)
        try:
            return tuple(node.symbolics) if node is not None else ()
        except Exception:
            return ()

    def meant(self, name: str, value: Any) -> Any:
        """A wanted value in the camera's own words and steps: `Off` may be False or `Disabled`, 11 may be 8."""
        node = self.node(name)
        return value if node is None else _fit(node, value)

    def write(self, name: str, value: Any) -> Any:
        """Write a node in the camera's own words and steps, unless it has the value; the value that it then has."""
        node = self.node(name)
        if node is None:
            raise FeatureError("the camera does not have it")
        access = self.access(node)
        try:
            fitted = _fit(node, value)
            if access in _READABLE and _same(self.read(name), fitted):  # the present value may be none that it knows
                return fitted
            if access not in _WRITEABLE:
                raise FeatureError("cannot be changed now")
            node.value = fitted
            return node.value if access == "RW" else fitted
        except FeatureError:
            raise
        except Exception as error:
            raise FeatureError(plain(error)) from error

    def execute(self, name: str) -> None:
        """Run a command."""
        node = self.node(name)
        if node is None:
            raise FeatureError("the camera does not have it")
        try:
            node.execute()
        except Exception as error:
            raise FeatureError(plain(error)) from error

    def is_done_late(self, name: str, most_s: float) -> bool:
        """Wait until a command that was run is done; whether it was done, but not at once."""
        node, until, late = self.node(name), time.monotonic() + most_s, False
        with suppress(Exception):  # a command that cannot be read back counts as done at once
            while node is not None and not node.is_done():
                if time.monotonic() > until:
                    return False
                late = True
                time.sleep(0.0005)
        return late


def _fit(node: Any, value: Any) -> Any:
    if hasattr(type(node), "symbolics"):
        return _entry(tuple(node.symbolics), value)
    if isinstance(value, str) and value in (_YES[0], _NO[0]) and not hasattr(type(node), "max_length"):
        value = value == _YES[0]  # a switch, or a number that serves as one
    if isinstance(value, str) or not hasattr(type(node), "min"):
        return value
    low, high = node.min, node.max
    if not isinstance(low, int):
        return min(max(float(value), low), high)
    allowed = _listed(node)
    if allowed:
        return min(allowed, key=lambda one: abs(one - value))
    step = max(int(getattr(node, "inc", 1) or 1), 1)
    whole = min(max(round(value), low), high)
    return low + (whole - low) // step * step


def _listed(node: Any) -> tuple[int, ...]:
    """The values of a whole number that takes only some."""
    from genicam import genapi

    try:
        return tuple(node.list_of_valid_values) if node.inc_mode == genapi.EIncMode.listIncrement else ()
    except Exception:
        return ()


def _entry(entries: tuple[str, ...], value: Any) -> Any:
    """The entry of an enumeration that a value means: `Off` is `Disabled`, 2 is `X2` or `Binning2x2`."""
    if value in entries:
        return value
    if isinstance(value, bool):
        value = _YES[0] if value else _NO[0]
    if isinstance(value, int | float):
        fits = (e for e in entries if (found := re.findall(r"\d+", e)) and {int(n) for n in found} == {value})
        return next(fits, str(value))
    words = next((words for words in (_YES, _NO) if words[0] == value), (value,))
    small = {entry.lower(): entry for entry in reversed(entries)}
    return next((small[word.lower()] for word in words if word.lower() in small), value)


def _text_of(node: Any, attribute: str) -> str:
    try:
        return str(getattr(node, attribute, "") or "")
    except Exception:
        return ""


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
