"""Look at captures and motion sets, and build a set from a folder of captures.

bunraku motion info walk.bvh              what a clip does, in numbers, and what is wrong with it
bunraku motion info set.npz               the modules of a set and their examples' parameters
bunraku motion preview walk.bvh -o a.png  its poses, contacts and curves on one picture
bunraku motion build captures -o set.npz  a motion set from a folder of .bvh and .amc files
"""

import argparse
import math
import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

from bunraku.cli import USAGE, Problem
from bunraku.cli.output import add_json, print_json, table
from bunraku.cli.progress import Progress

if TYPE_CHECKING:
    from bunraku.motion.capture import Capture
    from bunraku.motion.motionset import Example, MotionSet

DEGREES = ("turn_rate", "heading_change", "direction", "bend", "tilt")
"""Beginnings of the names of measures that are printed in degrees."""


def add(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    verbs = parser.add_subparsers()
    info = verbs.add_parser("info", help="numbers of a clip or a set")
    info.add_argument("file", metavar="FILE|SET", help="a .bvh or .amc file, or a motion set (.npz)")
    _add_reading(info)
    add_json(info)
    preview = verbs.add_parser("preview", help="a picture of a clip")
    preview.add_argument("file", metavar="FILE|SET", help="a .bvh or .amc file, or a motion set (.npz)")
    preview.add_argument("-o", dest="output", metavar="PNG", required=True, help="the picture to write")
    preview.add_argument("--example", metavar="NAME", help="which example of a set (module/name)")
    preview.add_argument("--poses", type=int, default=14, metavar="N", help="poses on the strip (default 14)")
    _add_reading(preview)
    build = verbs.add_parser("build", help="a motion set from a folder of captures")
    build.add_argument("folder", metavar="DIR", help="a folder with .bvh and .amc files")
    build.add_argument("-o", dest="output", metavar="SET", required=True, help="the motion set to write (.npz)")
    build.add_argument("--recipe", metavar="TOML", help="use this recipe; else one is found and written beside the set")
    build.add_argument("--name", help="the set's name (default: the folder's)")
    add_json(build)


def _add_reading(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--asf", metavar="FILE", help="the skeleton of an .amc file (default: found beside it)")
    parser.add_argument("--fps", type=float, help="frames a second of an .amc file that does not say (default 120)")
    parser.add_argument("--unit", type=float, help="metres in one unit of the file (default: told from the legs)")
    parser.add_argument("--up", choices=("x", "y", "z"), help="the file's upward axis (default: told from the pose)")
    parser.add_argument("--root", choices=("absolute", "added"), help="what the root's OFFSET does (default: told)")


def run(args: argparse.Namespace) -> int:
    """Do what is asked."""
    # One clip is measured once: compiling the kernels would take longer than running them.
    os.environ.setdefault("BUNRAKU_JIT", "0")
    if args.what == "info":
        return _info(args)
    if args.what == "preview":
        return _preview(args)
    return _build(args)


def _capture(args: argparse.Namespace) -> "Capture":
    from bunraku.motion.files import load_capture

    return load_capture(args.file, asf=args.asf, fps=args.fps, unit=args.unit, up=args.up, root=args.root)


def _load_set(file: str) -> "MotionSet":
    from bunraku.motion.motionset import MotionSet

    return MotionSet.load(Path(file))


def _info(args: argparse.Namespace) -> int:
    if Path(args.file).suffix.lower() == ".npz":
        return _set_info(args)
    told = clip_info(_capture(args))
    if args.json:
        print_json(told)
        return 0
    print(
        f"{told['name']}: {told['frames']} frames, {told['measures'].get('seconds', told['seconds']):.2f} s at "
        f"{told['fps']:g} frames/s, {told['joints']} joints, unit {told['unit']:.6g} m, {told['up']} up, "
        f"T-pose from the {told['rest']}"
    )
    rows = []
    for name, value in told["measures"].items():
        angle = name.startswith(DEGREES)
        rows.append([name, f"{math.degrees(value) if angle else value:.3f}", _unit_of(name, angle)])
    if rows:
        print(table(rows, ["measure", "value", "unit"]))
    for number, cycle in enumerate(told["cycles"], 1):
        keys = "  ".join(f"{key:.2f}" for key in cycle["keys"])
        print(f"cycle {number}: {cycle['seconds']:.2f} s; left strike, right passes, right strike, left passes: {keys}")
    if told["jump"]:
        print(f"jump: begin, deepest, take-off, apex, landing, end: {'  '.join(f'{k:.2f}' for k in told['jump'])}")
    for line in told["findings"]:
        print(f"found: {line}")
    return 0


def _unit_of(name: str, angle: bool) -> str:
    if angle:
        return "degrees/s" if name == "turn_rate" else "degrees"
    if name.startswith("duck"):
        return "0.4 leg"
    return "m/s" if "speed" in name or name == "foot_skate" else "s" if name.endswith("seconds") else "m"


def clip_info(capture: "Capture") -> dict[str, Any]:
    """What ``motion info`` tells about a capture; lengths in m, times in s, angles in rad."""
    clip = capture.clip
    told: dict[str, Any] = {
        "name": clip.name, "frames": len(clip), "fps": clip.fps, "seconds": clip.duration,
        "joints": len(clip.skeleton),
        "unit": capture.unit, "up": capture.up, "root": capture.root, "rest": capture.rest,
        "roles": {role: clip.skeleton.names[joint] for role, joint in clip.skeleton.roles.items()},
        "measures": {}, "contacts": {}, "cycles": [], "jump": None, "findings": list(capture.findings),
    }  # fmt: skip
    if clip.skeleton.roles:
        from bunraku.motion.analysis import measure
        from bunraku.motion.analysis_contacts import contacts, runs
        from bunraku.motion.analysis_flaws import flaws
        from bunraku.motion.analysis_gait import gait_cycles, jump_keys

        on = contacts(clip)
        told["measures"] = measure(clip, on).as_dict()
        told["contacts"] = {
            side: [[first / clip.fps, (last - 1) / clip.fps] for first, last in runs(on[:, foot])]
            for foot, side in enumerate(("left_foot", "right_foot"))
        }
        told["cycles"] = [{"seconds": c.seconds, "keys": list(c.keys)} for c in gait_cycles(clip, on)]
        keys = jump_keys(clip, on) if told["measures"]["flight_seconds"] > 0.2 else None
        told["jump"] = list(keys) if keys else None
        told["findings"] += [flaw.text for flaw in flaws(clip, on)]
    return told


def _set_info(args: argparse.Namespace) -> int:
    found = _load_set(args.file)
    groups = [(m.name, m.parameters, m.examples) for m in found.modules.values()]
    told = {
        "name": found.name,
        "skeleton": found.skeleton.hash,
        "joints": len(found.skeleton),
        "modules": [
            {"name": name, "parameters": list(parameters), "examples": [_told(e) for e in examples]}
            for name, parameters, examples in groups
        ],
        "canonical": {name: _told(example) for name, example in found.canonical.items()},
    }
    if args.json:
        print_json(told)
        return 0
    print(f"{found.name}: {len(found.modules)} modules, {len(found.examples())} clips, {len(found.skeleton)} joints")
    for name, parameters, examples in groups:
        print(f"\n{name}")
        rows = [[e.clip.name, *(f"{v:.2f}" for v in e.values), f"{e.duration:.2f}", _kind(e)] for e in examples]
        print(table(rows, ["example", *parameters, "seconds", ""]))
    if found.canonical:
        print("\ncanonical clips")
        rows = [[name, f"{e.duration:.2f}", _kind(e)] for name, e in found.canonical.items()]
        print(table(rows, ["clip", "seconds", ""]))
    return 0


def _kind(example: "Example") -> str:
    return "made" if example.made else "captured"


def _told(example: "Example") -> dict[str, Any]:
    return {
        "name": example.clip.name, "values": example.values.tolist(), "keys": example.keys.tolist(),
        "seconds": example.duration, "cycle": example.cycle, "made": example.made,
    }  # fmt: skip


def _preview(args: argparse.Namespace) -> int:
    from bunraku.motion.preview import Layout, picture

    output = Path(args.output)
    if output.suffix.lower() not in (".png", ".jpg", ".jpeg"):
        raise Problem(f"{output}: a picture's name ends in .png or .jpg", USAGE)
    if not 1 <= args.poses <= 100:
        raise Problem(f"--poses {args.poses}: give 1 to 100", USAGE)
    layout = Layout(poses=args.poses)
    if Path(args.file).suffix.lower() == ".npz":
        example = _example(_load_set(args.file), args.example)
        picture(example.clip, example.contacts, example.keys.tolist(), layout).save(output)
    else:
        clip = _capture(args).clip
        if not clip.skeleton.roles:
            raise Problem(f"{args.file}: no humanoid; its joints' names tell no arms, legs and head", USAGE)
        picture(clip, layout=layout).save(output)
    print(output)
    return 0


def _example(found: "MotionSet", name: str | None) -> "Example":
    labelled = {f"{m.name}/{e.clip.name}": e for m in found.modules.values() for e in m.examples}
    labelled |= {f"canonical/{label}": e for label, e in found.canonical.items()}
    fitting = [label for label in labelled if name is not None and (label == name or label.endswith(f"/{name}"))]
    if not fitting:
        shown = ", ".join(list(labelled)[:6])
        raise Problem(
            f"--example {name or 'NAME'}: name one of the set's {len(labelled)} examples ({shown}, ...)", USAGE
        )
    return labelled[fitting[0]]


def _build(args: argparse.Namespace) -> int:
    from bunraku.figure.default import default_figure
    from bunraku.motion.build import make
    from bunraku.motion.build_plan import plan
    from bunraku.motion.build_recipe import Recipe, read_recipe, write_recipe

    folder, output = Path(args.folder), Path(args.output)
    if not folder.is_dir():
        raise Problem(f"{folder}: no such folder", USAGE)
    if output.suffix.lower() != ".npz":
        raise Problem(f"{output}: a motion set's name ends in .npz", USAGE)
    skeleton = default_figure()
    notes: list[str] = []
    if args.recipe is None:
        with Progress("looking through") as progress:
            planned = plan(folder, skeleton, args.name, progress)
        recipe, notes = planned.recipe, planned.notes
        written = output.with_suffix(".toml")
        output.parent.mkdir(parents=True, exist_ok=True)
        write_recipe(recipe, written)
    else:
        written = Path(args.recipe)
        recipe = read_recipe(written)
        if args.name:
            recipe = Recipe(args.name, recipe.pieces)
    with Progress("making") as progress:
        built = make(recipe, folder, skeleton, progress)
    built.save(output)
    counts = {name: len(module.examples) for name, module in built.modules.items()}
    made = sum(example.made for example in built.examples())
    if args.json:
        print_json({"set": str(output), "recipe": str(written), "modules": counts, "canonical": list(built.canonical),
                    "made": made, "captured": len(built.examples()) - made, "bytes": output.stat().st_size,
                    "notes": notes})  # fmt: skip
        return 0
    for line in notes:
        print(f"note: {line}")
    print(table([[name, count] for name, count in counts.items()], ["module", "examples"]))
    print(f"canonical: {', '.join(built.canonical) or 'none'}")
    print(f"{output}: {len(built.examples())} clips ({made} made by editing), {output.stat().st_size / 1e6:.1f} MB; "
          f"recipe {written}")  # fmt: skip
    return 0
