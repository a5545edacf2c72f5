"""How pages are made: templates, and what they set in type."""

from __future__ import annotations

import re

import jinja2
from markupsafe import Markup, escape


def environment() -> jinja2.Environment:
    """Return the environment of the page templates: everything is escaped, and nothing that is missing passes."""
    made = jinja2.Environment(
        loader=jinja2.PackageLoader("obsdesign.report", "."),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    made.filters["typeset"] = _typeset
    return made


def _typeset(text: str) -> Markup:
    """Escape a text and set λmin with its index below."""
    return Markup(re.sub("λmin", "λ<sub>min</sub>", str(escape(text))))
