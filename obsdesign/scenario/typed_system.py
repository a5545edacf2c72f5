"""A system as text by itself: the table [system] without the rest of a scenario."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from pydantic import ValidationError

from obsdesign.arguments import validate_arguments
from obsdesign.errors import InputError
from obsdesign.scenario.degrees import non_angular_spreads, scenario_in_radians
from obsdesign.scenario.formula_problems import SYSTEM
from obsdesign.scenario.problem_text import Problem, describe_error, in_file, of_a_part, of_another_type
from obsdesign.scenario.system_problems import find_system_problems
from obsdesign.scenario.system_tables import OutputTable, SystemTable

if TYPE_CHECKING:
    from obsdesign.dynamics.text_system import TextSystem


@validate_arguments
def system_from_text(table: Mapping[str, Any]) -> TextSystem:
    """Return the system that a table of formulas is: xdot = rates, or next_state a period later, y = outputs.

    Arguments:
        table: keys and values of the table [system] of a scenario: states, constants, inputs and unknown with their units, parameters,
            landmarks, definitions, rates or next_state with a period, outputs with their noise, angles, units, time.
    Raises InputError that tells of all keys, names, formulas and units that are wrong.
    """
    from obsdesign.dynamics.text_system import TextSystem

    data = {SYSTEM: dict(table)}
    try:
        read = SystemTable.model_validate_json(json.dumps(scenario_in_radians(data)[SYSTEM], default=str))
        problems = list(find_system_problems(read))
    except ValidationError as error:
        details = [{**detail, "loc": (SYSTEM, *detail["loc"])} for detail in error.errors()]
        told = [detail for detail in details if not (of_another_type(detail, data) or of_a_part(detail, data))]
        raise _refusal([describe_error(detail, data, _keys_at) for detail in told]) from None
    if problems:
        raise _refusal([replace(problem, location=in_file(problem.location, data)) for problem in problems])
    system = TextSystem(read.system_text)
    no_angles = [Problem(location, "is given in degrees: is no angle") for location in non_angular_spreads(table["outputs"], system.text)]
    if no_angles:
        raise _refusal(no_angles)
    return system


def _refusal(problems: list[Problem]) -> InputError:
    return InputError("\n".join(map(str, problems)))


def _keys_at(location: tuple[str | int, ...]) -> tuple[str, ...]:
    """Keys that the table at a location accepts."""
    return tuple((SystemTable if len(location) == 1 else OutputTable).model_fields)
