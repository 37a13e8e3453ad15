"""What the tests with a browser share."""

from collections.abc import Iterator
from typing import Any

import pytest
from pages import BROWSER, FLAGS


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    sync_api = pytest.importorskip("playwright.sync_api", reason="needs playwright: pip install -e '.[test]'")
    with sync_api.sync_playwright() as driver:
        one = driver.chromium.launch(executable_path=BROWSER, args=FLAGS)
        yield one
        one.close()
