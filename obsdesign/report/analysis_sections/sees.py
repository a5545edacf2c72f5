"""What does each suite of sensors see?"""

from __future__ import annotations

from obsdesign.report.analysis_figures import dimension_map, rank_growth
from obsdesign.report.number_format import join
from obsdesign.report.section import Section
from obsdesign.report.sections.observability import decision_note, subsets_table
from obsdesign.study.analysis_study import AnalysisStudy, case_name, cases_apart, suite_name


def section(study: AnalysisStudy) -> Section:
    """Return the table of all cases, and its picture."""
    cases = cases_apart(study)
    pictures = tuple(filter(None, (dimension_map.picture(cases), rank_growth.picture(study))))
    return Section(
        "sees", "What does each suite of sensors see?", answer(study), pictures, (subsets_table(cases),), (decision_note(cases),)
    )


def answer(study: AnalysisStudy) -> str:
    """Say in which cases all sensors together see everything, and which smaller suites do so in every case."""
    n = len(study.scenario.state_names)
    whole = study.of_all_sensors
    good = [case_name(study, analysis) for analysis in whole if analysis.verdict.observable]
    who, see = _who(study)
    if len(whole) == 1:
        verdict = whole[0].verdict
        sees = f"all {n} states" if verdict.observable else f"{verdict.dimension} of {n} dimensions: {verdict.hidden}"
        return f"{who} {see} {sees}.{_smaller(study)}"
    said = (
        f"in {len(good)} of {len(whole)} cases ({join(good)})" if 0 < len(good) < len(whole) else "in every case" if good else "in no case"
    )
    return f"{who} {see} all {n} states {said}.{_smaller(study)}"


def _who(study: AnalysisStudy) -> tuple[str, str]:
    """Whom the answer is about, and the verb: all sensors, or the largest suites that were asked about."""
    suites = list(dict.fromkeys(analysis.sensors for analysis in study.of_all_sensors))
    if len(suites) > 1:
        return "The largest suites", "see"
    name = suite_name(study, suites[0])
    is_named_by_sensors = name == " + ".join(suites[0])
    return name if is_named_by_sensors else name.capitalize(), "sees" if len(suites[0]) == 1 else "see"


def _smaller(study: AnalysisStudy) -> str:
    """The smallest suites that see everything in every case in which all sensors do."""
    possible = {case_name(study, analysis) for analysis in study.of_all_sensors if analysis.verdict.observable}
    suites = [
        suite
        for suite in dict.fromkeys(analysis.sensors for analysis in study.analyses)
        if possible
        <= {case_name(study, analysis) for analysis in study.analyses if analysis.sensors == suite and analysis.verdict.observable}
    ]
    if not possible or not suites:
        return ""
    fewest = min(map(len, suites))
    if fewest == len(study.scenario.sensor_names):
        return " None of them can be spared." if fewest > 1 else ""
    if {suite for suite in suites if len(suite) == fewest} == {analysis.sensors for analysis in study.of_all_sensors}:
        return ""
    return f" So {_do(fewest)} {join([' + '.join(suite) for suite in suites if len(suite) == fewest], 'or')} alone."


def _do(fewest: int) -> str:
    return "does" if fewest == 1 else "do"
