"""`bag export`: a bag's poses as BVH, its messages as JSON lines."""

import argparse
import contextlib
import json
import os
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any, TextIO

from bunraku.cli import USAGE, Problem
from bunraku.cli.bag import chosen
from bunraku.cli.plain import Plain
from bunraku.cli.progress import Progress
from bunraku.msgs import InvalidMessage, Motion, SkeletonMessage, decode
from bunraku.runtime.bag import Bag
from bunraku.runtime.bag.format import kind_for

NOWHERE = Path(os.devnull)
"""In place of a run folder: a bag's channels tell the types."""


def export_json(args: argparse.Namespace) -> int:
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
    return 0


def export_bvh(args: argparse.Namespace) -> int:
    """Write one topic's poses as BVH, with the skeleton that was recorded beside them."""
    from bunraku.figure.wire import from_message
    from bunraku.motion.bvh import write_bvh
    from bunraku.motion.clip import clip_from_poses

    with Bag(args.file) as bag:
        channels = bag.channels
        poses = [topic for topic, one in channels.items() if _is_motion(kind_for(one).type)]
        wanted = args.topic or [_only(poses, args.file)]
        topics = chosen(channels, wanted, args.file)
        if len(topics) != 1:
            raise Problem(f"--topic chooses {', '.join(topics)}: a BVH holds one figure, choose one", USAGE)
        (topic,) = topics
        if topic not in poses:
            raise Problem(f"{topic} holds no poses ({', '.join(poses) or 'no topic of this bag'} does)", USAGE)
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
        raise Problem(f"{topic}: {len(kinds)} skeletons one after the other; a BVH holds one", USAGE)
    figure = skeletons.get(kinds.pop())
    if figure is None:
        raise Problem(f"{args.file}: the skeleton of {topic} was not recorded; record the topic skeleton too", USAGE)
    clip = clip_from_poses(figure, stamps, roots, rotations, args.fps, Path(args.file).stem)
    if Path(args.bvh).exists() and not args.overwrite:
        raise Problem(f"{args.bvh} exists already: choose another name, or --overwrite", USAGE)
    write_bvh(clip, args.bvh)
    left = f"; {bad} invalid messages left out" if bad else ""
    print(f"{args.bvh}: {len(clip)} frames, {clip.duration:.2f} s of {topic}{left}")
    return 0


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
