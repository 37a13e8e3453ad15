"""BVH files: the text to joints and numbers, and clips to text.

What the numbers mean (unit, upward axis, rest pose, where the root is) is `bunraku.motion.capture`'s part,
because no BVH file says it.
"""

import math
import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bunraku.motion import rotation as rot
from bunraku.motion.body import tip_of
from bunraku.motion.capture import Capture, CaptureError, Raw, interpret
from bunraku.motion.clip import Clip

Array = NDArray[np.float64]

MAX_CHANNELS = 20_000  # of all joints; a file that claims more is not motion
CENTIMETRE = 0.01


def read_bvh(file: str | Path, *, unit: float | None = None, up: str | None = None, root: str | None = None) -> Clip:
    """The clip in a BVH file, in metres, Y up, its skeleton's rest pose made a T-pose facing +Z.

    Args:
        unit: metres in one unit of the file; told from the leg length when None.
        up: "x", "y" or "z", the file's upward axis; told from the pose when None.
        root: "absolute" (the root's position channels replace its OFFSET) or "added"; told from the feet when None.

    Raises:
        CaptureError: the file cannot be read; one line with its name, the line number and what is wrong.
    """
    return load_bvh(file, unit=unit, up=up, root=root).clip


def load_bvh(file: str | Path, *, unit: float | None = None, up: str | None = None, root: str | None = None) -> Capture:
    """Like `read_bvh`, with what was found out and mended on the way."""
    path = Path(file)
    return interpret(parse_bvh(read_text(path), path.name), unit=unit, up=up, root=root)


def read_text(path: Path) -> str:
    """The text of a capture file; raises `CaptureError` when there is none."""
    try:
        data = path.read_bytes()
    except OSError as error:
        raise CaptureError(f"{path}: {error.strerror or error}; give a file that can be read") from None
    if b"\0" in data[:4096]:
        raise CaptureError(f"{path.name}: not a text file")
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError:
        return data.decode("latin-1")


class _Joint:
    """A joint while its lines are read."""

    def __init__(self, name: str, parent: int, line: int) -> None:
        self.name, self.parent, self.line = name, parent, line
        self.offset: tuple[float, float, float] | None = None
        self.channels: list[str] | None = None
        self.end: tuple[float, float, float] | None = None


def parse_bvh(text: str, name: str) -> Raw:
    """The joints and numbers of a BVH text; ``name`` is the file's, for messages.

    Raises:
        CaptureError: the text is broken; one line with the line number.
    """
    lines = text.splitlines()
    start = next((k for k, line in enumerate(lines) if line.split()[:1] and line.split()[0].upper() == "MOTION"), None)
    head = lines if start is None else lines[:start]
    joints, findings = _hierarchy(head, name)
    if start is None:
        raise CaptureError(f"{name}:{len(lines) or 1}: no MOTION section; the file ends too early")
    count = sum(len(joint.channels or ()) for joint in joints)
    if not 0 < count <= MAX_CHANNELS:
        raise CaptureError(f"{name}:{start + 1}: the joints have {count} channels; expected 1 to {MAX_CHANNELS}")
    declared, fps, first = _motion_head(lines, start + 1, name)
    table = _rows(lines, first, count, declared, name, findings)
    return _raw(joints, table, fps, name, findings)


def _tokens(lines: list[str]) -> Iterator[tuple[int, str, str]]:
    """(line number, token, the rest of its line); braces are tokens of their own."""
    for number, line in enumerate(lines, 1):
        for match in re.finditer(r"[{}]|[^\s{}]+", line):
            yield number, match[0], line[match.end() :]


def _hierarchy(lines: list[str], name: str) -> tuple[list[_Joint], list[str]]:
    """The joints of the HIERARCHY section, parents first."""
    joints: list[_Joint] = []
    findings: list[str] = []
    open_: list[tuple[str, int]] = []  # kind ("joint" or "end") and the joint it belongs to
    pending: tuple[str, int] | None = None
    tokens = _tokens(lines)
    line, token, rest = next(tokens, (1, "", ""))
    if token.upper() != "HIERARCHY":
        raise CaptureError(f"{name}:{line}: expected HIERARCHY, found {token[:30]!r}; this is not a BVH file")
    for line, token, rest in tokens:
        word = token.upper()
        if token == "{":
            if pending is None:
                raise CaptureError(f"{name}:{line}: '{{' without a joint before it")
            open_.append(pending)
            pending = None
        elif pending is not None:
            raise CaptureError(f"{name}:{line}: expected '{{', found {token[:30]!r}")
        elif token == "}":
            if not open_:
                raise CaptureError(f"{name}:{line}: '}}' closes nothing")
            kind, owner = open_.pop()
            if kind == "joint":
                if joints[owner].offset is None:
                    raise CaptureError(f"{name}:{line}: joint {joints[owner].name!r} has no OFFSET")
                joints[owner].channels = joints[owner].channels or []
        elif word in ("ROOT", "JOINT"):
            if word == "ROOT" and joints:
                raise CaptureError(f"{name}:{line}: a second ROOT; split the file, one figure in each")
            if word == "JOINT" and (not open_ or open_[-1][0] != "joint"):
                raise CaptureError(f"{name}:{line}: JOINT outside of a joint")
            label = rest.split("{")[0].strip()
            _skip(tokens, label)
            if not label:
                raise CaptureError(f"{name}:{line}: {word} without a name")
            joints.append(_Joint(label, open_[-1][1] if open_ else -1, line))
            pending = ("joint", len(joints) - 1)
        elif word == "END":
            if not open_ or open_[-1][0] != "joint":
                raise CaptureError(f"{name}:{line}: End Site outside of a joint")
            _skip(tokens, rest.split("{")[0])  # "Site", sometimes with a name
            pending = ("end", open_[-1][1])
        elif word == "OFFSET" and open_:
            values = _numbers(tokens, rest, 3, name, line)
            kind, owner = open_[-1]
            offset = (values[0], values[1], values[2])
            if kind == "end":
                joints[owner].end = offset
            else:
                joints[owner].offset = offset
        elif word == "CHANNELS" and open_ and open_[-1][0] == "joint":
            joints[open_[-1][1]].channels = _channels(tokens, rest, name, line)
        else:
            raise CaptureError(f"{name}:{line}: {token[:30]!r} is not expected here")
    if open_ or pending is not None:
        raise CaptureError(
            f"{name}:{len(lines) + 1}: {len(open_)} '}}' missing before MOTION; the file is cut or broken"
        )
    if not joints:
        raise CaptureError(f"{name}:{line}: HIERARCHY without a ROOT")
    _unique_names(joints, findings)
    return joints, findings


def _skip(tokens: Iterator[tuple[int, str, str]], text: str) -> None:
    for _ in re.finditer(r"[{}]|[^\s{}]+", text):
        next(tokens)


def _numbers(tokens: Iterator[tuple[int, str, str]], rest: str, count: int, name: str, line: int) -> list[float]:
    """``count`` finite numbers after a keyword on ``line``."""
    values = []
    for _ in range(count):
        at, token, _rest = next(tokens, (line, "", ""))
        try:
            value = float(token)
        except ValueError:
            raise CaptureError(f"{name}:{at}: expected {count} numbers, found {token[:30]!r}") from None
        if not math.isfinite(value) or abs(value) > 1e9 or "_" in token:
            raise CaptureError(f"{name}:{at}: {token[:30]!r} is no length")
        values.append(value)
    return values


def _channels(tokens: Iterator[tuple[int, str, str]], rest: str, name: str, line: int) -> list[str]:
    """Channel names as "px" or "rz", in the file's order."""
    at, token, _ = next(tokens, (line, "", ""))
    if not token.isascii() or not token.isdigit() or int(token) > 6:
        raise CaptureError(f"{name}:{at}: expected a channel count of 0 to 6, found {token[:30]!r}")
    found: list[str] = []
    for _k in range(int(token)):
        at, token, _ = next(tokens, (line, "", ""))
        word = token.lower()
        if word[:1] not in ("x", "y", "z") or word[1:] not in ("position", "rotation"):
            raise CaptureError(f"{name}:{at}: {token[:30]!r} is no channel (Xposition ... Zrotation)")
        channel = word[1] + word[0]
        if channel in found and channel[0] == "p":
            raise CaptureError(f"{name}:{at}: channel {token} comes twice")
        found.append(channel)
    return found


def _unique_names(joints: list[_Joint], findings: list[str]) -> None:
    seen: dict[str, int] = {}
    for joint in joints:
        label = joint.name
        while joint.name in seen:
            seen[label] += 1
            joint.name = f"{label}.{seen[label]}"
        if joint.name != label:
            findings.append(f"line {joint.line}: a second joint {label!r}, read as {joint.name!r}")
        seen[joint.name] = 1


def _motion_head(lines: list[str], start: int, name: str) -> tuple[int | None, float, int]:
    """The declared frame count, frames a second, and the index of the first line of numbers."""
    declared: int | None = None
    seconds: tuple[float, str] | None = None
    for k in range(start, len(lines)):
        line = lines[k].strip()
        if not line:
            continue
        key, _, value = line.partition(":")
        word = "".join(key.lower().split())
        value = value.strip()
        if word == "frames":
            if not value.isascii() or not value.isdigit():
                raise CaptureError(f"{name}:{k + 1}: expected a frame count, found {value[:30]!r}")
            declared = int(value[:18])
        elif word == "frametime":
            try:
                seconds = (float(value), value)
            except ValueError:
                raise CaptureError(f"{name}:{k + 1}: expected a frame time in seconds, found {value[:30]!r}") from None
            if not 1e-5 <= seconds[0] <= 1e4:
                raise CaptureError(f"{name}:{k + 1}: a frame time of {value[:30]} s; expected 0.00001 to 10000")
        else:
            if seconds is None:
                raise CaptureError(f"{name}:{k + 1}: expected 'Frame Time:', found {line[:30]!r}")
            return declared, frame_rate(*seconds), k
    if seconds is None:
        raise CaptureError(f"{name}:{len(lines)}: no 'Frame Time:'; the file ends too early")
    return declared, frame_rate(*seconds), len(lines)


def frame_rate(seconds: float, text: str) -> float:
    """Frames a second of a frame time; a whole number where the text is that number's reciprocal, rounded."""
    rate = 1.0 / seconds
    whole = round(rate)
    digits = text.strip().lower().partition(".")[2]
    if whole > 0 and digits.isdigit() and len(digits.lstrip("0")) >= 4:
        step = 10.0 ** -len(digits)
        if abs(1.0 / whole - seconds) <= step:
            return float(whole)
    return rate


def _rows(lines: list[str], first: int, count: int, declared: int | None, name: str, findings: list[str]) -> Array:
    """(F, count) the numbers; a broken row raises, a last row cut short is left out."""
    rows = [(k, row) for k in range(first, len(lines)) if (row := lines[k].split())]
    if not rows:
        raise CaptureError(f"{name}:{len(lines)}: no frames after 'Frame Time:'; the file ends too early")
    wrong = next((i for i, (_, row) in enumerate(rows) if len(row) != count), None)
    if wrong is not None:
        total = sum(len(row) for _, row in rows)
        if total % count == 0 and declared == total // count and wrong == 0:
            pass  # frames that are broken over several lines
        elif wrong == len(rows) - 1 and wrong > 0 and len(rows[wrong][1]) < count:
            findings.append(f"line {rows[wrong][0] + 1}: the last frame is cut short and left out")
            rows.pop()
        else:
            k, row = rows[wrong]
            raise CaptureError(f"{name}:{k + 1}: {len(row)} numbers in this frame, the joints have {count} channels")
    try:
        flat = np.array([float(token) for _, row in rows for token in row])
        clean = bool(np.isfinite(flat).all()) and not any("_" in lines[k] for k, _ in rows)
    except ValueError:
        clean = False
    if not clean or bool((np.abs(flat) > 1e9).any()):
        _raise_at_bad_number(rows, name)
    table = flat.reshape(-1, count)
    if declared is not None and declared != len(table):
        findings.append(f"{declared} frames declared, {len(table)} there: the rows count")
    return table


def _raise_at_bad_number(rows: list[tuple[int, list[str]]], name: str) -> None:
    for k, row in rows:
        for token in row:
            try:
                good = abs(float(token)) <= 1e9 and "_" not in token
            except ValueError:
                good = False
            if not good:
                raise CaptureError(f"{name}:{k + 1}: {token[:30]!r} is no number of a frame")


def _raw(joints: list[_Joint], table: Array, fps: float, name: str, findings: list[str]) -> Raw:
    frames = len(table)
    rotations = np.zeros((frames, len(joints), 4))
    rotations[..., 3] = 1.0
    positions: list[Array | None] = []
    column = 0
    for k, joint in enumerate(joints):
        channels = joint.channels or []
        columns = {channel: column + c for c, channel in enumerate(channels)}
        column += len(channels)
        turns = [(c[1], column - len(channels) + i) for i, c in enumerate(channels) if c[0] == "r"]
        if turns:
            angles = np.radians(table[:, [at for _, at in turns]])
            rotations[:, k] = rot.from_euler("".join(axis for axis, _ in turns), angles)
        place: Array | None = None
        if any(c[0] == "p" for c in channels):
            place = np.tile(np.array(joint.offset), (frames, 1)) if k else np.zeros((frames, 3))
            for axis in range(3):
                at = columns.get("p" + "xyz"[axis])
                if at is not None:
                    place[:, axis] = table[:, at]
        positions.append(place)
    return Raw(
        name=Path(name).stem,
        names=[joint.name for joint in joints],
        parents=[joint.parent for joint in joints],
        offsets=np.array([joint.offset for joint in joints]),
        ends={k: np.array(joint.end) for k, joint in enumerate(joints) if joint.end is not None},
        positions=positions,
        rotations=rotations,
        fps=fps,
        findings=findings,
    )


def write_bvh(clip: Clip, file: str | Path, *, unit: float = CENTIMETRE) -> None:
    """Write a clip as BVH: Y up, channels Zrotation Xrotation Yrotation, lengths in ``unit`` metres (a centimetre).

    OFFSETs are the T-pose; the root's is zero, so that programs that add it to the position channels and
    programs that do not agree. Angles are unwrapped along time.
    """
    Path(file).write_text(bvh_text(clip, unit=unit), encoding="utf-8", newline="\n")


def bvh_text(clip: Clip, *, unit: float = CENTIMETRE) -> str:
    """What `write_bvh` writes."""
    skeleton = clip.skeleton
    children: list[list[int]] = [[] for _ in skeleton.names]
    for joint in range(1, len(skeleton)):
        children[skeleton.parents[joint]].append(joint)
    lines, order = ["HIERARCHY"], []
    stack: list[tuple[int, int, bool]] = [(0, 0, False)]
    while stack:
        joint, depth, done = stack.pop()
        tab = "\t" * depth
        if done:
            lines.append(f"{tab}}}")
            continue
        order.append(joint)
        offset = np.zeros(3) if joint == 0 else skeleton.offsets[joint] / unit
        label = "_".join(skeleton.names[joint].replace("{", "(").replace("}", ")").split()) or f"joint{joint}"
        lines.append(f"{tab}{'JOINT' if joint else 'ROOT'} {label}")
        lines.append(f"{tab}{{")
        lines.append(f"{tab}\tOFFSET {_triple(offset)}")
        places = "" if joint else "Xposition Yposition Zposition "
        lines.append(f"{tab}\tCHANNELS {3 if joint else 6} {places}Zrotation Xrotation Yrotation")
        if not children[joint]:
            tip = _triple(tip_of(skeleton, joint) / unit)
            lines += [f"{tab}\tEnd Site", f"{tab}\t{{", f"{tab}\t\tOFFSET {tip}", f"{tab}\t}}"]
        stack.append((joint, depth, True))
        stack += [(child, depth + 1, False) for child in reversed(children[joint])]
    lines += ["MOTION", f"Frames: {len(clip)}", f"Frame Time: {1.0 / clip.fps:.10f}"]
    angles = np.degrees(rot.unwrapped_zxy(clip.rotations))[:, order].reshape(len(clip), -1)
    table = np.concatenate([clip.roots / unit, angles], axis=1)
    form = " ".join(["%.6f"] * table.shape[1])
    lines += [form % tuple(row) for row in table.tolist()]
    return "\n".join(lines) + "\n"


def _triple(v: Array) -> str:
    return f"{v[0]:.6f} {v[1]:.6f} {v[2]:.6f}"
