"""How a figure walks under a pen, in numbers: the tables of docs/pen.md.

    python studies/pen_walk.py [--seconds 60]

A simulated pen draws a smooth random line, at speeds that change between a stroll and a run, on a large tablet
and on one 15 cm wide, where it is lifted at the edge and set down again on the other side. Interpreter and blender
run on a stage in memory at their own rates. Besides: how long after the pen's samples each motion begins, and how
often an early start is wrong.
"""

import argparse
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from math import pi

import numpy as np
from blending import drift, recorded, velocity_steps
from numpy.typing import NDArray

from bunraku.figure.metrics import path_error
from bunraku.msgs import Jump, Locomotion, Pad, Pen, Step
from bunraku.nodes.blender.node import Blender
from bunraku.nodes.interpreter.node import Interpreter
from bunraku.nodes.interpreter.pen_rules import PenRules
from bunraku.runtime.memory import MemoryStage

Array = NDArray[np.float64]
FPS, RATE, RULES = 60.0, 120.0, PenRules()


class Stage:
    """Interpreter and blender; the camera looks along +Z, so that pen right is -X and pen up +Z."""

    def __init__(self, size: tuple[float, float], early: bool = False, natural: bool = False) -> None:
        self.stage = MemoryStage()
        how = {"pen_early": early, "pen_natural": natural}
        self.stage.add(Interpreter, azimuth=pi - 1e-9, elevation=0.5, distance=6.5, **how)
        self.blender = self.stage.add(Blender, skeleton=True, remap={"motion": "pose"}, show_overlay=False)
        self.size = size
        self.frames: list[tuple[Array, ...]] = []
        self.time = 0.0
        self.wait(0.5)

    def send(self, at: tuple[float, float], *, contact: bool = True, pressure: float = 0.3) -> None:
        """The pen at (right, up) m of the ground from the tablet's middle."""
        x, y = 0.5 + at[0] / (self.size[0] * RULES.scale), 0.5 - at[1] / (self.size[1] * RULES.scale)
        pen = Pen(device="pen", size_m=self.size, in_range=True, contact=contact, x=x, y=y,
                  pressure=pressure if contact else 0.0)  # fmt: skip
        self.stage.publish("pen", pen)

    def wait(self, seconds: float) -> None:
        """Let time pass, keeping what is measured of each of the blender's frames."""
        end = self.time + seconds
        while self.time < end - 1e-9:
            part = min(1.0 / (2.0 * RATE), end - self.time)
            before = self.blender.before
            self.stage.advance(part)
            self.time += part
            if self.blender.before != before:
                player = self.blender.core.player
                here = np.array([player.place.x, player.place.z, player.place.heading])
                state = player.state
                self.frames.append((player.root.copy(), player.rotations.copy(), state.mode.copy(),
                                    state.prints.copy(), here, np.array([player.beyond, self.time])))  # fmt: skip


def drawn(seconds: float, size: tuple[float, float], seed: int) -> Iterator[tuple[bool, tuple[float, float], float]]:
    """(contact, place on the tablet, pen speed m/s) at `RATE`: a wandering line that keeps off the edge, or, on a
    tablet less than 20 cm wide, is lifted there and set down on the other side."""
    random = np.random.default_rng(seed)
    half = 0.5 * np.array(size) * RULES.scale - 0.15
    small = size[0] < 0.2
    at, heading, turn, speed, wanted = np.zeros(2), 0.0, 0.0, 1.2, 1.2
    t = 0.0
    while t < seconds:
        dt = 1.0 / RATE
        if random.random() < 0.4 * dt:
            wanted = float(random.uniform(0.6, 2.6))
        speed += (wanted - speed) * dt / 0.6
        turn += (-turn * 1.5 + float(random.normal(0.0, 1.2)) / np.sqrt(dt) * 0.35) * dt * 2.0
        if not small:
            # Back toward the middle from near the edge.
            near = float(np.max(np.abs(at) / half))
            if near > 0.6:
                back = np.arctan2(-at[0], -at[1])
                off = float((back - heading + pi) % (2 * pi) - pi)
                turn += np.sign(off) * 6.0 * (near - 0.6) * dt * 8.0
        turn = float(np.clip(turn, -1.4, 1.4))
        heading += turn * dt
        at = at + speed * dt * np.array([np.sin(heading), np.cos(heading)])
        if (np.abs(at) > half).any():
            at = np.clip(at, -half, half)
            if small:
                yield False, (float(at[0]), float(at[1])), 0.0
                t += 0.35
                yield False, (0.0, 0.0), 0.35  # lifted and carried
                at = -np.sign(at) * (np.abs(at) > half - 1e-6) * (half - 0.05) + at * (np.abs(at) <= half - 1e-6)
            else:
                heading += 0.3
        yield True, (float(at[0]), float(at[1])), speed
        t += dt


@dataclass(frozen=True)
class Quality:
    """A walk in numbers: m, m/s, degrees/s."""

    length: float
    resets: int
    path_rms: float
    path_most: float
    drift: float
    beyond: float
    step_most: float
    step_usual: float
    speed_error: float
    behind: float
    """s from the pen's last sample until the figure is where it ended."""


def free_walk(seconds: float, size: tuple[float, float], seed: int) -> Quality:
    """Draw for so long; measure the figure against the whole line that was drawn."""
    stage = Stage(size)
    ground: list[tuple[float, float]] = []
    offset, down, last, resets = np.zeros(2), False, (0.0, 0.0), 0
    for contact, at, value in drawn(seconds, size, seed):
        if not contact:
            if value:
                stage.wait(value)
                resets += 1
            else:
                stage.send(at, contact=False)
            down = False
            continue
        if not down:
            offset = np.array(ground[-1] if ground else (0.0, 0.0)) - np.array(at)
            down = True
        stage.send(at)
        stage.wait(1.0 / RATE)
        last = at
        ground.append((float(offset[0] + at[0]), float(offset[1] + at[1])))
    stage.send(last, contact=False)
    until = stage.time
    while stage.time < until + 30.0 and not (stage.blender.core.player.free and stage.time > until + 2.0):
        stage.wait(0.5)  # it goes to the path's end
    player = stage.blender.core.player
    line = np.array(ground[::6]) * np.array([-1.0, 1.0])
    clip = recorded(player, stage.frames)
    here = np.array([one[4][:2] for one in stage.frames])
    off = path_error(here, line)
    steps = velocity_steps(clip)
    going = np.hypot(*(here - here[-1]).T) > 0.02
    arrived = float(max(one[5][1] for one, on in zip(stage.frames, going, strict=True) if on))
    asked = float(np.hypot(*np.diff(line, axis=0).T).sum())
    walked = float(np.hypot(*np.diff(here, axis=0).T).sum())
    return Quality(
        length=asked, resets=resets, path_rms=float(np.sqrt((off**2).mean())), path_most=float(off.max()),
        drift=drift(player, clip, stage.frames), beyond=max(float(one[5][0]) for one in stage.frames),
        step_most=float(steps.max()), step_usual=float(np.quantile(steps.max(axis=1), 0.9)),
        speed_error=abs(walked - asked) / asked, behind=max(arrived - until, 0.0),
    )  # fmt: skip


def round_corner(angle: float, speed: float, natural: bool) -> tuple[float, float, float]:
    """m/s at the slowest and on average over the 2 m about a sharp corner, and s from the pen's end to the figure's."""
    stage = Stage((0.6, 0.6), natural=natural)
    at = np.array([0.0, -3.0])
    stage.send((0.0, -3.0))
    for leg, turned in ((3.0, 0.0), (4.0, angle)):
        count = round(leg / speed * RATE)
        for _ in range(count):
            at = at + leg / count * np.array([np.sin(turned), np.cos(turned)])
            stage.send((float(at[0]), float(at[1])))
            stage.wait(1.0 / RATE)
    stage.send((float(at[0]), float(at[1])), contact=False)
    until = stage.time
    stage.wait(6.0)
    here = np.array([one[4][:2] for one in stage.frames])
    times = np.array([one[5][1] for one in stage.frames])
    gaps = np.hypot(*np.diff(here, axis=0).T)
    walked = np.cumsum(gaps)
    middle = (walked > 2.0) & (walked < 4.0)
    going = np.hypot(*(here - here[-1]).T) > 0.02
    return float(gaps[middle].min() * FPS), 2.0 / (middle.sum() / FPS), float(times[going][-1] - until)


def first_motion(stage: Stage, since: float) -> float:
    """s from ``since`` until the hips have left where they were by 1 cm."""
    times = np.array([one[5][1] for one in stage.frames])
    roots = np.array([one[0] for one in stage.frames])
    rest = roots[times <= since][-1]
    gone = np.linalg.norm(roots - rest, axis=1) > 0.01
    late = times[gone & (times > since)]
    return float(late[0] - since) if len(late) else float("nan")


def latency(kind: str, early: bool, phase: float) -> tuple[float, float, float]:
    """s from the stroke's first sample to its command, from its last one, and from the command to motion."""
    stage = Stage((0.4, 0.4), early)
    stage.wait(0.5 + phase)
    begun = stage.time
    heard = len(stage.stage.received("command"))
    said = float("nan")
    ended = float("nan")

    def send(at: tuple[float, float], **more: bool) -> None:
        nonlocal said
        stage.send(at, **more)
        note()

    def note() -> None:
        nonlocal said
        if said != said and any(
            isinstance(one, Step | Jump | Locomotion) for one in stage.stage.received("command")[heard:]
        ):
            said = stage.time

    if kind == "jump":
        send((0.0, 0.0))
        stage.wait(0.1)
        begun = stage.time
        send((0.0, 0.0), contact=False)
        stage.wait(0.15)
        ended = stage.time
        send((0.0, 0.6))
    else:
        length, seconds = (0.45, 0.3) if kind == "step" else (2.0, 1.4)
        for k in range(round(seconds * RATE) + 1):
            send((0.0, length * k / round(seconds * RATE)))
            stage.wait(1.0 / RATE)
            note()
        ended = stage.time
        send((0.0, length), contact=False)
    for _ in range(240):
        stage.wait(1.0 / RATE)
        note()
    return said - begun, said - ended, first_motion(stage, said)


def pad_latency(kind: str, phase: float) -> float:
    """s from a gamepad's sample to motion; the command is said at once."""
    stage = Stage((0.4, 0.4))
    stage.wait(0.5 + phase)
    begun = stage.time
    left = [0.0, -0.6] if kind == "walk" else [0.0, 0.0]
    right = [0.0, 0.0] if kind == "walk" else [0.0, -0.8]
    for _ in range(60):
        buttons = [kind == "jump", kind == "step"]
        stage.stage.publish("pad", Pad(device="pad", axes=[*left, *right], buttons=buttons))
        stage.wait(2.0 / RATE)
    return first_motion(stage, begun)


SHAPES: dict[str, Callable[[float], float]] = {
    "slows down to its end": lambda s: s * s * (3.0 - 2.0 * s),
    "least jerk": lambda s: s**3 * (10.0 - 15.0 * s + 6.0 * s * s),
    "even speed, then stops": lambda s: s,
    "flick, lifted at 70 % of its time": lambda s: (0.7 * s) ** 2 * (3.0 - 1.4 * s) / (0.7**2 * (3.0 - 1.4)),
}
"""How far a stroke is at a share of its time."""


def early_errors(shape: Callable[[float], float], shortest: float, count: int = 400, seed: int = 5) -> int:
    """Of random strokes of a step from ``shortest`` m on, aside and back: how many an early start takes for a walk."""
    from bunraku.nodes.interpreter.pen_stroke import PenTrack, Sample

    random = np.random.default_rng(seed)
    wrong = 0
    for _ in range(count):
        track = PenTrack(RULES)
        aside = float(random.uniform(RULES.early_ahead + 0.1, 2.0 * pi - RULES.early_ahead - 0.1))
        length, seconds = random.uniform(shortest, RULES.longest_step), random.uniform(0.15, 0.6)
        frames = max(2, round(seconds * RATE))
        early = False
        for k in range(frames + 1):
            shake = random.normal(0.0, 0.004, 2)
            gone = length * shape(k / frames)
            place = (gone * np.sin(aside) + float(shake[0]), gone * np.cos(aside) + float(shake[1]))
            for event in track.hear(Sample(10.0 + k / RATE, place, True)):
                early = early or (event.kind == "moving" and track.stroke.unambiguous(track.moved_at, RULES, 0.0))
        wrong += early
    return wrong


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seconds", type=float, default=60.0, help="of the free walk (default 60)")
    parser.add_argument("--seeds", type=int, default=2, help="walks on each tablet (default 2)")
    args = parser.parse_args()
    print("| tablet | seed | path m | resets | off the path, rms / most mm | foot drift mm | beyond reach mm |"
          " velocity step, 90 % / most °/s | length walked | on after the pen s |")  # fmt: skip
    print("|---|---|---|---|---|---|---|---|---|---|")
    for name, size in (("40 x 40 cm", (0.4, 0.4)), ("15 x 9.4 cm", (0.15, 0.094))):
        for seed in range(args.seeds):
            q = free_walk(args.seconds, size, seed)
            print(f"| {name} | {seed} | {q.length:.1f} | {q.resets} "
                  f"| {1e3 * q.path_rms:.0f} / {1e3 * q.path_most:.0f} "
                  f"| {1e3 * q.drift:.2f} | {1e3 * q.beyond:.1f} | {q.step_usual:.0f} / {q.step_most:.0f} "
                  f"| {100 * (1 - q.speed_error):.1f} % | {q.behind:.1f} |", flush=True)  # fmt: skip
    print("\n| corner | pen m/s | path | slowest m/s | mean of 2 m about it m/s | on after the pen s |")
    print("|---|---|---|---|---|---|")
    for angle in (45.0, 90.0, 135.0, 180.0):
        for speed in (1.3, 2.4):
            for natural in (False, True):
                a, b, c = round_corner(np.radians(angle), speed, natural)
                name = "natural" if natural else "as drawn"
                print(f"| {angle:.0f}° | {speed} | {name} | {a:.2f} | {b:.2f} | {c:.1f} |", flush=True)
    print("\n| motion | first sample to command ms | last sample to command ms | command to motion ms |")
    print("|---|---|---|---|")
    for kind, early in (("step", False), ("walk", False), ("walk", True), ("jump", False)):
        rows = np.array([latency(kind, early, phase) for phase in np.arange(4) / (4 * FPS)]) * 1e3
        a, b, c = np.median(rows, axis=0)
        last = f"{b:.0f}" if b > -1.0 else "before its end"
        print(f"| {kind}{', early start' if early else ''} | {a:.0f} | {last} | {c:.0f} |", flush=True)
    for kind in ("step", "walk", "jump"):
        c = float(np.median([pad_latency(kind, phase) for phase in np.arange(4) / (4 * FPS)]) * 1e3)
        print(f"| {kind}, gamepad | 0 | 0 | {c:.0f} |", flush=True)
    print("\n| a step's stroke, aside and back | of 400 from 0.2 m taken for a walk | of 400 from early_step on |")
    print("|---|---|---|")
    for name, shape in SHAPES.items():
        print(f"| {name} | {early_errors(shape, 0.2)} | {early_errors(shape, RULES.early_step)} |", flush=True)


if __name__ == "__main__":
    main()
