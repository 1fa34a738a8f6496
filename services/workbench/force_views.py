"""Wheel forces of runs held out as a picture for the page, estimated without their dynamometers."""

from __future__ import annotations

from lacet.identify.progress import silent
from lacet.services.workbench.refusals import NotThere
from lacet.services.workbench.session_cache import WAIT, SessionCache


def forces_png(cache: SessionCache, number: int, run: str) -> bytes:
    """Wheel forces of a run held out with their bands, beside what its dynamometers measured, as PNG.

    Raises NotThere for a run that is not held out, has no dynamometers, or whose rows do not give its forces.
    """
    # Only here: matplotlib takes half a second to load.
    from lacet.services.render.figures.force_plots import forces_picture

    cache.compared(number)
    with cache.computing(WAIT):
        study, version = cache.version(number)
        found = cache.session(study, silent).values.forces(version)
    part = next((one for one in found if one.estimated.run == run), None)
    if part is None:
        raise NotThere(
            f"run {run} of version {number}: no wheel forces to compare; it must be held out and have its own"
        )
    return forces_picture(part.estimated, part.errors)
