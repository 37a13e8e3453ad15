"""What a simulated user is like: how soon, how fast and how exactly it sees and moves. Each has a unit and a reason."""

from dataclasses import dataclass, fields, replace
from math import exp, sqrt

import numpy as np


@dataclass(frozen=True)
class Person:
    """Constants of one simulated user; the study's sensitivity changes them."""

    reaction: float = 0.26  # s from what is seen to a chosen act (choice reaction, 0.2-0.4 s)
    delay: float = 0.15  # s from what is seen to a correction while steering (visual delay, 0.1-0.2 s)
    timing: float = 0.12  # s, standard deviation of when a moving thing is expected somewhere
    hand: float = 0.11  # m/s of a pen that draws at ease
    hurry: float = 0.20  # m/s of a pen that has to get past something
    narrow: float = 0.30  # s: a way drawn W m wide is drawn at most at W / narrow (the steering law's form)
    curved: float = 0.33  # exponent of a bend's radius in the drawing speed (the two-thirds power law)
    drift: float = 4.0  # degrees, standard deviation of a pen's direction about the wanted one
    thumb: float = 8.0  # degrees, the same of a stick under a thumb
    wander: float = 0.30  # s, correlation time of both
    aim: float = 0.05  # standard deviation of where an aimed movement ends, share of its length
    tremor: float = 0.0005  # m, and at least this
    reach_a: float = 0.10  # s of an aimed movement (Fitts)
    reach_b: float = 0.10  # s/bit
    press: float = 0.10  # s of a button
    slow: float = 0.50  # tilt of the stick where the way bends; else it is pushed fully
    bend: float = 30.0  # degrees that the way may turn within a second for the full tilt


SPREAD = {"reaction": 0.15, "delay": 0.15, "hand": 0.20, "hurry": 0.15, "drift": 0.25, "thumb": 0.25, "aim": 0.25,
          "slow": 0.15, "timing": 0.25}  # fmt: skip
"""By what share (log-normal) people differ."""


def someone(seed: int, base: Person | None = None) -> Person:
    """One person: the constants of ``base`` with the spread of people; the same person for pen and gamepad."""
    rng = np.random.default_rng([seed, 77])
    usual = base or Person()
    drawn = {
        one.name: getattr(usual, one.name) * exp(float(rng.normal(0.0, SPREAD[one.name])))
        for one in fields(Person)
        if one.name in SPREAD
    }
    return replace(usual, **drawn)


class Wander:
    """A value that wanders about 0 with a standard deviation and a correlation time (Ornstein-Uhlenbeck)."""

    def __init__(self, rng: np.random.Generator, deviation: float, time: float) -> None:
        self.rng, self.deviation, self.time = rng, deviation, time
        self.value = float(rng.normal(0.0, deviation))

    def step(self, dt: float) -> float:
        """Its value ``dt`` s later."""
        keep = exp(-dt / self.time)
        self.value = keep * self.value + self.deviation * sqrt(1.0 - keep * keep) * float(self.rng.normal())
        return self.value
