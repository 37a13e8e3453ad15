"""What users of pen and gamepad share: eyes that lag, a sense of what comes, and patience."""

from collections import deque
from collections.abc import Generator
from dataclasses import dataclass, replace
from math import hypot, sqrt

import numpy as np
from numpy.typing import NDArray

from bunraku.figure.default import default_figure
from bunraku.msgs import Camera, Overlay, Pose
from bunraku.runtime.node import Node, param, subscribe, timer

from .person import Person, someone
from .route import Gap, Route, route_of
from .sight import Floor, Sight, look

Array = NDArray[np.float64]
Acting = Generator[None, None, None]
HZ = 60.0
GLANCE = 2  # ticks between two glances
BODY = 0.50  # m before and behind a thing's crossing in which it would be touched
BESIDE = 0.58  # m beside the way at which a pillar is no danger
BEFORE = 0.80  # m before a crossing at which one waits
START = 1.7  # m/s² with which a figure sets off, as users have learnt
TAKEOFF = (0.75, 1.45)
"""s from a jump's order until it is in the air, and down again."""
ALOFT = (0.30, 1.90)
"""s from a jump's order in which arms and body reach out farther than a standing figure's."""
PATIENCE = 15.0  # s
LEAP = 1.1  # m of a jump over a bar
BAR = 0.42  # m before a bar's track at which one jumps


@dataclass(frozen=True)
class Act:
    """What has to be done somewhere along the way."""

    hold: float
    """Arc length (m) at which it begins."""
    gap: Gap | None = None
    thing: int | None = None
    low: float = 0.0
    high: float = 0.0


def moved(new: Array, old: Array) -> Array:
    """By how much (2) m the picture moved from one glance at the tiles (T, 4, 2) to another.

    Tiles behind the eye (nan) tell nothing.
    """
    way = (new - old).reshape(-1, 2)
    way = way[np.isfinite(way).all(axis=1)]
    return np.median(way, axis=0) if len(way) else np.zeros(2)


class Player(Node):
    """A simulated user: hears only what makes up the picture, and says only its device's samples."""

    name = "player"
    journal = False
    seed: int = param(0, low=0, high=1_000_000, doc="which person")
    leave: bool = param(False, doc="end when the goal is reached")

    def setup(self) -> None:
        self.person = someone(self.seed)
        self.rng = np.random.default_rng([self.seed, 5])
        self.skeleton = default_figure()
        self.camera: Camera | None = None
        self.pose: Pose | None = None
        self.course: Overlay | None = None
        self.drawn: Overlay | None = None
        self.floor: Floor | None = None
        self.sights: deque[Sight] = deque(maxlen=60)
        self.known = 0
        self.crossings: dict[tuple[int, int], tuple[float, float]] = {}
        self.taken_in: tuple[int, Array, Route] | None = None
        self.passed: set[int] = set()
        self.crossed: set[int] = set()
        self.paces: dict[int, deque[float]] = {}
        self.arc: float | None = None
        self.ticks = 0
        self.done = False
        self.acting: Acting | None = None

    def become(self, person: Person) -> None:
        """Be somebody else, before the first glance."""
        self.person = person

    @subscribe("camera", Camera, trigger=False)
    def on_camera(self, msg: Camera) -> None:
        """The picture's place."""
        self.camera = msg

    @subscribe("pose", Pose, trigger=False)
    def on_pose(self, msg: Pose) -> None:
        """The figure in the picture."""
        self.pose = msg

    @subscribe("overlay/*", Overlay, trigger=False)
    def on_overlay(self, msg: Overlay, topic: str) -> None:
        """What is drawn in the picture."""
        if topic.endswith("/course"):
            self.course = msg
        elif topic.endswith("/interpreter"):
            self.drawn = msg

    @timer(hz=HZ)
    def tick(self) -> None:
        """Look, and go on with what is being done."""
        if self.camera is None or self.pose is None or self.course is None or self.done:
            return
        if self.floor is None:
            self.floor = Floor.learnt(self.camera)
        if self.ticks % GLANCE == 0:
            self._glance(self.floor, self.camera, self.pose, self.course)
        self.ticks += 1
        if self.acting is None:
            self.acting = self.play()
        if next(self.acting, "over") == "over":
            self.done = True
            self.rest()
            if self.leave:
                self.stop(0)

    def play(self) -> Acting:
        """What the user does, one tick a step."""
        raise NotImplementedError

    def rest(self) -> None:
        """Let go of the device."""
        raise NotImplementedError

    # Time and eyes

    @property
    def time(self) -> float:
        """s."""
        return self.now * 1e-9

    def pause(self, seconds: float) -> Acting:
        """Do nothing new for a while."""
        for _ in range(max(1, round(seconds * HZ))):
            yield
            self.keep()

    def keep(self) -> None:
        """Hold the device as it is, for one tick."""

    def _glance(self, floor: Floor, camera: Camera, pose: Pose, course: Overlay) -> None:
        if len(pose.rotations) != len(self.skeleton):
            return
        sight = look(self.time, floor, camera, self.skeleton, pose, course, self.drawn)
        if len(sight.tiles) < 2:
            return
        shown = np.nonzero(sight.shown)[0]
        if len(shown):
            self.known = max(self.known, int(shown[-1]) + 1)
        self.sights.append(sight)

    def seen(self, ago: float) -> Sight | None:
        """The newest sight that is at least ``ago`` s old."""
        for one in reversed(self.sights):
            if self.time - one.time >= ago - 1e-6:
                return one
        return None

    def pair(self, ago: float, span: float = 0.2) -> tuple[Sight, Sight, Array, float] | None:
        """A sight, one ``span`` s before it, by how much the picture moved between them (2) m, and the s between."""
        new, old = self.seen(ago), self.seen(ago + span)
        if new is None or old is None or new is old:
            return None
        return new, old, moved(new.tiles, old.tiles), new.time - old.time

    def velocity(self, ago: float) -> Array:
        """m/s of the figure (2) as seen."""
        both = self.pair(ago)
        if both is None:
            return np.zeros(2)
        new, old, shift, dt = both
        return np.asarray((new.figure - old.figure - shift) / dt)

    # The way

    def route(self, sight: Sight) -> Route:
        """The way as far as it was seen so far; it is taken in once and then moves with the picture."""
        if self.taken_in is None or self.taken_in[0] != self.known:
            tiles = sight.tiles
            if self.taken_in is not None:  # what lies behind the eye is remembered
                known = self.taken_in[1] + moved(tiles, self.taken_in[1])
                tiles = np.where(np.isfinite(tiles), tiles, known)
            self.taken_in = (self.known, tiles, route_of(tiles[: max(self.known, 2)]))
        _, tiles, way = self.taken_in
        return replace(way, places=way.places + moved(sight.tiles, tiles))

    def crossing(self, sight: Sight, route: Route, number: int) -> tuple[float, float]:
        """Between which arc lengths (m) a thing may be on the way: tracks do not move, so one look will do."""
        key = (self.known, number)
        if key not in self.crossings:
            self.crossings[key] = route.crossing(sight.things[number])
        return self.crossings[key]

    def whole(self, sight: Sight) -> bool:
        """Whether the goal was seen."""
        return self.known >= len(sight.tiles)

    def acts(self, sight: Sight, route: Route, here: float) -> list[Act]:
        """What is to be done from here on, the first one first."""
        found = []
        bound: set[int] = set()
        for gap in route.gaps:
            if gap.number in self.passed:
                continue
            inside = None
            for number, thing in enumerate(sight.things):
                low, high = self.crossing(sight, route, number)
                if thing.asks == "" and gap.off - 0.4 < low < gap.on + 0.9:
                    bound.add(number)
                    inside = number
            found.append(Act(gap.off, gap, inside, gap.off, gap.on))
        for number, thing in enumerate(sight.things):
            if number in self.crossed or number in bound or thing.asks == "duck":
                continue
            low, high = self.crossing(sight, route, number)
            if low > route.end - 0.1:
                continue
            if here > high + BODY:
                self.crossed.add(number)
                continue
            found.append(Act(low - (BAR if thing.asks == "jump" else BEFORE), None, number, low, high))
        return sorted(found, key=lambda one: one.hold)

    def ducks(self, sight: Sight, route: Route, arc: float, before: float, after: float = 0.5) -> bool:
        """Whether one has to be low at an arc length (m), from so far before a beam's track to so far behind it."""
        for number, thing in enumerate(sight.things):
            if thing.asks == "duck":
                low, high = self.crossing(sight, route, number)
                if low - before <= arc <= high + after:
                    return True
        return False

    # What moves

    def foresee(self, number: int, ahead: float, ago: float) -> Array | None:
        """Where an obstacle's middle will be (2), in the sight of ``ago`` s before, ``ahead`` s from now."""
        both = self.pair(ago)
        if both is None or number >= len(both[0].things) or number >= len(both[1].things):
            return None
        new, old = both[:2]
        dt = new.moved - old.moved
        thing = new.things[number]
        a, b = thing.track
        length = float(np.hypot(*(b - a)))
        if length < 0.05 or dt < 0.05:
            return np.asarray(thing.shadow.mean(axis=0))
        along = (b - a) / length
        at = float((thing.shadow.mean(axis=0) - a) @ along)
        before = float((old.things[number].shadow.mean(axis=0) - old.things[number].track[0]) @ along)
        pace = (at - before) / dt
        # Its usual speed is known from watching; near a turning place the last glance tells too little.
        paces = self.paces.setdefault(number, deque(maxlen=40))
        paces.append(abs(pace))
        usual = float(np.quantile(paces, 0.7))
        way = at if pace >= 0.0 else 2.0 * length - at
        trip = (way + usual * (ahead + self.time - new.moved)) % (2.0 * length)
        place = trip if trip <= length else 2.0 * length - trip
        return np.asarray(a + place * along)

    def clear(self, act: Act, route: Route, begin: float, end: float, ago: float) -> bool:
        """Whether a pillar will be beside the way from ``begin`` to ``end`` s from now."""
        assert act.thing is not None
        sight = self.seen(ago)
        if sight is None:
            return False
        low, high = self.crossing(sight, route, act.thing)
        middle = route.at(0.5 * (low + high))
        slip = float(self.rng.normal(0.0, self.person.timing))
        for ahead in np.arange(begin, end + 0.05, 0.08):
            there = self.foresee(act.thing, float(ahead) + slip, ago)
            if there is None or hypot(*(there - middle)) < BESIDE:
                return False
        return True

    def under(self, act: Act, route: Route, here: float, lag: float, ago: float) -> bool:
        """Whether a jump that is ordered ``lag`` s from now goes over a bar."""
        assert act.thing is not None
        slip = float(self.rng.normal(0.0, self.person.timing))
        spots = []
        for ahead in (lag + TAKEOFF[0], lag + 0.5 * sum(TAKEOFF), lag + TAKEOFF[1] + 0.25):
            there = self.foresee(act.thing, ahead + slip, ago)
            if there is None:
                return False
            spots.append(route.nearest(there, here, 2.5) - here)
        return spots[0] > 0.33 and 0.35 <= spots[1] <= 0.80 and spots[2] < LEAP - 0.30

    def landed(self, act: Act, far: float, before: float) -> Acting:
        """Watch until the figure has come down ``far`` m on from arc length ``before``; else look again."""
        begun = self.time
        yield from self.pause(0.6)
        while self.time - begun < 3.5:
            yield from self.pause(0.05)
            sight = self.seen(self.person.delay)
            if sight is None:
                continue
            here = self.route(sight).nearest(sight.figure, before + far, 1.5)
            if here > before + 0.7 * far and hypot(*self.velocity(self.person.delay)) < 0.25:
                if act.gap is not None:
                    self.passed.add(act.gap.number)
                if act.thing is not None:
                    self.crossed.add(act.thing)
                self.arc = here
                return
        self.arc = None  # it did not jump: look again

    def setting_off(self, way: float, lag: float) -> float:
        """s until a figure that stands has gone ``way`` m."""
        return lag + sqrt(2.0 * max(way, 0.0) / START)
