"""Two studies on one page: what changed, and their pictures side by side."""

from __future__ import annotations

from dataclasses import replace

from obsdesign.report.comparison import Comparison, changes_table, numbers_table
from obsdesign.report.figures import error_histories, path_map, schedule_raster
from obsdesign.report.figures._drawing import Picture, with_prefix
from obsdesign.report.page import environment
from obsdesign.report.section import Section
from obsdesign.study.record import Study


def comparison_page(comparison: Comparison, studies: tuple[Study, Study], names: tuple[str, str]) -> str:
    """Return a page without any reference to the network; names: what the two are called."""
    changed = (
        f"{len(comparison.changes)} keys of the question differ" if len(comparison.changes) != 1 else "One key of the question differs"
    )
    gains = [pair.what for pair in comparison.numbers if pair.is_gain]
    losses = [pair.what for pair in comparison.numbers if pair.is_gain is False]
    answer = f"{changed}. Of the numbers of the answer {len(gains)} are better in {names[1]}, and {len(losses)} worse."
    parts = (
        Section("question", "What changed in the question?", "", (), (changes_table(comparison, names),)),
        Section("numbers", "What came out?", "", (), (numbers_table(comparison, names),), comparison.notes),
        Section("pictures", "How do they look?", f"First {names[0]}, then {names[1]}.", _pictures(studies, names), ()),
    )
    title, question = " and ".join(names), "Two results of obsdesign beside each other."
    return environment().get_template("base.html.j2").render(title=title, question=question, answer=answer, headline=(), parts=parts)


def _pictures(studies: tuple[Study, Study], names: tuple[str, str]) -> tuple[Picture, ...]:
    """The map, the schedule and the errors of each, in pairs."""
    pictures = []
    for draw in (path_map.picture, schedule_raster.picture, error_histories.picture):
        for prefix, study, name in zip("ab", studies, names, strict=True):
            picture = draw(study) if study.checks or draw is not error_histories.picture else None
            if picture is not None:
                pictures.append(with_prefix(replace(picture, caption=f"{name}. {picture.caption}"), prefix))
    return tuple(pictures)
