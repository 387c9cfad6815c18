"""Locks between processes: on a folder, and on the machine while times are measured."""

import os
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext, suppress
from pathlib import Path

try:
    import fcntl
except ImportError:  # the command line tells an OSError in one line
    raise OSError("notebooks run on Linux and macOS; on Windows, use WSL") from None

#: Environment variable with the number of the open file that `shared` has locked. A kernel has
#: this file, and so the lock, from its parent.
LOCK_VARIABLE = "REPORTKIT_LOCK"


@contextmanager
def locked(folder: Path, wait: bool = True, kind: int = fcntl.LOCK_EX) -> Iterator[int]:
    """Lock a folder against other processes until the block ends or this process dies.

    Yields the number of the open file that has the lock.

    Raises
    ------
    OSError
        If another process has locked it and `wait` is false.
    """
    handle = os.open(folder, os.O_RDONLY)
    try:
        with suppress(OSError) if wait else nullcontext():  # some file systems have no locks
            fcntl.flock(handle, kind | (0 if wait else fcntl.LOCK_NB))
        yield handle
    finally:
        os.close(handle)


@contextmanager
def shared(notebooks: Path) -> Iterator[None]:
    """Use the machine beside other notebooks of a folder, but wait while one of them measures."""
    with locked(notebooks, kind=fcntl.LOCK_SH) as handle:
        os.environ[LOCK_VARIABLE] = str(handle)
        try:
            yield
        finally:
            del os.environ[LOCK_VARIABLE]


@contextmanager
def alone() -> Iterator[None]:
    """Let no other notebook that is `shared` work during the block.

    First it waits until each of them has ended or waits here as well. In a process that has no
    lock of `shared` it does nothing.
    """
    with suppress(OSError, KeyError):
        fcntl.flock(int(os.environ[LOCK_VARIABLE]), fcntl.LOCK_EX)
    try:
        yield
    finally:
        with suppress(OSError, KeyError):
            fcntl.flock(int(os.environ[LOCK_VARIABLE]), fcntl.LOCK_SH)
