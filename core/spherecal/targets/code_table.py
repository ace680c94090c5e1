"""A target set as the decoder needs it: its template, the places where code dots may be, and codes by their places."""

from dataclasses import dataclass

import numpy as np

from spherecal.base.arrays import FloatArray, IntArray
from spherecal.base.errors import InputError
from spherecal.base.messages.values import Phrase
from spherecal.targets.family import DOTS, SIZE_MM
from spherecal.targets.target_set import TargetSet

# Layouts may differ by what was measured on single stickers, less than the 2.5 mm between places of code dots.
_SAME_PLACE_MM = 0.6


@dataclass(frozen=True)
class CodeTable:
    """Targets as arrays, all places scaled so that a sticker is 28 wide whatever its printed size.

    `layouts` (n, 8, 2) are the targets `ids` (n,) in the order of DOTS. `template` (5, 2) is the mean of their A to E.
    `places` (k, 2) are all places of code dots. `by_triple` (k, k, k) and `by_pair` (k, k) give the index of the target
    whose code dots are at these places in ascending order. There -1 is none and -2 (pairs only) several. `dot_radius`
    is in the same unit as the places.
    """

    ids: IntArray
    layouts: FloatArray
    template: FloatArray
    places: FloatArray
    by_triple: IntArray
    by_pair: IntArray
    dot_radius: float


def code_table(target_set: TargetSet) -> CodeTable:
    """The tables of a target set of family dots8."""
    unit = target_set.size_mm / SIZE_MM
    ids = np.array(sorted(target_set.layouts))
    if not len(ids):
        raise InputError(Phrase("error-empty-target-set"))
    try:
        layouts = np.array([target_set.places(target, DOTS) for target in ids.tolist()]) / unit
    except KeyError as error:
        raise InputError(Phrase("error-target-lacks-dot", {"dot": str(error.args[0])})) from error
    template = layouts[:, :5].mean(axis=0)
    if np.abs(layouts[:, :5] - template).max() > _SAME_PLACE_MM:
        raise InputError(Phrase("error-frame-dots"))
    places, place_of = _cluster(layouts[:, 5:].reshape(-1, 2))
    triples = np.sort(place_of.reshape(-1, 3), axis=1)
    by_triple = np.full((len(places),) * 3, -1)
    by_pair = np.full((len(places),) * 2, -1)
    for index, triple in enumerate(triples.tolist()):
        i, j, k = triple
        if by_triple[i, j, k] >= 0 or len(set(triple)) < 3:
            values = {"first": int(ids[by_triple[i, j, k]]), "second": int(ids[index])}
            raise InputError(Phrase("error-same-code", values))
        by_triple[i, j, k] = index
        for pair in ((i, j), (i, k), (j, k)):
            by_pair[pair] = index if by_pair[pair] == -1 else -2
    return CodeTable(ids, layouts, template, places, by_triple, by_pair, target_set.dot_diameter_mm / 2 / unit)


def _cluster(dots: FloatArray) -> tuple[FloatArray, IntArray]:
    """Mean places of dots (n, 2) that are close together, and each dot's place (n,)."""
    places, members = np.empty((len(dots), 2)), list[list[FloatArray]]()
    place_of = np.empty(len(dots), dtype=np.int64)
    for i, dot in enumerate(dots):
        known = len(members)
        away = places[:known] - dot
        near = np.flatnonzero(np.hypot(away[:, 0], away[:, 1]) < _SAME_PLACE_MM)
        if len(near):
            place_of[i] = near[0]
            members[near[0]].append(dot)
        else:
            place_of[i], places[known] = known, dot
            members.append([dot])
    return np.array([np.mean(group, axis=0) for group in members]), place_of
