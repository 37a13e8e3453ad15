"""The last steps of a walk: a whole number of them ends where its path ends (Oshita 2005, section 6.3, figure 11).

How many steps are left follows from the room, the speed and the examples' own cadence. A walk that would end in the
middle of a step goes a little slower, so that its steps become shorter, or a little faster, so that they become longer
and the one that would be very short is not needed; what that leaves is made up for by the cadence.
"""

from dataclasses import dataclass
from math import log, sqrt

import numpy as np

from bunraku.motion.timewarp import seconds_between
from bunraku.motion.voice import Voice, posed

SHARES = (0.80, 0.86, 0.93, 1.0, 1.07, 1.15, 1.23)
"""What the speed may be multiplied by."""
RATES = (0.75, 1.35)
"""What the cadence may be multiplied by."""
COUNTED = 0.8
"""m before the place where a walk begins to brake: from there on its steps are counted."""
HELD = 0.08
"""m before the end in which the last footfall waits for it."""
HURRY = 0.04
"""s, half-life of a change of cadence."""
HARDER = 0.3
"""1/s: who runs brakes harder. The speed r m before the end is sqrt(2 brake r) + `HARDER` r."""
GRID = 0.1
"""m/s between two entries of a table."""


def speed_at(room: float, brake: float) -> float:
    """m/s at most, ``room`` m before the end; brakes by ``brake`` (m/s²) in the last moment and harder before."""
    return sqrt(2.0 * brake * room) + HARDER * room


def room_of(speed: float, brake: float) -> float:
    """m that a figure needs to brake from ``speed`` (m/s) to a stand: the inverse of `speed_at`."""
    root = (sqrt(2.0 * brake + 4.0 * HARDER * speed) - sqrt(2.0 * brake)) / (2.0 * HARDER)
    return root * root


def braked(speed: float, change: float, room: float, brake: float, dt: float) -> float:
    """The speed (m/s) ``dt`` s later: changed by ``change`` (m/s), but braked so that it ends in ``room`` m.

    Harder than usual only as far as the room asks for; never slower than 0.04 m/s.
    """
    bound = speed_at(room, brake)
    usual = brake + 1.5 * HARDER * sqrt(2.0 * brake * room) + HARDER * HARDER * room
    if speed <= bound:
        return min(speed + change, max(bound, speed - usual * dt, 0.04))
    harder = max(room_of(speed, brake) / max(room, 1e-3), 1.0)
    return max(speed + min(change, -harder * usual * dt), 0.04)


@dataclass(frozen=True, eq=False)
class Cadence:
    """Steps of a locomotion module, at 0, `GRID`, ... m/s."""

    brake: float  # m/s²
    rates: tuple[float, ...]
    """Steps a second."""
    braking: tuple[float, ...]
    """Steps from this speed to a stand."""

    def _at(self, table: tuple[float, ...], speed: float) -> float:
        k = min(int(speed / GRID), len(table) - 2)
        return table[k] + (speed / GRID - k) * (table[k + 1] - table[k])

    def rate(self, speed: float) -> float:
        """Steps a second at a speed (m/s)."""
        return self._at(self.rates, speed)

    def stopping(self, speed: float) -> float:
        """Steps of braking from a speed (m/s)."""
        return self._at(self.braking, speed)


def cadence_of(voice: Voice, most: float, brake: float) -> Cadence:
    """The cadence of a locomotion module up to ``most`` m/s, upright and straight ahead; ``brake`` in m/s²."""
    table, rates, braking = voice.table, [], [0.0]
    for k in range(int(most / GRID) + 2):
        at = np.zeros(len(voice.parameters))
        at[voice.parameters.index("speed")] = k * GRID
        weights = voice.weights(posed(voice.weights, at, np.zeros(3)))
        rates.append(2.0 / seconds_between(table.generic, table.spans, weights, 0.0, 1.0))
        if k:
            seconds = (room_of(k * GRID, brake) - room_of((k - 1) * GRID, brake)) / ((k - 0.5) * GRID)
            braking.append(braking[-1] + 0.5 * (rates[-1] + rates[-2]) * seconds)
    return Cadence(brake, tuple(rates), tuple(braking))


def steps_left(cadence: Cadence, room: float, speed: float, wanted: float, start: float) -> float:
    """How many steps a walk makes before its end.

    Args:
        room: m to the end.
        speed: m/s now. wanted: m/s that it goes on at until it has to brake.
        start: m/s², getting faster.
    """
    needed = room_of(speed, cadence.brake)
    if needed >= room:
        return cadence.stopping(speed) * room / max(needed, 1e-6)
    top, begun, steps = max(wanted, 0.05), 0.0, 0.0
    if wanted > speed:
        for _ in range(4):  # where speeding up and braking meet
            begun = max(top * top - speed * speed, 0.0) / (2.0 * start)
            over = begun + room_of(top, cadence.brake) - room
            if over <= 0.0:
                break
            top = max(top - over / (top / start + 2.0 * room_of(top, cadence.brake) / top), speed)
        steps = (top - speed) / start * 0.5 * (cadence.rate(top) + cadence.rate(speed))
    even = max(room - begun - room_of(top, cadence.brake), 0.0)
    return steps + even * cadence.rate(top) / top + cadence.stopping(top)


def last_steps(
    cadence: Cadence, room: float, speed: float, wanted: float, start: float, step: float
) -> tuple[float, float, int]:
    """What speed and cadence are to be multiplied by so that a step ends where the path does, and how many more are
    made after the one under way.

    Args:
        step: how much of the step under way is left, 0..1. The others are as in `steps_left`.
    """
    best = (float("inf"), 1.0, 1.0, 0)
    braking = room_of(speed, cadence.brake) >= room
    for share in (1.0,) if braking else SHARES:
        steps = max(steps_left(cadence, room, speed, share * wanted, start), 1e-3)
        more = max(round(steps - step), 0)
        whole = max(step + more, 1e-3)
        cost = 4.0 * log(whole / steps) ** 2 + log(share) ** 2
        if cost < best[0]:
            best = (cost, share, whole / steps, more)
    return best[1:]
