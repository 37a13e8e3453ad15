"""What a finger costs over a motion: how far it is missed, how much moves at once, what stays of the motion.

    python studies/over.py                   the table of docs/touch.md, from every part held over every motion
    python studies/over.py --all             and a line for each of them
    python studies/over.py --update          writes the table into docs/touch.md

A finger's place goes with the figure as a drag plane does: with its place on the ground and its low-passed heading. It
takes a third of a second to get there, stays, and lets go.
"""

import argparse
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from math import exp, pi
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bunraku.figure.default import default_figure
from bunraku.figure.fk import fk
from bunraku.figure.metrics import joint_velocities, unexplained_ways
from bunraku.figure.rig import rig_of
from bunraku.motion.constraint import path_of
from bunraku.motion.player import Player
from bunraku.motion.synth import builtin_set
from bunraku.nodes.controller.core import Stack

Array = NDArray[np.float64]
Frame = tuple[Array, Array, tuple[bool, bool]]

HZ = 60
DT = 1.0 / HZ
FIGURE = default_figure()
RIG = rig_of(FIGURE)
BEGIN, GRAB, THERE, SETTLED, RELEASE, END = 0.5, 1.5, 1.5 + 1.0 / 3.0, 2.1, 4.5, 6.0
"""s: when the motion begins, the finger comes down, is where it wants to be, is looked at, lets go; the end."""
HEADING_LAG = 0.12
"""s, of the heading that carries a drag plane (`TouchRules.heading_lag`)."""
NAMES = ("pelvis", "left_hand", "right_hand", "left_foot", "right_foot")
JOINTS = {"pelvis": 0, "head": FIGURE.names.index("head")}
for _limb, _side in enumerate(("left", "right", "left", "right")):
    JOINTS[f"{_side}_{'hand' if _limb < 2 else 'foot'}"] = int(RIG.limbs[_limb, 2])
    JOINTS[f"{_side}_{'elbow' if _limb < 2 else 'knee'}"] = int(RIG.limbs[_limb, 1])


@dataclass(frozen=True)
class Touch:
    """A finger that holds ``part`` at ``way`` (left, up, ahead; m) from where the standing figure has it.

    ``free``: whether nothing is in the way, so that the part should be under the finger.
    """

    part: str
    name: str
    way: tuple[float, float, float]
    free: bool = True

    @property
    def joint(self) -> int:
        """The joint under the finger."""
        return JOINTS[self.part]


def sides(part: str, name: str, way: tuple[float, float, float], free: bool = True) -> Iterator[Touch]:
    """A touch of the left side, and its mirror image."""
    yield Touch(f"left_{part}", name, way, free)
    yield Touch(f"right_{part}", name, (-way[0], way[1], way[2]), free)


TOUCHES = (
    *sides("hand", "up", (0.28, 0.72, 0.10)),
    *sides("hand", "aside", (0.42, 0.52, 0.05)),
    *sides("hand", "ahead", (0.05, 0.50, 0.50)),
    *sides("hand", "before the chest", (-0.10, 0.45, 0.35)),
    *sides("hand", "across", (-0.30, 0.40, 0.35)),
    *sides("elbow", "up", (0.15, 0.20, 0.05)),
    *sides("foot", "up ahead", (0.0, 0.25, 0.25)),
    *sides("foot", "aside", (0.20, 0.12, 0.0)),
    *sides("foot", "through the other leg", (-0.22, 0.05, 0.0), free=False),
    *sides("knee", "up", (0.0, 0.15, 0.20)),
    Touch("pelvis", "down", (0.0, -0.10, 0.0)),
    Touch("pelvis", "aside", (0.05, -0.03, 0.0)),
    Touch("head", "turned", (0.0, 0.7, 0.0)),
)


def going(speed: float, radius: float = 0.0, duck: float = 0.0) -> Callable[[Player], None]:
    """Go along a straight path, or a circle, at ``speed`` m/s."""

    def begin(player: Player) -> None:
        if radius > 0.0:
            angles = np.linspace(0.0, 5.5 * speed / radius, 80)
            points = np.stack([radius * (1.0 - np.cos(angles)), radius * np.sin(angles)], axis=1)
        else:
            points = np.array([[0.0, 0.0], [0.0, 6.0 * speed]])
        player.stand(duck=duck)
        player.follow(path_of(points, speeds=np.full(len(points), speed)))

    return begin


def making(module: str, value: float) -> Callable[[Player], None]:
    """A move, again and again."""
    return lambda player: player.move(module, [value])


MOTIONS: dict[str, Callable[[Player], None]] = {
    "stand": lambda player: None,
    "walk": going(1.2),
    "bend": going(1.2, radius=0.9),
    "run": going(2.6),
    "duck": going(1.0, duck=0.8),
    "turn": making("turn_left", 2.0),
    "jump": making("jump_up", 0.4),
}


@cache
def playing(name: str) -> tuple[Frame, ...]:
    """What the player makes of a motion, `HZ` frames a second until `END`."""
    player = Player(builtin_set())
    begin = MOTIONS[name]
    frames = []
    for n in range(round(END * HZ)):
        if n >= BEGIN * HZ and player.free:
            begin(player)
        player.update(DT)
        left, right = player.contacts
        frames.append((player.root.copy(), player.rotations.copy(), (bool(left), bool(right))))
    return tuple(frames)


def heading_of(turn: Array) -> float:
    """The heading (rad) of an orientation: its twist about +Y."""
    return 2.0 * float(np.arctan2(turn[1], turn[3]))


def yawed(yaw: float, v: Array) -> Array:
    """A vector (3) turned about +Y."""
    c, s = np.cos(yaw), np.sin(yaw)
    return np.array([c * v[0] + s * v[2], v[1], c * v[2] - s * v[0]])


@cache
def carried(name: str) -> tuple[Array, Array]:
    """Ground place and mean pelvis height (F, 3) m and low-passed heading (F) rad of a motion."""
    frames = playing(name)
    places = np.array([frame[0] for frame in frames])
    places[:, 1] = places[round(GRAB * HZ) : round(RELEASE * HZ), 1].mean()
    headings = np.empty(len(frames))
    yaw = heading_of(frames[0][1][0])
    for n, frame in enumerate(frames):
        turned = heading_of(frame[1][0]) - yaw
        yaw += ((turned + pi) % (2.0 * pi) - pi) * (1.0 - exp(-DT / HEADING_LAG))
        headings[n] = yaw
    return places, headings


@dataclass(frozen=True, eq=False)
class Played:
    """A motion (M) and the figure (P) with a finger on it: F frames, J joints."""

    motion: str
    touch: Touch
    targets: Array  # (F, 3) m, nan while nothing is held
    moved: Array  # (F, J, 3) m, M
    posed: Array  # (F, J, 3) m, P
    turned: Array  # (F, J, 4) local, M
    rotations: Array  # (F, J, 4) local, P
    planted: NDArray[np.bool_]  # (F, 2)


def play(motion: str, touch: Touch) -> Played:
    """The stack over a motion, with one finger."""
    frames = playing(motion)
    places, headings = carried(motion)
    stack = Stack(FIGURE)
    standing, _ = fk(FIGURE, frames[0][0], frames[0][1])
    joint = touch.joint
    goal = standing[joint] + np.array(touch.way) - frames[0][0]
    targets = np.full((len(frames), 3), np.nan)
    moved, posed, rotations, planted = [], [], [], []
    grabbed: Array | None = None
    for _ in range(90):
        stack.lie_over(*frames[0])
        stack.step(DT)
    for n, frame in enumerate(frames):
        stack.lie_over(*frame)
        expected, _ = fk(FIGURE, frame[0], frame[1])
        time = n * DT
        if GRAB <= time < RELEASE:
            if grabbed is None:
                grabbed = yawed(-headings[n], stack.positions_ws[joint] - places[n])
            share = min(1.0, (time - GRAB) / (THERE - GRAB))
            share *= share * (3.0 - 2.0 * share)
            if touch.part == "head":
                half = 0.5 * (headings[n] + share * touch.way[1])
                stack.hold("head", np.array([0.0, np.sin(half), 0.0, np.cos(half)]))
            else:
                targets[n] = places[n] + yawed(headings[n], grabbed + (goal - grabbed) * share)
                stack.hold(touch.part, targets[n])
        else:
            stack.hold(touch.part, None)
        stack.step(DT)
        moved.append(expected)
        posed.append(stack.positions_ws.copy())
        rotations.append(stack.rotations_ls.copy())
        planted.append(stack.state.planted > 0.5)
    return Played(
        motion, touch, targets, np.array(moved), np.array(posed), np.array([frame[1] for frame in frames]),
        np.array(rotations), np.array(planted),
    )  # fmt: skip


def seen() -> slice:
    """The frames in which the finger rests on the figure."""
    return slice(round(SETTLED * HZ), round(RELEASE * HZ))


def misses(played: Played) -> Array:
    """How far (m) the held joint is from its finger while that rests; none where something is in the way.

    An elbow or knee can only be on a sphere about its shoulder or hip; what counts is the point nearest to the finger.
    """
    if not played.touch.free or played.touch.part == "head":
        return np.zeros(0)
    at, targets, joint = played.posed[seen(), played.touch.joint], played.targets[seen()], played.touch.joint
    if played.touch.part.endswith(("elbow", "knee")):
        root = played.posed[seen(), FIGURE.parents[joint]]
        way = targets - root
        length = np.linalg.norm(FIGURE.offsets[joint])
        targets = root + way * (length / np.linalg.norm(way, axis=1)[:, None])
    return np.asarray(np.linalg.norm(at - targets, axis=1))


def beyond(played: Played) -> Array:
    """How far (m) the finger is out of the limb's own reach, hanging where the motion has it, at the same frames."""
    for limb in range(4):
        if RIG.limbs[limb, 2] == played.touch.joint:
            root = played.moved[seen(), RIG.limbs[limb, 0]]
            away = np.linalg.norm(played.targets[seen()] - root, axis=1)
            return np.asarray(np.maximum(away - RIG.reach[limb, 1], 0.0))
    return np.zeros(round(RELEASE * HZ) - round(SETTLED * HZ))


def leaps(played: Played) -> Array:
    """(F-1) m: how far a joint goes in a frame beyond what motion and finger explain (`unexplained_ways`)."""
    return np.asarray(unexplained_ways(played.posed, played.moved, led(played)).max(axis=1))


def led(played: Played) -> Array:
    """(F-1) m: how far the finger goes in a frame, seen from the motion's root."""
    ways = np.diff(played.targets - played.moved[:, 0], axis=0)
    return np.asarray(np.nan_to_num(np.linalg.norm(ways, axis=1)))


def kinks(played: Played) -> tuple[Array, Array]:
    """Largest velocity steps of a joint (F-2) rad/s: the figure's, and the motion's."""
    own, his = (np.diff(joint_velocities(turns, DT), axis=0) for turns in (played.rotations, played.turned))
    return np.linalg.norm(own, axis=2).max(axis=1), np.linalg.norm(his, axis=2).max(axis=1)


MEASURES = ("hand", "foot", "elbow, knee", "pelvis")
START, STOP = "<!-- over a motion -->", "<!-- end over -->"
DOC = Path(__file__).resolve().parents[1] / "docs" / "touch.md"


def kind(touch: Touch) -> str:
    """Which column a touch counts in."""
    end = touch.part.rpartition("_")[2]
    return "elbow, knee" if end in ("elbow", "knee") else end


def row(motion: str, out: Callable[[str], None]) -> str:
    """The line of a motion in the table; ``out`` is told every touch."""
    found: dict[str, list[Array]] = {}
    leap, kink, own = 0.0, 0.0, 0.0
    for touch in TOUCHES:
        played = play(motion, touch)
        missed = misses(played) * 1e3
        if missed.size:
            found.setdefault(kind(touch), []).append(missed)
        far, steps = leaps(played).max() * 1e3, kinks(played)
        leap, kink, own = max(leap, far), max(kink, steps[0].max()), max(own, steps[1].max())
        said = f"{np.median(missed):.0f} / {missed.max():.0f}" if missed.size else "-"
        out(f"{motion:6}{touch.part:12}{touch.name:22}{said:>10} mm{far:6.0f} mm{np.degrees(steps[0].max()):7.0f} °/s")
    cells = []
    for name in MEASURES:
        missed = np.concatenate(found[name])
        cells.append(
            " / ".join(f"{value:.0f}" for value in (np.median(missed), np.quantile(missed, 0.95), missed.max()))
        )
    return f"| {motion} | {' | '.join(cells)} | {max(leap, 0.0):.0f} | {np.degrees(kink):.0f} ({np.degrees(own):.0f}) |"


def table(out: Callable[[str], None]) -> str:
    """The table of docs/touch.md."""
    head = "| motion | hand mm | foot mm | elbow, knee mm | pelvis mm | leap mm | velocity step °/s |"
    return "\n".join([head, "|---|---|---|---|---|---|---|", *(row(motion, out) for motion in MOTIONS)])


def main(argv: Sequence[str] | None = None) -> None:
    """Print the table, or write it."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--all", action="store_true", help="a line for every part over every motion")
    parser.add_argument("--update", action="store_true", help="write the table into docs/touch.md")
    args = parser.parse_args(argv)
    said = table(print if args.all else lambda _line: None)
    print(said)
    if args.update:
        text = DOC.read_text()
        before, _, rest = text.partition(START)
        _, _, after = rest.partition(STOP)
        DOC.write_text(f"{before}{START}\n\n{said}\n\n{STOP}{after}")


if __name__ == "__main__":
    main()
