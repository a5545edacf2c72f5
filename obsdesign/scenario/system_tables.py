"""The table [system] of a scenario: a system as text, in place of [vehicle] and [[sensors]]."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any

from pydantic import BeforeValidator, Field, GetJsonSchemaHandler
from pydantic_core import CoreSchema

from obsdesign.scenario.kind_tables import in_degrees_too
from obsdesign.scenario.tables import ScenarioTable

if TYPE_CHECKING:
    from obsdesign.dynamics.system_text import SystemText, TextOutput

_Json = dict[str, Any]
_TEXT: _Json = {"type": "string"}
_NUMBER: _Json = {"type": "number"}


@dataclass(frozen=True)
class _Also:
    """Makes a JSON Schema accept other forms of a value as well."""

    forms: tuple[_Json, ...]

    def __get_pydantic_json_schema__(self, core: CoreSchema, handler: GetJsonSchemaHandler) -> _Json:
        return {"anyOf": [*self.forms, handler(core)]}

    def __hash__(self) -> int:
        return id(self)


def _as_text(value: Any) -> Any:  # noqa: ANN401  # whatever TOML can hold
    """A number as the formula that it is."""
    return repr(value) if isinstance(value, (int, float)) and not isinstance(value, bool) else value


def _as_units(value: Any) -> Any:  # noqa: ANN401
    """A list of names as a table of names without units."""
    if not (isinstance(value, list) and all(isinstance(name, str) for name in value)):
        return value
    twice = [name for i, name in enumerate(value) if name in value[:i]]
    if twice:
        raise ValueError(f"names {twice[0]!r} twice")
    return dict.fromkeys(value, "")


def _as_parameter(value: Any) -> Any:  # noqa: ANN401
    """A number, or a text such as "15 m/s", as a table."""
    if isinstance(value, (int, float)) and not isinstance(value, bool):
        return {"value": value}
    if not isinstance(value, str):
        return value
    number, _, unit = value.strip().partition(" ")
    try:
        return {"value": float(number), "unit": unit.strip()}
    except ValueError:
        raise ValueError(f'is {value!r}: must be a number and its unit, such as "15.5 m/s"') from None


def _as_landmark(value: Any) -> Any:  # noqa: ANN401
    """A point as a table."""
    return _with_tuples({"at": value} if isinstance(value, list) else value)


def _as_output(value: Any) -> Any:  # noqa: ANN401
    """A formula, or several, as a table; of a table one formula as several."""
    is_formula = isinstance(value, (str, int, float, list)) and not isinstance(value, bool)
    table = {"of": value} if is_formula else value
    if isinstance(table, dict) and isinstance(table.get("of"), (str, int, float)):
        table = {**table, "of": [table["of"]]}
    return _with_tuples(table)


def _with_tuples(table: Any) -> Any:  # noqa: ANN401
    """A table whose lists are tuples: strict validation of what was made here takes no others."""
    if not isinstance(table, dict):
        return table
    return {key: tuple(item) if isinstance(item, list) else item for key, item in table.items()}


Formula = Annotated[str, BeforeValidator(_as_text), _Also((_NUMBER,))]
Units = Annotated[dict[str, str], BeforeValidator(_as_units), _Also(({"type": "array", "items": _TEXT},))]


class ParameterTable(ScenarioTable):
    """A number with a name."""

    value: float = Field(description="in its unit")
    unit: str = Field(default="", description='its unit, "" = not known: then it fits everywhere')


class LandmarkTable(ScenarioTable):
    """A point with a name, whose entries formulas contain as name.x, name.y, name.z."""

    at: tuple[float, ...] = Field(min_length=2, max_length=3, description="x, y, and perhaps z, in its unit")
    unit: str = Field(default="m", description="its unit; default: m")


class OutputTable(ScenarioTable):
    """What one sensor measures, and how well."""

    of: Annotated[tuple[Formula, ...], _Also((_TEXT, _NUMBER))] = Field(
        min_length=1, description="the formula, or several that are measured together"
    )
    unit: str = Field(default="", description="unit of what is measured; default: that of the formula")
    sigma: Annotated[float, Field(gt=0)] | Annotated[str, Field(min_length=1)] | tuple[Annotated[float, Field(gt=0)], ...] = Field(
        default=1.0, description="standard deviation of one sample, in the unit; or a formula, or one number for each of several"
    )
    rate: float | None = Field(default=None, gt=0, description="samples per second [Hz]; default: one every step")
    inflation: float = Field(default=1.0, gt=0, description="what filters multiply sigma by, for what the model leaves out")
    bias_floor: float = Field(default=0.0, ge=0, description="standard deviation of a constant error, in the unit")
    correlation: float = Field(default=0.0, ge=0, lt=1, description="correlation of the noise of successive samples")
    detection: float = Field(default=1.0, gt=0, le=1, description="share of the samples that arrive")


class SystemTable(ScenarioTable):
    """A system as text: xdot = rates, y = outputs, as formulas of states, inputs, parameters and landmarks."""

    states: Units = Field(min_length=1, description="name of each state, and its unit; or a list of names")
    constants: Units = Field(default={}, description="states that do not change, such as parameters that nobody knows")
    inputs: Units = Field(default={}, description="inputs that are known: steering, or measured")
    unknown: Units = Field(default={}, description="inputs that nobody knows: disturbances")
    parameters: dict[str, Annotated[ParameterTable, BeforeValidator(_as_parameter), _Also((_NUMBER, _TEXT))]] = Field(
        default={}, description='numbers with names: a number, "15 m/s", or { value, unit }'
    )
    landmarks: dict[
        str,
        Annotated[
            LandmarkTable, BeforeValidator(_as_landmark), _Also(({"type": "array", "items": _NUMBER, "minItems": 2, "maxItems": 3},))
        ],
    ] = Field(default={}, description="points with names: [x, y] or [x, y, z] in m, or { at, unit }")
    definitions: dict[str, Formula] = Field(default={}, description="formulas with names, which others contain")
    rates: dict[str, Formula] = Field(default={}, description="how fast each state changes, a formula in its unit per `time`")
    next_state: dict[str, Formula] = Field(default={}, description="in place of rates: each state a `period` later, a formula in its unit")
    period: float | None = Field(default=None, gt=0, description="length of a step of next_state, in `time`")
    outputs: dict[
        str,
        Annotated[
            OutputTable,
            *in_degrees_too("sigma", "bias_floor"),
            BeforeValidator(_as_output),
            _Also((_TEXT, {"type": "array", "items": _TEXT})),
        ],
    ] = Field(min_length=1, description="what is measured: a formula, several, or { of, unit, sigma, rate, ... }")
    angles: tuple[str, ...] | None = Field(default=None, description="states and outputs that wrap to (-pi, pi]; default: those in rad")
    units: dict[str, str] = Field(default={}, description='units that are not known: what they are, "0.5 m"; "" = a thing that is counted')
    time: str = Field(default="s", description="the unit of time of the rates, or of the period")

    @property
    def system_text(self) -> SystemText:
        """The system as text."""
        from obsdesign.dynamics.system_text import SystemText, TextLandmark, TextParameter, TextQuantity

        quantities = {key: tuple(TextQuantity(name, unit) for name, unit in getattr(self, key).items()) for key in _QUANTITIES}
        return SystemText(
            states=(*quantities["states"], *quantities["constants"]),
            rates=(*(self.motion.get(name, "0") for name in self.states), *(self._at_rest(name) for name in self.constants)),
            inputs=quantities["inputs"],
            unknown=quantities["unknown"],
            parameters=tuple(TextParameter(name, table.value, table.unit) for name, table in self.parameters.items()),
            landmarks=tuple(TextLandmark(name, table.at, table.unit) for name, table in self.landmarks.items()),
            definitions=tuple(self.definitions.items()),
            outputs=tuple(_output(name, table) for name, table in self.outputs.items()),
            angles=self.angles,
            user_units=tuple(self.units.items()),
            time=self.time,
            period=self.period,
        )

    @property
    def motion(self) -> dict[str, str]:
        """The formulas of what moves: rates, or next values."""
        return self.next_state or self.rates

    def _at_rest(self, name: str) -> str:
        """What moves a state that does not change."""
        return "0" if self.period is None else name


_QUANTITIES = ("states", "constants", "inputs", "unknown")


def _output(name: str, table: OutputTable) -> TextOutput:
    from obsdesign.dynamics.system_text import TextOutput

    return TextOutput(
        name, table.of, table.unit, table.sigma, table.rate, table.inflation, table.bias_floor, table.correlation, table.detection
    )
