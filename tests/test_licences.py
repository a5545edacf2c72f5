"""docs/licences.md names every package that an install brings."""

from __future__ import annotations

import importlib.util
import re

from conftest import ROOT


def test_every_package_that_an_install_brings_has_its_licence_told():
    spec = importlib.util.spec_from_file_location("licences", ROOT / "docs" / "licences.py")
    script = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(script)
    told = dict(re.findall(r"^\| (\S+) \| (.+) \|$", (ROOT / "docs" / "licences.md").read_text(), flags=re.MULTILINE))
    assert [name for name in script.closure(script.declared(script.EXTRAS)) if name not in told and script.is_installed(name)] == []
    assert {"numpy", "casadi", "clarabel", "cvxpy", "rosbags"} <= told.keys()
    assert [name for name, licence in told.items() if licence == "not said"] == []
