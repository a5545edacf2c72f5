"""A function of CasADi as machine code: generated C, compiled once, kept in the user's cache folder."""

from __future__ import annotations

import ctypes
import hashlib
import os
import platform
import shutil
import subprocess
import sys
import tempfile
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, Literal

import casadi as ca
import platformdirs

FLAGS = ("-shared", "-fPIC", "-ffp-contract=off")  # no fused multiply-add: the virtual machine has none, the numbers are the same
ENVIRONMENT_VARIABLE = "OBSDESIGN_COMPILE"
LONG_SOURCE, MAX_OPERATIONS = 3_000, 30_000  # operations: from the first on compilers optimise less, beyond the second they take too long
_MAX_FILES = 400  # files in the cache folder; the longest unused go first
_TIMEOUT = 120.0  # seconds a compiler may take

CompilePolicy = Literal["never", "when worth it", "at once"]


def compile_policy() -> CompilePolicy:
    """Return what the environment asks for: OBSDESIGN_COMPILE=0 never, 1 at once, else when a function has run long enough."""
    value = os.environ.get(ENVIRONMENT_VARIABLE, "")
    return "never" if value == "0" else "at once" if value == "1" else "when worth it"


@dataclass(frozen=True)
class NativeFunction:
    """Machine code, or the reason why there is none."""

    entry: Any  # a C function, or None
    reason: str


@dataclass(frozen=True)
class Compiler:
    """The C compiler on this machine: path and version, or the reason why there is none."""

    path: str
    version: str
    reason: str = ""


@cache
def compiler() -> Compiler:
    """Return $CC, cc, gcc or clang, whichever is found first."""
    requested = os.environ.get("CC")
    names = (requested,) if requested else ("cc", "gcc", "clang")
    executable = next((path for path in map(shutil.which, names) if path), None)
    if executable is None:
        return Compiler("", "", f"no C compiler ({', '.join(names)}) is on the path")
    try:
        version = subprocess.run(
            [executable, "--version"], capture_output=True, text=True, errors="replace", timeout=_TIMEOUT, check=True
        ).stdout
    except (OSError, subprocess.SubprocessError) as error:
        return Compiler("", "", f"{executable} does not run: {error}")
    return Compiler(executable, version)


@cache
def processor() -> str:
    """Return the model of this machine's processor: code made for one need not run on another."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace").splitlines()
        name = next((line.partition(":")[2].strip() for line in lines if line.startswith("model name")), "")
    except OSError:
        name = ""
    return f"{sys.platform} {platform.machine()} {name or platform.processor()}"


def cache_folder() -> Path:
    """Return where compiled functions are kept."""
    return platformdirs.user_cache_path("obsdesign") / "compiled"


def source_of(function: ca.Function, driver: str) -> str:
    """Return C code for a function and for a driver that calls it."""
    generator = ca.CodeGenerator(function.name(), {"with_header": False})
    generator.add(function)
    return f"{generator.dump()}\n{driver}\n"


def entry_of(source: str, name: str) -> Any:  # noqa: ANN401  # a C function, or None
    """Return a function of a text of C that stands beside a module; None without a compiler, or where none is wanted."""
    return None if compile_policy() == "never" else _native_text(source, name).entry


@cache
def _native_text(source: str, name: str) -> NativeFunction:
    return load(source, name, 0) or NativeFunction(None, "")


def load(source: str, entry: str, operations: int, *, only_cached: bool = False) -> NativeFunction | None:
    """Return the entry of a source as machine code, from the cache folder or newly compiled; None if only_cached and not there.

    operations: how long the source is. Never raises: what went wrong is the reason. Two processes may do this at once: each
    writes a file of its own and renames it.
    """
    c_compiler = compiler()
    if not c_compiler.path:
        return NativeFunction(None, c_compiler.reason)
    if operations > MAX_OPERATIONS:
        return NativeFunction(None, f"{operations} operations are too many for a compiler (at most {MAX_OPERATIONS})")
    flags = ("-O2" if operations < LONG_SOURCE else "-O1", *FLAGS)
    key = "\n".join([source, processor(), c_compiler.path, c_compiler.version, *flags])
    target = cache_folder() / f"{hashlib.sha256(key.encode()).hexdigest()}.so"
    try:
        if target.exists():
            return _open_library(target, entry)
        if only_cached:
            return None
        target.parent.mkdir(parents=True, exist_ok=True)
        _compile([c_compiler.path, *flags], source, target)
        _evict_unused(target.parent)
        return _open_library(target, entry)
    except (OSError, AttributeError, subprocess.SubprocessError) as error:
        return NativeFunction(None, _failure_text(error))


def _open_library(target: Path, entry: str) -> NativeFunction:
    """Open a compiled file; one that does not open is thrown away, for the next to make it anew."""
    try:
        function = getattr(ctypes.CDLL(str(target)), entry)
        function.argtypes = [ctypes.c_longlong] * 2 + [ctypes.c_void_p] * 5
    except (OSError, AttributeError):
        target.unlink(missing_ok=True)
        raise
    os.utime(target)
    return NativeFunction(function, "")


def _compile(command: list[str], source: str, target: Path) -> None:
    with tempfile.TemporaryDirectory(dir=target.parent) as scratch:
        code, library = Path(scratch) / "step.c", Path(scratch) / "step.so"
        code.write_text(source, encoding="utf-8")
        subprocess.run(
            [*command, str(code), "-o", str(library), "-lm"], capture_output=True, text=True, errors="replace", timeout=_TIMEOUT, check=True
        )
        library.replace(target)


def _evict_unused(folder: Path) -> None:
    with suppress(OSError):  # another process may do the same
        files = sorted(folder.glob("*.so"), key=lambda file: file.stat().st_mtime)
        for file in files[:-_MAX_FILES]:
            file.unlink(missing_ok=True)


def _failure_text(error: Exception) -> str:
    message = getattr(error, "stderr", None) or str(error)
    return f"compiling failed: {message.strip().splitlines()[0] if message.strip() else type(error).__name__}"
