"""Many runs of one function: on this machine's processors, or on any executor."""

import math
import multiprocessing
import os
import pickle
import signal
import sys
import traceback
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import Executor, Future, ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from typing import Any

from tqdm import tqdm

#: Times that workers may be killed before a study gives up.
MAX_RESTARTS = 3
#: Parts that the cases are cut into, unless `chunk` is given.
_PARTS = 128


class StudyError(RuntimeError):
    """A case failed, or workers were killed again and again.

    Attributes
    ----------
    case : int or None
        Number of the case that failed, from 0.
    """

    def __init__(self, text: str, case: int | None = None) -> None:
        super().__init__(text, case)
        self.case = case

    def __str__(self) -> str:
        return str(self.args[0])


def study(
    cases: Iterable[Any],
    run: Callable[[Any], Any],
    *,
    executor: Executor | None = None,
    progress: bool = False,
    chunk: int | None = None,
) -> list[Any]:
    """Run a function on many cases, in parallel, and return the results in their order.

    Parameters
    ----------
    cases : iterable
        One argument of `run` each.
    run : callable
        ``run(case)``. Without an `executor` it has to be found by new processes: a function of a
        module, or a `functools.partial` of one.
    executor : concurrent.futures.Executor, optional
        Such as the ``get_executor()`` of a Dask client. Left out, one process a processor is
        started, and what a killed process had not returned is run again, up to `MAX_RESTARTS`
        times. The results do not depend on it.
    progress : bool
        Show a bar on standard error.
    chunk : int, optional
        Cases that a worker takes at once; by default the cases are cut into 128 parts.

    Returns
    -------
    list
        ``run(case)`` of each case.

    Raises
    ------
    StudyError
        If `run` raises, with the number of the case in the text and in ``case``; or if processes
        are killed too often.
    TypeError, ValueError
        If `run` cannot be sent to another process, or `chunk` is less than 1.
    """
    todo = list(cases)
    if chunk is not None and (isinstance(chunk, bool) or chunk < 1):
        raise ValueError(f"chunk = {chunk!r} is not allowed; it must be at least 1")
    size = chunk or max(math.ceil(len(todo) / _PARTS), 1)
    parts = {first: todo[first : first + size] for first in range(0, len(todo), size)}
    done: dict[int, list[Any]] = {}
    with tqdm(total=len(todo), file=sys.stderr, disable=not progress) as bar:
        if executor is not None:
            futures: dict[Future, int] = {}
            try:
                _collect(executor, run, parts, done, bar, futures)
            finally:
                for future in futures:
                    future.cancel()
        else:
            _in_processes(run, parts, done, bar)
    return [result for first in parts for result in done[first]]


def _in_processes(
    run: Callable[[Any], Any], parts: dict[int, list[Any]], done: dict[int, list[Any]], bar: tqdm
) -> None:
    """Collect all parts with pools of our own, a new one whenever a process was killed."""
    try:
        pickle.dumps(run)
    except Exception as error:
        raise TypeError(f"{run!r} cannot be sent to another process: {error}") from error
    restarts = 0
    while missing := {first: part for first, part in parts.items() if first not in done}:
        # Fresh processes: to fork one that has threads can leave a lock closed for ever.
        workers = min(_processors(), len(missing))
        context = multiprocessing.get_context("spawn")
        pool = ProcessPoolExecutor(workers, context, _end_on_ctrl_c)
        try:
            # Its futures end with its processes; one cancelled before would upset the pool.
            _collect(pool, run, missing, done, bar, {})
        except BrokenProcessPool as error:
            restarts += 1
            if restarts > MAX_RESTARTS:
                lost = min(first for first in parts if first not in done)
                raise StudyError(
                    f"processes were killed {restarts} times, the last time with case {lost} or a "
                    "later one not finished; they may need more memory than there is, or not find "
                    f"{run!r}, which has to stand in a module"
                ) from error
        except BaseException:  # an error or Ctrl-C: do not wait for what still runs
            for process in list((pool._processes or {}).values()):
                process.terminate()
            raise
        finally:
            pool.shutdown(cancel_futures=True)


def _collect(
    executor: Executor,
    run: Callable[[Any], Any],
    parts: dict[int, list[Any]],
    done: dict[int, list[Any]],
    bar: tqdm,
    futures: dict[Future, int],
) -> None:
    # New processes inherit the mask: Ctrl-C is not to meet them before they are ready for it.
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        for first, part in parts.items():
            futures[executor.submit(_run_part, run, first, part)] = first
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
    for future in as_completed(futures):
        done[futures[future]] = future.result()
        bar.update(len(parts[futures[future]]))


def _end_on_ctrl_c() -> None:
    """Let a process end without a word."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})


def _run_part(run: Callable[[Any], Any], first: int, part: Sequence[Any]) -> list[Any]:
    results = []
    for n, case in enumerate(part, first):
        try:
            results.append(run(case))
        except Exception as error:  # not every exception survives the way between processes
            failure = StudyError(f"case {n}: {type(error).__name__}: {error}", n)
            failure.add_note(traceback.format_exc())
            raise failure from None
    return results


def _processors() -> int:
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
