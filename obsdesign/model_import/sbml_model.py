"""SBML: species, parameters and compartments that reactions and rules move."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from typing import Any

from obsdesign.display import MissingPackageError
from obsdesign.errors import InputError
from obsdesign.formulas.tree import AbstractTree, Name, Number, Product, Sum, names_of
from obsdesign.formulas.writing import write_formula
from obsdesign.model_import.imported_model import ImportedModel, usable_names
from obsdesign.model_import.sbml_formula import TIME, tree_of

_CONVERSIONS = ("expandFunctionDefinitions", "promoteLocalParameters")


def read_sbml(text: str, file: str, outputs: Sequence[str], estimate: Sequence[str]) -> ImportedModel:
    """Return the model of a text in SBML: its species as concentrations, or amounts where the file says so; see `read_model`.

    Raises MissingPackageError where python-libsbml is not installed, and InputError for a text that is no SBML, or that has events, delays,
    algebraic rules, cases, or compartments that change.
    """
    try:
        model = _SbmlModel(_document(text, file))
        return model.as_import(file, outputs, estimate)
    except InputError as error:
        raise InputError(f"{file}: {str(error).removeprefix(f'{file}: ')}") from None


def _document(text: str, file: str) -> Any:  # noqa: ANN401  # of a package that is optional
    try:
        import libsbml
    except ImportError:
        raise MissingPackageError("SBML needs python-libsbml, which is not installed: pip install 'obsdesign[sbml]'") from None
    if "<!DOCTYPE" in text or "<!ENTITY" in text:
        raise InputError("has a document type of its own, as no SBML has: it is not read")
    document = libsbml.readSBMLFromString(text)
    if document.getModel() is None or document.getNumErrors(libsbml.LIBSBML_SEV_FATAL):
        reason = document.getError(0).getShortMessage() if document.getNumErrors() else "there is no model in it"
        raise InputError(f"is no SBML that can be read: {reason}")
    for conversion in _CONVERSIONS:
        properties = libsbml.ConversionProperties()
        properties.addOption(conversion, True)
        document.convert(properties)
    return document


@dataclass(frozen=True)
class _SbmlModel:
    """A document of libsbml, which owns its model, and what the model says."""

    document: Any

    @property
    def _model(self) -> Any:  # noqa: ANN401
        return self.document.getModel()

    def as_import(self, file: str, outputs: Sequence[str], estimate: Sequence[str]) -> ImportedModel:
        """Return the model with these outputs, () = every state, and with the parameters that are to be estimated."""
        self._refuse()
        rates, definitions = self._rates, self._definitions
        unknown = [name for name, value in self._numbers.items() if not math.isfinite(value)]
        estimated = [self._choice(name, self._numbers, "--estimate") for name in estimate]
        constants = dict.fromkeys((*estimated, *unknown))
        chosen = [self._choice(name, (*rates, *definitions), "--outputs") for name in outputs]
        measured = chosen or [name for name in rates if name != self._time]
        renamed = (f"{name} is called {new}: formulas know another {name}." for name, new in self._names.items() if name != new)
        notes = (f"{name} has no value: it is taken for one that nobody knows." for name in unknown)
        clock = [f"{self._time} is time, a state whose rate is 1: it is known, so name it in known_at_start."] * (self._time in rates)
        values = {**self._numbers, **self._start}
        start = {name: values[name] for name in (*rates, *constants) if math.isfinite(values.get(name, math.nan))}
        return ImportedModel(
            title=self._model.getName() or self._model.getId() or f"The model of {file}",
            states=tuple(rates),
            rates={name: write_formula(tree) for name, tree in rates.items()},
            outputs={name: name for name in measured},
            constants=tuple(constants),
            parameters={name: value for name, value in self._numbers.items() if name not in constants},
            definitions={name: write_formula(tree) for name, tree in definitions.items()},
            start=start,
            notes=(*renamed, *notes, *clock),
        )

    def _refuse(self) -> None:
        model = self._model
        if count := model.getNumEvents():
            raise InputError(f"has {count} events, which formulas do not have")
        for rule in model.getListOfRules():
            if rule.isAlgebraic():
                raise InputError("has an algebraic rule, which formulas do not have")
            if model.getCompartment(rule.getVariable()) is not None:
                raise InputError(f"the compartment {rule.getVariable()} changes its size: must be constant")
            if not (model.getSpecies(rule.getVariable()) or model.getParameter(rule.getVariable())):
                raise InputError(f"has a rule for {rule.getVariable()}, which is no species and no parameter")
        if model.isSetConversionFactor() or any(species.isSetConversionFactor() for species in model.getListOfSpecies()):
            raise InputError("has conversion factors, which are not read")

    def _choice(self, name: str, accepted: Sequence[str] | dict[str, float], option: str) -> str:
        """What a name is called, that somebody chose."""
        if self._names.get(name, name) not in accepted:
            raise InputError(f"{option}: there is no {name!r} (accepted: {', '.join(accepted) or 'none'})")
        return self._names.get(name, name)

    @cached_property
    def _names(self) -> dict[str, str]:
        """What identifiers are called in formulas, time among them."""
        model = self._model
        groups = (model.getListOfSpecies(), model.getListOfParameters(), model.getListOfCompartments(), model.getListOfReactions())
        identifiers = [item.getId() for group in groups for item in group]
        time = TIME
        while time in identifiers:
            time += "_"
        return {**usable_names(identifiers), TIME: time}

    @property
    def _time(self) -> str:
        return self._names[TIME]

    def _tree(self, node: Any, what: str) -> AbstractTree:  # noqa: ANN401
        if node is None:
            raise InputError(f"{what} has no formula")
        try:
            return tree_of(node, self._names)
        except InputError as error:
            raise InputError(f"{what} {error}") from None

    @cached_property
    def _rules(self) -> dict[str, tuple[bool, AbstractTree]]:
        """What rules are for -> whether they say its rate, and their formula."""
        rules = {rule.getVariable(): rule for rule in self._model.getListOfRules()}
        return {self._names[name]: (rule.isRate(), self._tree(rule.getMath(), f"the rule of {name}")) for name, rule in rules.items()}

    @cached_property
    def _definitions(self) -> dict[str, AbstractTree]:
        """Assignment rules, values that follow from others, and the speed of each reaction, by name."""
        definitions = {name: tree for name, (is_rate, tree) in self._rules.items() if not is_rate}
        for assignment in self._model.getListOfInitialAssignments():
            name = self._names.get(str(assignment.getSymbol()), "")
            if self._model.getParameter(assignment.getSymbol()) is not None and name not in self._rules:
                definitions[name] = self._tree(assignment.getMath(), f"the value of {name}")
        for reaction in self._model.getListOfReactions():
            law = reaction.getKineticLaw()
            what = f"the reaction {reaction.getId()}"
            definitions[self._names[reaction.getId()]] = self._tree(None if law is None else law.getMath(), what)
        return definitions

    @cached_property
    def _rates(self) -> dict[str, AbstractTree]:
        """How fast each state changes."""
        rates = {name: tree for name, (is_rate, tree) in self._rules.items() if is_rate}
        for species in self._model.getListOfSpecies():
            name = self._names[species.getId()]
            if name not in self._rules and not species.getBoundaryCondition() and not species.getConstant():
                terms = list(self._terms_of(species.getId()))
                if terms:
                    signs, speeds = zip(*terms, strict=True)
                    is_plain = len(terms) == 1 and not signs[0]
                    rates[name] = self._per_volume(species, speeds[0] if is_plain else Sum(speeds, signs))
        if not rates:
            raise InputError("has nothing that changes: no reactions between species, and no rate rules")
        used = {name for tree in (*rates.values(), *self._definitions.values()) for name in names_of(tree)}
        return {**rates, self._time: Number(Fraction(1))} if self._time in used else rates

    def _terms_of(self, species: str) -> Iterator[tuple[bool, AbstractTree]]:
        """What reactions do to a species: whether it is used up, and how much of it per time."""
        for reaction in self._model.getListOfReactions():
            for group, is_used in ((reaction.getListOfReactants(), True), (reaction.getListOfProducts(), False)):
                for reference in group:
                    if reference.getSpecies() == species:
                        yield is_used, self._times_stoichiometry(reference, Name(self._names[reaction.getId()]))

    def _times_stoichiometry(self, reference: Any, speed: AbstractTree) -> AbstractTree:  # noqa: ANN401
        if reference.isSetStoichiometryMath():
            raise InputError(f"the stoichiometry of {reference.getSpecies()} is a formula: must be a number")
        number = reference.getStoichiometry() if reference.isSetStoichiometry() else 1.0
        if not (math.isfinite(number) and number >= 0):
            raise InputError(f"the stoichiometry of {reference.getSpecies()} is {number}: must be a number of at least 0")
        return speed if number == 1 else Product((Number(Fraction(repr(number))), speed), (False, False))

    def _per_volume(self, species: Any, change: AbstractTree) -> AbstractTree:  # noqa: ANN401
        """A change of amount as one of what stands for the species in formulas: its concentration, unless the file says otherwise."""
        compartment = self._model.getCompartment(species.getCompartment())
        if species.getHasOnlySubstanceUnits() or compartment is None or compartment.getSpatialDimensions() == 0:
            return change
        return Product((change, Name(self._names[species.getCompartment()])), (False, True))

    @cached_property
    def _numbers(self) -> dict[str, float]:
        """What does not change: parameters, sizes of compartments, species that nothing moves; NaN of those without a value."""
        model = self._model
        moving = {*self._rates, *self._definitions}
        numbers = {self._names[item.getId()]: item.getSize() if item.isSetSize() else 1.0 for item in model.getListOfCompartments()}
        numbers |= {self._names[item.getId()]: item.getValue() if item.isSetValue() else math.nan for item in model.getListOfParameters()}
        numbers |= {self._names[item.getId()]: self._initial(item) for item in model.getListOfSpecies()}
        used = {name for tree in (*self._rates.values(), *self._definitions.values()) for name in names_of(tree)}
        return {name: value for name, value in numbers.items() if name in used and name not in moving}

    @property
    def _start(self) -> dict[str, float]:
        """Initial values of species and parameters that change."""
        start = {self._names[item.getId()]: self._initial(item) for item in self._model.getListOfSpecies()}
        start |= {self._names[item.getId()]: item.getValue() for item in self._model.getListOfParameters() if item.isSetValue()}
        return {**start, self._time: 0.0}

    def _initial(self, species: Any) -> float:  # noqa: ANN401
        """The initial value of what stands for a species; NaN where there is none."""
        compartment = self._model.getCompartment(species.getCompartment())
        size = compartment.getSize() if compartment is not None and compartment.isSetSize() else 1.0
        is_amount = species.getHasOnlySubstanceUnits() or compartment is None or compartment.getSpatialDimensions() == 0
        if species.isSetInitialAmount():
            return species.getInitialAmount() if is_amount else species.getInitialAmount() / size if size else math.nan
        if species.isSetInitialConcentration():
            return species.getInitialConcentration() * (size if is_amount else 1.0)
        return math.nan
