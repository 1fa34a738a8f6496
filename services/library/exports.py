"""Exports of fitted models and runs to the formats of other programs."""

from __future__ import annotations

from pathlib import Path

from lacet.daq.errors import UsageError
from lacet.daq.formats.mf4_write import write_mf4
from lacet.daq.run import Run
from lacet.identify.validation.noise_floor import SCORE_DRAWS
from lacet.identify.validation.score import compare
from lacet.services.exports.files import Form, Identified, Written, export_car, form_of, replacing
from lacet.services.library.fits import Fit
from lacet.services.library.rankings import Ranking
from lacet.services.one_thread import one_thread
from lacet.services.workspace.results import diagnosis_result, fit_result


def export(
    what: Fit | Run, path: str | Path, *, form: str | None = None, ranking: Ranking | None = None, force: bool = False
) -> Written:
    """Write a fitted car, its results, or a run in the format of another program.

    Parameters
    ----------
    what : a fitted model, or a run.
    path : file to write; its suffix says the form: ``.toml`` vehicle file, ``.xml`` MJCF, ``.urdf``, ``.yaml``
        CommonRoad, ``.mat``, ``.json``, ``.csv`` and ``.parquet`` of a fit, ``.mf4`` of a run.
    form : where the suffix says too little: ``errors`` or ``ranking`` of a table.
    ranking : ranking to export with the results of the fit.
    force : replace a file that exists.

    Returns
    -------
    Written
        What was written, and what the form could not hold.

    Raises
    ------
    LacetError
        The form does not fit, the file exists, or the runs do not determine what the form needs.

    Examples
    --------
    >>> written = lacet.export(fitted, "values.csv")
    >>> written.form.word, written.says.partition(":")[2][:30]
    ('values', ' kind, name, effect, value, un')
    """
    file = Path(path)
    chosen = form_of(file, form, of_run=isinstance(what, Run))
    if isinstance(what, Run):
        if chosen is Form.ROWS:
            raise UsageError(f"{file}: one message a sample is made of a log: lacet export LOG -o {file}")
        with replacing(file, force) as part:
            write_mf4(what, part)
        return Written(file, chosen, f"{len(what.signals)} channels", {})
    details, loaded = what.details, what.runs.loaded
    with one_thread():
        scored = chosen in (Form.ERRORS, Form.RESULTS, Form.MATLAB)
        used = [compare(details, run, SCORE_DRAWS) for run in details.runs] if scored else []
        result = fit_result(details, loaded, used, knowledge=what.knowledge)
        title = f"{loaded.vehicle.name}, identified by lacet from {', '.join(what.runs.names)}"
        diagnosis = None if ranking is None else diagnosis_result(ranking.details)
        return export_car(Identified(loaded.vehicle, result, lambda: details, diagnosis, title), file, chosen, force)
