"""What all tests share."""

import os
from collections.abc import Iterator

import pytest


@pytest.fixture(autouse=True)
def _same_environment() -> Iterator[None]:
    """A verb run in this process may set variables (a launch puts compiling aside): no later test inherits them."""
    before = dict(os.environ)
    yield
    for name in set(os.environ) - set(before):
        del os.environ[name]
    os.environ.update(before)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Real processes and browsers have a timing of their own: on a crowded machine they may try again."""
    for item in items:
        outside = any(item.get_closest_marker(name) for name in ("peer", "stack"))
        if outside or item.path.name.startswith(("test_web_", "test_page")):
            item.add_marker(pytest.mark.flaky(reruns=2, reruns_delay=2))
