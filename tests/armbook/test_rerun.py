"""Tests of reruns of the report's own notebooks; each starts a kernel."""

import json
import re

import numpy as np

from armbook.cli import main
from armsim.arm import simulate
from armsim.arm.files import read_axis, write_measurement
from armsim.arm.measurement import Measurement, signals
from armsim.paths import DATA


def test_notebook_of_the_report_reruns(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["rerun", "10", "-p", "fit", "rk6"]) == 0
    (made,) = (tmp_path / "runs").iterdir()
    told = capsys.readouterr().out
    assert "saturation_current " in told
    assert str(made.relative_to(tmp_path) / "10_model.html") in told
    text = (made / "10_model.html").read_text()
    assert "saturation_current_deficit" in text
    assert not re.search(r'src="(?!data:)', text)
    assert "application/papermill" not in text


def test_a_record_and_an_axis_of_the_users_own_are_fitted(tmp_path, monkeypatch, capsys):
    """Another axis than the book's, its record in other columns, a wrong start for two values."""
    monkeypatch.chdir(tmp_path)
    text = (DATA / "axes" / "y.toml").read_text(encoding="utf-8")
    axis, noise = read_axis(DATA / "axes" / "y.toml")
    true = axis.replace(K_1=axis.K_1, V_L=0.95 * axis.V_L, B_a=1.1 * axis.B_a)
    (tmp_path / "my_axis.toml").write_text(
        text.replace("[instrument]", f"K_1 = {axis.K_1!r}\n\n[instrument]"), encoding="utf-8"
    )
    t = np.round(0.002 * np.arange(451), 9)
    volts = np.where(t < 0.45, 9.0, 0.0)
    ideal = signals(simulate(true, [(0.0, 9.0), (0.45, 0.0)], t[-1])(t), t, true)
    seen = ideal + noise.deviations * np.random.default_rng(1).standard_normal(ideal.shape)
    write_measurement("my_run.csv", Measurement(t, volts, *seen))
    files = "-p measurements my_run.csv -p axis my_axis.toml"
    short = "-p refits 20 -p fine_step 2e-5 -p starts 1"
    assert main(["rerun", "parameter_fit", *files.split(), *short.split()]) == 0
    (result,) = (tmp_path / "runs").iterdir()
    values = json.loads((result / "52_parameter_fit.json").read_text(encoding="utf-8"))
    for name in ("V_L", "B_a"):
        off = values[name]["value"] - getattr(true, name)
        assert abs(off) < 4 * values[f"{name}_error"]["value"]
    assert values["passed"]["value"] is True
    assert "V_L_true" not in values  # what is known of the published record only
