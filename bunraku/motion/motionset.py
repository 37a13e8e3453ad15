"""A motion set: examples of motion with measured parameters, grouped into the modules that blend them.

A *module* holds variations of one motion: the same sequence of events, so that its examples can be aligned
in time and blended (Oshita 2005, section 4.1, table 2). `MODULES` names the modules that the blender plays;
a set may lack some of them and may hold others. Besides, a set holds *canonical* clips, one of each way
of walking or jumping (`CANONICAL`).

The file is one compressed ``.npz``: rotations as 16-bit integers (3e-5 rad), roots as float32.
"""

import io
import json
import zipfile
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bunraku.figure.skeleton import Skeleton, SkeletonError, frozen
from bunraku.motion.clip import Clip, ClipError

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

VERSION = 1
_SCALE = 32767.0

MODULES: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {
        "locomotion": ("speed", "turn", "tilt", "bend", "duck"),
        "stand": ("tilt", "bend", "duck"),
        "step_left": ("angle", "distance"),
        "step_right": ("angle", "distance"),
        "jump_forward": ("angle", "distance"),
        "jump_back": ("angle", "distance"),
        "jump_left": ("angle", "distance"),
        "jump_right": ("angle", "distance"),
        "jump_up": ("height",),
        "turn_left": ("angle",),
        "turn_right": ("angle",),
    }
)
"""Parameters of each module.

speed m/s along the path; turn rad/s, positive to the left; tilt rad to the figure's left and bend rad forward, of
the line from hips to neck; duck, how far the hips are below their height at rest as a share of 0.4 leg
lengths; angle rad about +Y from straight ahead, positive to the left (of the way gone, or turned); distance m
along the ground; height m of the hips' highest point over their height at the beginning.
"""

CANONICAL = ("walk", "jog", "run", "sneak", "march", "jump_up", "short_jump", "long_jump")
"""Names of the canonical clips; the first five repeat."""

EVENTS: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {
        "locomotion": ("left_strike", "right_passes", "right_strike", "left_passes", "left_strike"),
        "stand": ("begin", "end"),
        "step_left": ("begin", "lead_off", "lead_strike", "follow_off", "follow_strike", "end"),
        "step_right": ("begin", "lead_off", "lead_strike", "follow_off", "follow_strike", "end"),
        "jump": ("begin", "deepest", "take_off", "apex", "landing", "end"),
        "turn_left": ("begin", "lead_off", "lead_strike", "follow_off", "follow_strike", "end"),
        "turn_right": ("begin", "lead_off", "lead_strike", "follow_off", "follow_strike", "end"),
    }
)
"""What happens at the key times of a module's examples, the same events in the same order ("jump": of all jumps).

A foot *passes* where it is beside the other one; a foot is *off* when it leaves the ground and *strikes* when it
comes down. Walking and running share the four locomotion events, whereas their take-offs come in different orders.
"""


class MotionSetError(ValueError):
    """A motion set that cannot be made, read or used; one line that says why."""


@dataclass(frozen=True, eq=False)
class Example:
    """One clip of a module with what was measured from it.

    In a clip that repeats (``cycle``) the last frame is the first one of the next repetition, carried along.
    """

    clip: Clip
    values: Array  # (m,) measured, in the order of the module's parameters
    keys: Array  # (k,) s in the clip, increasing; the first and last bound what is played
    contacts: Flags  # (F, 2) left foot, right foot on the ground
    cycle: bool = False
    made: bool = False  # by a generator or by editing; else captured

    def __post_init__(self) -> None:
        name = self.clip.name
        object.__setattr__(self, "values", frozen(np.atleast_1d(self.values)))
        object.__setattr__(self, "keys", frozen(self.keys))
        contacts: Flags = np.array(self.contacts, dtype=np.bool_)
        contacts.setflags(write=False)
        object.__setattr__(self, "contacts", contacts)
        if self.values.ndim != 1 or not np.isfinite(self.values).all():
            raise MotionSetError(f"example {name!r}: its parameter values must be finite numbers")
        if self.keys.ndim != 1 or len(self.keys) < 2 or not np.all(np.diff(self.keys) > 0.0):
            raise MotionSetError(f"example {name!r}: needs two or more key times, increasing")
        if self.keys[0] < -1e-6 or self.keys[-1] > self.clip.duration + 1e-6:
            raise MotionSetError(f"example {name!r}: key times must lie within 0..{self.clip.duration:.3f} s")
        if self.contacts.shape != (len(self.clip), 2):
            raise MotionSetError(f"example {name!r}: contacts have shape {self.contacts.shape}, not (frames, 2)")

    @property
    def duration(self) -> float:
        """Seconds from the first key time to the last."""
        return float(self.keys[-1] - self.keys[0])


@dataclass(frozen=True, eq=False)
class Module:
    """Variations of one motion, with the same parameters and key events."""

    name: str
    parameters: tuple[str, ...]
    examples: tuple[Example, ...]

    def __post_init__(self) -> None:
        if not self.examples:
            raise MotionSetError(f"module {self.name!r} has no example")
        first = self.examples[0]
        for example in self.examples:
            label = f"module {self.name!r}, example {example.clip.name!r}"
            if example.values.shape != (len(self.parameters),):
                raise MotionSetError(f"{label}: {len(example.values)} values for {len(self.parameters)} parameters")
            if len(example.keys) != len(first.keys):
                raise MotionSetError(f"{label}: {len(example.keys)} key times where the first has {len(first.keys)}")
            if example.cycle != first.cycle:
                raise MotionSetError(f"{label}: cycles and single motions cannot be blended")
            if example.clip.skeleton.hash != first.clip.skeleton.hash:
                raise MotionSetError(f"{label}: another skeleton; retarget it first")

    @property
    def values(self) -> Array:
        """(n, m) the examples' parameter values."""
        return np.stack([example.values for example in self.examples])

    @property
    def cycle(self) -> bool:
        """Whether the motion repeats."""
        return self.examples[0].cycle


@dataclass(frozen=True, eq=False)
class MotionSet:
    """All modules and canonical clips of one skeleton."""

    name: str
    skeleton: Skeleton
    modules: Mapping[str, Module]
    canonical: Mapping[str, Example] = field(default_factory=dict)

    def __post_init__(self) -> None:
        object.__setattr__(self, "modules", MappingProxyType(dict(self.modules)))
        object.__setattr__(self, "canonical", MappingProxyType(dict(self.canonical)))
        for example in self.examples():
            if example.clip.skeleton.hash != self.skeleton.hash:
                raise MotionSetError(f"example {example.clip.name!r} is for another skeleton; retarget it first")

    def examples(self) -> tuple[Example, ...]:
        """Every example of every module, then the canonical ones."""
        blended = [example for module in self.modules.values() for example in module.examples]
        return (*blended, *self.canonical.values())

    def module(self, name: str) -> Module:
        """The module of that name; raises `MotionSetError` when the set has none."""
        try:
            return self.modules[name]
        except KeyError:
            raise MotionSetError(
                f"motion set {self.name!r} has no module {name!r} (has: {', '.join(self.modules)})"
            ) from None

    def to_bytes(self) -> bytes:
        """The set as one compressed file."""
        examples = self.examples()
        meta = {
            "version": VERSION,
            "name": self.name,
            "skeleton": {
                "names": list(self.skeleton.names),
                "parents": self.skeleton.parents.tolist(),
                "roles": dict(self.skeleton.roles),
            },
            "modules": [
                {"name": m.name, "parameters": list(m.parameters), "examples": [_describe(e) for e in m.examples]}
                for m in self.modules.values()
            ],
            "canonical": [{"name": name, "example": _describe(e)} for name, e in self.canonical.items()],
        }
        joints = len(self.skeleton)
        roots = [e.clip.roots.astype("<f4") for e in examples]
        rotations = [np.rint(e.clip.rotations * _SCALE).astype("<i2") for e in examples]
        contacts = [e.contacts for e in examples]
        out = io.BytesIO()
        np.savez_compressed(
            out,
            meta=np.frombuffer(json.dumps(meta).encode(), np.uint8),
            offsets=self.skeleton.offsets,
            masses=self.skeleton.masses,
            mass_centers=self.skeleton.mass_centers,
            box_centers=self.skeleton.box_centers,
            box_sizes=self.skeleton.box_sizes,
            roots=np.concatenate([*roots, np.zeros((0, 3), "<f4")]),
            rotations=np.concatenate([*rotations, np.zeros((0, joints, 4), "<i2")]),
            contacts=np.packbits(np.concatenate([*contacts, np.zeros((0, 2), np.bool_)]).reshape(-1)),
        )
        return out.getvalue()

    def save(self, path: Path) -> None:
        """Write the file whole or not at all (a reader never sees half of one)."""
        path.parent.mkdir(parents=True, exist_ok=True)
        partial = path.with_name(f".{path.name}.part")
        partial.write_bytes(self.to_bytes())
        partial.replace(path)

    @classmethod
    def load(cls, path: Path) -> "MotionSet":
        """Read a file made by `save`; raises `MotionSetError` with one line that names the file."""
        try:
            data = path.read_bytes()
        except OSError as error:
            raise MotionSetError(f"cannot read motion set {path}: {error.strerror}") from None
        return cls.from_bytes(data, str(path))

    @classmethod
    def from_bytes(cls, data: bytes, label: str = "motion set") -> "MotionSet":
        """Read what `to_bytes` made; raises `MotionSetError` with one line that begins with ``label``."""
        try:
            with np.load(io.BytesIO(data), allow_pickle=False) as archive:
                arrays = {key: archive[key] for key in archive.files}
            meta = json.loads(bytes(arrays["meta"]))
            if meta["version"] != VERSION:
                raise MotionSetError(
                    f"made by another version ({meta['version']}, this reads {VERSION}); build it again"
                )
            return _assemble(meta, arrays)
        except (MotionSetError, ClipError, SkeletonError) as error:
            raise MotionSetError(f"{label}: {error}") from None
        except (ValueError, LookupError, TypeError, EOFError, OSError, AttributeError, NotImplementedError,
                RecursionError, RuntimeError, MemoryError, zipfile.BadZipFile, zlib.error) as error:  # fmt: skip
            reason = " ".join(str(error).split())[:120]
            raise MotionSetError(f"{label}: not a motion set ({reason}); build it again") from None


def _describe(example: Example) -> dict[str, Any]:
    return {
        "name": example.clip.name,
        "fps": example.clip.fps,
        "frames": len(example.clip),
        "values": example.values.tolist(),
        "keys": example.keys.tolist(),
        "cycle": example.cycle,
        "made": example.made,
    }


def _assemble(meta: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]]) -> MotionSet:
    described = meta["skeleton"]
    skeleton = Skeleton(
        tuple(described["names"]), np.array(described["parents"]), arrays["offsets"], described["roles"],
        arrays["masses"], arrays["mass_centers"], arrays["box_centers"], arrays["box_sizes"],
    )  # fmt: skip
    roots = arrays["roots"].astype(np.float64)
    rotations = arrays["rotations"].astype(np.float64) / _SCALE
    if rotations.shape != (len(roots), len(skeleton), 4) or roots.shape != (len(roots), 3):
        raise MotionSetError("its arrays do not fit its skeleton; build it again")
    contacts = np.unpackbits(arrays["contacts"], count=2 * len(roots)).reshape(-1, 2).astype(np.bool_)
    at = 0

    def example(item: Mapping[str, Any]) -> Example:
        nonlocal at
        frames = int(item["frames"])
        span = slice(at, at + frames)
        at += frames
        clip = Clip(str(item["name"]), skeleton, float(item["fps"]), roots[span], rotations[span])
        values, keys = np.array(item["values"], dtype=np.float64), np.array(item["keys"], dtype=np.float64)
        return Example(clip, values, keys, contacts[span], bool(item["cycle"]), bool(item["made"]))

    modules = {}
    for entry in meta["modules"]:
        examples: Sequence[Example] = [example(item) for item in entry["examples"]]
        modules[str(entry["name"])] = Module(str(entry["name"]), tuple(entry["parameters"]), tuple(examples))
    canonical = {str(entry["name"]): example(entry["example"]) for entry in meta["canonical"]}
    return MotionSet(str(meta["name"]), skeleton, modules, canonical)
