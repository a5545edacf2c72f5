"""Files that are broken, hostile or half written: one error that names them, nothing run, nothing written, nothing half there."""

from __future__ import annotations

import io
import re
import signal
import sqlite3
import subprocess
import sys
import threading
import time
import zipfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import obsdesign as od
from benchmarks.fuzz import cases, mutants, sample_track, tallies, tally
from obsdesign.exchange.formats import FORMATS, format_of, read_track, write_track
from obsdesign.exchange.track import Track
from obsdesign.files import write_files

CASES = cases()


@pytest.mark.parametrize("name", CASES)
def test_a_broken_file_is_read_or_refused_and_nothing_else(name):
    read, place, content = CASES[name]
    counts = tally(read, place, mutants(content, 150, seed=7))
    assert counts.inputs == 150 and counts.refused > 0
    assert (counts.faults, counts.hangs, counts.written) == ((), 0, 0)


@pytest.mark.slow
def test_a_hundred_thousand_broken_files_leave_no_traceback():
    counts = tallies(100_000, seed=11)
    assert sum(each.inputs for each in counts.values()) >= 100_000
    assert {name: (each.faults, each.hangs, each.written) for name, each in counts.items()} == dict.fromkeys(counts, ((), 0, 0))


@settings(max_examples=30, deadline=None)
@given(data=st.binary(max_size=300), word=st.sampled_from(sorted(FORMATS)))
def test_any_bytes_are_refused_by_name(data, word, tmp_path_factory):
    file = tmp_path_factory.mktemp("any") / "odd"
    file.write_bytes(data)
    with pytest.raises(od.InputError, match="odd"):
        read_track(file, word)


@settings(max_examples=25, deadline=None)
@given(
    points=st.lists(st.tuples(st.floats(-4e4, 4e4), st.floats(-4e4, 4e4), st.floats(-100, 5000)), min_size=2, max_size=8),
    word=st.sampled_from(sorted(FORMATS)),
)
def test_any_path_comes_back(points, word, tmp_path_factory):
    position = np.array(points)
    if word in ("plan", "wpl"):  # a mission has no two way points at one place
        position = position[np.append(True, np.abs(np.diff(position, axis=0)).max(axis=1) > 0.01)]
    if len(position) < 2:
        return
    track = Track(np.arange(len(position)) * 1.5, position, origin=sample_track().origin)
    again = read_track(write_track(track, word, tmp_path_factory.mktemp("any") / f"x{format_of(word).suffix}", "ardupilot")[0])
    np.testing.assert_allclose(again.position, position, atol=max(format_of(word).precision.position, 1e-9))


# ---------------------------------------------------------------- what a hostile file would do


@pytest.mark.parametrize("word", ["kml", "gpx"])
def test_document_types_and_entities_are_refused(word, tmp_path):
    entities = "".join(f'<!ENTITY l{i + 1} "{f"&l{i};" * 10}">' for i in range(40))
    for declared in (
        '<!DOCTYPE a [<!ENTITY b "c">]>',
        '<!DOCTYPE a SYSTEM "file:///nowhere">',
        f"<!DOCTYPE a [<!ENTITY l0 'x'>{entities}]>",
    ):
        for before, encoding in (("", "utf-8"), (f"<!-- {'long ' * 10_000}-->", "utf-8"), ("", "utf-16")):
            (tmp_path / "odd").write_text(f"<?xml version='1.0' encoding='{encoding}'?>{before}{declared}<a>&l40;</a>", encoding)
            with pytest.raises(od.InputError, match="declares a document type or entities: must be plain XML"):
                read_track(tmp_path / "odd", word)
    (tmp_path / "odd").write_text("<a/><!DOCTYPE a [<!ENTITY b 'c'>]><a>&b;</a>")  # it may stand before the first element only
    with pytest.raises(od.InputError, match="is no XML"):
        read_track(tmp_path / "odd", word)


@pytest.mark.parametrize("word", ["kml", "tum"])
def test_rows_of_different_length_are_told(word, tmp_path):
    file = write_track(sample_track(), word, tmp_path / f"x{format_of(word).suffix}")[0]
    text = file.read_text()
    second = re.findall(r"<gx:coord>.*</gx:coord>" if word == "kml" else r"(?m)^\d.*$", text)[1]
    file.write_text(text.replace(second, re.sub(r" \S+?(?=$|<)", "", second)))
    with pytest.raises(od.InputError, match=r"(row|gx:coord) 2 has \d numbers, (row|gx:coord) 1 has \d"):
        read_track(file)


def test_archives_of_pickles_or_of_more_than_they_hold_are_refused(tmp_path):
    np.savez(tmp_path / "pickled.npz", t=np.array([None, 1], dtype=object), position=np.zeros((2, 3)))
    head = io.BytesIO()
    np.lib.format.write_array_header_1_0(head, {"descr": "<f8", "fortran_order": False, "shape": (10**13,)})
    with zipfile.ZipFile(tmp_path / "long.npz", "w") as archive:
        archive.writestr("t.npy", head.getvalue())
    with zipfile.ZipFile(tmp_path / "packed.npz", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("t.npy", bytes(1000))
        archive.infolist()[0].file_size = 2**40  # what its directory says
    for name in ("pickled", "long", "packed"):
        start = time.process_time()
        with pytest.raises(od.InputError, match=name):
            read_track(tmp_path / f"{name}.npz")
        assert time.process_time() - start < 1


def test_a_bag_with_views_or_a_question_without_end_is_refused(tmp_path):
    folder = write_track(sample_track(), "bag", tmp_path / "x_bag")[0]
    (file,) = folder.glob("*.db3")
    with sqlite3.connect(file) as database:
        database.execute("CREATE VIEW endless AS WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i FROM n) SELECT i FROM n")
    with pytest.raises(od.InputError, match="endless is no plain table"):
        read_track(folder)


# ---------------------------------------------------------------- writing


def test_a_target_that_cannot_be_written_is_one_message_and_leaves_what_was(tmp_path):
    (tmp_path / "file").write_text("mine")
    with pytest.raises(od.InputError, match="cannot be written"):
        write_track(sample_track(), "kml", tmp_path / "file" / "x.kml")
    assert [each.name for each in tmp_path.iterdir()] == ["file"] and (tmp_path / "file").read_text() == "mine"


@pytest.mark.parametrize("word", FORMATS)
def test_a_folder_of_something_else_is_left_as_it_is(word, tmp_path):
    """Such as the result that is exported, given as --out by mistake: its files would be gone."""
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "result.json").write_text("{}")
    with pytest.raises(od.InputError, match=r"mine: is a folder that holds result\.json: it is left as it is"):
        write_track(sample_track(), word, tmp_path / "mine")
    assert [file.name for file in tmp_path.rglob("*")] == ["mine", "result.json"]


def test_a_mission_and_its_table_are_written_both_or_neither(tmp_path):
    (tmp_path / "x.plan.sensors.csv").mkdir()
    with pytest.raises(od.InputError, match=r"x\.plan\.sensors\.csv: is a folder"):
        write_track(sample_track(), "plan", tmp_path / "x.plan")
    assert [file.name for file in tmp_path.iterdir()] == ["x.plan.sensors.csv"]


@pytest.mark.parametrize("word", FORMATS)
def test_writing_again_replaces_the_whole(word, tmp_path):
    target = tmp_path / f"x{format_of(word).suffix}"
    for points in (30, 12):
        write_track(sample_track(points), word, target)
    assert len(read_track(target).t) == 12
    assert not list(tmp_path.glob(".partial-*"))


def test_a_process_that_is_killed_leaves_no_half_file(tmp_path):
    """Killed at many moments: the target is the old file or the new one."""
    code = (
        "from benchmarks.fuzz import sample_track\nfrom obsdesign.exchange.formats import write_track\nfrom pathlib import Path\n"
        "a, b = sample_track(3000), sample_track(5000)\nprint('ready', flush=True)\n"
        "while True:\n for each in (a, b):\n  write_track(each, 'tum', Path('x.tum'))\n"
    )
    for delay in (0.02, 0.11, 0.23):
        with subprocess.Popen([sys.executable, "-c", code], cwd=tmp_path, stdout=subprocess.PIPE, text=True) as process:
            assert process.stdout is not None and process.stdout.readline() == "ready\n"
            time.sleep(delay)
            process.send_signal(signal.SIGKILL)
        if (tmp_path / "x.tum").exists():
            assert len(read_track(tmp_path / "x.tum").t) in (3000, 5000)


FULL = """
import resource, sys
from pathlib import Path
import obsdesign as od
from benchmarks.fuzz import sample_track
from obsdesign.exchange.formats import FORMATS, format_of, write_track
track = sample_track(2000)
write_track(sample_track(), "bag", Path("warm_bag"))
resource.setrlimit(resource.RLIMIT_FSIZE, (6000, 6000))
for word in FORMATS:
    try:
        write_track(track, word, Path(f"x{format_of(word).suffix}"))
    except od.InputError as error:
        print(word, "cannot be written" in str(error))
"""


def test_a_disk_that_is_full_is_one_message_and_nothing_is_left(tmp_path):
    """No file may grow beyond 6 kB: what a full disk does to whoever writes."""
    done = subprocess.run([sys.executable, "-c", FULL], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert (done.stderr, done.stdout.split()) == ("", [part for word in FORMATS for part in (word, "True")])
    assert [file.name for file in tmp_path.iterdir()] == ["warm_bag"]


def test_two_that_write_into_one_folder_leave_whole_files(tmp_path):
    """Whoever is last, each file is of one of them."""

    def write(letter: str) -> None:
        for _ in range(20):
            write_files(tmp_path, dict.fromkeys(("a.json", "b.json"), letter * 50000))

    threads = [threading.Thread(target=write, args=(letter,)) for letter in "xy"]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert sorted(file.name for file in tmp_path.iterdir()) == ["a.json", "b.json"]
    for file in tmp_path.iterdir():
        assert file.read_text() in ("x" * 50_000, "y" * 50_000)


def test_files_that_are_too_large_are_refused_before_they_are_read(tmp_path):
    file: Path = tmp_path / "large.kml"
    with file.open("wb") as sparse:
        sparse.truncate(2**30)
    with pytest.raises(od.InputError, match="must be at most"):
        read_track(file)
