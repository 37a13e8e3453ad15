"""A node: declared topics, timers and parameters around a state that changes in steps only.

A step is one message with its newest side information, one control request, or the timers that are due.
Nothing in here knows sockets: a stage (`bunraku.runtime.zmqstage` or `bunraku.runtime.memory`) carries the
bodies, so that a node runs the same in its own process, in a unit test and in exact replay.
"""

import contextlib
import logging
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Protocol

from bunraku.msgs import InvalidMessage, Journal, Log, Params, TopicKind, decode, kind_of
from bunraku.runtime.clock import Clock
from bunraku.runtime.declare import (
    SECOND,
    BoundPublisher,
    Publisher,
    Subscription,
    Timer,
    declared_by,
    marked,
    request,
    subscribe,
    subscribe_raw,
    subscriptions_of,
    timer,
)  # fmt: skip
from bunraku.runtime.names import check_topic, resolve
from bunraku.runtime.params import ParamProblem, convert_all, param, params_of

__all__ = [
    "BoundPublisher",
    "Input",
    "Node",
    "ParamProblem",
    "Publisher",
    "Stage",
    "Subscription",
    "param",
    "request",
    "subscribe",
    "subscribe_raw",
    "timer",
]

REPORT_EVERY = SECOND
"""ns between two lines about dropped messages."""


class Stage(Protocol):
    """What carries a node's messages and tells it the time."""

    @property
    def clock(self) -> Clock: ...

    def advertise(self, node: "Node", topic: str, kind: TopicKind) -> None:
        """Become the publisher of a topic; raises when another one is."""
        ...

    def listen(self, node: "Node", subscription: "Subscription") -> None:
        """Begin to hand a topic's bodies to the node."""
        ...

    def send(self, topic: str, body: bytes) -> None:
        """Publish a body."""
        ...

    def subscribers(self, topic: str) -> int:
        """How many listen to a topic that was advertised here."""
        ...

    def stack_is_up(self) -> bool:
        """Whether all nodes that were launched together have set up."""
        ...

    def add_reader(self, fileno: int, callback: Callable[[], None]) -> None:
        """Call back, as a step, whenever a descriptor can be read."""
        ...

    def remove_reader(self, fileno: int) -> None:
        """Stop watching a descriptor."""
        ...

    def post(self, callback: Callable[[], None]) -> None:
        """Call back soon, as a step; safe from any thread."""
        ...

    def stop(self, status: int) -> None:
        """End the node after this step."""
        ...


@dataclass
class Input:
    """A message on its way into a step."""

    subscription: Subscription
    topic: str
    message: Any


class _TopicLog(logging.Handler):
    """Says the node's log lines on its `log` topic."""

    def __init__(self, node: "Node") -> None:
        super().__init__()
        self.node = node

    def emit(self, record: logging.LogRecord) -> None:
        levels = ("debug", "info", "warning", "error", "critical")
        level = levels[min(max(record.levelno // 10 - 1, 0), 4)]
        text = record.getMessage()
        if record.exc_info and record.exc_info[1] is not None:
            text += f" ({type(record.exc_info[1]).__name__}: {record.exc_info[1]})"
        log = Log(node=self.node.full_name, level=level, text=text[:4096])  # type: ignore[arg-type]
        self.node.log_publisher.publish(log)


class Node:
    """Subclass it, declare topics, timers and parameters, and give it to a stage."""

    name: ClassVar[str] = "node"
    jit: ClassVar[bool] = False
    """Whether its process compiles the kernels."""
    journal: ClassVar[bool] = True
    """Whether its steps are journalled (not where nothing that it says could be compared)."""

    def __init__(
        self,
        stage: Stage,
        *,
        name: str | None = None,
        namespace: str = "",
        remap: dict[str, str] | None = None,
        params: dict[str, Any] | None = None,
    ) -> None:
        self.stage = stage
        self.node_name = name or self.name
        self.namespace = namespace
        self.remap = dict(remap or {})
        self.full_name = check_topic(f"{namespace}/{self.node_name}" if namespace else self.node_name)
        self.param_values = convert_all(type(self), params or {})
        self.now = stage.clock.now()
        self.origin: int | None = None
        self.device = False
        self.subscriptions: dict[str, Subscription] = {}
        self.dynamic: dict[str, Callable[..., Any]] = {}
        self.publishers: dict[str, BoundPublisher[Any]] = {}
        self.invalid: dict[str, int] = {}
        self.gaps: dict[str, int] = {}
        self.steps = 0
        self._reported: dict[str, int] = {}
        self._why: dict[str, str] = {}
        self._reported_at = 0
        self._last_seq: dict[str, int] = {}
        self._due: dict[str, int] = {}
        self.timers = [one.__dict__["timer"] for one in marked(type(self), "timer")]
        self.requests = {one.__dict__["request"]: one.__name__ for one in marked(type(self), "request")}
        self.log = logging.getLogger(f"bunraku.{self.full_name}.{id(self):x}")
        self.log.setLevel(logging.INFO)
        self.log_publisher: BoundPublisher[Log] = self.advertise(f"log/{self.node_name}", Log)
        self.params_publisher: BoundPublisher[Params] = self.advertise(f"params/{self.node_name}", Params)
        self.journal_publisher: BoundPublisher[Journal] | None = None
        if self.journal:
            self.journal_publisher = self.advertise(f"journal/{self.node_name}", Journal)
        for key, declared in declared_by(type(self), Publisher).items():
            self.publishers[key] = self.advertise(declared.topic, declared.type)
        self._log_handler = _TopicLog(self)
        self.log.addHandler(self._log_handler)

    # What a subclass may say

    def setup(self) -> None:
        """Called once, when parameters are set and before the first step."""

    def teardown(self) -> None:
        """Called once at the end, also after a failure."""

    def save(self) -> bytes | None:
        """Small state that lets the node take up from where it was after a crash; None for nothing."""
        return None

    def restore(self, state: bytes) -> None:
        """Take up from what `save` gave; called after `setup`."""

    def on_param(self, name: str) -> None:
        """A parameter was changed while the node runs."""

    def wants(self, topic: str) -> bool:
        """Whether a topic that a pattern matches shall be heard; asked until it is true."""
        return True

    # What a subclass may use

    def advertise(self, topic: str, type_: Any) -> BoundPublisher[Any]:
        """Become the publisher of one more topic."""
        resolved = check_topic(resolve(topic, self.namespace, self.remap))
        kind = kind_of(resolved) or kind_of(topic) or TopicKind(type_)
        self.stage.advertise(self, resolved, replace(kind, type=type_))
        return BoundPublisher(self, resolved, type_)

    @classmethod
    def further(cls, params: dict[str, Any]) -> tuple[Sequence[str], Sequence[str]]:
        """Topics that a node with these parameters opens in `setup`, beside the declared ones: (said, heard)."""
        return (), ()

    def listen(
        self, topic: str, type_: Any, handler: Callable[..., Any], *, trigger: bool = True, raw: bool = False
    ) -> None:
        """Hear one more topic (in `setup`): as `subscribe`, for names that parameters give."""
        kind = kind_of(topic)
        newest = not raw and (bool(kind and kind.newest) or not trigger)
        key = f"dynamic:{topic}"
        self.dynamic[key] = handler
        self._open(Subscription(topic, type_, key, trigger, raw=raw, newest=newest))

    def every(self, hz: float, handler: Callable[[], None], *, idle: bool = False) -> None:
        """Start one more timer (in `setup`): as `timer`, for a method at a rate that a parameter gives."""
        self.timers.append(Timer(handler.__name__, round(SECOND / hz), idle))
        self._due[handler.__name__] = self.now + round(SECOND / hz)

    def add_reader(self, fileno: int, callback: Callable[[], None]) -> None:
        """Watch a device's descriptor; the node's steps then depend on more than the journal holds."""
        self.device = True
        self.stage.add_reader(fileno, callback)

    def remove_reader(self, fileno: int) -> None:
        """Stop watching a device's descriptor."""
        self.stage.remove_reader(fileno)

    def post(self, callback: Callable[[], None]) -> None:
        """Run something as a step of this node; safe from any thread."""
        self.device = True
        self.stage.post(callback)

    def stop(self, status: int = 0) -> None:
        """End the node after this step."""
        self.stage.stop(status)

    def set_param(self, name: str, value: Any) -> None:
        """Change a parameter; raises `ParamProblem`."""
        declared = params_of(type(self))
        if name not in declared:
            raise ParamProblem(f"no parameter {name!r} (has: {', '.join(sorted(declared)) or 'none'})")
        self.param_values[name] = declared[name].convert(value)
        self.on_param(name)
        self.publish_params()

    # What a stage calls

    def start(self, state: bytes | None = None) -> None:
        """Set up and make the first step; ``state`` is what `save` gave before a crash."""
        self.now = self.stage.clock.now()
        for one in self.timers:
            self._due[one.handler] = self.now + one.period
        self.publish_params()
        self.setup()
        if state is not None:
            self.restore(state)
        for subscription in subscriptions_of(type(self)):
            self._open(subscription)
        if self.journal_publisher is not None:
            begin = {
                "class": f"{type(self).__module__}:{type(self).__qualname__}",
                "name": self.node_name,
                "namespace": self.namespace,
                "remap": self.remap,
                "params": self.param_values,
                "state": state,
            }
            self.journal_publisher.publish(Journal(now=self.now, start=begin, device=self.device))

    def finish(self) -> None:
        """Tear down; the log's last lines are still said."""
        try:
            self.teardown()
        finally:
            self.log.removeHandler(self._log_handler)

    def receive(self, subscription: Subscription, topic: str, body: bytes) -> Input | None:
        """Read a body; an invalid one is counted and dropped (None)."""
        try:
            message = decode(subscription.type, body)
        except InvalidMessage as error:
            self.invalid[topic] = self.invalid.get(topic, 0) + 1
            self._report(topic, str(error))
            return None
        last = self._last_seq.get(topic)
        if last is not None and not subscription.newest and message.seq > last + 1:
            self.gaps[topic] = self.gaps.get(topic, 0) + message.seq - last - 1
        self._last_seq[topic] = message.seq
        return Input(subscription, topic, message)

    def step(self, now: int, inputs: list[Input], action: Callable[[], Any] | None = None) -> Any:
        """Change state: side information and the trigger in ``inputs``, then ``action``, then due timers."""
        self.now = now
        self.origin = inputs[-1].message.origin if inputs else None
        result = None
        try:
            for one in inputs:
                self._handle(one)
            if action is not None:
                result = action()
            if inputs and inputs[-1].subscription.trigger:
                for each in self.timers:
                    if each.idle:
                        self._due[each.handler] = now + each.period + each.period // 2
            self._run_timers(now)
        finally:
            self.steps += 1
            self.origin = None
            if self.journal_publisher is not None:
                seqs = {one.topic: one.message.seq for one in inputs}
                self.journal_publisher.publish(Journal(now=now, inputs=seqs, device=self.device))
        return result

    def take_raw(self, subscription: Subscription, topic: str, body: bytes) -> None:
        """Hand an unread body to its handler."""
        self.now = self.stage.clock.now()
        self._handler(subscription)(topic, body)

    def carry_out(self, now: int, wanted: dict[str, Any]) -> dict[str, Any]:
        """Answer a control request, as a step; the reply has `ok` and, if that is false, `error`."""
        operation = wanted.get("op")
        if operation == "param.get":
            return {"ok": True, "params": self.param_values}
        if operation == "info":
            return {"ok": True, "info": self.describe()}
        self.now = now
        try:
            if operation == "param.set":
                self.set_param(str(wanted.get("name")), wanted.get("value"))
                reply: dict[str, Any] = {"ok": True, "params": self.param_values}
            elif operation in self.requests:
                arguments = {str(key): value for key, value in wanted.items() if key != "op"}
                reply = {"ok": True, **(getattr(self, self.requests[operation])(**arguments) or {})}
            else:
                known = ", ".join(["info", "param.get", "param.set", *sorted(self.requests)])
                return {"ok": False, "error": f"{self.full_name} has no request {operation!r} (has: {known})"}
        except (ValueError, TypeError) as error:
            return {"ok": False, "error": str(error)}
        self.steps += 1
        if self.journal_publisher is not None:
            self.journal_publisher.publish(Journal(now=now, request=wanted, device=self.device))
        return reply

    def next_due(self) -> int | None:
        """When the next timer is due (ns), or None."""
        return min(self._due.values(), default=None)

    def describe(self) -> dict[str, Any]:
        """What the node is and has seen, for the `info` request."""
        return {
            "name": self.full_name,
            "class": f"{type(self).__module__}:{type(self).__qualname__}",
            "says": sorted(
                {one.topic for one in self.publishers.values()}
                | {one.topic for one in (self.log_publisher, self.params_publisher, self.journal_publisher) if one}
            ),
            "hears": sorted(self.subscriptions),
            "requests": sorted(self.requests),
            "steps": self.steps,
            "invalid": self.invalid,
            "gaps": self.gaps,
        }

    def publish_params(self) -> None:
        """Say all parameters with their documentation."""
        described = {key: one.describe(self.param_values[key]) for key, one in params_of(type(self)).items()}
        self.params_publisher.publish(Params(node=self.full_name, params=described))

    def report_dropped(self, now: int) -> None:
        """Once a second, one line for each topic whose messages were dropped since the last line."""
        if now - self._reported_at < REPORT_EVERY:
            return
        for topic, count in self.invalid.items():
            new = count - self._reported.get(topic, 0)
            if new:
                self._reported_at = now
                self._reported[topic] = count
                self.log.warning("%s: dropped %d invalid messages: %s", topic, new, self._why.get(topic, ""))

    def _report(self, topic: str, why: str) -> None:
        self._why[topic] = why
        self.report_dropped(self.stage.clock.now())

    def _open(self, subscription: Subscription) -> None:
        resolved = resolve(subscription.topic, self.namespace, self.remap)
        if not subscription.pattern:
            check_topic(resolved)
        self.subscriptions[resolved] = subscription
        self.stage.listen(self, subscription)

    def _handler(self, subscription: Subscription) -> Callable[..., Any]:
        handler: Callable[..., Any] | None = self.dynamic.get(subscription.handler)
        return handler if handler is not None else getattr(self, subscription.handler)

    def _handle(self, one: Input) -> None:
        handler = self._handler(one.subscription)
        if one.subscription.pattern:
            handler(one.message, one.topic)
        else:
            handler(one.message)

    def _run_timers(self, now: int) -> None:
        for one in self.timers:
            due = self._due[one.handler]
            if due > now + 2 * one.period + one.period // 2:
                due = self._due[one.handler] = now + one.period  # the clock was set back
            if due <= now:
                late = (now - due) // one.period
                self._due[one.handler] = due + (late + 1) * one.period
                getattr(self, one.handler)()


def close_log(node: Node) -> None:
    """Detach every handler of a node's logger."""
    for handler in list(node.log.handlers):
        with contextlib.suppress(Exception):
            handler.flush()
        node.log.removeHandler(handler)
