"""Show or export the default figure at rest.

bunraku figure                    its joints as a table
bunraku figure -o figure.bvh      its rest pose as a file
"""

import argparse
from pathlib import Path
from typing import Any

from bunraku.cli import USAGE, Problem
from bunraku.cli.output import add_json, print_json, table

FORMATS = (".bvh", ".glb", ".json")
FPS = 60.0
"""Of the single frame that a rest file holds."""


def add(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("-o", dest="output", metavar="FILE", help=f"write it; by the name's end: {', '.join(FORMATS)}")
    add_json(parser)


def run(args: argparse.Namespace) -> int:
    """Print or write the figure."""
    if args.output is not None:
        return _write(Path(args.output))
    told = described()
    if args.json:
        print_json(told)
        return 0
    rows = []
    for joint in told["joints"]:
        offset = " ".join(f"{value:6.3f}" for value in joint["offset"])
        rows.append([joint["name"], joint["role"] or "-", joint["parent"] or "-", offset, f"{joint['mass']:5.2f}"])
    print(table(rows, ["joint", "role", "parent", "offset x y z (m)", "mass (kg)"]))
    print(f"\n{len(rows)} joints, {told['height']:.2f} m, {told['mass']:.1f} kg, skeleton {told['skeleton']}")
    return 0


def described() -> dict[str, Any]:
    """The figure as plain values: lengths in m, masses in kg, rest pose facing +Z with Y up."""
    from bunraku.figure.default import default_figure

    figure = default_figure()
    roles = {joint: role for role, joint in figure.roles.items()}
    tops = figure.rest_positions + figure.box_centers + figure.box_sizes
    joints = [
        {
            "name": name,
            "role": roles.get(k),
            "parent": figure.names[figure.parents[k]] if k else None,
            "offset": [round(float(value), 6) + 0.0 for value in figure.offsets[k]],
            "mass": round(float(figure.masses[k]), 6),
        }
        for k, name in enumerate(figure.names)
    ]
    return {
        "skeleton": figure.hash,
        "height": round(float(tops[:, 1].max()), 4),
        "mass": round(float(figure.masses.sum()), 4),
        "joints": joints,
    }


def _write(path: Path) -> int:
    if path.suffix not in FORMATS:
        raise Problem(f"{path}: end the name in {' or '.join(FORMATS)}", USAGE)
    if not path.parent.is_dir():
        raise Problem(f"{path.parent}: no such folder; make it first", USAGE)
    if path.suffix == ".json":
        import json

        path.write_text(json.dumps(described(), indent=1) + "\n")
    else:
        from bunraku.figure.default import default_figure

        figure = default_figure()
        root, rotations = figure.rest_pose()
        if path.suffix == ".glb":
            from bunraku.nodes.renderer.glb import save_glb

            save_glb(path, figure, root[None], rotations[None], FPS)
        else:
            from bunraku.motion.bvh import write_bvh
            from bunraku.motion.clip import Clip

            write_bvh(Clip("rest", figure, FPS, root[None], rotations[None]), path)
    print(path)
    return 0
