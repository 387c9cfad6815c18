"""What holds for all tests."""

import signal

# Who starts the tests in the background makes them ignore Ctrl-C, and so the programs that they
# start and interrupt. A handler here is the default there.
signal.signal(signal.SIGINT, signal.default_int_handler)
