"""The second process ends with the first, however that ends."""

import os
import signal
import subprocess
import sys
import time

import pytest

SCRIPT = """
import os, sys, time
from icjax.cli._helper import helper
if __name__ == "__main__":
    with helper() as executor:
        print(executor.submit(os.getpid).result() if executor else 0, flush=True)
        time.sleep(60)
"""


def alive(pid):
    try:
        with open(f"/proc/{pid}/stat") as file:
            return file.read().split()[2] != "Z"
    except OSError:
        return False


@pytest.mark.skipif(not os.path.isdir("/proc/self"), reason="looks processes up in /proc")
@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGTERM])
def test_no_process_is_left_behind(tmp_path, how):
    (tmp_path / "first.py").write_text(SCRIPT)
    with subprocess.Popen(
        [sys.executable, str(tmp_path / "first.py")], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
    ) as first:
        assert first.stdout is not None
        second = int(first.stdout.readline())
        if second == 0:
            first.kill()
            pytest.skip("one core: there is no second process")
        assert alive(second)
        first.send_signal(how)
        first.wait(20)
    limit = time.monotonic() + 20
    while alive(second) and time.monotonic() < limit:
        time.sleep(0.1)
    assert not alive(second)
