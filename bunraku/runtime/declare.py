"""What a node class declares: the topics that it says and hears, its timers and requests."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Generic, Self, TypeVar, overload

from bunraku.msgs import Journal, Log, Message, Params, TopicKind, kind_of
from bunraku.runtime.params import Param, params_of

if TYPE_CHECKING:
    from bunraku.runtime.node import Node

M = TypeVar("M", bound=Message)
H = TypeVar("H", bound=Callable[..., Any])
SECOND = 1_000_000_000


@dataclass(frozen=True)
class Subscription:
    """One topic, or all that match a pattern, and who hears them."""

    topic: str
    type: Any
    handler: str
    trigger: bool = True
    raw: bool = False
    newest: bool = False

    @property
    def pattern(self) -> bool:
        """Whether the topic has a '*' in it."""
        return "*" in self.topic


@dataclass(frozen=True)
class Timer:
    handler: str
    period: int
    idle: bool


class BoundPublisher(Generic[M]):
    """A node's own end of a topic that it says."""

    def __init__(self, node: "Node", topic: str, type_: Any) -> None:
        self.node, self.topic, self.type = node, topic, type_
        self.seq = 0
        self.last: M | None = None
        """The message published last."""

    def publish(self, message: M) -> None:
        """Send; fills in `stamp`, `seq` and, where it is None, the `origin` of this step."""
        stage = self.node.stage
        message.seq = self.seq
        self.seq += 1
        if message.origin is None:
            message.origin = self.node.origin
        message.stamp = stage.clock.now()
        self.last = message
        stage.send(self.topic, message.encode())

    def subscribers(self) -> int:
        """How many listen now."""
        return self.node.stage.subscribers(self.topic)


class Publisher(Generic[M]):
    """Declares a topic that the node says: ``pose = Publisher("pose", Pose)``."""

    def __init__(self, topic: str, type_: type[M] | Any) -> None:
        self.topic, self.type = topic, type_
        self.name = ""

    def __set_name__(self, owner: type[Any], name: str) -> None:
        self.name = name

    @overload
    def __get__(self, node: None, owner: type[Any]) -> Self: ...
    @overload
    def __get__(self, node: "Node", owner: type[Any]) -> BoundPublisher[M]: ...
    def __get__(self, node: "Node | None", owner: type[Any]) -> "Self | BoundPublisher[M]":
        return self if node is None else node.publishers[self.name]


def subscribe(topic: str, type_: Any, *, trigger: bool = True) -> Callable[[H], H]:
    """Hear a topic. ``trigger=False``: state that the next step is handed, never a reason for one.

    A pattern ('overlay/*') hears all that match; its handler also gets the topic's name.
    """

    def mark(handler: H) -> H:
        kind = kind_of(topic)
        newest = bool(kind and kind.newest) or not trigger
        one = Subscription(topic, type_, handler.__name__, trigger, newest=newest)
        handler.__dict__.setdefault("subscriptions", []).append(one)
        return handler

    return mark


def subscribe_raw(topic: str) -> Callable[[H], H]:
    """Hear bodies as they came: ``def on_raw(self, topic, body)``; every one, unread and not journalled."""

    def mark(handler: H) -> H:
        one = Subscription(topic, bytes, handler.__name__, raw=True)
        handler.__dict__.setdefault("subscriptions", []).append(one)
        return handler

    return mark


def timer(*, hz: float, idle: bool = False) -> Callable[[H], H]:
    """Call at a fixed rate without drift; missed ticks are left out.

    ``idle``: only after no message came for one and a half periods, so that a node that answers messages
    at once does not tick beside them.
    """

    def mark(handler: H) -> H:
        handler.__dict__["timer"] = Timer(handler.__name__, round(SECOND / hz), idle)
        return handler

    return mark


def request(name: str) -> Callable[[H], H]:
    """Answer a control request; keyword arguments in, a map (or None) out, ValueError to refuse."""

    def mark(handler: H) -> H:
        handler.__dict__["request"] = name
        return handler

    return mark


def marked(node: type["Node"], mark: str) -> list[Callable[..., Any]]:
    """Methods that a decorator marked, in the order of declaration; an override replaces."""
    found: dict[str, Callable[..., Any]] = {}
    for base in reversed(node.__mro__):
        for name, value in vars(base).items():
            if callable(value) and mark in getattr(value, "__dict__", {}):
                found[name] = value
    return list(found.values())


def subscriptions_of(node: type["Node"]) -> list[Subscription]:
    return [one for method in marked(node, "subscriptions") for one in method.__dict__["subscriptions"]]


def declared_by(node: type["Node"], kind: type[Any]) -> dict[str, Any]:
    found: dict[str, Any] = {}
    for base in reversed(node.__mro__):
        found.update({name: value for name, value in vars(base).items() if isinstance(value, kind)})
    return found


@dataclass(frozen=True)
class Declaration:
    """What a node class says of itself without running."""

    says: dict[str, TopicKind]
    hears: dict[str, bool]
    """Topic or pattern -> whether it triggers."""
    params: dict[str, Param]
    requests: list[str]


def declaration(node: type["Node"], name: str | None = None) -> Declaration:
    """The topics, parameters and requests of a node class, its own log and parameters included."""
    name = name or node.name
    says: dict[str, TopicKind] = {
        f"log/{name}": TopicKind(Log),
        f"params/{name}": TopicKind(Params, latched=True),
    }
    if node.journal:
        says[f"journal/{name}"] = TopicKind(Journal)
    for one in declared_by(node, Publisher).values():
        kind = kind_of(one.topic) or TopicKind(one.type)
        says[one.topic] = replace(kind, type=one.type)
    hears = {one.topic: one.trigger for one in subscriptions_of(node)}
    requests = [one.__dict__["request"] for one in marked(node, "request")]
    return Declaration(says, hears, params_of(node), requests)
