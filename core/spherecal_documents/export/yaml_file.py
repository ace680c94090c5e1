"""YAML and JSON of other programs, read with care into checked values."""

import json
from pathlib import Path

import numpy as np
import yaml

from spherecal.base.arrays import FloatArray
from spherecal.base.errors import InputError
from spherecal.files.json_file import JsonValue, decode, read_bytes

# A camchain of 100 cameras has 100 kB and 9,000 values; 50,000 take 3 s to read.
_MOST_BYTES = 8 << 20
_MOST_EVENTS, _DEEPEST = 50_000, 50
_LONGEST = 2000  # of one value: numbers have 24 characters, names 100; Python writes no whole number of 4300 digits
_QUICK = getattr(yaml, "CSafeLoader", yaml.SafeLoader)  # where libyaml was built in


class _Loader(yaml.SafeLoader):
    """The safe loader, plus OpenCV's matrices."""


def _mapping(loader: yaml.SafeLoader, node: yaml.Node) -> object:
    if not isinstance(node, yaml.MappingNode):
        raise yaml.YAMLError("a matrix of OpenCV's must have rows, cols, dt and data")
    return loader.construct_mapping(node, deep=True)


_Loader.add_constructor("tag:yaml.org,2002:opencv-matrix", _mapping)


def read_yaml(path: Path) -> JsonValue:
    """What a YAML file holds, OpenCV's `%YAML:1.0` included."""
    text = decode(path, read_bytes(path, _MOST_BYTES))
    if text.startswith("%YAML:"):
        text = text.partition("\n")[2]
    try:
        _look_through(text)
        value = _named(yaml.load(text, _Loader))
    except (yaml.YAMLError, ValueError, OverflowError, RecursionError) as error:
        mark = getattr(error, "problem_mark", None)
        where = f"line {mark.line + 1}: " if mark is not None else ""
        problem = getattr(error, "problem", None) or str(error)
        raise InputError(f"{path}: is not valid YAML ({where}{problem}).") from None
    return JsonValue(value, path)


def read_other_json(path: Path) -> JsonValue:
    """What a JSON file holds."""
    try:
        return JsonValue(json.loads(decode(path, read_bytes(path, _MOST_BYTES))), path)
    except (ValueError, RecursionError) as error:
        raise InputError(f"{path}: is not valid JSON ({error}).") from None


def _look_through(text: str) -> None:
    """YAMLError where a file is not what cameras need: anchors (a small file can expand to a huge one), size, depth."""
    depth = 0
    for number, event in enumerate(yaml.parse(text, _QUICK)):
        if isinstance(event, yaml.AliasEvent):
            raise yaml.YAMLError("it uses anchors and aliases, which camera files do not need")
        if isinstance(event, yaml.ScalarEvent) and len(event.value) > _LONGEST:
            raise yaml.YAMLError(f"it has a value of {len(event.value)} characters")
        if number > _MOST_EVENTS:
            raise yaml.YAMLError(f"it has more than {_MOST_EVENTS} values")
        depth += isinstance(event, yaml.CollectionStartEvent) - isinstance(event, yaml.CollectionEndEvent)
        if depth > _DEEPEST:
            raise yaml.YAMLError("its lists and objects are nested too deeply")


def _named(value: object) -> object:
    """The value with texts for all keys, as in JSON: YAML also has numbers and dates there."""
    if isinstance(value, dict):
        return {str(key): _named(item) for key, item in value.items()}
    return [_named(item) for item in value] if isinstance(value, list) else value


def opencv_matrix(value: JsonValue) -> FloatArray:
    """A matrix as OpenCV's FileStorage or ROS writes it (rows, cols, data), or a list of lists; (rows, columns)."""
    if isinstance(value.value, list):
        nested = value.items(least=1)
        if isinstance(nested[0].value, list):
            return np.array(value.matrix(len(nested), len(nested[0].items(least=1))))
        return np.array([[item.number() for item in nested]])
    f = value.fields(("rows", "cols", "data"))
    shape = f["rows"].integer(1, 100), f["cols"].integer(1, 100)
    data, count = f["data"], shape[0] * shape[1]
    if isinstance(data.value, list) and len(data.value) == 1 and isinstance(data.value[0], str):
        # camera_calibration of ROS wrote numbers without commas between them (its issue 533)
        data = data.at(0, [_number(text) for text in data.value[0].split()])
    return np.array(data.numbers(count)).reshape(shape)


def _number(text: str) -> float | str:
    try:
        return float(text)
    except ValueError:
        return text
