"""Bad input: one message that names the key, the value and what is accepted; and a scenario is what its file says."""

from __future__ import annotations

import math
import subprocess
import sys
from pathlib import Path

import pytest

import obsdesign as od

AEROSONDE = Path(__file__).parent.parent / "scenarios" / "aerosonde_wind.toml"

# what is replaced in the file, by what, and what the message must say
BAD_INPUT = {
    "unknown key": ("speed = 20.0", "sped = 20.0\nspeed = 20.0", ["vehicle.sped", "did you mean 'speed'"]),
    "unknown key in degrees": (
        "heading_deg = 30.0",
        "heading_deg = 30.0\nheadin_deg = 1.0",
        ["start.headin_deg", "did you mean 'heading'"],
    ),
    "unknown input": (
        "turn_rate = [",
        "turn_rte = [",
        ["design.bounds.turn_rte", "did you mean 'turn_rate'", "design.bounds.turn_rate: missing"],
    ),
    "unknown state": ("wind_y = 5.0", "wind_z = 5.0", ["prior.wind_z", "did you mean 'wind_", "prior.wind_y: missing key"]),
    "unknown kind": (
        'kind = "gps"',
        'kind = "gsp"',
        ["sensors[0].kind", "'gsp'", "bearing, gps, magnetometer, range", "did you mean 'gps'"],
    ),
    "unknown criterion": (
        "min_eigenvalue",
        "min_eigenvalu",
        ["design.criterion", "log_det, min_eigenvalue, posterior, trace_inverse", "did you mean"],
    ),
    "unknown suite": ('[["gps"]]', '[["gpss"]]', ["design.suites[0]", "'gpss'", "did you mean 'gps'"]),
    "missing key": ("sigma = 1.0 ", "", ["sensors[2].sigma", "missing key"]),
    "missing kind": ('kind = "dubins"', "", ["vehicle.kind", "missing key"]),
    "missing table": ("[time]\nduration", "[tim]\nduration", ["time: missing key", "tim: unknown key", "did you mean 'time'"]),
    "wrong type": ("speed = 20.0", 'speed = "fast"', ["vehicle.speed", "'fast'", "valid number"]),
    "number as text": ("sigma = 2.0", 'sigma = "2.0"', ["sensors[0].sigma", "'2.0'", "valid number"]),
    "boolean as number": ("duration = 120.0", "duration = true", ["time.duration", "True", "valid number"]),
    "table as number": ("speed = 20.0", "speed = { value = 20.0 }", ["vehicle.speed", "valid number"]),
    "negative sigma": ("sigma = 2.0", "sigma = -2.0", ["sensors[0]", "sigma", "-2.0", "above 0"]),
    "negative sigma in degrees": ("sigma_deg = 12.0", "sigma_deg = -12.0", ["sensors[1]", "sigma_deg = -12.0", "above 0"]),
    "NaN sigma": ("sigma = 2.0", "sigma = nan", ["sensors[0].sigma", "nan", "finite"]),
    "infinite start": ("x = 0.0", "x = inf", ["start.x", "inf", "finite"]),
    "zero speed": ("speed = 20.0", "speed = 0.0", ["vehicle", "speed is 0.0", "above 0"]),
    "beacon on the start": ("beacon = [-1000.0, 1700.0]", "beacon = [0.0, 0.0]", ["sensors[2].beacon", "[0.0, 0.0]", "start"]),
    "beacon near the start": ("distance = 100.0", "distance = 2000.0", ["design.constraints[1]", "start"]),
    "horizon shorter than a segment": ("duration = 120.0", "duration = 3.0", ["time.duration", "3 s", "5 s"]),
    "segment no multiple of the step": ("segment = 5.0", "segment = 5.2", ["time.segment", "5.2 s", "1 s"]),
    "duration no multiple of the segment": ("duration = 120.0", "duration = 122.0", ["time.duration", "122 s", "5 s"]),
    "sensor period no multiple of the step": ("rate = 1.0 ", "rate = 3.0 ", ["sensors[0].rate", "3 Hz", "0.333333 s", "1 s"]),
    "too many per segment": ("per_segment = 1", "per_segment = 5", ["selection.per_segment", "is 5", "4"]),
    "pieces that do not fit": ("pieces = 24", "pieces = 7", ["design.path", "7", "120"]),
    "bounds upside down": ("[-0.25, 0.25]", "[0.25, -0.25]", ["design.bounds.turn_rate", "below"]),
    "prior of zero": ("heading = 0.1 ", "heading = 0.0 ", ["prior.heading", "0.0", "above 0"]),
    "negative noise": ("heading = 0.01", "heading = -0.01", ["process_noise.heading", "-0.01", "negative"]),
    "a key of the program": ("seed = 1", 'seed = 1\ndigest = "x"', ["digest", "unknown key"]),
    "syntax error": ("[vehicle]", "[vehicle", ["not valid TOML", "line 10", "column 9"]),
}


@pytest.mark.parametrize("case", BAD_INPUT)
def test_bad_input_is_one_message_that_names_key_value_and_remedy(case, tmp_path):
    old, new, expected = BAD_INPUT[case]
    text = AEROSONDE.read_text()
    assert old in text
    file = tmp_path / "scenario.toml"
    file.write_text(text.replace(old, new, 1))
    with pytest.raises(od.ScenarioError) as refused:
        od.load_scenario(file)
    for part in (str(file), *expected):
        assert part in str(refused.value)


def test_several_mistakes_are_told_at_once(tmp_path):
    file = tmp_path / "scenario.toml"
    file.write_text(AEROSONDE.read_text().replace("sigma = 2.0", "sigma = nan").replace("speed = 20.0", "sped = 20.0"))
    with pytest.raises(od.ScenarioError, match=r"3 problems(.|\n)*vehicle.speed(.|\n)*vehicle.sped(.|\n)*sensors\[0\].sigma"):
        od.load_scenario(file)


def test_unreadable_files_are_named(tmp_path):
    with pytest.raises(od.ScenarioError, match=r"nowhere\.toml: cannot be read"):
        od.load_scenario(tmp_path / "nowhere.toml")
    with pytest.raises(od.ScenarioError, match="cannot be read"):
        od.load_scenario(tmp_path)
    (tmp_path / "latin.toml").write_bytes(b"title = \xff")
    with pytest.raises(od.ScenarioError, match="not UTF-8"):
        od.load_scenario(tmp_path / "latin.toml")


def test_a_scenario_is_what_its_file_says():
    scenario = od.load_scenario(AEROSONDE)
    assert scenario.vehicle == od.Dubins(speed=20.0, wind="constant")
    beacon = (-1000.0, 1700.0)
    assert scenario.sensors == (
        od.GPS(2.0, rate=1.0),
        od.Magnetometer(math.radians(12), rate=1.0),
        od.Range(beacon, 1.0, rate=1.0),
        od.Bearing(beacon, math.radians(5), rate=1.0),
    )
    assert scenario.start["heading"] == pytest.approx(math.pi / 6)
    assert (scenario.steps, scenario.segments) == (120, 24)
    assert scenario.design.bounds == {"turn_rate": (-0.25, 0.25)}
    assert scenario.design.constraints == (od.Goal((1400.0, 800.0), 100.0), od.StandOff(100.0))


def test_loading_a_scenario_loads_no_heavy_library():
    heavy = "{'casadi', 'cvxpy', 'scipy', 'matplotlib', 'numpy', 'flint'}"
    code = f"import sys, obsdesign as od; od.load_scenario({str(AEROSONDE)!r}); sys.exit(', '.join({heavy} & set(sys.modules)) or 0)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def test_two_sensors_of_one_kind_get_names_of_their_own():
    system = od.System(od.Dubins(20.0), (od.Range((1.0, 2.0), 1.0), od.Range((3.0, 4.0), 1.0), od.GPS(1.0)))
    assert system.sensor_names == ("range", "range_2", "gps")
    assert system.model.sensor_names == system.sensor_names
    assert [signal.name for signal in system.model.outputs] == ["range", "range_2", "gps_x", "gps_y"]
