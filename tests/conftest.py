"""What holds for all tests."""

import os
import signal

from hypothesis import HealthCheck, is_hypothesis_test, seed, settings

# Who starts the tests in the background makes them ignore Ctrl-C, and so the programs that they
# start and interrupt. A handler here is the default there.
signal.signal(signal.SIGINT, signal.default_int_handler)

# `make test` tries the same examples each time, on however busy a machine. `make fuzz` tries new
# ones, and keeps those that fail in .hypothesis.
_ANY_SPEED = {"deadline": None, "suppress_health_check": [HealthCheck.too_slow]}
settings.register_profile("ci", derandomize=True, database=None, **_ANY_SPEED)
settings.register_profile("fuzz", max_examples=2000, print_blob=True, **_ANY_SPEED)
settings.load_profile("ci")


def pytest_collection_modifyitems(items):
    """Give every property the seed of `make fuzz`. (Pytest's own option would keep no failures.)"""
    number = os.environ.get("FUZZ_SEED")
    for item in items if number else ():
        if is_hypothesis_test(getattr(item, "function", None)):
            seed(int(number))(item.function)
