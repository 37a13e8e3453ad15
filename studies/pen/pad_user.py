"""A user with a gamepad: steers with the left stick, jumps by the right one and a button, ducks by another."""

from math import atan2, cos, degrees, hypot, pi, radians, remainder, sin

import numpy as np
from numpy.typing import NDArray

from bunraku.msgs import Pad
from bunraku.nodes.interpreter.pad import PadRules
from bunraku.runtime.node import Publisher

from .person import Wander
from .player import ALOFT, BODY, HZ, LEAP, PATIENCE, Act, Acting, Player
from .route import Route
from .sight import Sight

Array = NDArray[np.float64]
RULES = PadRules()
FLICK = 0.10  # s from rest to the full tilt
MARGIN = 0.45  # m before a place at which one means to stand, since a run is seen too late
GAINS = 0.7  # m/s that a figure may have gained since it was seen


def coast(speed: float) -> float:
    """m that a figure of a speed (m/s) goes on when the stick is let go, as users have learnt."""
    return max(RULES.stop + 0.07 * speed, 0.93 * RULES.coast(speed))


class PadPlayer(Player):
    """A simulated user who plays with a gamepad."""

    pad: Publisher[Pad] = Publisher("pad", Pad)

    def setup(self) -> None:
        super().setup()
        self.left, self.right = np.zeros(2), np.zeros(2)  # sticks, right and up
        self.wanted = np.zeros(2)
        self.buttons: set[int] = set()
        self.dash = -1.0

    def rest(self) -> None:
        self.left, self.right, self.wanted, self.buttons = np.zeros(2), np.zeros(2), np.zeros(2), set()
        self.say()

    def keep(self) -> None:
        self.say()

    def say(self) -> None:
        """One sample; sticks take their time."""
        most = 1.0 / (FLICK * HZ)
        step = self.wanted - self.left
        self.left = self.left + step * min(1.0, most / max(hypot(*step), 1e-9))
        values = [self.left[0], -self.left[1], self.right[0], -self.right[1]]
        axes = [float(np.clip(value, -1.0, 1.0)) for value in values]
        self.pad.publish(Pad(device="pad", axes=axes, buttons=[number in self.buttons for number in range(16)]))

    @staticmethod
    def tilted(way: Array, share: float) -> Array:
        """A stick toward a direction (2), a share of the way beyond its dead zone."""
        length = hypot(*way)
        if length < 1e-9 or share <= 0.0:
            return np.zeros(2)
        return np.asarray(way / length * (RULES.dead + (1.0 - RULES.dead) * min(share, 1.0)))

    def situation(self) -> tuple[Sight, Route, Array, float, Array]:
        """Sight, way, where the figure is by now, its arc length and its velocity."""
        delay = self.person.delay
        sight = self.seen(delay) or self.sights[0]
        route = self.route(sight)
        velocity = self.velocity(delay)
        here = sight.figure + velocity * delay
        self.arc = route.nearest(here, self.arc)
        return sight, route, here, self.arc, velocity

    def play(self) -> Acting:
        yield from self.pause(0.75 + self.person.reaction)
        wander = Wander(self.rng, radians(self.person.thumb), self.person.wander)
        while not self.sights[-1].there:
            sight, route, here, arc, velocity = self.situation()
            speed = hypot(*velocity)
            acts = self.acts(sight, route, arc)
            act = acts[0] if acts else None
            rolls = coast(min(speed + GAINS, RULES.fastest))
            if act is not None and arc >= act.hold - MARGIN - rolls:
                yield from self.do(act)
                continue
            if self.ducks(sight, route, arc, 0.6 + 0.9 * max(speed, 0.6), 0.5):
                self.buttons.add(RULES.duck)
            else:
                self.buttons.discard(RULES.duck)
            way = route.at(arc + 0.45 + 0.30 * speed) - here
            angle = atan2(way[1], way[0]) + wander.step(1.0 / HZ)
            aside = degrees(abs(remainder(angle - atan2(velocity[1], velocity[0]), 2.0 * pi))) if speed > 0.6 else 0.0
            straight = max(route.turn(arc, max(1.2, speed)), aside) < self.person.bend
            full = straight or arc < self.dash
            near = act is not None and act.hold - arc < 0.3 + 0.3 * speed + rolls and arc >= self.dash
            share = 1.0 if full and not near and RULES.duck not in self.buttons else self.person.slow
            self.wanted = self.tilted(np.array([cos(angle), sin(angle)]), share)
            self.say()
            yield
        yield from self.pause(0.2)

    # Acting

    def halt(self, most: float = 2.5) -> Acting:
        """Let the stick go and watch until the figure stands."""
        self.wanted = np.zeros(2)
        begun = self.time
        while self.time - begun < most:
            yield from self.pause(0.1)
            if self.time - begun > 0.35 and hypot(*self.velocity(self.person.delay)) < 0.06:
                return

    def do(self, act: Act) -> Acting:
        """A gap, a bar or a pillar."""
        jumps = act.thing is not None and self.sights[-1].things[act.thing].asks == "jump"
        if act.thing is not None and act.gap is None and not jumps:
            yield from self.let_by(act)
            return
        yield from self.halt()
        yield from self.approach(act)
        if act.thing is not None:
            yield from self.moment(act, jumps)
        _, route, here, arc, _ = self.situation()
        goal = route.at(act.gap.on) if act.gap is not None else here + route.way(arc) * LEAP
        yield from self.leap(goal - here)
        yield from self.landed(act, hypot(*(goal - here)), arc)

    def approach(self, act: Act) -> Acting:
        """Small pushes of the stick until the jump is not too far."""
        for _ in range(4):
            _, route, here, arc, _ = self.situation()
            goal = act.gap.on if act.gap is not None else act.hold + LEAP
            if hypot(*(route.at(goal) - here)) < RULES.longest_jump + (0.02 if act.gap is not None else 0.12):
                return
            self.wanted = self.tilted(route.at(arc + 0.4) - here, 0.15)
            yield from self.pause(FLICK)
            yield from self.halt()

    def moment(self, act: Act, bar: bool) -> Acting:
        """Wait until a jump now would get past."""
        begun, ago = self.time, self.person.delay
        lag = self.person.reaction + self.person.press
        while self.time - begun < PATIENCE:
            _, route, _, arc, _ = self.situation()
            good = (
                self.under(act, route, arc, lag, ago)
                if bar
                else self.clear(act, route, lag + ALOFT[0], lag + ALOFT[1], ago)
            )
            if good:
                break
            yield from self.pause(0.05)
        yield from self.pause(self.person.reaction)

    def leap(self, way: Array) -> Acting:
        """Right stick where to, then the button."""
        far = hypot(*way) * (1.0 + float(self.rng.normal(0.0, self.person.aim)))
        angle = atan2(way[1], way[0]) + float(self.rng.normal(0.0, radians(0.5 * self.person.thumb)))
        self.right = self.tilted(np.array([cos(angle), sin(angle)]), far / RULES.longest_jump)
        yield from self.pause(self.person.press)
        self.buttons.add(RULES.jump)
        yield from self.pause(self.person.press)
        self.buttons.discard(RULES.jump)
        self.right = np.zeros(2)

    def let_by(self, act: Act) -> Acting:
        """Go on when the pillar will be beside the way; stand until then."""
        assert act.thing is not None
        begun, ago = self.time, self.person.delay
        waited = False
        while self.time - begun < PATIENCE:
            _, route, _, arc, velocity = self.situation()
            speed = hypot(*velocity)
            left = act.low - arc
            if not waited and speed > 0.5:
                begin, end = (left - BODY) / speed, (left + BODY) / speed
            else:
                lag = self.person.reaction + 0.15
                begin, end = self.setting_off(left - BODY, lag), self.setting_off(left + BODY, lag)
            if self.clear(act, route, begin, end, ago):
                break
            if not waited:
                yield from self.halt()
                waited = True
            yield from self.pause(0.05)
        if waited:
            yield from self.pause(self.person.reaction)
        self.crossed.add(act.thing)
        self.dash = act.high + 0.6
