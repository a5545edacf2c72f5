"""What a log gets wrong: units, clocks, sizes, codes for no answer. Each is named; and honest drives of any kind are not refused."""

from contextlib import nullcontext

import numpy as np
import pytest

import obsdesign as od
from obsdesign.scenario.loading import load_scenario_of_log
from obsdesign.study.log_setup import scenario_setup

PLACES = {"a": (60.0, 0.0), "b": (0.0, 50.0), "c": (-40.0, -30.0)}
SYSTEM = od.System(
    od.Unicycle(),
    (
        *(od.Range(place, 0.5, name=name) for name, place in PLACES.items()),
        od.Bearing((30.0, 30.0), 0.05, name="camera"),
        od.RangeBearing((30.0, 30.0), 0.5, bearing_sigma=0.05, name="lidar"),
    ),
)
SCENARIO = """
[vehicle]
kind = "unicycle"
[[sensors]]
kind = "range"
sigma = 0.5
[[sensors]]
kind = "bearing"
sigma = 0.05
name = "camera"
beacon = [30.0, 30.0]
[[sensors]]
kind = "range_bearing"
sigma = 0.5
bearing_sigma = 0.05
name = "lidar"
beacon = [30.0, 30.0]
[prior]
x = 1.0
y = 1.0
heading = 0.2
[replay]
"""


def drive(seed=0, seconds=60.0, turn=0.3):
    """Rows (t, signal, value) of a drive at 2 Hz by closed-form steps: a circle's arc of constant speed and turn rate for each."""
    random, dt, x, rows = np.random.default_rng(seed), 0.5, np.array([1.0, -2.0, random_heading(seed)]), []
    for k in range(int(seconds / dt)):
        speed, rate = 2.0 + np.sin(k / 9), turn * np.cos(k / 17) + 1e-6
        t = dt * k
        rows += [
            (t, "speed", speed),
            (t, "turn_rate", rate),
            *((t, f"truth.{n}", v) for n, v in zip(("x", "y", "heading"), x, strict=True)),
        ]
        name = ("a", "b", "c", "camera", "lidar")[random.integers(5)]
        off = np.subtract(PLACES.get(name, (30.0, 30.0)), x[:2])
        distance, bearing = np.hypot(*off) + 0.3 * random.standard_normal(), np.arctan2(off[1], off[0]) - x[2]
        bearing = (bearing + 0.04 * random.standard_normal() + np.pi) % (2 * np.pi) - np.pi
        if name == "lidar":
            rows += [(t, "lidar_distance", distance), (t, "lidar_angle", bearing)]
        else:
            rows.append((t, name, bearing if name == "camera" else distance))
        after = x[2] + rate * dt
        chord = speed / rate * np.array([np.sin(after) - np.sin(x[2]), np.cos(x[2]) - np.cos(after)])
        x = np.array([*(x[:2] + chord), after])
    return rows


def random_heading(seed):
    return float(np.random.default_rng(seed + 1000).uniform(-10.0, 10.0))


def table(rows, header="t,signal,value"):
    return "\n".join([header, *(f"{float(t)!r},{name},{float(value)!r}" for t, name, value in rows)]) + "\n"


def read(folder, text):
    (folder / "drive.csv").write_text(text)
    return od.read_log(folder / "drive.csv", SYSTEM)


def scaled(factor, *names):
    return lambda t, name, value: (t, name, value * factor if name in names else value)


DEGREE = 180 / np.pi
MEANT = {
    "true headings in degrees": (
        scaled(DEGREE, "truth.heading"),
        r"column 'truth.heading': its numbers go with the motion only if .*degrees",
    ),
    "one true position in mm": (scaled(1e3, "truth.y"), r"column 'truth.y': the way that the truth tells .* with 0\.001 times its numbers"),
    "one true position in km": (scaled(1e-3, "truth.x"), r"column 'truth.x': the way that the truth tells .* with 1000 times its numbers"),
    "all true positions in mm": (scaled(1e3, "truth.x", "truth.y"), r"column '(a|b|c|speed)': its numbers are .* times what the truth"),
    "times in milliseconds": (
        lambda t, *rest: (1e3 * t, *rest),
        r"speed and turn_rate over the log's time .* are its times in ms\? .* t \[ms\]",
    ),
    "times in microseconds": (lambda t, *rest: (1e6 * t, *rest), r"are its times in us\?"),
    "times in nanoseconds": (lambda t, *rest: (1e9 * t, *rest), r"are its times in ns\?"),
    "bearings in degrees": (scaled(DEGREE, "camera"), r"column 'camera': its numbers are 57\.3 times .* degrees"),
    "the lidar's bearings in degrees": (scaled(DEGREE, "lidar_angle"), r"column 'lidar_angle': its numbers are 57\.3 times .* degrees"),
    "the lidar's ranges in mm": (scaled(1e3, "lidar_distance"), r"column 'lidar_distance': its numbers are .* thousand"),
    "-9 for no answer": (
        lambda t, name, v: (t, name, -9.0 if name == "b" and t > 20 else v),
        r"column 'b': -9 at t = \d+(\.5)? s: what it measures is",
    ),
    "-9 for no echo": (lambda t, name, v: (t, name, -9.0 if name == "lidar_distance" and t > 20 else v), r"column 'lidar': -9 at t"),
    "a size out of this world": (
        lambda t, name, v: (t, name, 1e300 if name == "a" and t > 20 else v),
        r"line \d+, column 'a': a size of 1e\+300",
    ),
    "a speed out of this world": (
        lambda t, name, v: (t, name, -1e20 if name == "speed" and t == 20 else v),
        r"line \d+, column 'speed': a size of 1e\+20",
    ),
    "a turn that none makes": (
        lambda t, name, v: (t, name, -1e6 if name == "turn_rate" and t == 20 else v),
        r"column 'turn_rate': 1e\+06 at t = 20 s, where 90 % of its numbers are below 0\.[23]",
    ),
    "a clock that is set": (
        lambda t, *rest: (t + 1.7e9 if t > 30 else t, *rest),
        r"line \d+, column 'speed': t = 1\.7\S*e\+09 s is .* was the clock set",
    ),
    "one time out of this world": (
        lambda t, *rest: (1e15 if t == 30 else t, *rest),
        r"line \d+, column 'speed': t = 1e\+15 s is 1e\+15 s after",
    ),
}


@pytest.mark.parametrize("case", MEANT)
@pytest.mark.parametrize("seed", [0, 1])
def test_what_is_off_is_named_with_its_column(case, seed, tmp_path):
    change, message = MEANT[case]
    with pytest.raises(od.InputError, match=message):
        read(tmp_path, table([change(*row) for row in drive(seed)]))


@pytest.mark.parametrize("turn", [0.0, 0.02, 0.3, 2.0])
def test_honest_drives_are_not_refused(turn, tmp_path):
    """Straight, gentle, winding and spinning; headings that are unwrapped, wrapped, or in degrees that say so; long and short."""
    wrapped = lambda t, name, v: (t, name, (v + np.pi) % (2 * np.pi) - np.pi if name == "truth.heading" else v)  # noqa: E731
    degrees = lambda t, name, v: (t, f"{name} [deg]", v * DEGREE) if name == "truth.heading" else (t, name, v)  # noqa: E731
    for seed in range(6):
        rows = drive(seed, 30.0 + 20 * seed, turn)
        logs = [read(tmp_path, table([change(*row) for row in rows])) for change in (lambda *row: row, wrapped, degrees)]
        for log in logs:
            assert log.notes == ()
            off = (log.truth.x - logs[0].truth.x + np.pi) % (2 * np.pi) - np.pi
            assert np.abs(off).max() < 1e-9


def test_tables_may_be_parted_by_other_marks_and_begin_with_remarks(tmp_path):
    text = table(drive())
    log = read(tmp_path, text)
    for other in (text.replace(",", ";"), text.replace(",", "\t"), "# of Tuesday\n\n# second run\n" + text, "\ufeff" + text):
        (tmp_path / "other.csv").write_text(other, encoding="utf-8")
        found = od.read_log(tmp_path / "other.csv", SYSTEM)
        for part, names in (("inputs", "tu"), ("truth", "tx"), ("samples", ("t", "y", "sensor"))):
            for name in names:
                np.testing.assert_array_equal(getattr(getattr(found, part), name), getattr(getattr(log, part), name))
    with pytest.raises(od.InputError, match=r"line 4, column 'value': 'nan' is no finite"):
        read(tmp_path, "# remark\n\nt;signal;value\n0;a;nan\n")
    with pytest.raises(od.InputError, match=r"line 2, column 'value': '12,5' is no finite number: write it with a point"):
        read(tmp_path, "t;signal;value\n0;a;12,5\n")
    with pytest.raises(
        od.InputError, match=r"line 1: has a column 'signal' and no column 'value' beside it \(columns are t, signal, reading\)"
    ):
        read(tmp_path, "t,signal,reading\n0,a,12\n")


@pytest.mark.parametrize("sigma", ["1e-300", "1e+300"])
def test_no_sample_is_as_exact_as_that(sigma, tmp_path):
    with pytest.raises(
        od.InputError, match=rf"line 4, column 'a': a size of {sigma.replace('+', '.')} at t = 1 s: must be between 1e-12 and 1e\+12"
    ):
        read(tmp_path, f"t,signal,value,sigma\n0,speed,1,\n0,turn_rate,0,\n1,a,5,{sigma}\n2,a,5,\n")


def test_pauses_and_sensors_that_are_stuck_are_told(tmp_path):
    rows = [(t if t < 30 else t + 3600, name, 7.0 if name == "c" else value) for t, name, value in drive()]
    log = read(tmp_path, table([row for row in rows if not row[1].startswith("truth")]))
    count = log.samples.counts["c"]
    assert log.notes == (
        "nothing came from t = 29.5 to 3630 s: inputs that are held go on over that time", f"c: all {count} samples are 7: is it stuck?",
    )  # fmt: skip


def setup(folder, rows):
    (folder / "drive.csv").write_text(table(rows))
    (folder / "my.toml").write_text(SCENARIO)
    return scenario_setup(folder / "drive.csv", load_scenario_of_log(folder / "my.toml", PLACES), None)


def test_a_log_begins_where_the_truth_is_then(tmp_path):
    """A truth that began earlier is taken where the log begins; of states that it tells only later, or only after the log, nothing is."""
    rows = drive()
    whole = setup(tmp_path, rows)
    later = setup(tmp_path, [row for row in rows if row[1].startswith("truth") or row[0] >= 20.0])
    truth = {name: value for t, name, value in rows if t == 20.0}
    assert later.log.samples.t[0] >= 20.0 and later.notes == ()
    assert later.prior.mean == pytest.approx([truth[f"truth.{name}"] for name in ("x", "y", "heading")], rel=1e-12)
    no_heading = setup(tmp_path, [row for row in rows if row[1] != "truth.heading" or row[0] > 20.0])
    assert no_heading.prior.mean == pytest.approx([*whole.prior.mean[:2], 0.0])
    assert no_heading.notes == ("heading begins at 0, as uncertain as the prior says: neither [start] nor the truth tells it",)
    after = setup(tmp_path, [(row[0] + 1000, *row[1:]) if row[1].startswith("truth") else row for row in rows])
    with pytest.raises(od.InputError, match="start: missing key 'x': the log holds no truth of it there"):
        after.prior  # noqa: B018


def test_the_distance_between_robots_is_not_below_zero(tmp_path):
    system = od.System(od.TwoRobots("known"), (od.PeerRange(sigma=0.1),))
    inputs = [signal.name for signal in system.model.inputs]
    for value, is_refused in ((3.0, False), (-0.2, False), (-3.0, True)):  # -0.2: noise
        rows = [",".join(map(str, (t, *(0.1 for _ in inputs), value))) for t in range(4)]
        (tmp_path / "pair.csv").write_text("\n".join([",".join(("t", *inputs, "peer_range")), *rows]))
        with (
            pytest.raises(od.InputError, match="'peer_range': -3 at t = 0 s: what it measures is not below 0")
            if is_refused
            else nullcontext()
        ):
            od.read_log(tmp_path / "pair.csv", system)
