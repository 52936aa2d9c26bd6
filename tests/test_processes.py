"""Worker processes and interrupts."""

import signal
import subprocess
import sys
import time
from contextlib import nullcontext

import pytest

from sffr_workbench.common.processes import interrupts_ignored

WAIT = "import sys, time; print('ready', flush=True); time.sleep(60)"


@pytest.mark.parametrize("ignored", [True, False])
def test_an_interrupt_does_not_reach_what_was_started_while_they_were_ignored(ignored):
    """And does reach what was started otherwise, and this process afterwards."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        with interrupts_ignored() if ignored else nullcontext():
            child = subprocess.Popen([sys.executable, "-c", WAIT], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL)
        with child:
            assert child.stdout.readline() == b"ready\n"
            child.send_signal(signal.SIGINT)
            deadline = time.monotonic() + (0.3 if ignored else 10.0)
            while child.poll() is None and time.monotonic() < deadline:
                time.sleep(0.01)
            assert (child.returncode is None) == ignored
            child.kill()
        with pytest.raises(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)
    finally:
        signal.signal(signal.SIGINT, before)
