"""Fixtures that all tests share."""

import signal

import pytest
import warp as wp

from warp_smoke.launch import Launcher


def pytest_configure(config):
    """Lets the commands that tests start hear Ctrl-C, also where a shell has it ignored, as in background jobs."""
    signal.signal(signal.SIGINT, signal.default_int_handler)


def _devices():
    return ["cpu"] + (["cuda"] if wp.is_cuda_available() else [])


@pytest.fixture(scope="session", params=_devices())
def device(request):
    """Each device that kernels can run on here."""
    return request.param


@pytest.fixture(scope="session")
def launcher(device):
    """A launcher on the device, with the machine's threads."""
    return Launcher(device)


@pytest.fixture
def divided_launches(monkeypatch):
    """Divides every launch among all threads, however short it is."""
    monkeypatch.setattr("warp_smoke.launch._SECONDS_WORTH_A_THREAD", 1e-9)
