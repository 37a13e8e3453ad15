"""Parameters of a node: declared as class attributes, typed by their annotation, checked on every change."""

from typing import TYPE_CHECKING, Any, TypeVar, get_type_hints

import msgspec

from bunraku.msgs import Parameter

if TYPE_CHECKING:
    from bunraku.runtime.node import Node

T = TypeVar("T")


class ParamProblem(ValueError):
    """A parameter that does not exist or a value that it does not take; one line with the remedy."""


class Param:
    """The declaration of one parameter; on a node it reads as its value."""

    def __init__(
        self, default: Any, low: float | None, high: float | None, choices: list[str] | None, doc: str
    ) -> None:
        self.default, self.low, self.high, self.choices, self.doc = default, low, high, choices, doc
        self.name = ""
        self.owner: type[Any] = object

    def __set_name__(self, owner: type[Any], name: str) -> None:
        self.name, self.owner = name, owner

    def __get__(self, node: "Node | None", owner: type[Any]) -> Any:
        return self if node is None else node.param_values[self.name]

    def __set__(self, node: "Node", value: Any) -> None:
        raise AttributeError(f"{self.name} is a parameter: change it with set_param")

    def type(self) -> Any:
        """The annotated type."""
        return get_type_hints(self.owner).get(self.name, type(self.default))

    def convert(self, value: Any) -> Any:
        """The value in the parameter's type (text is read as one); raises `ParamProblem`."""
        expected = self.type()
        if isinstance(value, str) and expected is not str:
            text = value.strip()
            if text.startswith(("[", "{", '"')):
                try:
                    value = msgspec.json.decode(text)
                except msgspec.DecodeError:
                    raise ParamProblem(f"{self.name}: {text!r} is not JSON") from None
            elif text.lower() in ("none", "null"):
                value = None
            elif expected == list[str]:
                value = [part for part in text.split(",") if part]
            else:
                value = text
        try:
            value = msgspec.convert(value, expected, strict=False)
        except msgspec.ValidationError as error:
            raise ParamProblem(f"{self.name}: {str(error).split(' - at')[0]}, got {value!r}") from None
        if isinstance(value, float) and not -1e300 < value < 1e300:
            raise ParamProblem(f"{self.name}: {value} is not a finite number")
        if isinstance(value, (int, float)) and not isinstance(value, bool):
            if self.low is not None and value < self.low:
                raise ParamProblem(f"{self.name}: {value} is below its least, {self.low}")
            if self.high is not None and value > self.high:
                raise ParamProblem(f"{self.name}: {value} is above its most, {self.high}")
        if self.choices is not None and value not in self.choices:
            raise ParamProblem(f"{self.name}: {value!r} is none of {', '.join(self.choices)}")
        return value

    def describe(self, value: Any) -> Parameter:
        """The parameter as the `params/<node>` topic tells it."""
        expected = self.type()
        return Parameter(
            value=value,
            type=getattr(expected, "__name__", str(expected)) if isinstance(expected, type) else str(expected),
            doc=self.doc,
            low=self.low,
            high=self.high,
            choices=self.choices,
        )


def param(
    default: T,
    *,
    low: float | None = None,
    high: float | None = None,
    choices: list[str] | None = None,
    doc: str = "",
) -> T:
    """Declare a parameter: ``half_life: float = param(0.08, low=0.0, doc="seconds")``."""
    declared: Any = Param(default, low, high, choices, doc)
    return declared  # type: ignore[no-any-return]


def params_of(node: type[Any]) -> dict[str, Param]:
    """All parameters that a node class declares, base classes first."""
    found: dict[str, Param] = {}
    for base in reversed(node.__mro__):
        found.update({name: value for name, value in vars(base).items() if isinstance(value, Param)})
    return found


def convert_all(node: type[Any], values: dict[str, Any]) -> dict[str, Any]:
    """Every parameter's value, the given ones converted and checked; raises `ParamProblem`."""
    declared = params_of(node)
    for name in values:
        if name not in declared:
            known = ", ".join(sorted(declared)) or "none"
            raise ParamProblem(f"no parameter {name!r} (has: {known})")
    return {name: one.convert(values[name]) if name in values else one.default for name, one in declared.items()}
