"""What native libraries say past Python: known lines are left out, others come through, also when it ends badly."""

import os

import pytest

from warp_smoke.native_words import leaving_out


def test_other_lines_are_passed_on(capfd):
    """Of two lines written to the descriptor, the one with the words is gone; what is said later is all there."""
    with leaving_out("no driver"):
        os.write(2, b"Warning: no driver here\nError: disk full\n")
    os.write(2, b"no driver, later\n")
    assert capfd.readouterr().err == "Error: disk full\nno driver, later\n"


def test_words_before_an_error_are_not_lost(capfd):
    """An exception leaves the descriptor as it was, and says what the library said."""

    def break_down():
        os.write(2, b"Error: disk full\n")
        raise RuntimeError("broken")

    with pytest.raises(RuntimeError, match="broken"), leaving_out("no driver"):
        break_down()
    os.write(2, b"after\n")
    assert capfd.readouterr().err == "Error: disk full\nafter\n"
