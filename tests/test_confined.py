"""Calls in a process with limits: results and errors come back, what hangs or crashes is named."""

import os
import signal
import subprocess
import sys
import time
from typing import Any

import numpy as np
import pytest

from contactfusion.confined import LimitError, confined
from contactfusion.errors import ConfigurationError


def doubled(array: Any) -> Any:
    print("a library that prints")
    return 2 * array


def refusing() -> None:
    raise ConfigurationError("is no mesh", "file")


def unpicklable() -> None:
    class Odd(Exception):
        pass

    raise Odd("of a library")


def endless() -> None:
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    while True:
        pass


def sleeping() -> None:
    time.sleep(60)


def crashing() -> None:
    os.kill(os.getpid(), signal.SIGSEGV)


def leaving() -> None:
    os._exit(3)


def greedy() -> int:
    return len(bytearray(2**29))


def test_the_result_comes_back_whatever_a_library_prints() -> None:
    np.testing.assert_array_equal(confined(doubled, np.arange(3.0)), [0.0, 2.0, 4.0])


def test_errors_come_back() -> None:
    with pytest.raises(ConfigurationError, match="file: is no mesh"):
        confined(refusing)
    with pytest.raises(RuntimeError, match="Odd: of a library"):
        confined(unpicklable)


def test_what_crashes_ends_with_the_signal() -> None:
    with pytest.raises(LimitError, match="SIGSEGV"):
        confined(crashing)
    with pytest.raises(LimitError, match="exit status 3"):
        confined(leaving)


def test_what_takes_too_long_or_too_much_is_ended() -> None:
    with pytest.raises(LimitError, match="longer than it may"):
        confined(endless, seconds=1.0)
    with pytest.raises(LimitError, match=r"more memory than 0\.1 GiB"):
        confined(greedy, memory=2**27)
    assert confined(greedy, memory=2**30) == 2**29


def test_an_interrupt_ends_the_caller_and_what_it_waits_for() -> None:
    script = (  # started in the background, a process would ignore the signal
        "import signal\nsignal.signal(signal.SIGINT, signal.default_int_handler)\n"
        "from contactfusion.confined import confined\n"
        "from tests.test_confined import sleeping\n"
        "print('ready', flush=True)\nconfined(sleeping)\n"
    )
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    with subprocess.Popen(
        [sys.executable, "-c", script], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL,
        env=environment,
    ) as caller:  # fmt: skip
        assert caller.stdout and caller.stdout.readline() == b"ready\n"
        time.sleep(1.0)
        caller.send_signal(signal.SIGINT)
        start = time.monotonic()
        assert caller.wait(timeout=10.0) != 0
        assert time.monotonic() - start < 5.0


def test_a_limit_of_the_caller_that_is_lower_stays() -> None:
    script = (
        "import resource\nfrom contactfusion.confined import confined\n"
        "from tests.test_confined import doubled\n"
        "resource.setrlimit(resource.RLIMIT_AS, (2**33, 2**33))\n"
        "print(confined(doubled, 21, memory=2**40))\n"
    )
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, env=environment
    )
    assert done.stdout == "42\n", done.stderr
