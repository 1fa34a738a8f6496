"""Views of a row's residual for the page: against a state, and in frequency."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from lacet.daq.errors import nearest
from lacet.daq.formats.result import plain
from lacet.identify.car.rows import Row
from lacet.identify.progress import silent
from lacet.identify.regression.wls import Fit
from lacet.identify.validation.failure_analysis import FailureAnalysis
from lacet.identify.validation.residual_map import Against, against_states
from lacet.identify.validation.restoring_force import LEAST_SAMPLES
from lacet.identify.validation.spectra import row_spectrum
from lacet.identify.validation.states import ClearStates
from lacet.services.render.rows import CORNER_WORDS
from lacet.services.render.units import TRAVEL, TRAVEL_RATE, display_unit
from lacet.services.workbench.refusals import NotThere
from lacet.services.workbench.session_cache import WAIT, SessionCache


def where_payload(cache: SessionCache, version: int) -> dict[str, Any]:
    """The failure analysis as ``lacet where --json`` has it, with labels and display units where the page draws it."""
    _, found = cache.found_where(version)
    return {
        **found,
        "against": {
            row: {name: {**one, "shown": _shown(Row.parse(row), one["unit"], one["state"])} for name, one in of.items()}
            for row, of in found["against"].items()
        },
        "surfaces": {
            corner: {**one, "shown": _shown_surface(corner, one["travel"], one["rate"])}
            for corner, one in found["surfaces"].items()
        },
        "least_samples": LEAST_SAMPLES,
    }


def _shown(row: Row, unit: str, values: Sequence[float]) -> dict[str, Any]:
    """Values of a state in display units, and the unit of the row's residual."""
    factor, text = display_unit(unit, max(map(abs, values)))
    return {"state": [factor * value for value in values], "unit": text, "row_unit": row.unit}


def _shown_surface(corner: str, travel: Sequence[float], rate: Sequence[float]) -> dict[str, Any]:
    """Name of a corner, and the edges of its surface in display units."""
    return {
        "label": CORNER_WORDS[corner], "unit": Row.parse(f"suspension.{corner}").unit,
        "travel": [TRAVEL[0] * edge for edge in travel], "travel_unit": TRAVEL[1],
        "rate": [TRAVEL_RATE[0] * edge for edge in rate], "rate_unit": TRAVEL_RATE[1],
    }  # fmt: skip


def against_payload(cache: SessionCache, version: int, text: str, state: str) -> dict[str, Any]:
    """A row's residual against a state; for states with little noise the part absorbed by the model is added again."""
    found, _ = cache.found_where(version)
    row = _row(found, text)
    ready = found.against.get(row, {}).get(state)
    if ready is None:
        with cache.computing(WAIT):
            fitted = _fitted(cache, version)
            every = against_states(fitted.runs, fitted.residual, row, None)
            if state not in every:
                raise NotThere(f"row {row} has no state '{state}'{nearest(state, every)}: {', '.join(every)}")
            ready = against_states(fitted.runs, fitted.residual, row, [state], ClearStates(fitted.runs))[state]
    return plain(_against(ready) | {"shown": _shown(row, ready.mean.unit, ready.mean.centre.tolist())})


def _fitted(cache: SessionCache, number: int) -> Fit:
    """The fit of a version; to be called while `computing`."""
    study, version = cache.version(number)
    return cache.session(study, silent).values.fitted(version)


def _row(found: FailureAnalysis, text: str) -> Row:
    """A row of the analysed fit by its text. Raises NotThere with the nearest match."""
    if text not in found.rows:
        raise NotThere(f"no row {text}{nearest(text, found.rows)}")
    return Row.parse(text)


def _against(a: Against) -> dict[str, Any]:
    return {
        "row": a.row, "name": a.mean.state, "unit": a.mean.unit, "row_unit": a.row_unit, "state": a.mean.centre,
        "mean": a.mean.mean, "low": a.mean.low, "high": a.mean.high, "count": a.mean.count, "put_back": a.put_back,
    }  # fmt: skip


def spectrum_payload(cache: SessionCache, version: int, text: str) -> dict[str, Any]:
    """Spectrum of a row's residual beside its floor's, and its coherence with the states; or `why` there is none."""
    found, _ = cache.found_where(version)
    row = _row(found, text)
    ready = found.spectra.get(row)
    if ready is None:
        with cache.computing(WAIT):
            study, number = cache.version(version)
            session = cache.session(study, silent)
            ready = row_spectrum(session.values.fitted(number), session.values.floor(number), row)
        if ready is None:
            return {"row": str(row), "why": "No spectrum: no run has three stretches of four seconds without a hole."}
    return plain(
        {
            "row": row, "why": "", "unit": ready.unit, "density_unit": f"({ready.unit})²/Hz",
            "frequency": ready.frequency, "residual": ready.residual, "floor": ready.floor, "high": ready.high,
            "level": ready.level,
            "coherence": {name: ready.coherence[name] for name in ready.explained}, "explained": ready.explained,
            "together": {"of": ready.together_of, "squared": ready.together, "level": ready.together_level},
            "segments": ready.segments,
        }
    )  # fmt: skip
