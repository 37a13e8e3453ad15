"""How long reading and writing a capture takes, and the measured values of a folder of captures beside a catalogue.

    python benchmarks/bvh.py [--frames 5000]
    python benchmarks/bvh.py --catalogue FOLDER      (FOLDER/index.csv: file, mean_root_speed_mps, ...)

Prints medians of five runs in ms: BVH of 21 joints read (text to clip: unit, axes, T-pose), parsed only (text to
numbers), split and converted only (the floor of any parser in this language), and written.
"""

import argparse
import csv
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from bunraku.motion.analysis import hips, measure, path_speed
from bunraku.motion.bvh import parse_bvh, read_bvh, write_bvh
from bunraku.motion.clip import Clip
from bunraku.motion.synth import builtin_set


def long_walk(frames: int) -> Clip:
    """A walk of that many frames."""
    cycle = builtin_set().canonical["walk"].clip
    times = np.arange(frames) / cycle.fps
    roots, rotations = cycle.samples(times % cycle.duration)
    roots[:, 2] += np.floor(times / cycle.duration) * (cycle.roots[-1, 2] - cycle.roots[0, 2])
    return Clip("walk", cycle.skeleton, cycle.fps, roots, rotations)


def median(work: Callable[[], object], times: int = 5) -> float:
    """ms."""
    taken = []
    for _ in range(times):
        begin = time.perf_counter()
        work()
        taken.append(1e3 * (time.perf_counter() - begin))
    return float(np.median(taken))


def speed(frames: int) -> None:
    """Print the times."""
    clip = long_walk(frames)
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "walk.bvh"
        wrote = median(lambda: write_bvh(clip, file))
        text = file.read_text()
        size = len(text) / 1e6
        rows = text[text.index("Frame Time") :].split("\n", 1)[1]
        print(f"{frames} frames, {len(clip.skeleton)} joints, {size:.1f} MB")
        for name, ms in (
            ("read", median(lambda: read_bvh(file))),
            ("parse", median(lambda: parse_bvh(text, "walk.bvh"))),
            ("split and convert", median(lambda: np.array([float(word) for word in rows.split()]))),
            ("write", wrote),
        ):
            print(f"{name:18} {ms:7.1f} ms  {ms / size:6.1f} ms/MB")


COLUMNS = (
    ("mean speed", "mean_root_speed_mps", "%"),
    ("mean speed, the catalogue's rule", "mean_root_speed_mps", "%"),
    ("heading change", "heading_change_deg", "degrees"),
    ("turn rate", "turn_rate_dps", "degrees/s"),
    ("hips, lowest", "root_height_min_m", "mm"),
    ("hips, highest", "max_root_height_m", "mm"),
    ("flight height", "flight_height_m", "mm"),
    ("left ankle, highest", "left_foot_max_m", "mm"),
    ("right ankle, highest", "right_foot_max_m", "mm"),
    ("way ahead", "net_forward_m", "mm"),
    ("way to the left", "net_left_m", "mm"),
    ("bend, largest", "bend_fwd_max_deg", "degrees"),
    ("tilt, largest", "tilt_left_max_deg", "degrees"),
)


def compare(folder: Path) -> None:
    """Print how far our measures are from the catalogue's, over all its files."""
    with (folder / "index.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    differences: dict[str, list[tuple[float, str]]] = {label: [] for label, _, _ in COLUMNS}
    for row in rows:
        clip = read_bvh(folder / row["file"])
        m = measure(clip)
        whole = clip.slice(0, (len(clip) - 1) // 6 * 6 + 1)
        ruled = path_speed(hips(whole), clip.fps) * whole.duration / clip.duration
        degrees = [np.degrees(v) for v in (m.heading_change, m.turn_rate, m.bend_max, m.tilt_max)]
        heights = (m.hips_min, m.hips_max, m.flight_height, m.left_foot_max, m.right_foot_max)
        ours = (m.speed, ruled, *degrees[:2], *heights, m.net_forward, m.net_left, *degrees[2:])
        for value, (label, key, unit) in zip(ours, COLUMNS, strict=True):
            listed = float(row[key])
            off = float(value) - listed
            if unit == "degrees":
                off = (off + 180.0) % 360.0 - 180.0
            # Two digits are listed: what the rounding alone could be does not count for slow clips.
            off = 100.0 * max(abs(off) - 0.005, 0.0) / max(listed, 0.05) if unit == "%" else off
            off = 1e3 * off if unit == "mm" else off
            differences[label].append((abs(off), row["file"]))
    print(f"{len(rows)} files\n")
    print("| measure | median | 95 % of the files within | largest | where |\n|---|---|---|---|---|")
    for label, _, unit in COLUMNS:
        values = np.array([value for value, _ in differences[label]])
        worst = max(differences[label])
        print(f"| {label} ({unit}) | {np.median(values):.2f} | {np.percentile(values, 95):.2f} | {worst[0]:.2f} | "
              f"{Path(worst[1]).stem} |")  # fmt: skip


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--frames", type=int, default=5000)
    parser.add_argument("--catalogue", type=Path)
    arguments = parser.parse_args()
    if arguments.catalogue is not None:
        compare(arguments.catalogue)
    else:
        speed(arguments.frames)
