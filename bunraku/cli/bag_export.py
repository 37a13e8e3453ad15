"""`bag export`: a bag's poses as BVH, glTF or a film, its messages as JSON lines."""

import argparse
import contextlib
import json
import os
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any, TextIO

from bunraku.cli import USAGE, Problem
from bunraku.cli.bag import chosen
from bunraku.cli.plain import Plain
from bunraku.cli.progress import Progress
from bunraku.msgs import InvalidMessage, Motion, SkeletonMessage, decode
from bunraku.runtime.bag import Bag
from bunraku.runtime.bag.format import kind_for

if TYPE_CHECKING:
    from bunraku.motion.clip import Clip

NOWHERE = Path(os.devnull)
"""In place of a run folder: a bag's channels tell the types."""


def export(args: argparse.Namespace) -> int:
    """Write every form that was asked for."""
    files = [path for path in (args.bvh, args.glb, args.mp4, args.json) if path is not None]
    if not files:
        raise Problem("name what to write: at least one of --bvh, --glb, --mp4 and --json", USAGE)
    for path in files:
        _check_new(path, args.overwrite)
    if args.bvh is not None or args.glb is not None:
        _export_clip(args)
    if args.mp4 is not None:
        _export_film(args)
    if args.json is not None:
        _export_json(args)
    return 0


def _check_new(path: str, overwrite: bool) -> None:
    """Refuse before any work what could not be written after it."""
    if path == "-":
        return
    if Path(path).exists() and not overwrite:
        raise Problem(f"{path} exists already: choose another name, or --overwrite", USAGE)
    if not Path(path).absolute().parent.is_dir():
        raise Problem(f"{path} cannot be written: no folder {Path(path).parent}", USAGE)


def _export_json(args: argparse.Namespace) -> None:
    """Write each message as a line: topic, type, time of receipt (ns) and the message."""
    count = 0
    with Bag(args.file) as bag:
        channels = bag.channels
        topics = chosen(channels, args.topic, args.file)
        plain = {}
        for topic in topics:
            plain[topic] = Plain(NOWHERE, topic)
            plain[topic].shapes = dict(getattr(kind_for(channels[topic]).type, "shapes", {}))
        with _output(args.json, args.overwrite) as out, Progress("exporting") as progress:
            for entry in bag.messages(set(topics), progress=progress):
                value = {
                    "topic": entry.topic,
                    "type": channels[entry.topic].type,
                    "received": entry.received,
                    "message": plain[entry.topic](entry.body),
                }
                out.write(json.dumps(value, ensure_ascii=False, allow_nan=False) + "\n")
                count += 1
    if args.json != "-":
        print(f"{args.json}: {count} messages of {len(topics)} topics")


def _export_clip(args: argparse.Namespace) -> None:
    """Write one topic's poses as BVH, glTF or both."""
    from bunraku.figure.skeleton import SkeletonError

    clip, topic, bad = _read_clip(args)
    left = f"; {bad} invalid messages left out" if bad else ""
    told = f"{len(clip)} frames, {clip.duration:.2f} s of {topic}{left}"
    if args.bvh is not None:
        from bunraku.motion.bvh import write_bvh

        write_bvh(clip, args.bvh)
        print(f"{args.bvh}: {told}")
    if args.glb is not None:
        from bunraku.nodes.renderer.glb import save_glb

        try:
            save_glb(args.glb, clip.skeleton, clip.roots, clip.rotations, clip.fps)
        except SkeletonError as error:
            raise Problem(f"the figure of {topic} has no mesh: {error}; write --bvh", USAGE) from None
        print(f"{args.glb}: {told}")


def _read_clip(args: argparse.Namespace) -> "tuple[Clip, str, int]":
    """One topic's poses with the skeleton that was recorded beside them, their topic, and how many were invalid."""
    from bunraku.figure.wire import from_message
    from bunraku.motion.clip import clip_from_poses

    with Bag(args.file) as bag:
        channels = bag.channels
        topics = _pose_topics(args, list(channels), {topic: kind_for(one).type for topic, one in channels.items()})
        if len(topics) != 1:
            raise Problem(f"--topic chooses {', '.join(topics)}: BVH and glTF hold one figure, choose one", USAGE)
        (topic,) = topics
        skeletons: dict[str, Any] = {}
        stamps, roots, rotations, kinds, bad = [], [], [], set(), 0
        heard = {topic, *(name for name, one in channels.items() if kind_for(one).type is SkeletonMessage)}
        with Progress("reading") as progress:
            for entry in bag.messages(heard, progress=progress):
                try:
                    message = decode(kind_for(channels[entry.topic]).type, entry.body)
                    if isinstance(message, SkeletonMessage):
                        skeleton = from_message(message)
                        skeletons[skeleton.hash] = skeleton
                        continue
                except (InvalidMessage, ValueError):
                    bad += 1
                    continue
                kinds.add(message.skeleton)
                stamps.append(message.stamp)
                roots.append(message.root)
                rotations.append(message.rotations)
    if not stamps:
        raise Problem(f"{args.file}: no valid pose on {topic}", USAGE)
    if len(kinds) != 1:
        raise Problem(f"{topic}: {len(kinds)} skeletons one after the other; BVH and glTF hold one", USAGE)
    figure = skeletons.get(kinds.pop())
    if figure is None:
        raise Problem(f"{args.file}: the skeleton of {topic} was not recorded; record the topic skeleton too", USAGE)
    return clip_from_poses(figure, stamps, roots, rotations, args.fps, Path(args.file).stem), topic, bad


def _export_film(args: argparse.Namespace) -> None:
    """Film every figure, or those of the topics."""
    from bunraku.cli.bag_film import figures_in, film, fps_of, size_of
    from bunraku.nodes.renderer.film import Shots

    width, height = size_of(args.size)
    fps = fps_of(args.fps)
    with Bag(args.file) as bag:
        types = {topic: kind_for(one).type for topic, one in bag.channels.items()}
    topics = _pose_topics(args, list(types), types, one=False)
    figures = figures_in(topics)
    if not figures:
        raise Problem(f"{', '.join(topics)}: a film shows topics named pose", USAGE)
    shots = Shots(output=args.mp4, width=width, height=height, fps=fps, figures=tuple(figures))
    with Progress("filming") as progress:
        frames = film(args.file, shots, args.engine, progress)
    shown = ", ".join(f"{name}/pose" if name else "pose" for name in figures)
    print(f"{args.mp4}: {frames} frames, {frames / fps:.2f} s of {shown}")


def _pose_topics(args: argparse.Namespace, topics: list[str], types: dict[str, Any], *, one: bool = True) -> list[str]:
    """Those of a bag's topics that hold the poses to write; raises `Problem`."""
    poses = [topic for topic in topics if _is_motion(types[topic])]
    if args.topic is None and not one:
        named = [topic for topic in poses if topic.rpartition("/")[2] == "pose"]
        if not named:
            raise Problem(f"{args.file} holds no poses", USAGE)
        return named
    found = chosen(topics, args.topic or [_only(poses, args.file)], args.file)
    for topic in found:
        if topic not in poses:
            raise Problem(f"{topic} holds no poses ({', '.join(poses) or 'no topic of this bag'} does)", USAGE)
    return found


def _is_motion(type_: Any) -> bool:
    return isinstance(type_, type) and issubclass(type_, Motion)


def _only(poses: list[str], where: str) -> str:
    """The topic to take where none was named: the one `pose`, in a namespace or not."""
    found = [topic for topic in poses if topic.split("/")[-1] == "pose"] or poses
    if "pose" in found:
        return "pose"
    if len(found) == 1:
        return found[0]
    if not found:
        raise Problem(f"{where} holds no poses", USAGE)
    raise Problem(f"{where} holds several figures: choose one with --topic ({', '.join(found)})", USAGE)


@contextlib.contextmanager
def _output(path: str, overwrite: bool) -> Iterator[TextIO]:
    if path == "-":
        yield sys.stdout
        return
    try:
        file = open(path, "w" if overwrite else "x", encoding="utf-8")  # noqa: SIM115
    except FileExistsError:
        raise Problem(f"{path} exists already: choose another name, or --overwrite", USAGE) from None
    except OSError as error:
        raise Problem(f"{path} cannot be written: {error.strerror}", USAGE) from None
    with file:
        yield file
