"""What every test has."""

import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest
from stage import Stage


@pytest.fixture
def stage() -> Iterator[Stage]:
    """A stage; its drivers end with the test."""
    # Pytest's own folders have longer paths than sockets may have.
    with tempfile.TemporaryDirectory(prefix="uvcam") as folder:
        stage = Stage(Path(folder))
        yield stage
        stage.close()
