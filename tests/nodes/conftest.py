"""What tests of nodes share."""

from collections.abc import Iterator

import pytest
from house import House


@pytest.fixture
def house() -> Iterator[House]:
    """A page server whose doors are open."""
    one = House()
    yield one
    one.server.stop()
