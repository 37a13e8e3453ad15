"""What is drawn of the course: tiles, obstacles with their shadows and tracks, and the record."""

from bunraku.msgs import Primitive
from bunraku.nodes.course.game import Game
from bunraku.nodes.course.stages import DUCK, JUMP, Place

TILE = (0.20, 0.74, 0.80, 0.34)
START = (0.30, 0.66, 0.42, 0.40)
GOAL = (0.16, 0.36, 0.86, 0.62)
TRACK = (0.30, 0.32, 0.36, 0.30)
SHADOW = (0.15, 0.16, 0.20, 0.34)
COLORS = {JUMP: (0.93, 0.55, 0.12, 0.92), DUCK: (0.62, 0.32, 0.74, 0.86)}
PILLAR = (0.86, 0.24, 0.22, 0.84)
HIT = (1.0, 0.08, 0.05, 1.0)
TEXT = (0.16, 0.20, 0.30, 1.0)
ALARM = (0.85, 0.10, 0.08, 1.0)
FLAT = 0.004
"""m above the ground of what lies on it."""
THIN = 0.03
"""m, width of an obstacle's track."""
LINE = 0.042
"""Height of a line of the record, share of the picture."""


def on_ground(places: list[Place], origin: Place, height: float = FLAT) -> list[tuple[float, ...]]:
    """Places of the course's ground in the world, (x, y, z) m."""
    return [(x + origin[0], height, z + origin[1]) for x, z in places]


def drawn(game: Game, now: float, number: int, origin: Place) -> list[Primitive]:
    """All of it; the course lies at ``origin`` (x, z) m of the world."""
    return [*tiles(game, origin), *obstacles(game, now, origin), *record(game, number)]


def tiles(game: Game, origin: Place) -> list[Primitive]:
    """A polygon a tile: the first one green, the last one blue, the others cyan."""
    out = []
    last = len(game.stage.tiles) - 1
    for k, tile in enumerate(game.stage.tiles):
        color = START if k == 0 else GOAL if k == last else TILE
        corners = [(float(x), float(z)) for x, z in tile]
        out.append(Primitive(kind="polygon", points=on_ground(corners, origin), color=color, size=0.014))
    return out


def obstacles(game: Game, now: float, origin: Place) -> list[Primitive]:
    """For each obstacle its track and its shadow on the ground, and itself with a word of what it asks for."""
    if not game.obstacles:
        return []
    out = []
    t = game.since(now)
    for number, one in enumerate(game.stage.obstacles):
        a, b = one.ends(t)
        touched = number < len(game.touched) and game.touched[number]
        color = HIT if touched else COLORS.get(one.asks, PILLAR)
        below: list[Place] = [(float(a[0]), float(a[2])), (float(b[0]), float(b[2]))]
        body: list[tuple[float, ...]] = [(float(x) + origin[0], float(y), float(z) + origin[1]) for x, y, z in (b, a)]
        wide = 2.0 * one.radius
        shadow = Primitive(kind="line", points=on_ground(below, origin), color=SHADOW, size=wide)
        if below[0] == below[1]:
            shadow = Primitive(kind="circle", points=on_ground(below[:1], origin), color=SHADOW, size=one.radius)
        out += [
            Primitive(kind="line", points=on_ground([one.begin, one.end], origin), color=TRACK, size=THIN),
            shadow,
            Primitive(kind="line", points=body, color=color, size=wide, label=one.asks),
        ]
        if one.asks == DUCK:  # thin lines down to the ground tell where it hangs
            for (x, y, z), (u, v) in zip(body, reversed(below), strict=True):
                foot = (u + origin[0], 0.04, v + origin[1])
                out.append(Primitive(kind="line", points=[(x, y, z), foot], color=TRACK, size=0.015))
    return out


def record(game: Game, number: int) -> list[Primitive]:
    """Time, course-outs, collisions and points, at the picture's upper left."""
    score = game.score
    first = f"Stage {number}: {game.stage.says}"
    hits = f"   hit {score.hits}" if game.obstacles else ""
    second = f"{score.seconds:.1f} s   off the course {score.outs}{hits}   = {score.points(game.rules):.1f}"
    if game.phase == "ready":
        second = "Go to the blue tile; the clock starts when the figure moves"
    out = [_words(first, 0, TEXT), _words(second, 1, TEXT)]
    if game.phase == "finished":
        out.append(_words("There!", 2, (*GOAL[:3], 1.0)))
    elif game.off:
        out.append(_words("off the course", 2, ALARM))
    elif any(game.touched):
        out.append(_words("hit", 2, ALARM))
    return out


def _words(text: str, row: int, color: tuple[float, float, float, float]) -> Primitive:
    at = (0.02, 0.07 + 1.35 * LINE * row)
    return Primitive(kind="text", space="screen", points=[at], color=color, size=LINE, label=text)
