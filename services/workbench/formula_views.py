"""Formulas in the measured states of a run, as arrays for the page."""

from __future__ import annotations

from lacet.identify.effects.language.formula import read_formula
from lacet.identify.progress import silent
from lacet.services.render.units import unit_text
from lacet.services.workbench.packed_arrays import packed
from lacet.services.workbench.refusals import NotThere
from lacet.services.workbench.session_cache import WAIT, SessionCache


def formula_body(cache: SessionCache, version: int, run: str, text: str) -> bytes:
    """A formula's values along a run of a version, at the instants of the rows.

    Raises UsageError for a fault in the formula, NotThere for a run that the version does not have.
    """
    formula = read_formula(text)
    study, _ = cache.version(version)
    with cache.computing(WAIT):
        session = cache.session(study, silent)
        drives = {drive.name: drive for held in (False, True) for drive in session.runs.prepared(held)}
        if run not in drives:
            raise NotThere(f"no run {run} in version {version}: {', '.join(drives)}")
        motion = drives[run].kept_motion
        arrays = {"t": motion.t, "values": formula.series(motion)}
    return packed(arrays, run=run, formula=formula.text, unit=unit_text(formula.unit))
