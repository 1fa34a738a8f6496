"""Write the catalogue's page and its pictures: ``python -m benchmarks.catalogue_page --help``."""

from __future__ import annotations

import argparse
import json
import sys
import time
from fnmatch import fnmatch

from benchmarks.catalogue_page.cases import CASES
from benchmarks.catalogue_page.page import PAGE, PICTURED, PICTURES, page, pictured
from lacet.daq.errors import LacetError
from lacet.identify.effects.catalogue import effect_classes
from lacet.services.one_thread import one_thread

DESCRIPTION = """Write docs/catalogue.md from the catalogue, and draw the pictures it lacks.

  python -m benchmarks.catalogue_page                       the text, and pictures that are missing or out of date
  python -m benchmarks.catalogue_page --text                the text alone, in a second
  python -m benchmarks.catalogue_page --again 'coulomb*'    draw some anew; what was simulated is kept in build/
"""


def main() -> int:
    """Command line."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.catalogue_page",
        description=DESCRIPTION,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--text", action="store_true", help="only the text")
    parser.add_argument("--again", action="append", default=[], metavar="PATTERN", help="draw these families anew")
    args = parser.parse_args()
    complete = True
    if not args.text:
        complete = _pictures(args.again)
    PAGE.write_text(page(), encoding="utf-8")
    print(f"wrote {PAGE}")
    return 0 if complete else 1


def _pictures(again: list[str]) -> bool:
    """Draw what is missing or out of date; whether all could be."""
    from benchmarks.catalogue_page.drawing import draw
    from benchmarks.catalogue_page.residuals import signature

    families = [name for name in effect_classes() if name in CASES and CASES[name].how != "none"]
    missing = [
        name
        for name in families
        if not (PICTURES / f"{name}.png").is_file()
        or pictured().get(name, {}).get("case") != CASES[name].digest
        or any(fnmatch(name, p) for p in again)
    ]
    failed = False
    with one_thread():
        for number, family in enumerate(missing, 1):
            begin = time.process_time()
            try:
                one = signature(family)
            except LacetError as cause:
                failed = True
                print(f"{number}/{len(missing)} {family}: {cause}", flush=True)
                continue
            draw(one, CASES[family].loop, PICTURES / f"{family}.png")
            facts = {
                "case": CASES[family].digest,
                "row": one.row,
                "ratio": float(f"{one.ratio:.2g}"),
                "state": one.state,
            }
            said = {**pictured(), family: facts}
            PICTURED.write_text(json.dumps(said, indent=1, sort_keys=True, ensure_ascii=False) + "\n", encoding="utf-8")
            spent = time.process_time() - begin
            print(f"{number}/{len(missing)} {family}: {one.row} {one.ratio:.1f} × floor ({spent:.0f} s)", flush=True)
    return not failed


if __name__ == "__main__":
    sys.exit(main())
