"""`obsdesign import`: a model of another tool as a scenario."""

from __future__ import annotations

from argparse import Namespace
from pathlib import Path

from obsdesign.cli.verb import QUIET, Argument, Outcome, Verb
from obsdesign.errors import InputError, ScenarioError


def import_model(options: Namespace) -> Outcome:
    """Write a scenario whose system is the model of a file, and say what of it was changed."""
    from obsdesign.files import write_files
    from obsdesign.model_import.reading import read_model
    from obsdesign.scenario.loading import scenario_from_text

    source: Path = options.file
    model = read_model(source, options.outputs, options.estimate)
    target: Path = options.out or Path(f"{source.stem}.toml")
    if target.exists():
        raise InputError(f"{target} is there already: it is left as it is; choose another name with --out")
    text = model.scenario(source.name)
    try:
        scenario = scenario_from_text(text, str(target))
    except ScenarioError as error:
        raise InputError(f"{source}: holds what a system as text cannot say: {error}") from None
    write_files(target.parent, {target.name: text})
    names = {"states": model.states, "constants": model.constants, "inputs": model.inputs, "outputs": scenario.sensor_names}
    counts = ", ".join(f"{len(group)} {what}" for what, group in names.items())
    shown = (f"Written: {target} ({model.title}: {counts})", *model.notes, f"  obsdesign analyse {target}   says what can be seen of it")
    return Outcome({"scenario": str(target), "title": model.title, **names, "notes": model.notes}, shown)


def _words(text: str) -> tuple[str, ...]:
    return tuple(filter(None, (word.strip() for word in text.split(","))))


VERB = Verb(
    name="import",
    what="write a scenario of a model in another tool's file: SBML, or the equations of StructuralIdentifiability.jl",
    action=import_model,
    example="import model.xml --outputs A,B --estimate k1,k2",
    arguments=(
        Argument("file", "SBML (.xml, .sbml), or @ODEmodel(...) in a text (.jl, .txt, .ode)", read=Path, completes="files"),
        Argument("--outputs", "what is measured, of SBML, which does not say (default: every state)", _words, (), variable="NAMES"),
        Argument("--estimate", "parameters of SBML that nobody knows: states that do not change", _words, (), variable="NAMES"),
        Argument("--out", "file to write (default: NAME.toml in this folder)", read=Path, completes="files", variable="FILE"),
        QUIET,
    ),
)
