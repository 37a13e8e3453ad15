"""From what a launch file asks for to processes: every check that needs the node classes, and the wiring."""

import difflib
import importlib
import json
import os
import sys
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from typing import Any

from bunraku.runtime.declare import declaration
from bunraku.runtime.launch import NAME, LaunchError, NodeSpec
from bunraku.runtime.names import RECORDERS, STACK, resolve
from bunraku.runtime.node import Node
from bunraku.runtime.params import ParamProblem, convert_all, params_of
from bunraku.runtime.supervise import Task

SUBSCRIBERS = "BUNRAKU_SUBSCRIBERS"
"""Environment: a JSON map, topic -> how many nodes of the launch hear it."""
OWN = ("log", "params", "journal")
"""Topics in which a node speaks of itself."""


class UnknownNode(ValueError):
    """No node of that name; one line."""


def table() -> dict[str, str]:
    """Node name -> 'module:Class'."""
    return dict(importlib.import_module("bunraku.nodes").NODES)


def load(kind: str) -> type[Node]:
    """The class of a node in the table, or of 'module:Class'; raises `UnknownNode`."""
    known = table()
    path = known.get(kind, kind)
    module, colon, name = path.partition(":")
    if not colon:
        close = difflib.get_close_matches(kind, known, 1, 0.5)
        hint = f", did you mean {close[0]!r}?" if close else ""
        raise UnknownNode(f"no node {kind!r}{hint} (there is: {', '.join(sorted(known))}, or give module:Class)")
    try:
        found = getattr(importlib.import_module(module), name)
    except Exception as error:  # whatever its module does when it is imported
        raise UnknownNode(f"node {kind!r}: {path} cannot be loaded: {type(error).__name__}: {error}") from error
    if not (isinstance(found, type) and issubclass(found, Node)):
        raise UnknownNode(f"node {kind!r}: {path} is no node class")
    return found


def expected_subscribers(topic: str) -> int:
    """How many subscribers the launch file gives a topic; 0 outside of a launch."""
    try:
        counts = json.loads(os.environ.get(SUBSCRIBERS) or "{}")
        return int(counts.get(topic, 0))
    except (ValueError, AttributeError, TypeError):
        return 0


@dataclass(frozen=True)
class Planned:
    """A checked node of a launch."""

    spec: NodeSpec
    node: type[Node]
    params: Mapping[str, Any]
    """The given parameters in their own types."""
    says: Mapping[str, str]
    """Topic on the stage -> topic in the node's source."""
    hears: Sequence[str]
    """Topics and patterns on the stage."""

    def hears_topic(self, topic: str) -> bool:
        """Whether one of its subscriptions takes the topic.

        A node that hears a pattern but not all that matches says so in a class method
        ``would_hear(params, namespace, topic)``.
        """
        would = getattr(self.node, "would_hear", None)
        if would is not None and not would(convert_all(self.node, dict(self.params)), self.spec.ns, topic):
            return False
        return any(fnmatchcase(topic, wanted) for wanted in self.hears)

    @property
    def outputs(self) -> list[str]:
        """What it says beside of itself."""
        return sorted(topic for topic, source in self.says.items() if source.partition("/")[0] not in OWN)


def check(specs: Sequence[NodeSpec]) -> list[Planned]:
    """The nodes of a launch with everything about them checked; raises `LaunchError`, a line for each fault."""
    faults: list[str] = []
    planned: list[Planned] = []
    seen: dict[str, NodeSpec] = {}
    for spec in specs:
        if not NAME.fullmatch(spec.path):
            faults.append(spec.fault("name", f"{spec.path!r}: use a-z, 0-9, '_' and '/' between the parts"))
            continue
        if spec.path in seen:
            other = f" (the other: {seen[spec.path].file})" if seen[spec.path].file != spec.file else ""
            faults.append(spec.fault("name", f"two nodes have it{other}; give one name=... or group('ns', ...)"))
            continue
        seen[spec.path] = spec
        one = _check_node(spec, faults)
        if one is not None:
            planned.append(one)
    faults += _twice(planned)
    if faults:
        raise LaunchError(*faults)
    return planned


def with_listeners(planned: Sequence[Planned]) -> list[Planned]:
    """The same, each parameter ``wait_for`` that the launch file leaves open set to the listeners it gives."""
    counts = wiring(planned)
    done = []
    for one in planned:
        open_ = not one.spec.command and "wait_for" not in one.spec.params
        if open_ and "wait_for" in params_of(one.node):
            number = max((counts[one.spec.path].get(topic, 0) for topic in one.outputs), default=0)
            one = replace(one, params={**one.params, "wait_for": params_of(one.node)["wait_for"].convert(str(number))})
        done.append(one)
    return done


def _check_node(spec: NodeSpec, faults: list[str]) -> Planned | None:
    try:
        node = load(spec.kind)
    except UnknownNode as error:
        faults.append(spec.fault("node", str(error)))
        return None
    declared = declaration(node, spec.name)
    params = {}
    before = len(faults)
    for key, value in spec.params.items():
        if key not in declared.params:
            has = ", ".join(sorted(declared.params)) or "none"
            faults.append(spec.fault(f"params.{key}", f"no such parameter{_near(key, declared.params)} (has: {has})"))
            continue
        try:
            params[key] = declared.params[key].convert(value)
        except (ParamProblem, TypeError) as error:
            faults.append(spec.fault(f"params.{key}", str(error).removeprefix(f"{key}: ")))
    said, heard = [*declared.says], [*declared.hears]
    if len(faults) == before:
        more_said, more_heard = node.further(convert_all(node, dict(params)))
        said += [topic for topic in more_said if topic not in said]
        heard += [topic for topic in more_heard if topic not in heard]
    topics = [*said, *heard]
    for source, goal in spec.remap.items():
        if source not in topics:
            has = ", ".join(sorted(t for t in topics if t.split("/")[0] not in OWN))
            faults.append(spec.fault(f"remap.{source}", f"no such topic{_near(source, topics)} (has: {has})"))
        if not NAME.fullmatch(goal.removeprefix("/")):
            faults.append(spec.fault(f"remap.{source}", f"{goal!r}: use a-z, 0-9, '_' and '/' between the parts"))
    remap = dict(spec.remap)
    says = {resolve(topic, spec.ns, remap): topic for topic in said}
    return Planned(spec, node, params, says, [resolve(topic, spec.ns, remap) for topic in heard])


def _twice(planned: Sequence[Planned]) -> list[str]:
    """A line for each topic that two nodes would say."""
    first: dict[str, Planned] = {}
    faults = []
    for one in planned:
        for topic in one.says:
            other = first.setdefault(topic, one)
            if other is not one:
                where = other.spec.file or "launch"
                text = f"{topic!r} is said by {other.spec.path} ({where}) too; remap one or use a namespace"
                faults.append(one.spec.fault("topic", text))
    return faults


def _near(word: str, choices: Iterable[str]) -> str:
    close = difflib.get_close_matches(word, list(choices), 1, 0.5)
    return f", did you mean {close[0]!r}?" if close else ""


def choose(planned: Sequence[Planned], only: Sequence[str] = (), without: Sequence[str] = ()) -> list[Planned]:
    """Only these, or all but those, by name or full name; raises `LaunchError` for one that is not there."""
    for word in (*only, *without):
        _find(planned, word)
    kept = [one for one in planned if not only or {one.spec.path, one.spec.name} & set(only)]
    return [one for one in kept if not {one.spec.path, one.spec.name} & set(without)]


def _find(planned: Sequence[Planned], word: str) -> list[Planned]:
    found = [one for one in planned if word in (one.spec.path, one.spec.name)]
    if not found:
        paths = [one.spec.path for one in planned]
        raise LaunchError(f"no node {word!r} in this launch{_near(word, paths)} (has: {', '.join(paths)})")
    return found


def find(planned: Sequence[Planned], word: str) -> Planned:
    """The one node of this name or full name; raises `LaunchError`."""
    found = _find(planned, word)
    if len(found) > 1:
        raise LaunchError(f"{word!r} names {len(found)} nodes: write {' or '.join(one.spec.path for one in found)}")
    return found[0]


def substitute(planned: Sequence[Planned], word: str, command: Sequence[str], topics: Sequence[str]) -> list[Planned]:
    """Another ``bunraku`` command in a node's place; it says these topics and hears nothing.

    The stack ends with it.
    """
    gone = find(planned, word)
    spec = replace(gone.spec, command=tuple(command), respawn=False, required=True)
    says = {topic: topic for topic in topics}
    return [replace(one, spec=spec, says=says, hears=()) if one is gone else one for one in planned]


def wiring(planned: Sequence[Planned]) -> dict[str, dict[str, int]]:
    """Node -> topic that it says -> how many other nodes of the launch hear it (0 left out)."""
    counts: dict[str, dict[str, int]] = {}
    for one in planned:
        heard = {t: sum(other.hears_topic(t) for other in planned if other is not one) for t in one.says}
        counts[one.spec.path] = {topic: count for topic, count in heard.items() if count}
    return counts


def as_word(value: Any) -> str:
    """A parameter's value as a word of the command line."""
    return value if isinstance(value, str) else json.dumps(value)


def command(one: Planned) -> list[str]:
    """The words that start a node."""
    spec = one.spec
    if spec.command:
        return [*spec.command]
    words = ["run", spec.kind]
    if spec.name != one.node.name:
        words += ["--name", spec.name]
    if spec.ns:
        words += ["--ns", spec.ns]
    for key, value in one.params.items():
        words += ["--set", f"{key}:={as_word(value)}"]
    for source, goal in spec.remap.items():
        words += ["--remap", f"{source}:={goal}"]
    return words


def awaited(planned: Sequence[Planned]) -> dict[str, list[str]]:
    """Recorder -> patterns of what it records from the start, for the nodes that shall wait for it."""
    return {
        one.spec.path: [resolve(topic, one.spec.ns) for topic in one.params.get("topics", ["*"])]
        for one in planned
        if one.spec.kind == "recorder" and one.params.get("output")
    }


def tasks(planned: Sequence[Planned], *, jit: bool = True, env: Mapping[str, str] | None = None) -> list[Task]:
    """The processes of a launch."""
    counts = wiring(planned)
    recorders = json.dumps(awaited(planned))
    stack = json.dumps([one.spec.path for one in planned if not one.spec.command])
    return [
        Task(
            one.spec.path,
            [sys.executable, "-m", "bunraku.cli", *command(one)],
            {
                **(env or {}),
                "BUNRAKU_JIT": "1" if jit and one.node.jit else "0",
                SUBSCRIBERS: json.dumps(counts[one.spec.path]),
                RECORDERS: recorders,
                STACK: stack,
                **one.spec.env,
            },
            respawn=one.spec.respawn,
            required=one.spec.required,
            stop=one.spec.stop,
        )
        for one in planned
    ]
