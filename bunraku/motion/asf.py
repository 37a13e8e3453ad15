"""Acclaim files: the skeleton (ASF) and its motion (AMC), as CMU and HDM05 give them.

A bone's rotation is C M C⁻¹ with C from its ``axis`` line and M from its degrees of freedom; its joint is at
the end of the bone above it. Files of this kind need not say their rate; both collections have 120 Hz.
"""

import math
import re
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bunraku.motion import rotation as rot
from bunraku.motion.bvh import read_text
from bunraku.motion.capture import Capture, CaptureError, Raw, interpret
from bunraku.motion.clip import Clip

Array = NDArray[np.float64]

DEFAULT_FPS = 120.0
INCH = 0.0254  # m; the collections' unit of length is an inch, divided by the file's own "length"
MAX_BONES = 2000
LARGEST = 1e9  # of any number in a frame
_MOVES = ("tx", "ty", "tz")
_TURNS = ("rx", "ry", "rz")


def read_amc(
    file: str | Path, asf: str | Path | None = None, *, fps: float | None = None, unit: float | None = None
) -> Clip:
    """The clip in an AMC file, its skeleton's rest pose made a T-pose facing +Z.

    Args:
        asf: the skeleton's file; looked for beside the AMC file when None (see `find_asf`).
        fps: frames a second where the file does not say; 120 when None.
        unit: metres in one unit of the file; from the ASF's ``length`` when None.

    Raises:
        CaptureError: one line with the file's name, the line number and what is wrong.
    """
    return load_amc(file, asf, fps=fps, unit=unit).clip


def load_amc(
    file: str | Path,
    asf: str | Path | None = None,
    *,
    fps: float | None = None,
    unit: float | None = None,
    up: str | None = None,
    root: str | None = None,
) -> Capture:
    """Like `read_amc`, with what was found out and mended on the way; ``up`` and ``root`` as in `read_bvh`."""
    path = Path(file)
    text = read_text(path)
    where = Path(asf) if asf is not None else find_asf(path)
    figure = parse_asf(read_text(where), where.name)
    return interpret(parse_amc(text, path.name, figure, fps), unit=unit, up=up, root=root)


def find_asf(amc: Path) -> Path:
    """The ASF file in the same folder whose name begins the AMC's; else the only one there."""
    found = sorted(p for p in amc.parent.iterdir() if p.suffix.lower() == ".asf")
    fitting = [p for p in found if amc.stem.lower().startswith(p.stem.lower())]
    if fitting:
        return max(fitting, key=lambda p: len(p.stem))
    if len(found) == 1:
        return found[0]
    seen = f"{len(found)} others" if found else "none"
    raise CaptureError(f"{amc.name}: no skeleton beside it named like it ({seen}); give the ASF file")


@dataclass
class Bone:
    """One bone of an ASF file; "root" is the first."""

    name: str
    line: int
    direction: Array = field(default_factory=lambda: np.zeros(3))
    length: float = 0.0
    axis: tuple[float, float, float] = (0.0, 0.0, 0.0)
    axis_order: str = "xyz"
    freedom: tuple[str, ...] = ()
    parent: int = -1


@dataclass
class Figure:
    """The skeleton of an ASF file."""

    bones: list[Bone]  # parents first, the root first of all
    unit: float | None  # m
    degrees: bool
    position: Array


def parse_asf(text: str, name: str) -> Figure:
    """The bones of an ASF text; raises `CaptureError` with the line that is broken."""
    root = Bone("root", 1, freedom=("tx", "ty", "tz", "rx", "ry", "rz"))
    bones: dict[str, Bone] = {"root": root}
    parents: dict[str, tuple[str, int]] = {}
    position = np.zeros(3)
    unit: float | None = None
    degrees = True
    section, bone = "", None
    for number, line in enumerate(text.splitlines(), 1):
        words = line.split("#")[0].split()
        if not words:
            continue
        key, rest = words[0].lower(), words[1:]
        at = f"{name}:{number}"
        if key.startswith(":"):
            section, bone = key[1:], None
        elif section == "units":
            if key == "length" and rest:
                length = _floats(rest, 1, at)[0]
                if not 1e-4 < length < 1e4:
                    raise CaptureError(f"{at}: a unit length of {rest[0]}; expected about 0.45")
                unit = INCH / length
            elif key == "angle" and rest:
                degrees = not rest[0].lower().startswith("rad")
        elif section == "root":
            if key == "order":
                root.freedom = _freedom(rest, at)
            elif key == "axis" and rest:
                root.axis_order = _order(rest[0], at)
            elif key == "position":
                position = np.array(_floats(rest, 3, at))
            elif key == "orientation":
                x, y, z = _floats(rest, 3, at)
                root.axis = (x, y, z)
        elif section == "bonedata":
            if key == "begin":
                bone = Bone("", number)
            elif key == "end":
                if bone is None or not bone.name:
                    raise CaptureError(f"{at}: 'end' of a bone without a name")
                if bone.name in bones:
                    raise CaptureError(f"{at}: a second bone {bone.name!r}")
                bones[bone.name], bone = bone, None
                if len(bones) > MAX_BONES:
                    raise CaptureError(f"{at}: more than {MAX_BONES} bones")
            elif bone is None:
                raise CaptureError(f"{at}: {key[:30]!r} outside of a bone; expected 'begin'")
            else:
                _bone_line(bone, key, rest, at)
        elif section == "hierarchy" and key not in ("begin", "end"):
            for child in rest:
                if child in parents:
                    raise CaptureError(f"{at}: bone {child!r} has two parents")
                parents[child] = (words[0], number)
    if len(bones) < 2:
        raise CaptureError(f"{name}:1: no :bonedata; this is not an ASF file")
    return Figure(_ordered(bones, parents, name), unit, degrees, position)


def _bone_line(bone: Bone, key: str, rest: list[str], at: str) -> None:
    if key == "name" and rest:
        bone.name = rest[0]
    elif key == "direction":
        direction = np.array(_floats(rest, 3, at))
        size = float(np.linalg.norm(direction))
        if size < 1e-9:
            raise CaptureError(f"{at}: a bone without a direction")
        bone.direction = direction / size
    elif key == "length":
        bone.length = _floats(rest, 1, at)[0]
        if not 0.0 <= bone.length < 1e6:
            raise CaptureError(f"{at}: a bone length of {rest[0]}")
    elif key == "axis":
        x, y, z = _floats(rest, 3, at)
        bone.axis = (x, y, z)
        if len(rest) > 3:
            bone.axis_order = _order(rest[3], at)
    elif key == "dof":
        bone.freedom = _freedom(rest, at)


def _ordered(bones: dict[str, Bone], parents: dict[str, tuple[str, int]], name: str) -> list[Bone]:
    """Parents first, from the root on."""
    for child, (parent, number) in parents.items():
        for label in (child, parent):
            if label not in bones:
                raise CaptureError(f"{name}:{number}: the hierarchy names {label[:30]!r}, :bonedata does not")
    if "root" in parents:
        parent, number = parents["root"]
        raise CaptureError(f"{name}:{number}: the root is put below {parent[:30]!r}")
    children: dict[str, list[str]] = {}
    for label in bones:
        if label in parents:
            children.setdefault(parents[label][0], []).append(label)
    order: list[Bone] = []
    index: dict[str, int] = {}
    stack = ["root"]
    while stack:
        label = stack.pop()
        if label in index:
            raise CaptureError(f"{name}:{parents[label][1]}: bone {label!r} is above itself")
        index[label] = len(order)
        bone = bones[label]
        bone.parent = index[parents[label][0]] if label in parents else -1
        order.append(bone)
        stack += reversed(children.get(label, []))
    lost = [label for label in bones if label not in index]
    if lost:
        raise CaptureError(f"{name}:{bones[lost[0]].line}: bone {lost[0]!r} hangs from nothing; see :hierarchy")
    return order


def _floats(words: list[str], count: int, at: str) -> list[float]:
    try:
        values = [float(word.strip("()")) for word in words[:count]]
    except ValueError:
        raise CaptureError(f"{at}: expected {count} numbers, found {' '.join(words)[:40]!r}") from None
    if len(values) < count or not all(math.isfinite(v) and abs(v) < 1e9 for v in values):
        raise CaptureError(f"{at}: expected {count} numbers, found {' '.join(words)[:40]!r}")
    return values


def _freedom(words: list[str], at: str) -> tuple[str, ...]:
    found = tuple(word.lower() for word in words)
    wrong = next((word for word in found if word not in (*_MOVES, *_TURNS, "l")), None)
    if wrong is not None or len(set(found)) != len(found):
        raise CaptureError(f"{at}: {(wrong or ' '.join(found))[:30]!r} are no degrees of freedom (rx ry rz tx ty tz l)")
    return found


def _order(word: str, at: str) -> str:
    order = word.lower()
    if sorted(order) != ["x", "y", "z"]:
        raise CaptureError(f"{at}: {word[:30]!r} is no order of axes (XYZ)")
    return order


def parse_amc(text: str, name: str, figure: Figure, fps: float | None = None) -> Raw:
    """The joints and numbers of an AMC text on an ASF's figure; raises `CaptureError` with the broken line."""
    if fps is not None and not (math.isfinite(fps) and fps > 0.0):
        raise CaptureError(f"{name}: {fps} frames a second; give a positive number")
    findings: list[str] = []
    degrees, rate = figure.degrees, fps
    index = {bone.name: k for k, bone in enumerate(figure.bones)}
    values: list[list[list[float]]] = [[] for _ in figure.bones]
    count = [len(bone.freedom) for bone in figure.bones]
    frames, frame_line = 0, 0
    number = 0
    for number, line in enumerate(text.splitlines(), 1):
        words = line.split()
        if not words or words[0][0] == "#":
            continue
        head = words[0]
        if head[0] == ":":
            key = head.lower()
            if key == ":radians":
                degrees = False
            elif key == ":degrees":
                degrees = True
            elif key in (":samples-per-second", ":frames-per-second") and len(words) > 1 and fps is None:
                rate = _floats(words[1:], 1, f"{name}:{number}")[0]
                if not 1e-3 < rate < 1e5:
                    raise CaptureError(f"{name}:{number}: {words[1]} frames a second")
            continue
        if len(words) == 1 and head.isascii() and head.isdigit():
            if frames:
                _check_frame(values, frames, figure, f"{name}:{frame_line}")
            frames, frame_line = frames + 1, number
            continue
        if not frames:
            raise CaptureError(
                f"{name}:{number}: expected a frame number, found {head[:30]!r}; this is not an AMC file"
            )
        bone = index.get(head)
        if bone is None:
            raise CaptureError(f"{name}:{number}: bone {head[:30]!r} is not in the skeleton; is it the right ASF file?")
        if len(words) - 1 != count[bone]:
            raise CaptureError(
                f"{name}:{number}: {len(words) - 1} numbers for {head!r}, its skeleton has {count[bone]}"
            )
        if len(values[bone]) != frames - 1:
            raise CaptureError(f"{name}:{number}: bone {head!r} twice in a frame")
        try:
            row = [float(word) for word in words[1:]]
        except ValueError:
            raise CaptureError(f"{name}:{number}: {line.strip()[:40]!r} are no numbers") from None
        if not all(-LARGEST <= value <= LARGEST for value in row):
            raise CaptureError(f"{name}:{number}: {line.strip()[:40]!r} has numbers that are no lengths or angles")
        values[bone].append(row)
    if not frames:
        raise CaptureError(f"{name}:{number or 1}: no frames; the file ends too early")
    if any(len(track) < frames for track, bone in zip(values, figure.bones, strict=True) if track and bone.freedom):
        if frames == 1 or any(len(track) < frames - 1 for track in values if track):
            raise CaptureError(f"{name}:{frame_line}: the last frame is cut short")
        findings.append(f"line {frame_line}: the last frame is cut short and left out")
        frames -= 1
    if not any(values):
        raise CaptureError(f"{name}:{frame_line}: frames without any bone; is it the right ASF file?")
    return _raw(name, figure, values, frames, degrees, rate or DEFAULT_FPS, findings)


def _check_frame(values: list[list[list[float]]], frames: int, figure: Figure, at: str) -> None:
    for track, bone in zip(values, figure.bones, strict=True):
        if len(track) != frames and track:
            raise CaptureError(f"{at}: bone {bone.name!r} is missing in this frame")


def _raw(
    name: str, figure: Figure, values: list[list[list[float]]], frames: int, degrees: bool, fps: float,
    findings: list[str],
) -> Raw:  # fmt: skip
    bones = figure.bones
    rotations = np.zeros((frames, len(bones), 4))
    rotations[..., 3] = 1.0
    track = np.tile(figure.position, (frames, 1))
    offsets = np.zeros((len(bones), 3))
    ends = {}
    has_child = {bone.parent for bone in bones}
    for k, bone in enumerate(bones):
        if k and bone.parent >= 0:
            above = bones[bone.parent]
            offsets[k] = above.direction * above.length
        if k not in has_child:
            ends[k] = bone.direction * bone.length
        if not bone.freedom or not values[k]:
            continue
        table = np.array(values[k][:frames])
        turns = [(c, word[1]) for c, word in enumerate(bone.freedom) if word in _TURNS]
        if turns:
            # The first listed is turned first: R = R3 R2 R1.
            angles = table[:, [c for c, _ in reversed(turns)]]
            angles = np.radians(angles) if degrees else angles
            turn = rot.from_euler("".join(axis for _, axis in reversed(turns)), angles)
            around = np.array([bone.axis["xyz".index(axis)] for axis in reversed(bone.axis_order)])
            base = rot.from_euler(bone.axis_order[::-1], np.radians(around) if figure.degrees else around)
            rotations[:, k] = rot.mul(rot.mul(base, turn), rot.inverse(base))
        if k == 0:
            for c, word in enumerate(bone.freedom):
                if word in _MOVES:
                    track[:, "xyz".index(word[1])] += table[:, c]
    return Raw(
        name=re.sub(r"\.amc$", "", name, flags=re.IGNORECASE),
        names=[bone.name for bone in bones],
        parents=[bone.parent for bone in bones],
        offsets=offsets,
        ends=ends,
        positions=[track, *[None] * (len(bones) - 1)],
        rotations=rotations,
        fps=fps,
        findings=findings,
        unit=figure.unit,
    )
