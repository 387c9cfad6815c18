"""Studies: the same results from every executor, also when a worker is killed in the middle."""

import os
import signal
import subprocess
import sys
import textwrap
import time
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from functools import partial
from multiprocessing import get_context

import pytest
from distributed import Client, LocalCluster

from armsim.arm import AxisParameters, simulate, study
from armsim.arm.study import MAX_RESTARTS, StudyError

#: Functions that new processes can find.
MODULE = '''
import os, signal, time
from pathlib import Path

from armsim.arm import AxisParameters, simulate


def square(n):
    return n * n


def final_position(T_p):
    return simulate(AxisParameters.paper_x_axis(T_p=T_p), 10.0, 0.1)(0.1)[0]


def fails(n):
    if n == 13:
        raise ValueError("not with me")
    return n


def killed_once(folder, n):
    """In case 7 the first worker kills itself; each run of a case leaves a file."""
    Path(folder, f"{n}-{os.getpid()}").touch()
    time.sleep(0.01)
    if n == 7:
        try:
            Path(folder, "killed").touch(exist_ok=False)
        except FileExistsError:
            return n * n
        os.kill(os.getpid(), signal.SIGKILL)
    return n * n


def killed(n):
    if n == 7:
        os.kill(os.getpid(), signal.SIGKILL)
    return n


def slow(n):
    os.write(1, b"started\\n")  # in one piece, as others write too
    time.sleep(60)
'''
CASES = range(40)
SQUARES = [n * n for n in CASES]


@pytest.fixture(scope="module")
def work(tmp_path_factory):
    """A module in a folder where new processes look."""
    folder = tmp_path_factory.mktemp("work")
    (folder / "armsim_work.py").write_text(MODULE, encoding="utf-8")
    sys.path.insert(0, str(folder))
    import armsim_work

    yield armsim_work
    sys.path.remove(str(folder))


@pytest.fixture(scope="module")
def dask(work):
    with (
        LocalCluster(
            n_workers=2, threads_per_worker=1, dashboard_address=None, worker_dashboard_address=None
        ) as cluster,
        Client(cluster) as client,
    ):
        yield client.get_executor()


def test_results_do_not_depend_on_the_executor(work, dask):
    cases = [0.02 + 0.002 * n for n in range(12)]
    serial = [work.final_position(T_p) for T_p in cases]
    with ThreadPoolExecutor(2) as threads:
        assert study(cases, work.final_position, executor=threads) == serial
    with ProcessPoolExecutor(2, get_context("spawn")) as processes:
        assert study(cases, work.final_position, executor=processes) == serial
    assert study(cases, work.final_position) == serial
    assert study(cases, work.final_position, executor=dask) == serial


@pytest.mark.parametrize("chunk", [None, 1, 7, 1000])
def test_order_is_kept_however_the_cases_are_cut(work, chunk):
    with ThreadPoolExecutor(3) as threads:
        assert study(iter(CASES), work.square, executor=threads, chunk=chunk) == SQUARES


def test_no_cases_no_results(work):
    assert study([], work.square) == []


def test_killed_worker_loses_nothing(work, tmp_path):
    assert study(CASES, partial(work.killed_once, tmp_path), chunk=2) == SQUARES
    assert (tmp_path / "killed").exists()


def test_killed_dask_worker_loses_nothing(work, dask, tmp_path):
    assert study(CASES, partial(work.killed_once, tmp_path), executor=dask, chunk=2) == SQUARES
    assert (tmp_path / "killed").exists()


def test_worker_killed_again_and_again_is_an_error(work):
    with pytest.raises(StudyError, match=f"killed {MAX_RESTARTS + 1} times.*need more memory"):
        study(range(8), work.killed, chunk=4)


@pytest.mark.parametrize("kind", ["own", "threads", "dask"])
def test_failure_names_the_case(work, dask, kind):
    with ThreadPoolExecutor(2) as threads:
        executor = {"own": None, "threads": threads, "dask": dask}[kind]
        with pytest.raises(StudyError, match="case 13: ValueError: not with me") as caught:
            study(CASES, work.fails, executor=executor, chunk=5)
    assert caught.value.case == 13
    assert "in fails" in "".join(caught.value.__notes__)


def test_function_that_cannot_be_sent_is_refused():
    with pytest.raises(TypeError, match="cannot be sent to another process"):
        study(CASES, lambda n: n)


@pytest.mark.parametrize("chunk", [0, -1, True])
def test_chunk_is_checked(work, chunk):
    with pytest.raises(ValueError, match="at least 1"):
        study(CASES, work.square, chunk=chunk)


def test_bar_shows_only_when_asked(work, capsys):
    with ThreadPoolExecutor(2) as threads:
        study(CASES, work.square, executor=threads)
        assert capsys.readouterr() == ("", "")
        study(CASES, work.square, executor=threads, progress=True)
    out, err = capsys.readouterr()
    assert out == "" and "40/40" in err


@pytest.mark.parametrize("whole_group", [True, False], ids=["terminal", "process only"])
def test_ctrl_c_ends_the_study_and_its_processes(work, whole_group):
    code = """
        import armsim_work
        from armsim.arm import study
        if __name__ == "__main__":
            try:
                study(range(4), armsim_work.slow, chunk=1)
            except KeyboardInterrupt:
                print("stopped")
    """
    folder = os.path.dirname(work.__file__)
    script = os.path.join(folder, "main.py")
    with open(script, "w", encoding="utf-8") as file:
        file.write(textwrap.dedent(code))
    process = subprocess.Popen(
        [sys.executable, script],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    try:
        assert process.stdout.readline() == "started\n"
        start = time.monotonic()
        (os.killpg if whole_group else os.kill)(process.pid, signal.SIGINT)
        out, err = process.communicate(timeout=20)  # the pipes close when the last worker is gone
        assert time.monotonic() - start < 10
        assert out.endswith("stopped\n") and "Traceback" not in err
    finally:
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGKILL)


def test_processes_give_the_numbers_of_this_one(work):
    p = AxisParameters.paper_x_axis(T_p=0.05)
    assert study([0.05], work.final_position) == [simulate(p, 10.0, 0.1)(0.1)[0]]
