"""Ctrl-C, the interrupt button of a notebook and an alarm end a computation, and nothing else.

Numba makes arrays and named tuples by calling Python, where a signal may raise an error that numba
does not expect. Each computation is interrupted in a process of its own, since that would crash.
"""

import subprocess
import sys
import threading

import pytest
from jupyter_client.kernelspec import KernelSpecManager
from jupyter_client.manager import KernelManager

PREPARE = """
import random, signal, threading, time
import numpy as np
from armsim.arm import AxisParameters, identify, simulate, simulate_many
from armsim.arm.files import read_axis, read_measurement
from armsim.methods import tableaux
from armsim.paths import DATA
import thermostat

p = AxisParameters.paper_x_axis()
axes = [p.replace(T_p=T_p) for T_p in (0.03, 0.04, 0.05)]
times = np.linspace(0, 1, 20)
record = read_measurement(DATA / "measurements" / "x_axis_test.csv")
axis = read_axis(DATA / "axes" / "x.toml")

def estimated():
    return identify.fit(record, *axis, starts=1).values

def many():
    return simulate_many(axes, 10.0, 1.0, times, threads=1)

def room():
    return thermostat.solve(15.0, 40.0, 5.0, (0.25, 8.0, 19.0, 21.0))(times)

def exact():
    return simulate(p, 10.0, 1.0)(times)

def stepped():
    return simulate(p, 10.0, 0.02, method=tableaux.RK6, step_size=1e-5).y

def adaptive():
    return simulate(p, 10.0, 0.02, method=tableaux.DP5).y

compute, expected = {name}, {name}()
"""
INTERRUPT = """
class Alarm(Exception):
    pass

def alarmed(*_):
    raise Alarm

def send(number, after, caught):
    # Again if it was lost: Python ignores errors while it clears away.
    while not caught.wait(after):
        signal.raise_signal(number)
        after = 20.0

signal.signal(signal.SIGINT, signal.default_int_handler)
signal.signal(signal.SIGALRM, alarmed)
begin = time.perf_counter()
compute()
longest = min(0.03, time.perf_counter() - begin)
draw = random.Random(0)
for n in range(100):
    number, error = [(signal.SIGINT, KeyboardInterrupt), (signal.SIGALRM, Alarm)][n % 2]
    caught = threading.Event()
    sender = threading.Thread(target=send, args=(number, draw.uniform(0, longest), caught))
    try:
        sender.start()
        while True:
            compute()
    except error:
        caught.set()
    sender.join()
    assert np.array_equal(compute(), expected)
print("right")
"""


@pytest.mark.parametrize("name", ["exact", "many", "room", "stepped", "adaptive", "estimated"])
def test_a_signal_at_any_moment_raises_its_error_and_the_next_call_is_right(name):
    code = PREPARE.format(name=name) + INTERRUPT
    path = "\n".join(["import sys", f"sys.path += {sys.path}", ""])
    found = subprocess.run([sys.executable, "-c", path + code], capture_output=True, text=True)
    assert (found.returncode, found.stdout) == (0, "right\n"), found.stderr[-2000:]


LOOP = """
print("begun", flush=True)
while True:
    compute()
"""


def test_interrupt_leaves_a_notebook_kernel_alive():
    this_python = KernelSpecManager(kernel_dirs=[])
    kernel = KernelManager(kernel_name="python3", kernel_spec_manager=this_python)
    kernel.start_kernel()
    client = kernel.blocking_client()
    try:
        client.start_channels()
        client.wait_for_ready(timeout=60)

        def run(code):
            said, ended = [], threading.Event()

            def interrupt():
                kernel.interrupt_kernel()
                while not ended.wait(20):  # s; lost: Python ignores errors while it clears away
                    kernel.interrupt_kernel()

            def hook(message):
                said.append(message["content"].get("text", ""))
                if said[-1] == "begun\n":
                    threading.Thread(target=interrupt).start()

            reply = client.execute_interactive(code, timeout=300, output_hook=hook)["content"]
            ended.set()
            return reply.get("ename", reply["status"]), "".join(said)

        path = f"import sys; sys.path += {sys.path}\n"
        assert run(path + PREPARE.format(name="exact"))[0] == "ok"
        for _ in range(5):
            assert run(LOOP)[0] == "KeyboardInterrupt"
            assert run("print(np.array_equal(compute(), expected))") == ("ok", "True\n")
    finally:
        client.stop_channels()
        kernel.shutdown_kernel(now=True)
