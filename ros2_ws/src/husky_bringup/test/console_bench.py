"""What tests of the console's page share: viser's server as the console has it."""

from collections.abc import Iterator

import pytest

from husky_bringup.console.server import PageServer


@pytest.fixture(scope="module")
def server() -> Iterator[PageServer]:
    started = PageServer()
    yield started
    started.stop()
