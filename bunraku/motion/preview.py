"""A clip on one picture: a film strip of its poses, when the feet stand, and curves with numbers."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from bunraku.motion import rotation as rot
from bunraku.motion.analysis import Measures, headings, hips, lean, measure
from bunraku.motion.analysis_contacts import Flags, contacts, point_speeds, sole_points
from bunraku.motion.analysis_gait import gait_cycles
from bunraku.motion.clip import Clip

Array = NDArray[np.float64]
Color = tuple[int, int, int]

PAPER: Color = (250, 249, 246)
INK: Color = (38, 38, 42)
GREY: Color = (170, 170, 172)
FLOOR: Color = (222, 219, 210)
LEFT: Color = (200, 70, 40)
RIGHT: Color = (40, 95, 170)
ACCENT: Color = (70, 140, 80)


@dataclass(frozen=True)
class Layout:
    """Sizes in pixels."""

    width: int = 1280
    strip: int = 300
    bars: int = 54
    curve: int = 84
    margin: int = 64
    poses: int = 14


LAYOUT = Layout()


def picture(clip: Clip, flags: Flags | None = None, keys: Sequence[float] = (), layout: Layout = LAYOUT) -> Image.Image:
    """The picture of a humanoid clip; ``keys`` (s) are drawn as lines through everything (else gait strikes are).

    Left limbs are red, right ones blue. Each pose of the strip stands at its own time on the axis below;
    the way that the figure first faces goes to the right.
    """
    on = contacts(clip) if flags is None else flags
    m = measure(clip, on)
    if not keys:
        keys = [t for cycle in gait_cycles(clip, on) for t in (cycle.keys[0], cycle.keys[2], cycle.keys[4])]
    tracks = _tracks(clip)
    height = 50 + layout.strip + layout.bars + len(tracks) * layout.curve + 34
    image = Image.new("RGB", (layout.width, height), PAPER)
    draw = ImageDraw.Draw(image)
    draw.text((layout.margin, 10), _title(clip, m), fill=INK, font=_font(15))
    draw.text((layout.margin, 30), _numbers(m), fill=(90, 90, 92), font=_font(12))
    top = 50
    _strip(draw, clip, top, layout)
    top += layout.strip
    _bars(draw, on, clip.fps, top, layout)
    top += layout.bars
    for label, lines in tracks:
        _curve(draw, label, lines, top, layout)
        top += layout.curve
    _axis(draw, clip, top, layout)
    for key in sorted(set(keys)):
        x = _x(key, clip, layout)
        draw.line([(x, 54 + layout.strip), (x, top)], fill=ACCENT, width=1)
    return image


def _font(size: int) -> ImageFont.FreeTypeFont | ImageFont.ImageFont:
    return ImageFont.load_default(size)


def _title(clip: Clip, m: Measures) -> str:
    return f"{clip.name}   {len(clip)} frames, {m.seconds:.2f} s at {clip.fps:g} frames/s, {len(clip.skeleton)} joints"


def _numbers(m: Measures) -> str:
    deg = np.degrees
    return (
        f"speed {m.speed:.2f} m/s   turn {deg(m.heading_change):+.0f}° ({deg(m.turn_rate):+.0f}°/s)   "
        f"went {m.distance:.2f} m at {deg(m.direction):+.0f}°   "
        f"bend {deg(m.bend_mean):+.0f}° (to {deg(m.bend_max):+.0f}°)   "
        f"tilt {deg(m.tilt_mean):+.0f}°   duck {m.duck_mean:.2f}   rise {m.rise:.2f} m   "
        f"longest flight {m.flight_seconds:.2f} s   feet slide {m.foot_skate:.2f} m/s"
    )


def _x(time: float, clip: Clip, layout: Layout) -> float:
    span = max(clip.duration, 1e-6)
    return layout.margin + time / span * (layout.width - 2 * layout.margin)


def _bones(clip: Clip) -> list[tuple[int, int, Color]]:
    """(joint, parent, color) of every bone."""
    side = {}
    for role, joint in clip.skeleton.roles.items():
        if role.startswith(("left", "right")):
            side[joint] = LEFT if role.startswith("left") else RIGHT
    out = []
    colors: list[Color] = [INK] * len(clip.skeleton)
    for joint in range(1, len(clip.skeleton)):
        parent = int(clip.skeleton.parents[joint])
        colors[joint] = side.get(joint, colors[parent])
        out.append((joint, parent, colors[joint]))
    return out


def view(points: Array, facing: float) -> Array:
    """(..., 2) m: right and up on the picture of world points (..., 3); ``facing`` (rad) goes to the right."""
    turned = rot.rotate(rot.yaw(-facing + np.radians(55.0)), points)
    c, s = np.cos(np.radians(12.0)), np.sin(np.radians(12.0))
    return np.stack([turned[..., 0], turned[..., 1] * c - turned[..., 2] * s], axis=-1)


def _strip(draw: ImageDraw.ImageDraw, clip: Clip, top: int, layout: Layout) -> None:
    count = min(layout.poses, len(clip))
    frames = np.unique(np.linspace(0, len(clip) - 1, count).round().astype(int))
    facing = float(headings(clip)[0])
    middle = hips(clip)
    places = clip.world[0]
    reach = max(float(places[..., 1].max()) + 0.12, 1.2)
    scale = (layout.strip - 24) / reach
    ground = top + layout.strip - 14
    draw.rectangle([layout.margin - 30, ground - 2, layout.width - layout.margin + 30, ground + 10], fill=FLOOR)
    bones = _bones(clip)
    soles = sole_points(clip)
    for frame in frames:
        x = _x(frame / clip.fps, clip, layout)
        base = np.array([middle[frame, 0], 0.0, middle[frame, 2]])

        def on_page(points: Array, x: float = x, base: Array = base) -> list[tuple[float, float]]:
            return [(x + scale * float(u), ground - scale * float(v)) for u, v in view(points - base, facing)]

        for joint, parent, color in bones:
            draw.line(on_page(places[frame, [parent, joint]]), fill=color, width=3)
        for foot, color in ((0, LEFT), (1, RIGHT)):
            draw.line(on_page(soles[frame, foot]), fill=color, width=2)
        head = clip.skeleton.roles.get("head")
        if head is not None:
            up = rot.rotate(clip.world[1][frame, head], np.array([0.0, 0.09, 0.0]))
            (hx, hy) = on_page((places[frame, head] + up)[None])[0]
            r = 0.095 * scale
            draw.ellipse([hx - r, hy - r, hx + r, hy + r], outline=INK, width=2, fill=PAPER)


def _bars(draw: ImageDraw.ImageDraw, on: Flags, fps: float, top: int, layout: Layout) -> None:
    span = max((len(on) - 1) / fps, 1e-6)
    wide = layout.width - 2 * layout.margin
    for foot, (label, color) in enumerate((("left", LEFT), ("right", RIGHT))):
        y = top + 10 + foot * 20
        draw.text((12, y - 2), label, fill=color, font=_font(12))
        draw.rectangle([layout.margin, y, layout.width - layout.margin, y + 12], outline=(225, 223, 218))
        edges = np.flatnonzero(np.diff(np.concatenate([[0], on[:, foot].astype(int), [0]])))
        for first, last in zip(edges[::2], edges[1::2], strict=True):
            a = layout.margin + max(first - 0.5, 0.0) / fps / span * wide
            b = layout.margin + min(last - 0.5, len(on) - 1.0) / fps / span * wide
            draw.rectangle([a, y, max(b, a + 1), y + 12], fill=color)


def _tracks(clip: Clip) -> list[tuple[str, list[tuple[str, Array, Color]]]]:
    """(unit, [(label, values (F,), color)]) of each row of curves."""
    places = clip.world[0]
    middle = hips(clip)
    flat = np.array(middle)
    flat[:, 1] = 0.0
    tilt, bend = lean(clip)
    feet = [places[:, clip.skeleton.role(side + "Foot"), 1] for side in ("left", "right")]
    heading = headings(clip)
    return [
        ("m/s", [("speed of the hips", point_speeds(flat, clip.fps, 0.1), INK)]),
        ("m high", [("hips", middle[:, 1], INK)]),
        ("m", [("left ankle", feet[0], LEFT), ("right ankle", feet[1], RIGHT)]),
        ("deg", [("heading", np.degrees(heading - heading[0]), ACCENT), ("bend", np.degrees(bend), INK),
                 ("tilt", np.degrees(tilt), GREY)]),
    ]  # fmt: skip


def _curve(
    draw: ImageDraw.ImageDraw, unit: str, lines: list[tuple[str, Array, Color]], top: int, layout: Layout
) -> None:
    low = min(float(values.min()) for _, values, _ in lines)
    high = max(float(values.max()) for _, values, _ in lines)
    if unit in ("m", "m/s"):
        low = min(low, 0.0)
    least = 4.0 if unit == "deg" else 0.1
    if high - low < least:
        low, high = (low, low + least) if low == 0.0 else (low - 0.5 * least, high + 0.5 * least)
    bottom = top + layout.curve - 8
    tall = layout.curve - 26
    right = layout.width - layout.margin
    draw.line([(layout.margin, bottom), (right, bottom)], fill=(225, 223, 218))
    draw.text((12, top + 12), f"{high:.3g} {unit}", fill=(110, 110, 112), font=_font(11))
    draw.text((12, bottom - 10), f"{low:.3g}", fill=(110, 110, 112), font=_font(11))
    x = layout.margin
    for label, values, color in lines:
        draw.text((x, top), label, fill=color, font=_font(12))
        x += 16 + 7 * len(label)
        at = layout.margin + np.linspace(0.0, right - layout.margin, len(values))
        y = bottom - (values - low) / (high - low) * tall
        points = list(zip(at.tolist(), y.tolist(), strict=True))
        draw.line(points if len(points) > 1 else points * 2, fill=color, width=2)


def _axis(draw: ImageDraw.ImageDraw, clip: Clip, top: int, layout: Layout) -> None:
    step = next((s for s in (0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 30.0) if clip.duration / s <= 14), 60.0)
    for k in range(int(clip.duration / step) + 1):
        x = _x(k * step, clip, layout)
        draw.line([(x, top), (x, top + 6)], fill=INK)
        draw.text((x - 8, top + 8), f"{k * step:g} s", fill=INK, font=_font(11))
