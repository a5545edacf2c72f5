"""`python -m benchmarks.run [name ...]`: run all benchmarks, or those named, and write their tables."""

from __future__ import annotations

import sys
from importlib import import_module

NAMES = (
    "verdicts",
    "random_systems",
    "information",
    "design",
    "design_speed",
    "path_bounds",
    "joint_bounds",
    "selection",
    "filter_schedules",
    "filters",
    "logs",
    "files",
    "startup",
    "fuzz",
    "guided_fuzz",
)


def main(names: list[str]) -> None:
    """Run the benchmarks."""
    for name in names or NAMES:
        if name not in NAMES:
            raise SystemExit(f"no benchmark {name!r} (accepted: {', '.join(NAMES)})")
        import_module(f"benchmarks.{name}").main()


if __name__ == "__main__":
    main(sys.argv[1:])
