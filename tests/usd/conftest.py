"""Fixtures for tests of what is read and written."""

import pytest
from PIL import Image
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


@pytest.fixture
def picture(tmp_path):
    """A picture beside the stage."""
    path = tmp_path / "picture.png"
    Image.new("RGB", (2, 2)).save(path)
    return path
