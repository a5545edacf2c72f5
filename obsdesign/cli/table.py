"""The table of verbs: help, completion, documentation and exit codes follow from it. A verb joins by one row."""

from __future__ import annotations

from obsdesign.cli.verb import Verb
from obsdesign.cli.verbs import (
    analyse,
    check,
    compare,
    design,
    doctor,
    export,
    import_model,
    init,
    log,
    replay,
    report,
    run,
    schema,
    select,
    sweep,
    validate,
)

VERBS: tuple[Verb, ...] = (
    init.VERB,
    check.VERB,
    schema.VERB,
    analyse.VERB,
    run.VERB,
    design.VERB,
    select.VERB,
    validate.VERB,
    log.VERB,
    replay.VERB,
    sweep.VERB,
    compare.VERB,
    export.VERB,
    import_model.VERB,
    report.VERB,
    doctor.VERB,
)
