"""Fixtures for tests of what is written."""

import pytest
from results import SET, write_all


@pytest.fixture
def set_stage(tmp_path):
    """The user's stage."""
    path = tmp_path / "user" / "set.usda"
    path.parent.mkdir()
    path.write_text(SET)
    return path


@pytest.fixture
def results(tmp_path, set_stage):
    """Results over the user's stage."""
    return write_all(set_stage, tmp_path / "out")
