"""Contacts of all touch devices from message to message, whatever order and loss they come with."""

from dataclasses import dataclass
from typing import Literal

from bunraku.msgs import Touch

MOST_FINGERS = 40
"""Of all devices together: more are left out."""
Key = tuple[str, int]
"""Device and contact id."""


@dataclass(frozen=True)
class Change:
    """One contact's news."""

    key: Key
    kind: Literal["down", "move", "up"]
    x: float
    y: float


class ContactTable:
    """Which fingers are down, by device and id.

    The rules: a frame lists all live contacts of its device, so one that is absent has left; a move that was
    never put down is put down; a second down of a live id is a new finger; an ending of an unknown one is nothing.
    """

    def __init__(self) -> None:
        self.live: dict[Key, tuple[float, float]] = {}
        self.heard: dict[str, float] = {}

    def frame(self, touch: Touch, now: float) -> list[Change]:
        """The changes that a device's message brings, endings first."""
        self.heard[touch.device] = now
        ends: list[Change] = []
        rest: list[Change] = []
        listed: set[Key] = set()
        for one in touch.contacts:
            key = (touch.device, one.id)
            if key in listed:
                continue
            listed.add(key)
            known = key in self.live
            if one.phase in ("up", "cancel"):
                if known:
                    ends.append(Change(key, "up", one.x, one.y))
                    del self.live[key]
                continue
            if known and one.phase == "down":
                ends.append(Change(key, "up", *self.live[key]))
                known = False
            if not known and len(self.live) >= MOST_FINGERS:
                continue
            rest.append(Change(key, "move" if known else "down", one.x, one.y))
            self.live[key] = (one.x, one.y)
        for key in [key for key in self.live if key[0] == touch.device and key not in listed]:
            ends.append(Change(key, "up", *self.live.pop(key)))
        return ends + rest

    def lose(self, device: str) -> list[Change]:
        """A device went: all that it had down goes up."""
        self.heard.pop(device, None)
        return [Change(key, "up", *self.live.pop(key)) for key in [k for k in self.live if k[0] == device]]

    def forget(self, now: float, after: float) -> list[Change]:
        """Fingers of devices that were silent for ``after`` s."""
        silent = [device for device, at in self.heard.items() if now - at > after]
        return [change for device in silent for change in self.lose(device)]
