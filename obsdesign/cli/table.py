"""The table of verbs: help, completion, documentation and exit codes follow from it. A verb joins by one row."""

from __future__ import annotations

from obsdesign.cli.verb import Verb
from obsdesign.cli.verbs import check, compare, export, init, log, report, run, schema, select

VERBS: tuple[Verb, ...] = (
    init.VERB,
    check.VERB,
    schema.VERB,
    run.VERB,
    select.VERB,
    log.VERB,
    compare.VERB,
    export.VERB,
    report.VERB,
)
