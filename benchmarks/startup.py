"""How long the command line takes to start: CPU seconds beside those of programs that import pydantic."""

from __future__ import annotations

import os
import resource
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from itertools import pairwise
from pathlib import Path

from benchmarks.tables import machine, table, write

_ROOT = Path(__file__).parent.parent
_SCENARIO = _ROOT / "scenarios" / "aerosonde_wind.toml"
_TIMES = 10
_PARSER = """
from obsdesign.cli.parser import build_parser
from obsdesign.cli.table import VERBS
build_parser(VERBS).parse_args(["check"])
"""
_MODEL = """
import os
os.environ["PYDANTIC_DISABLE_PLUGINS"] = "__all__"
import pydantic
class Model(pydantic.BaseModel):
    number: int
Model(number=1)
"""
_LOADING = "\nimport obsdesign.scenario.loading\n"
_NUMPY = "\nimport numpy\n"


def main() -> None:
    """Write startup.md."""
    with tempfile.TemporaryDirectory() as folder:
        # byte code is written once, as installing a package does
        environment = {**os.environ, "PYTHONPYCACHEPREFIX": folder, "PYTHONPATH": str(_ROOT)}
        environment.pop("PYTHONDONTWRITEBYTECODE", None)
        seconds = _measure(
            {
                "python": ("-c", "pass"),
                "pydantic": ("-c", "import pydantic"),
                "model": ("-c", _MODEL),
                "numpy": ("-c", _NUMPY),
                "import": ("-c", "import obsdesign"),
                "help": ("-m", "obsdesign", "--help"),
                "parser": ("-c", _PARSER),
                "parser, model": ("-c", _PARSER + _MODEL),
                "parser, model, loading": ("-c", _PARSER + _MODEL + _LOADING),
                "check": ("-m", "obsdesign", "check", str(_SCENARIO)),
            },
            environment,
        )
    write("startup", _text(seconds))


def _measure(programs: Mapping[str, Sequence[str]], environment: Mapping[str, str]) -> dict[str, float]:
    """Return the least CPU time of each program in turns, so that a busy machine is busy for all of them."""
    seconds = dict.fromkeys(programs, float("inf"))
    for _ in range(_TIMES + 1):
        for name, words in programs.items():
            seconds[name] = min(seconds[name], _cpu_seconds(words, environment))
    return seconds


def _cpu_seconds(words: Sequence[str], environment: Mapping[str, str]) -> float:
    """Return user and system time of one process [s]."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run([sys.executable, *words], env=dict(environment), stdout=subprocess.DEVNULL, check=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def _text(seconds: Mapping[str, float]) -> str:
    programs = {
        '`python -c "pass"`': "python",
        '`python -c "import pydantic"`': "pydantic",
        "a program that defines one pydantic model": "model",
        '`python -c "import obsdesign"`': "import",
        "`obsdesign --help`": "help",
        "`obsdesign check` of `aerosonde_wind`": "check",
    }
    pydantic, model = seconds["pydantic"], seconds["model"]
    rows = [(shown, seconds[name], seconds[name] / pydantic, seconds[name] / model) for shown, name in programs.items()]
    stages = ("python", "parser", "parser, model", "parser, model, loading", "check")
    named = (
        "Python itself",
        "the verbs and their parser",
        "pydantic, with its first model",
        "the tables of a scenario",
        "the kinds that it names, their tables, reading and judging it",
    )
    steps = [seconds[stages[0]], *(seconds[after] - seconds[before] for before, after in pairwise(stages))]
    return f"""# Start of the command line

CPU seconds (user and system), the least of {_TIMES}, byte code at hand as after an installation.

{table(("program", "CPU [s]", "/ import pydantic", "/ one pydantic model"), rows)}

`import pydantic` loads nothing of what defines a model: that comes with the first attribute that is asked for, so that a program with
one model takes {model / pydantic:.1f} times as long, and 1.6 times is out of reach for whatever has models. Beside a program with one model
`check` takes {seconds["check"] / model:.2f} times as long. Where its time goes:

{table(("stage of `check`", "CPU [s]"), list(zip(named, steps, strict=True)))}

Of vehicles, sensors, paths, constraints, costs and rules only the kinds that the scenario names are loaded. NumPy, which would add
{seconds["numpy"] - seconds["python"]:.2g} s, is loaded for rules of schedules alone.

{machine()}
"""


if __name__ == "__main__":
    main()
