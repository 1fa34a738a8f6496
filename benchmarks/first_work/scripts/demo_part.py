"""`lacet demo` after its live part, in either commit: python demo_part.py LOGS OUT DRAWS, or nothing but the imports.

What replay, recorder and worker would bring, and what is decoded meanwhile, are the logs in LOGS.
"""

from __future__ import annotations

import argparse
import importlib
import os
import shutil
import sys
from pathlib import Path
from typing import Any

HERE = "lacet.services" if Path(os.environ["PYTHONPATH"], "lacet").is_dir() else "services"
demo: Any = importlib.import_module(f"{HERE}.commands.demo")


def main() -> None:
    """Run the part."""
    if len(sys.argv) < 2:
        return
    import scipy.linalg  # noqa: F401  (its threads are limited too, whichever commit is measured)
    from threadpoolctl import threadpool_limits

    logs = {file.stem: file for file in Path(sys.argv[1]).glob("*.mcap")}

    def brought(capture: Path, out: Path, others: list[Path]) -> int:
        for file in (capture, *others):
            shutil.copy(logs[file.stem], out / file.name)
        return 0

    demo._over_the_wires = brought
    for name in ("_tell_worker", "_report_of_worker"):
        if hasattr(demo, name):
            setattr(demo, name, lambda out: None)
    parser = argparse.ArgumentParser()
    demo.add_arguments(parser)
    parser.add_argument("--json")
    with threadpool_limits(1):  # as the command line does
        demo.run(parser.parse_args(["--out", sys.argv[2], "--draws", sys.argv[3]]))


main()
