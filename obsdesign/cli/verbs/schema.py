"""`obsdesign schema`: the JSON Schemas of what obsdesign reads and writes."""

from __future__ import annotations

from argparse import Namespace

from obsdesign.cli.verb import Argument, Outcome, Verb


def schema(options: Namespace) -> Outcome:
    """Return the JSON Schema of scenarios, of result.json, analysis.json or replay.json."""
    import json

    if options.document == "scenario":
        from obsdesign.scenario.schema import Scenario as Document
    elif options.document == "replay":
        from obsdesign.report.replay_document import ReplayDocument as Document
    elif options.document == "analysis":
        from obsdesign.report.analysis_document import AnalysisDocument as Document
    else:
        from obsdesign.report.document import Result as Document
    document = Document.model_json_schema()
    return Outcome(document, (json.dumps(document, indent=1),))


VERB = Verb(
    name="schema",
    what="print the JSON Schema of scenarios, of result.json, analysis.json or replay.json",
    action=schema,
    example="schema result > result.schema.json",
    arguments=(Argument("document", "of what", choices=("scenario", "result", "analysis", "replay")),),
)
