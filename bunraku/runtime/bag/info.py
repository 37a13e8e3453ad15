"""What is in a bag, as data and as a table."""

import datetime
from typing import Any

from bunraku.runtime.bag.format import NS
from bunraku.runtime.bag.reader import Bag, Progress


def describe(bag: Bag, progress: Progress | None = None) -> dict[str, Any]:
    """Duration, topics, counts, rates, gaps, size and completeness of a bag as plain data; times in s."""
    statistics = bag.statistics(progress)
    channels = bag.channels
    start, end = bag.start, bag.end
    topics = []
    for topic, stats in statistics.items():
        channel = channels[topic]
        told = stats.as_dict()
        told["first"] = None if stats.first is None else stats.first / NS
        told["last"] = None if stats.last is None else stats.last / NS
        topics.append(
            {
                "topic": topic,
                "type": channel.type,
                "node": channel.node,
                "latched": channel.latched,
                "rate": stats.rate,
                **told,
            }
        )
    return {
        "file": str(bag.path),
        "size": bag.size,
        "complete": bag.complete,
        "damaged": bag.damaged,
        "profile": bag.profile,
        "library": bag.library,
        "start": None if start is None else start / NS,
        "end": None if end is None else end / NS,
        "duration": 0.0 if start is None or end is None else (end - start) / NS,
        "messages": sum(stats.count for stats in statistics.values()),
        "gaps": sum(stats.gaps for stats in statistics.values()),
        "chunks": bag.chunks,
        "session": bag.session,
        "topics": topics,
    }


def table(info: dict[str, Any]) -> list[str]:
    """The lines that `bag info` prints for what `describe` gave."""
    state = "complete" if info["complete"] else "not complete: the recorder was killed (`bunraku bag recover` mends it)"
    lines = [
        f"file      {info['file']}, {size(info['size'])}",
        f"state     {state}",
        f"duration  {info['duration']:.2f} s"
        + (f", from {_moment(info['start'])}" if info["start"] is not None else ""),
        f"messages  {info['messages']} on {len(info['topics'])} topics, {info['gaps']} missing by seq",
    ]
    if info["damaged"]:
        lines.append(f"damaged   {info['damaged']} parts cannot be read and are left out")
    if info["session"].get("recovered_from"):
        lines.append(f"mended    from {info['session']['recovered_from']}")
    if not info["topics"]:
        return lines
    rows = [("topic", "type", "messages", "rate", "missing", "restarts", "size", "said by")]
    for topic in info["topics"]:
        rows.append(
            (
                topic["topic"] + (" (latched)" if topic["latched"] else ""),
                topic["type"] if len(topic["type"]) <= 24 else topic["type"][:23] + "…",
                str(topic["count"]),
                "" if topic["rate"] is None else f"{topic['rate']:.1f}/s",
                str(topic["gaps"] or ""),
                str(topic["restarts"] or ""),
                size(topic["bytes"]),
                topic["node"],
            )
        )
    widths = [max(len(row[column]) for row in rows) for column in range(len(rows[0]))]
    numeric = {2, 3, 4, 5, 6}
    lines.append("")
    for row in rows:
        cells = (
            text.rjust(width) if column in numeric else text.ljust(width)
            for column, (text, width) in enumerate(zip(row, widths, strict=True))
        )
        lines.append("  ".join(cells).rstrip())
    return lines


def size(count: float) -> str:
    """A number of bytes in words."""
    for unit in ("B", "KiB", "MiB", "GiB"):
        if count < 1024 or unit == "GiB":
            return f"{count:.0f} {unit}" if unit == "B" else f"{count:.1f} {unit}"
        count /= 1024
    raise AssertionError


def _moment(seconds: float) -> str:
    try:
        return datetime.datetime.fromtimestamp(seconds).astimezone().strftime("%Y-%m-%d %H:%M:%S %z")
    except (OverflowError, ValueError, OSError):
        return f"{seconds:.3f}"
