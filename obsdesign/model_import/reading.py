"""Reading the file of a model, by its ending."""

from __future__ import annotations

from pathlib import Path

from obsdesign.errors import InputError
from obsdesign.model_import.imported_model import ImportedModel
from obsdesign.model_import.ode_model_text import read_ode_model
from obsdesign.model_import.sbml_model import read_sbml

_SBML, _EQUATIONS = (".xml", ".sbml"), (".jl", ".txt", ".ode")


def read_model(file: Path, outputs: tuple[str, ...] = (), estimate: tuple[str, ...] = ()) -> ImportedModel:
    """Return the model of a file: SBML (.xml, .sbml), or the equations of StructuralIdentifiability.jl (.jl, .txt, .ode).

    outputs: of SBML, which has none, what is measured; () = every state. estimate: of SBML the parameters that nobody knows.
    Raises InputError for a file that cannot be read, that holds no such model, or that says what formulas cannot.
    """
    ending = file.suffix.lower()
    if ending not in (*_SBML, *_EQUATIONS):
        raise InputError(f"{file}: ends in {ending or 'nothing'}: must be SBML ({', '.join(_SBML)}) or equations ({', '.join(_EQUATIONS)})")
    if ending in _EQUATIONS and (outputs or estimate):
        raise InputError(f"{file}: says itself what is measured and what is not known: --outputs and --estimate are for SBML")
    try:
        text = file.read_bytes().decode()
    except OSError as error:
        raise InputError(f"{file}: cannot be read: {error.strerror or error}") from None
    except UnicodeDecodeError as error:
        raise InputError(f"{file}: is not UTF-8 text (byte {error.start})") from None
    return read_ode_model(text, file.name) if ending in _EQUATIONS else read_sbml(text, file.name, outputs, estimate)
