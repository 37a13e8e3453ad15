"""Choosing how pictures are made."""

from collections.abc import Callable

from bunraku.nodes.renderer.view import Engine

ENGINES = ["auto", "gl", "pillow"]


def open_engine(kind: str = "auto", samples: int = 4, say: Callable[[str], object] = lambda line: None) -> Engine:
    """An engine without a window.

    Args:
        kind: ``gl`` needs OpenGL, ``pillow`` draws without, ``auto`` takes OpenGL where it can be had.
        samples: of OpenGL's antialiasing, 0 or 4.
        say: told one line when ``auto`` has to do without OpenGL.

    Raises:
        NoOpenGL: ``gl`` was asked for and cannot be had; one line with the remedy.
    """
    if kind not in ENGINES:
        raise ValueError(f"engine: {kind!r} is none of {', '.join(ENGINES)}")
    if kind != "pillow":
        from bunraku.nodes.renderer.opengl import NoOpenGL

        try:
            from bunraku.nodes.renderer.glengine import GLEngine

            return GLEngine(samples)
        except NoOpenGL as error:
            if kind == "gl":
                raise
            say(f"drawing without OpenGL, plainer and slower: {error}")
    from bunraku.nodes.renderer.plainengine import PillowEngine

    return PillowEngine()
