"""What is on its way to each robot: encoded once, granted when the robot runs next."""

from __future__ import annotations

from bisect import bisect_right
from operator import itemgetter

from msgspec import Raw

_arrival = itemgetter(0)


class Mail:
    """Per robot, items in order of arrival; equal arrivals in the order they were posted."""

    def __init__(self, robots: int) -> None:
        self._boxes: list[list[tuple[int, Raw]]] = [[] for _ in range(robots)]

    def post(self, robot: int, arrival_ns: int, item: Raw) -> None:
        """Have `item` reach a robot at `arrival_ns`."""
        box = self._boxes[robot]
        if box and arrival_ns < box[-1][0]:
            box.insert(bisect_right(box, arrival_ns, key=_arrival), (arrival_ns, item))
        else:
            box.append((arrival_ns, item))

    def take(self, robot: int, now_ns: int) -> list[Raw]:
        """Remove and return what has arrived by `now_ns`."""
        box = self._boxes[robot]
        if not box:
            return []
        if box[-1][0] <= now_ns:
            self._boxes[robot] = []
            return [item for _, item in box]
        arrived = bisect_right(box, now_ns, key=_arrival)
        taken = [item for _, item in box[:arrived]]
        del box[:arrived]
        return taken

    def next_arrival(self, robot: int) -> int | None:
        """When the first item not yet taken arrives."""
        box = self._boxes[robot]
        return box[0][0] if box else None
