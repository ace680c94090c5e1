"""Where names go beside the things that they name, so that none covers another."""

from collections.abc import Collection, Sequence

from PySide6.QtCore import QPointF, QRectF, QSizeF

_GAP_PX = 4.0


def place_tags(
    names: Sequence[str],
    places: Sequence[QPointF],
    sizes: Sequence[QSizeF],
    room: QRectF,
    mark_px: float,
    first: Collection[str] = (),
    taken: Sequence[QRectF] = (),
) -> dict[str, QRectF]:
    """The boxes of the names that have room, by name; one that would cover another name or a mark is left out."""
    marks = [QRectF(place.x() - mark_px / 2, place.y() - mark_px / 2, mark_px, mark_px) for place in places]
    used, found = list(taken), {}
    order = sorted(range(len(names)), key=lambda i: names[i] not in first)
    for i in order:
        boxes = [box for box in _beside(marks[i], sizes[i]) if room.contains(box)]
        others = [*used, *(mark for j, mark in enumerate(marks) if j != i and mark != marks[i])]
        free = next((box for box in boxes if not any(box.intersects(one) for one in others)), None)
        if free is None and names[i] in first:
            free = boxes[0] if boxes else _beside(marks[i], sizes[i])[0]
        if free is not None:
            used.append(free)
            found[names[i]] = free
    return found


def _beside(mark: QRectF, size: QSizeF) -> list[QRectF]:
    """To the right, above, to the left, below, then the corners."""
    right, left = mark.right() + _GAP_PX, mark.left() - _GAP_PX - size.width()
    above, below = mark.top() - size.height(), mark.bottom()
    middle_x, middle_y = mark.center().x() - size.width() / 2, mark.center().y() - size.height() / 2
    corners = [(x, y) for x in (right, left) for y in (above, below)]
    places = [(right, middle_y), (middle_x, above), (left, middle_y), (middle_x, below), *corners]
    return [QRectF(QPointF(x, y), size) for x, y in places]
