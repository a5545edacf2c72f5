"""`obsdesign init`: a scenario to start from."""

from __future__ import annotations

from argparse import Namespace
from pathlib import Path

from obsdesign.cli.verb import QUIET, Argument, Outcome, Verb
from obsdesign.errors import InputError


def init(options: Namespace) -> Outcome:
    """Write a scenario that runs, with comments, and the schema that editors complete from; or list the templates."""
    import json

    from obsdesign.files import write_files
    from obsdesign.scenario.schema import Scenario
    from obsdesign.scenario.starters import SCHEMA_FILE, starter_of, starters, text_to_edit

    if options.list:
        rows = {starter.name: {"title": starter.title, "question": starter.question} for starter in starters()}
        return Outcome({"templates": rows}, tuple(f"{name}: {row['title']}\n{_indent(row['question'])}" for name, row in rows.items()))
    if options.system and options.template not in (_DEFAULT, _AS_TEXT):
        raise InputError(f"--system writes {_AS_TEXT}: it does not go with the template {options.template!r}")
    starter = starter_of(_AS_TEXT if options.system else options.template)
    file = Path(f"{starter.name}.toml")
    if file.exists():
        raise InputError(f"{file} is there already: it is left as it is; rename it, or choose another template (obsdesign init --list)")
    schema = json.dumps(Scenario.model_json_schema(), indent=1) + "\n"
    write_files(Path(), {file.name: text_to_edit(starter), SCHEMA_FILE: schema})
    shown = (
        f"Written: {file} ({starter.title}), and {SCHEMA_FILE}, from which editors complete it.",
        f"  obsdesign run      answers its questions: open reports/{file.stem}/report.html",
        f"  obsdesign analyse  says only what its sensors can see, in seconds: open reports/{file.stem}/analysis.html",
        "  obsdesign check    says what is wrong with it when you have changed it",
    )
    return Outcome({"scenario": str(file), "schema": SCHEMA_FILE, "template": starter.name}, shown)


def _indent(text: str) -> str:
    import textwrap

    return textwrap.fill(text, 96, initial_indent="    ", subsequent_indent="    ")


_DEFAULT, _AS_TEXT = "aerosonde_wind", "rover_as_text"
VERB = Verb(
    name="init",
    what="write a scenario to start from, with comments, into this folder",
    action=init,
    example="init",
    arguments=(
        Argument("template", "which one (default: %(default)s); --list shows all", default=_DEFAULT, may_miss=True),
        Argument("--system", "one whose vehicle and sensors are formulas in it, to be replaced by your own", is_flag=True),
        Argument("--list", "list the templates and write nothing", is_flag=True),
        QUIET,
    ),
)
