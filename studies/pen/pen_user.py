"""A user with a pen on a tablet: draws along the way, waits, lifts and lands over gaps, presses under beams."""

from math import cos, hypot, radians, sin

import numpy as np
from numpy.typing import NDArray

from bunraku.msgs import Pen
from bunraku.nodes.interpreter.pen_rules import PenRules
from bunraku.runtime.node import Publisher, param

from .person import Wander
from .player import ALOFT, BODY, HZ, LEAP, PATIENCE, Act, Acting, Player
from .route import Route
from .sight import Sight

Array = NDArray[np.float64]
SIZE = (0.305, 0.240)
"""m, a large tablet (A4)."""
RIM = 0.012  # m at the tablet's edge that users keep free
PRESSED, LIGHT = 1.0, 0.30
QUICK = 0.6  # m/s² of a hand that draws
LEAD = 2.2  # m that a pen is ahead of the figure at most
WIDTH = 0.015  # m, how exactly a pen aims at a landing
LOW = 1.1  # m/s under a beam
SLOWS = 1.0  # m before a path's end where a figure slows down, as users have learnt
BEGUN = PenRules().longest_step
"""m of a stroke after which a standing figure sets off, as users have learnt."""


class PenPlayer(Player):
    """A simulated user who plays with a pen."""

    pen: Publisher[Pen] = Publisher("pen", Pen)
    scale: float = param(16.0, low=1.0, high=200.0, doc="figure metres for each metre of the tablet")

    def setup(self) -> None:
        super().setup()
        self.at = np.array([0.0, -0.30 * SIZE[1]])  # m from the tablet's middle, right and up
        self.contact, self.pressure = False, LIGHT
        self.moves: list[tuple[float, Array]] = []
        self.speed = 0.0  # m/s of the ground
        self.dash = -1.0
        self.near = False

    def rest(self) -> None:
        self.near = self.contact = False
        self.say()

    def keep(self) -> None:
        self.say()

    def say(self) -> None:
        """One sample."""
        x, y = 0.5 + self.at[0] / SIZE[0], 0.5 - self.at[1] / SIZE[1]
        self.pen.publish(
            Pen(device="pen", size_m=SIZE, in_range=self.near, contact=self.contact, x=float(x), y=float(y),
                pressure=self.pressure if self.contact else 0.0)
        )  # fmt: skip

    def shift(self, way: Array) -> None:
        """Move the pen by m of the ground, and say so."""
        self.at = self.at + way / self.scale
        if self.contact:
            self.moves.append((self.time, way))
        del self.moves[:-60]
        self.say()

    # Eyes on the pen

    def end(self, sight: Sight) -> Array:
        """Where the drawn path ends now, as the sight and the own hand tell."""
        late = [way for time, way in self.moves if time > sight.time]
        base = sight.figure if sight.path is None else sight.path
        return np.asarray(base + (np.sum(late, axis=0) if late else 0.0))

    def situation(self) -> tuple[Sight, Route, Array, float]:
        """Sight, way, where the path ends and its arc length."""
        sight = self.seen(self.person.delay) or self.sights[0]
        route = self.route(sight)
        end = self.end(sight)
        self.arc = route.nearest(end, self.arc)
        return sight, route, end, self.arc

    # Acting

    def play(self) -> Acting:
        yield from self.pause(0.6 + self.person.reaction)
        self.near = True
        yield from self.pause(0.15)
        self.contact = True
        self.say()
        drift = Wander(self.rng, radians(self.person.drift), self.person.wander)
        while not self.sights[-1].there:
            sight, route, end, arc = self.situation()
            figure = route.nearest(sight.figure, None if self.arc is None else arc - 0.5, 4.0)
            acts = self.acts(sight, route, figure)
            act = acts[0] if acts else None
            if act is not None and arc >= act.hold - 0.04:
                yield from self.do(act)
                continue
            stop = act.hold if act is not None else route.end
            if act is None and self.whole(sight) and arc > route.end - 0.06:
                self.speed = 0.0
                yield
                self.keep()
                continue
            self._press(sight, route, arc)
            self._pace(route, arc, stop, arc - figure)
            way = route.at(min(arc + 0.30 + 0.20 * self.speed, stop + 0.05)) - end
            if self._at_rim(way):
                yield from self.carry(route.way(arc, 1.0))
                continue
            angle = drift.step(1.0 / HZ)
            c, s = cos(angle), sin(angle)
            way = np.array([c * way[0] - s * way[1], s * way[0] + c * way[1]])
            self.shift(way / max(hypot(*way), 1e-6) * self.speed / HZ)
            yield
        yield from self.pause(0.2)

    def _press(self, sight: Sight, route: Route, arc: float) -> None:
        wanted = PRESSED if self.ducks(sight, route, arc, 0.7) else LIGHT
        self.pressure += float(np.clip(wanted - self.pressure, -0.12, 0.12))

    def _pace(self, route: Route, arc: float, stop: float, lead: float) -> None:
        """The drawing speed, m/s of the ground."""
        person = self.person
        speed = self.scale * (person.hurry if arc < self.dash else person.hand)
        speed = min(speed, route.width(arc) / person.narrow)
        bend = radians(route.turn(arc, 0.8))
        if bend > 0.2 and arc >= self.dash:
            speed *= min(1.0, (0.8 / bend / 1.6) ** person.curved)
        if self.pressure > 0.6:
            speed = min(speed, LOW)
        speed *= float(np.clip((LEAD + 0.6 - lead) / 0.6, 0.0, 1.0))
        speed = min(speed, (2.0 * QUICK * self.scale * max(stop - arc, 0.01)) ** 0.5)
        most = QUICK * self.scale / HZ
        self.speed += float(np.clip(speed - self.speed, -2.0 * most, most))

    def _room(self, way: Array) -> bool:
        """Whether the tablet has room for a movement of m of the ground."""
        goal = np.abs(self.at + way / self.scale)
        return bool((goal < 0.5 * np.array(SIZE) - RIM).all())

    def _at_rim(self, way: Array) -> bool:
        return not self._room(way / max(hypot(*way), 1e-6) * 0.05)

    def aimed(self, distance: float) -> float:
        """s of an aimed movement over m of the tablet (Fitts)."""
        return self.person.reach_a + self.person.reach_b * float(np.log2(distance / WIDTH + 1.0))

    def carry(self, ahead: Array) -> Acting:
        """Lift the pen and set it down where there is room ahead; too far off, or too late, for a jump."""
        self.speed = 0.0
        self.contact = False
        self.say()
        goal = -ahead * 0.36 * np.array(SIZE)
        far = hypot(*(goal - self.at))
        seconds = self.aimed(far)
        if far * self.scale < 1.9:
            seconds = max(seconds, 0.80)
        yield from self._fly(goal, seconds)
        self.contact = True
        self.say()
        yield from self.pause(0.06)

    def _fly(self, goal: Array, seconds: float) -> Acting:
        start, steps = self.at, max(2, round(seconds * HZ))
        for k in range(1, steps + 1):
            share = k / steps
            self.at = start + (goal - start) * share * share * (3.0 - 2.0 * share)
            if k < steps:
                self.say()
            yield

    def leap(self, way: Array) -> Acting:
        """Lift, and land ``way`` (2) m of the ground farther."""
        if not self._room(way):
            yield from self.carry(way / max(hypot(*way), 1e-6))
            yield from self.pause(0.1)
        far = hypot(*way) / self.scale
        spread = self.person.aim * far + self.person.tremor
        goal = self.at + way / self.scale + self.rng.normal(0.0, spread, 2)
        self.contact = False
        self.say()
        yield from self._fly(goal, self.aimed(far))
        self.contact = True
        self.moves.clear()
        self.say()

    def make_room(self, over: float) -> Acting:
        """Set the pen down elsewhere where the tablet has not room for so many m of the way."""
        _, route, _, arc = self.situation()
        here = route.at(arc)
        if not all(self._room(route.at(arc + share * over) - here) for share in (0.25, 0.5, 0.75, 1.0)):
            yield from self.carry(route.way(arc, 1.0))

    def still(self, most: float = 4.0) -> Acting:
        """Hold the pen until the figure has come to rest."""
        begun = self.time
        self.speed = 0.0
        while self.time - begun < most:
            yield from self.pause(0.1)
            if self.time - begun > 0.35 and hypot(*self.velocity(self.person.delay)) < 0.06:
                return

    def do(self, act: Act) -> Acting:
        """A gap, a bar or a pillar."""
        if act.thing is not None and act.gap is None and not self._jumps(act):
            yield from self.let_by(act)
            return
        if act.thing is not None:
            yield from self.make_room(LEAP)
            yield from self.still()
            yield from self.moment(act)
        elif self.speed > 0.0:
            self.speed = 0.0
            yield from self.pause(0.05)
        _sight, route, end, arc = self.situation()
        goal = route.at(act.gap.on) if act.gap is not None else end + route.way(arc) * LEAP
        yield from self.leap(goal - end)
        yield from self.landed(act, hypot(*(goal - end)), arc)

    def _jumps(self, act: Act) -> bool:
        return act.thing is not None and self.sights[-1].things[act.thing].asks == "jump"

    def moment(self, act: Act) -> Acting:
        """Wait until a jump now would get past."""
        begun = self.time
        lag = self.person.reaction + self.aimed(LEAP / self.scale)
        while self.time - begun < PATIENCE:
            _, route, _, arc = self.situation()
            ago = self.person.delay
            if self._jumps(act):
                good = self.under(act, route, arc, lag, ago)
            else:
                good = self.clear(act, route, lag + ALOFT[0], lag + ALOFT[1], ago)
            if good:
                break
            yield from self.pause(0.05)
        yield from self.pause(self.person.reaction)

    def let_by(self, act: Act) -> Acting:
        """Go on when the pillar will be beside the way; wait with a resting pen until then."""
        assert act.thing is not None
        begun, ago = self.time, self.person.delay
        yield from self.make_room(act.high + BODY + SLOWS - act.hold)
        waited = False
        while self.time - begun < PATIENCE:
            sight, route, _, arc = self.situation()
            figure = route.nearest(sight.figure, arc - 0.5, 4.0)
            left, pace = act.low - figure, hypot(*self.velocity(ago))
            if not waited and self.speed > 0.5 and pace > 0.5:
                pace = 0.5 * (pace + self.speed)
                begin, end = (left - BODY) / pace - ago, (left + BODY) / pace - ago
            else:
                if not waited:
                    yield from self.still()
                    waited = True
                    continue
                lag = self.person.reaction + BEGUN / (self.scale * self.person.hurry) + 0.15
                begin, end = self.setting_off(left - BODY, lag), self.setting_off(left + BODY, lag)
            if self.clear(act, route, begin, end, ago):
                break
            if not waited:
                yield from self.still()
                waited = True
            yield from self.pause(0.05)
        if waited:
            yield from self.pause(self.person.reaction)
        self.crossed.add(act.thing)
        self.dash = act.high + 0.6
